"""Live fit: the present model fitted to the run that is being recorded, again each second.

As long as a fit from scratch takes no longer than `QUICK`, each second has one: what ``lacet identify --to`` gives for
the same seconds. Later the sums of the last such fit go on (`RecursiveFit`), for which a second costs the same however
long the run is; and a fit from scratch is made beside them when the run has grown by `GROWTH`, up to `LONGEST`. A run
that is over is fitted from scratch once more (`LiveFit.whole`).
"""

from __future__ import annotations

import math
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.errors import LacetError
from lacet.daq.formats.log_run import begin_ns, build_run
from lacet.daq.formats.wire import StartRecord
from lacet.daq.rig import Rig
from lacet.daq.run_limits import RunLimits
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.car.sources.completion import completed
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import OVERVIEW, PreparedRun
from lacet.identify.regression.recursive_fit import ChangedRunError, GrownFit, RecursiveFit
from lacet.identify.regression.seconds_needed import Enough, seconds_needed
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.for_equations import for_equations
from lacet.identify.signals.reconstruct import bring_together
from lacet.identify.validation.equation_scores import RowLevel, column_totals, floor_by_row, row_levels
from lacet.identify.validation.parameter_estimates import Estimate, estimates
from lacet.services.acquisition.live_samples import LEAST_FREE, LiveSamples
from lacet.services.workspace.loading import in_common, prepare_run

QUICK = 0.5
"""Longest time that a fit from scratch may take to be made each second [s]: the rest of the second is the machine's.
Source: a choice."""
GROWTH = 1.5
"""Factor by which a run has grown since the last fit from scratch when the next one is made beside the sums.
Source: a choice."""
LONGEST = 300.0
"""Length of the longest run that is fitted from scratch [s]: the memory that it takes grows with the run. Source: a
choice; 300 s take 0.7 GB (docs/live.md)."""
MOVED = 1.0
"""Change of a value since the last fit from scratch, in its 95 % half intervals then, at which the next one is made
beside the sums before the run has grown by `GROWTH`: the residual is linearised at values that no longer hold. Source:
a choice."""
LEAST_GROWTH = 1.1
"""Factor by which the run must have grown for that. Source: processor time."""
STEP = 30.0
"""Most new seconds that are added to the sums at once [s]: so much of the channels is in memory."""
STALLED = 60.0
"""Time without a new second of all channels after which the fit ends [s]: samples that wait would fill the memory."""
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
    scores : row → RMS of its residual and noise floor.
    took : processor time [s].
    """

    seconds: float
    from_scratch: bool
    since: float
    estimates: list[Estimate]
    enough: Enough
    scores: Mapping[Row, RowLevel]
    took: float


class LiveFitEnded(LacetError):
    """End of a live fit, with its cause in words; the recording is not affected."""


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


@dataclass
class _GoingOn:
    """Sums of a fit from scratch that go on, without its samples but those of `overview`, at `OVERVIEW`.

    `t` : first instant of its grid [s]; `until` : end of the seconds that were added [s]; the others as in
    `_FromScratch`.
    """

    seconds: float
    begin_ns: int
    channels: frozenset[str]
    floor: Mapping[Row, float]
    sums: RecursiveFit
    overview: PreparedRun
    t: float
    until: float

    @classmethod
    def of(cls, base: _FromScratch) -> _GoingOn:
        run = base.fitted.runs[0]
        step = max(1, int(run.recording.filters.rate / OVERVIEW))
        overview = PreparedRun(run.recording.thinned(step), is_piece=True)
        return cls(
            base.seconds, base.begin_ns, base.channels, base.floor, RecursiveFit(base.fitted), overview,
            float(run.recording.t[0]), base.seconds,
        )  # fmt: skip


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
        self._begin_ns = start.started_ns
        self._going: _GoingOn | None = None
        self._beside: Future[_GoingOn] | None = None

    def wait(self) -> None:
        """Wait for the fit from scratch that is being made beside the sums, if any."""
        if self._beside is not None:
            self._beside.exception()

    def seconds_there(self, samples: LiveSamples) -> int:
        """Whole seconds for which every channel that is not silent has its samples [s]."""
        ends = [int(block.t_ns[-1]) for block in samples.blocks(samples.latest_ns - round(SILENT * 1e9)).values()]
        return max(0, math.floor(1e-9 * (min(ends) - self._begin_ns))) if ends else 0

    def update(self, samples: LiveSamples, seconds: int) -> LiveResult:
        """The fit of the first `seconds`. Raises LacetError where nothing can be fitted, as when they are too few.

        Samples that are not needed any more are dropped. Raises LiveFitEnded where no later second can be fitted
        either: the disk for samples is full, or a fit from scratch of more than `LONGEST` would be needed.
        """
        begun = time.process_time()
        if samples.full:
            raise self._no_room()
        if self._beside is not None and self._beside.done():
            self._take_beside()
        if self._going is None:
            first = min(seconds, math.floor(LONGEST))
            base = self._from_scratch(self._blocks(samples, first), first, longer=seconds > LONGEST)
            self._begin_ns = base.begin_ns
            if base.fitted.model.faults or (base.took <= QUICK and seconds < LONGEST):
                return self._first_result(base, time.process_time() - begun)
            self._going = _GoingOn.of(base)
            if seconds <= LONGEST:
                return self._first_result(base, time.process_time() - begun)
        going = self._going
        try:
            fitted = self._go_on(going, samples, seconds)
        except ChangedRunError:
            if seconds > LONGEST:
                raise self._ended(
                    "what is measured, or what the manoeuvre excites, has changed, and after "
                    f"{LONGEST:.0f} s no fit begins anew; the next recording is fitted again"
                ) from None
            self._going = None
            return self.update(samples, seconds)
        if seconds - going.t - going.sums.first_needed > STALLED:
            raise self._ended(f"a channel has been silent for {STALLED:.0f} s")
        self._plan(samples, seconds, fitted)
        levels = row_levels(fitted.equations.runs[0], fitted.totals, fitted.solution, going.floor)
        return LiveResult(
            float(seconds), False, going.seconds, estimates(fitted, None, (going.overview,)),
            seconds_needed(fitted, self._target, float(seconds)), levels, time.process_time() - begun,
        )  # fmt: skip

    def whole(self, samples: LiveSamples, seconds: int) -> LiveResult | None:
        """The fit from scratch of a run that is over: what ``lacet identify --to`` gives for `seconds` of its log.

        None where the run is longer than `LONGEST`. Raises LacetError where nothing can be fitted.
        """
        if seconds > LONGEST or samples.full:
            return None
        begun = time.process_time()
        # Clocks are fitted to all samples there are, as those of the log.
        base = self._from_scratch(samples.blocks(), seconds)
        return self._first_result(base, time.process_time() - begun)

    def _take_beside(self) -> None:
        """Go on with the fit from scratch that was made beside the sums; with the last one if there is none."""
        assert self._beside is not None
        found, self._beside = self._beside, None
        try:
            self._going = found.result()
        except OSError as cause:
            raise self._no_room() from cause
        except LacetError:
            pass

    def _plan(self, samples: LiveSamples, seconds: int, fitted: GrownFit) -> None:
        """Begin the next fit from scratch where it is due; drop the samples that none needs any more."""
        going = self._going
        assert going is not None
        grown = seconds / going.seconds
        due = grown >= GROWTH or (grown >= LEAST_GROWTH and _moved(fitted, going.sums.before) > MOVED)
        if self._beside is None and due and seconds <= LONGEST:
            self._beside = Future()
            # A thread for which the end of the program does not wait.
            made = (self._beside, self._blocks(samples, seconds), seconds)
            threading.Thread(target=self._anew, args=made, name="lacet-live-fit", daemon=True).start()
        elif self._beside is None and seconds > LONGEST:
            samples.forget(self._needed_ns(going))

    def _ended(self, why: str) -> LiveFitEnded:
        return LiveFitEnded(f"the fit has ended, the recording goes on: {why}")

    def _no_room(self) -> LiveFitEnded:
        return LiveFitEnded(
            f"the fit has ended, the recording goes on: less than {LEAST_FREE / 1e9:.1f} GB are free on the disk of "
            f"{tempfile.gettempdir()}, where samples are set aside (TMPDIR names another folder)"
        )

    def _anew(self, found: Future[_GoingOn], blocks: Mapping[str, Block], seconds: int) -> None:
        """The thread of a fit from scratch."""
        try:
            found.set_result(_GoingOn.of(self._from_scratch(blocks, seconds)))
        except Exception as error:  # for who asks for the result
            found.set_exception(error)

    def _from_scratch(self, blocks: Mapping[str, Block], seconds: int, longer: bool = False) -> _FromScratch:
        """The fit of the first `seconds`; `longer` : whether the run is too long for it, so that sums go on."""
        begun = time.thread_time()
        run = RunLimits(end=str(seconds)).of(build_run(self._start.run_id, self._start, blocks))
        ready = in_common([prepare_run(run, self._vehicle, self._rig, self._filters, [])])[0][0]
        model = self._model_of(self._vehicle, ready.prepared.recording.reference)
        if model.faults and longer:
            raise self._ended(f"a model with a sensor fault is fitted to {LONGEST:.0f} s at most")
        fitted = fit(model, [ready.prepared])
        floor = floor_by_row(fitted)
        channels = frozenset((ready.run or run).signals)
        begin = begin_ns(self._start, blocks)
        return _FromScratch(float(seconds), begin, channels, fitted, floor, time.thread_time() - begun)

    def _first_result(self, base: _FromScratch, took: float) -> LiveResult:
        """The result of a fit from scratch."""
        fitted = base.fitted
        levels = row_levels(fitted.equations.runs[0], column_totals(fitted), fitted.solution, base.floor)
        return LiveResult(
            base.seconds, True, base.seconds, estimates(fitted, None, fitted.runs),
            seconds_needed(fitted, self._target, base.seconds), levels, took,
        )  # fmt: skip

    def _blocks(self, samples: LiveSamples, seconds: int) -> dict[str, Block]:
        """The samples of the run's first seconds, and a second more."""
        return samples.blocks(0, self._begin_ns + round(1e9 * (seconds + 1.0)))

    def _needed_ns(self, going: _GoingOn) -> int:
        """Stamp from which on samples are needed to go on [ns]."""
        return going.begin_ns + round(1e9 * (going.t + going.sums.first_needed - SETTLING))

    def _go_on(self, going: _GoingOn, samples: LiveSamples, seconds: int) -> GrownFit:
        """The fit that goes on with the samples that it needs, many of them in steps."""
        while True:
            going.until = min(float(seconds), going.until + STEP)
            fitted = self._extended(going, samples, going.until)
            if going.until >= seconds:
                return fitted

    def _extended(self, going: _GoingOn, samples: LiveSamples, until: float) -> GrownFit:
        there = going.sums.recording
        blocks = samples.blocks(self._needed_ns(going), going.begin_ns + round(1e9 * (until + SETTLING)))
        run = build_run(self._start.run_id, self._start, blocks, start_ns=going.begin_ns)
        run, rig = for_equations(RunLimits(end=str(until)).of(run), self._vehicle, there.rig)
        run = replace(run, signals={name: s for name, s in run.signals.items() if name in going.channels})
        rate = there.filters.rate
        spans = [(s.t[0] - rig.latency(name), s.t[-1] - rig.latency(name)) for name, s in run.signals.items()]
        if set(run.signals) != going.channels:
            raise ChangedRunError
        first = max(0, math.ceil((max(a for a, _ in spans) - going.t) * rate))
        last = math.floor((min(b for _, b in spans) - going.t) * rate - 1e-6)
        grid = going.t + np.arange(first, last + 1) / rate
        recording = bring_together(run, self._vehicle, rig, there.filters, grid)
        return going.sums.extended(PreparedRun(completed(replace(recording, start=there.start))), first)


def _moved(fitted: FittedModel, before: FittedModel) -> float:
    """Largest change of a value since a fit before, in its 95 % half intervals with the sensor sheet."""
    kept = before.place
    half = TWO_SIDED_95 * np.sqrt(np.diag(before.covariance + before.covariance_sheet)[kept])
    return float(np.max(np.abs(fitted.theta[kept] - before.theta[kept]) / half))
