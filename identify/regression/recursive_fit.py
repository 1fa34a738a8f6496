"""Recursive fit: a fit that goes on with a run while it is recorded, from the sums of what it has seen.

A new second is added to the sums of those before; no finished sample is computed again. Everything that a fit takes
from the run as a whole is that of the fit it goes on from: the values at which the residual is linearised, the rig's
noise, the bias of noise in the regressors for each second. With the samples of that fit alone it gives its values; the
more seconds are new, the further it may be from a fit from scratch, which is made anew now and then.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row, body_levers
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Assembly, Piece
from lacet.identify.regression.corrected_scores import NoiseMoments
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import Equations, RunEquations
from lacet.identify.regression.sensitivity import ExpansionPoint
from lacet.identify.regression.sums.linear_fit import solve_linear
from lacet.identify.regression.sums.prepared_runs import PreparedEquations
from lacet.identify.regression.tolerances import SheetEntry, sheet_responses
from lacet.identify.regression.wls import Fit, fit_of
from lacet.identify.signals.filters import poles

CHUNK = 5.0
"""Length of the pieces that are finished once and kept [s]: long beside the filters' memory, short beside a drive."""


class ChangedRunError(Exception):
    """Change of a run's rows, channels or groups of parameters, with which no fit goes on: fit it from scratch."""


@dataclass(frozen=True)
class _Part:
    """A piece of the run with its responses to the sensor sheet: entry → row → (n,)."""

    piece: Piece
    responses: dict[SheetEntry, dict[Row, Array]]


class _Parts(Assembly):
    """Equations of a run whose pieces are there already; of `run` only name, rows and length are used."""

    def __init__(self, like: Assembly, run: PreparedRun, parts: Sequence[_Part]):
        super().__init__(
            like.physics, like.keep, like.faults, (run,), like.at, like.zeros, None, like.seeds, like.payload
        )
        self._parts = parts

    def pieces_of(self, run: int) -> Iterator[Piece]:
        """The pieces, in order."""
        return (part.piece for part in self._parts)

    def sheet_responses(self, piece: Piece) -> dict[SheetEntry, dict[Row, Array]]:
        """Responses of a piece to one tolerance of each gain and latency of the sensor sheet."""
        assert piece.number is not None
        return self._parts[piece.number].responses


@dataclass(frozen=True)
class _Sums:
    """Sums over the pieces of one run, as a fit asks for them (`RunSums`): in every parameter, and with its zeros."""

    assembly: _Parts
    physics: RunEquations
    own: RunEquations

    @property
    def levers(self) -> Mapping[Row, float]:
        """Proportions of the residuals of the body's rows."""
        return body_levers(self.assembly.runs[0].recording.vehicle)

    def columns(self) -> RunEquations:
        """Equations in every parameter of the physics, without zeros."""
        return self.physics

    def absent_channels(self) -> Collection[str]:
        """Channels that rows of the equations lack."""
        return ()

    def linearised(
        self, keep: NDArray[np.int64], at: ExpansionPoint | None, known: Array, rows: Sequence[Row]
    ) -> PreparedEquations:
        """Equations with sensitivities, at the values of the fit that goes on."""
        if not np.array_equal(keep, self.assembly.keep):
            raise ChangedRunError
        return PreparedEquations(self.assembly, Equations([self.own], known, rows))

    def without_faults(self, values: Array) -> _Sums:
        """Not to be had: the model has no sensor faults."""
        raise NotImplementedError


class RecursiveFit:
    """A fit that goes on with its run.

    Parameters
    ----------
    fitted : the fit from scratch that it goes on from: of one run, with zeros, of a model without sensor faults.
    """

    def __init__(self, fitted: Fit):
        assert fitted.assembly.at is not None
        self.fitted, self._like, self._at = fitted, fitted.assembly, fitted.assembly.at
        filters = fitted.runs[0].recording.filters
        step, rate = filters.step, filters.rate
        self._margin = math.ceil(filters.memory * rate / step) * step
        # The pre-filter's transient lies before the parallel filter's.
        before = 0.0 if filters.pre_cutoff is None else _memory(filters.pre_cutoff, rate, filters.order)
        self._settled = self._margin + math.ceil(before / step) * step + step
        self._chunk = max(step, round(CHUNK * rate / step) * step)
        self._size = _samples(fitted.equations.runs[0])
        self._parts: list[_Part] = []
        self._physics = RunEquations((), np.zeros(0))
        self._own: RunEquations | None = None
        self._done = 0
        self._finish(fitted.runs[0], 0)

    @property
    def first_needed(self) -> float:
        """Time since the grid's first instant from which on samples are needed to go on [s]."""
        filters = self._like.runs[0].recording.filters
        return max(0.0, (self._done - self._margin - self._settled) / filters.rate - 2.0 * filters.edge)

    def extended(self, run: PreparedRun, first: int = 0) -> Fit:
        """The fit of the run as it is now: of the samples kept as sums, and of those that `run` adds.

        Parameters
        ----------
        run : the run's last seconds, from `first_needed` on or earlier, up to now, on the grid of the fitted run.
        first : place of its first sample in the whole run.

        Raises ChangedRunError where rows or channels are others than before, so that a fit from scratch is needed.
        """
        there = self._like.runs[0]
        if run.rows != there.rows or set(run.recording.signals.value) != set(there.recording.signals.value):
            raise ChangedRunError
        self._finish(run, first)
        size = first + run.recording.t.size
        parts, physics = list(self._parts), _copy(self._physics)
        own = None if self._own is None else _copy(self._own)
        if (last := self._part(run, first, self._done, size)) is not None:
            parts.append(last[0])
            own = _add(physics, own, *last)
        if own is None:
            raise ChangedRunError
        before = self.fitted
        sums = _Sums(_Parts(self._like, _of_length(there, size), parts), physics, own)
        grown = _samples(own) / self._size
        moments = NoiseMoments(grown * before.moments.slopes, grown * before.moments.constants)
        return fit_of(
            before.model,
            before.options,
            solve_linear(before.model, sums, before.options, moments, near=self._at.values),
        )

    def _finish(self, run: PreparedRun, first: int) -> None:
        """Add the pieces of which the filters' transient at the run's end is over."""
        last = first + run.recording.t.size - self._settled
        for start, end in pairwise(range(self._done, last + 1, self._chunk)):
            found = self._part(run, first, start, end)
            self._done = end
            if found is None:
                continue
            part, columns = found
            self._own = _add(self._physics, self._own, part, columns)
            # What remains of it are its equations: its channels are not needed any more.
            bare = PreparedRun(part.piece.prepared.recording.at(np.zeros(1, np.intp)), is_piece=True)
            self._parts.append(replace(part, piece=replace(part.piece, prepared=bare, sensitivity=None)))

    def _part(self, run: PreparedRun, first: int, start: int, end: int) -> tuple[_Part, Mapping[Row, Array]] | None:
        """The samples from `start` to `end` of the whole run, and their columns in every parameter; None for none."""
        begin = max(0, start - self._margin)
        if begin < first:
            raise ChangedRunError
        index = {row: places[(places >= start - first) & (places < end - first)] for row, places in run.index.items()}
        index = {row: places + first - begin for row, places in index.items() if len(places)}
        if not index:
            return None
        recording = run.recording.at(slice(begin - first, end + self._margin - first))
        drive = PreparedRun(recording, begin, index, is_piece=True)
        columns = {row: drive.matrix(self._like.physics, row) for row in drive.rows}
        piece = self._like.made(0, len(self._parts), drive)
        assert piece.sensitivity is not None
        return _Part(piece, sheet_responses(drive, piece.sensitivity)), columns


def _memory(cutoff: float, rate: float, order: int) -> float:
    """Samples after which a filter has forgotten one but for one part in 10¹²."""
    return math.log(1e-12) / math.log(float(np.max(np.abs(poles(cutoff, rate, order)))))


def _samples(run: RunEquations) -> int:
    return sum(run.counts.values())


def _of_length(run: PreparedRun, size: int) -> PreparedRun:
    """A run of so many samples by its name and rows alone, for sums that do not ask for its channels."""
    recording = run.recording
    t = recording.t[0] + np.arange(size) / recording.filters.rate
    return PreparedRun(replace(recording, t=t), index=run.index)


def _copy(run: RunEquations) -> RunEquations:
    return RunEquations(run.zeros, run.priors, dict(run.triangles), dict(run.counts))


def _add(physics: RunEquations, own: RunEquations | None, part: _Part, columns: Mapping[Row, Array]) -> RunEquations:
    """Add a piece to the equations in all parameters and to those with zeros, which are begun with it if need be."""
    piece = part.piece
    assert piece.zeros is not None
    own = RunEquations(piece.zeros.names, piece.zeros.sigma) if own is None else own
    for row, right in piece.right.items():
        physics.add(row, columns[row], right)
        own.add(row, piece.blocks[row], right)
    return own
