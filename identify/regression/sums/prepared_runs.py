"""Sums over prepared runs, as a fit asks for them: of all runs of a fit in this process, or of one run of many."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row, body_levers
from lacet.identify.effects.base import SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step
from lacet.identify.regression.assembly import Assembly, MotionResponses
from lacet.identify.regression.corrected_scores import NoiseMoments
from lacet.identify.regression.huber import SecondSizes, usual_sizes
from lacet.identify.regression.identifiability import refuse_not_finite
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import Equations, RunEquations
from lacet.identify.regression.sensitivity import ExpansionPoint
from lacet.identify.regression.sensor_offsets import PayloadSpread
from lacet.identify.regression.sums.tree import merged
from lacet.identify.signals.reconstruct import Recording


@dataclass(frozen=True)
class PreparedRuns:
    """Runs in memory, one after the other.

    Attributes
    ----------
    model : whose sums they are.
    runs : the runs.
    zeros : whether each run has its sensor zeros.
    shared : responses of the residual from a fit to the same motions; None to compute them.
    seeds : number of each run in the seeds of its noise draws; by default its place.
    payload : how much the runs' payloads differ, where each has its own.
    """

    model: Model
    runs: tuple[PreparedRun, ...]
    zeros: bool = True
    shared: MotionResponses | None = None
    seeds: tuple[int, ...] = ()
    payload: PayloadSpread | None = None

    @property
    def levers(self) -> Mapping[Row, float]:
        """Proportions of the residuals of the body's rows, by the car's geometry."""
        return body_levers(self.runs[0].recording.vehicle)

    def columns(self) -> RunEquations | None:
        """Equations of all runs in every parameter of the physics, without zeros; None where no run has a row."""
        size = self.model.physics_size
        plain = Assembly(self.model.physics, np.arange(size), (), self.runs, None, zeros=False, seeds=self.seeds)
        each = accumulate(plain)
        return merged(each, RunEquations.merged) if each else None

    def absent_channels(self) -> Collection[str]:
        """Channels that rows of the equations lack in these runs."""
        return {name for run in self.runs for why in run.measured_rows.left_out.values() for name in why.channels}

    def linearised(
        self, keep: NDArray[np.int64], at: ExpansionPoint | None, known: Array, rows: Sequence[Row]
    ) -> PreparedEquations:
        """Equations with sensitivities; parameters as in `RunSums.linearised`."""
        assembly = Assembly(
            self.model.physics,
            keep,
            self.model.faults,
            self.runs,
            at,
            self.zeros,
            self.shared,
            self.seeds,
            self.payload,
        )
        return PreparedEquations(assembly, Equations(accumulate(assembly), known, rows))

    def without_faults(self, values: Array) -> PreparedRuns:
        """The runs, the model's sensor faults removed at these sizes."""
        return replace(self, runs=tuple(without_faults(run, self.model.faults, values) for run in self.runs))


@dataclass(frozen=True)
class PreparedEquations:
    """Equations of runs in memory, and the samples behind them."""

    assembly: Assembly
    equations: Equations

    def reweighted(self, x: Array, sigma: Mapping[Row, float]) -> PreparedEquations:
        """The same with robust weights of the samples from the residual at `x`."""
        found = self.second_sizes(x, sigma)
        return self.with_weights(found, usual_sizes(found.by_row()))

    def second_sizes(self, x: Array, sigma: Mapping[Row, float]) -> SecondSizes:
        """RMS of the residual at `x`, second by second."""
        return SecondSizes.of(self.assembly, self.equations, x, sigma)

    def with_weights(self, found: SecondSizes, usual: Mapping[Row, float]) -> PreparedEquations:
        """The same with robust weights from these sizes, where `usual` are the rows' median seconds over all runs."""
        assembly = self.assembly.weighted(found.weights(usual))
        return PreparedEquations(assembly, replace(self.equations, runs=accumulate(assembly)))

    def noise_moments(self, sigma: Mapping[Row, float], draws: int, progress: Progress) -> NoiseMoments:
        """What noise in the regressors does, of all runs."""
        total = len(self.assembly.runs)

        def each() -> Iterator[NoiseMoments]:
            for number, run in enumerate(self.equations.runs):
                progress(Step(Stage.NOISE_CORRECTION, number, total))
                moments, following = NoiseMoments.zero(self.equations.p, draws), run.following(sigma)
                for piece in self.assembly.pieces_of(number):
                    moments.add(piece, self.assembly.physics, self.assembly.keep, sigma, following)
                yield moments

        return merged(each(), NoiseMoments.merged)


def accumulate(assembly: Assembly) -> list[RunEquations]:
    """The equations of every run, piece by piece."""
    out: list[RunEquations | None] = [None] * len(assembly.runs)
    for piece in assembly.pieces():
        run = out[piece.run]
        if run is None:
            names, priors = (piece.zeros.names, piece.zeros.sigma) if piece.zeros else ((), np.zeros(0))
            out[piece.run] = run = RunEquations(names, priors)
        if not all(np.all(np.isfinite(a)) for part in (piece.blocks, piece.right) for a in part.values()):
            refuse_not_finite(assembly.physics, [piece.prepared])
        for row, block in piece.blocks.items():
            run.add(row, block, piece.right[row], None if piece.weights is None else piece.weights[row])
    return [run for run in out if run is not None]


def without_faults(run: PreparedRun, faults: Sequence[SensorFault], values: Array) -> PreparedRun:
    """A run with sensor faults of these sizes removed."""
    return PreparedRun(recording_without_faults(run.recording, faults, values))


def recording_without_faults(recording: Recording, faults: Sequence[SensorFault], values: Array) -> Recording:
    """A recording with sensor faults of these sizes removed."""
    for fault, p in zip(faults, values, strict=True):
        there = [channel for channel in fault.channels() if channel in recording.signals.value]
        undone = {channel: fault.correct(channel, recording, float(p)) for channel in there}
        recording = recording.with_signals(recording.signals.changed(undone, recording.filters.rate))
    return recording
