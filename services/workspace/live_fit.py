"""Live fit: the present model fitted to the run that is being recorded, again each second.

As long as a fit from scratch takes no longer than `QUICK`, each second has one: what ``lacet identify --to`` gives for
the same seconds. Later the sums of the last such fit go on (`RecursiveFit`), for which a second costs nearly the same
however long the run is; and a fit from scratch is made beside them when the run has grown by `GROWTH`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.formats.log_run import begin_ns, build_run
from lacet.daq.formats.wire import StartRecord
from lacet.daq.rig import Rig
from lacet.daq.run_limits import RunLimits
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.car.sources.completion import completed
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.recursive_fit import ChangedRunError, RecursiveFit
from lacet.identify.regression.seconds_needed import Enough, seconds_needed
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.for_equations import for_equations
from lacet.identify.signals.reconstruct import bring_together
from lacet.identify.validation.equation_scores import floor_by_row, row_scores
from lacet.identify.validation.parameter_estimates import Estimate, estimates
from lacet.identify.validation.score import RowScore
from lacet.services.acquisition.live_samples import LiveSamples
from lacet.services.workspace.loading import in_common, prepare_run

QUICK = 0.5
"""Longest time that a fit from scratch may take to be made each second [s]: the rest of the second is the machine's."""
GROWTH = 1.5
"""Factor by which a run has grown since the last fit from scratch when the next one is made beside the sums."""
MOVED = 1.0
"""Change of a value since the last fit from scratch, in its 95 % half intervals then, at which the next one is made
beside the sums before the run has grown by `GROWTH`: the residual is linearised at values that no longer hold."""
LEAST_GROWTH = 1.1
"""Factor by which the run must have grown for that."""
SILENT = 2.0
"""Time without a sample after which a channel is not waited for [s]."""

SETTLING = 1.5
"""Time before the first sample that is needed over which the channels' own filters settle [s]."""

ModelOf = Callable[[Vehicle, str], Model]
"""The model of a car with wheel loads at a reference, ``contact`` or ``hub``."""


@dataclass(frozen=True)
class LiveResult:
    """The fit of the run's first seconds.

    Attributes
    ----------
    seconds : of the run, from its start, whose samples were used [s].
    from_scratch : whether it is the fit of these seconds from scratch; otherwise the sums of one go on since `since`.
    since : seconds of the last fit from scratch [s].
    estimates, enough : of all parameters, in the model's order.
    scores : row → its score.
    took : processor time [s].
    """

    seconds: float
    from_scratch: bool
    since: float
    estimates: list[Estimate]
    enough: Enough
    scores: Mapping[Row, RowScore]
    took: float


@dataclass(frozen=True)
class _FromScratch:
    """A fit from scratch of the first `seconds`, with the noise floor of its rows.

    `begin_ns` : where the run's time begins [ns]; `channels` : those it was fitted to; `took` : processor time [s].
    """

    seconds: float
    begin_ns: int
    channels: frozenset[str]
    fitted: Fit
    floor: Mapping[Row, float]
    took: float


class LiveFit:
    """The fit of one run while it is recorded.

    Parameters
    ----------
    start : the run's start record, with the texts of rig and vehicle.
    model_of : gives the model.
    target : half of the 95 % interval with the sensor sheet ÷ value that is enough.

    Raises LacetError when rig or vehicle cannot be read.
    """

    def __init__(self, start: StartRecord, model_of: ModelOf, target: float, filters: Filters | None = None):
        self._start, self._target, self._filters = start, target, filters or Filters()
        self._rig = Rig.parse(start.rig_text, "rig of the run")
        self._vehicle = Vehicle.parse(start.vehicle_text, "vehicle of the run")
        self._model_of = model_of
        self._base: _FromScratch | None = None
        self._going: RecursiveFit | None = None
        self._beside: Future[tuple[_FromScratch, RecursiveFit]] | None = None
        self._pool = ThreadPoolExecutor(1, "lacet-live-fit")

    def close(self) -> None:
        """End the thread, without its fit."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def wait(self) -> None:
        """Wait for the fit from scratch that is being made beside the sums, if any."""
        if self._beside is not None:
            self._beside.exception()

    def seconds_there(self, samples: LiveSamples) -> int:
        """Whole seconds of which every channel has its samples, but those that are silent [s]."""
        ends = [int(block.t_ns[-1]) for block in samples.blocks(samples.latest_ns - round(SILENT * 1e9)).values()]
        begin = self._base.begin_ns if self._base else self._start.started_ns
        return max(0, math.floor(1e-9 * (min(ends) - begin))) if ends else 0

    def update(self, samples: LiveSamples, seconds: int) -> LiveResult:
        """The fit of the first `seconds`. Raises LacetError where nothing can be fitted, as when they are too few."""
        begun = time.process_time()
        if self._beside is not None and self._beside.done():
            self._base, self._going = self._beside.result()
            self._beside = None
        base = self._base
        if base is None or base.took <= QUICK or base.fitted.model.faults:
            base = self._base = self._from_scratch(samples.blocks(), seconds)
            self._going = None
            return self._result(base.fitted, base, seconds, time.process_time() - begun)
        try:
            self._going = self._going or RecursiveFit(base.fitted)
            fitted = self._go_on(self._going, base, samples, seconds)
        except ChangedRunError:
            self._base = None
            return self.update(samples, seconds)
        grown = seconds / base.seconds
        if self._beside is None and (
            grown >= GROWTH or (grown >= LEAST_GROWTH and _moved(fitted, base.fitted) > MOVED)
        ):
            self._beside = self._pool.submit(self._anew, samples.blocks(), seconds)
        return self._result(fitted, base, seconds, time.process_time() - begun)

    def _anew(self, blocks: Mapping[str, Block], seconds: int) -> tuple[_FromScratch, RecursiveFit]:
        found = self._from_scratch(blocks, seconds)
        return found, RecursiveFit(found.fitted)

    def _from_scratch(self, blocks: Mapping[str, Block], seconds: int) -> _FromScratch:
        begun = time.thread_time()
        run = RunLimits(end=str(seconds)).of(build_run(self._start.run_id, self._start, blocks))
        ready = in_common([prepare_run(run, self._vehicle, self._rig, self._filters, [])])[0][0]
        model = self._model_of(self._vehicle, ready.prepared.recording.reference)
        fitted = fit(model, [ready.prepared])
        floor = floor_by_row(fitted)
        channels = frozenset((ready.run or run).signals)
        begin = begin_ns(self._start, blocks)
        return _FromScratch(float(seconds), begin, channels, fitted, floor, time.thread_time() - begun)

    def _go_on(self, going: RecursiveFit, base: _FromScratch, samples: LiveSamples, seconds: int) -> Fit:
        """The fit that goes on with the samples that it needs."""
        there = base.fitted.runs[0].recording
        begin = float(there.t[0]) + going.first_needed
        from_ns = base.begin_ns + round(1e9 * (begin - SETTLING))
        run = build_run(self._start.run_id, self._start, samples.blocks(from_ns), start_ns=base.begin_ns)
        run = for_equations(RunLimits(end=str(seconds)).of(run), self._vehicle, there.rig)
        run = replace(run, signals={name: s for name, s in run.signals.items() if name in base.channels})
        rig, rate = there.rig, there.filters.rate
        spans = [(s.t[0] - rig.latency(name), s.t[-1] - rig.latency(name)) for name, s in run.signals.items()]
        if set(run.signals) != base.channels:
            raise ChangedRunError
        first = max(0, math.ceil((max(a for a, _ in spans) - there.t[0]) * rate))
        last = math.floor((min(b for _, b in spans) - there.t[0]) * rate - 1e-6)
        grid = there.t[0] + np.arange(first, last + 1) / rate
        recording = bring_together(run, self._vehicle, rig, there.filters, grid)
        return going.extended(PreparedRun(completed(replace(recording, start=there.start))), first)

    def _result(self, fitted: Fit, base: _FromScratch, seconds: int, took: float) -> LiveResult:
        runs = base.fitted.runs
        return LiveResult(
            float(seconds), fitted is base.fitted, base.seconds, estimates(fitted, None, runs),
            seconds_needed(fitted, self._target, float(seconds)), row_scores(fitted, base.floor), took,
        )  # fmt: skip


def _moved(fitted: Fit, before: Fit) -> float:
    """Largest change of a value since a fit before, in its 95 % half intervals with the sensor sheet."""
    kept = before.place
    half = 1.96 * np.sqrt(np.diag(before.covariance + before.covariance_sheet)[kept])
    return float(np.max(np.abs(fitted.theta[kept] - before.theta[kept]) / half))
