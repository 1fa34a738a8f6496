"""Recursive fit: a fit that goes on with a run while it is recorded, from the sums of what it has seen.

A new second is added to the sums of those before; no finished sample is computed again, and none is kept: neither
memory nor time grow with the run. Everything that a fit takes from the run as a whole is that of the fit it goes on
from: the values at which the residual is linearised, the rig's noise, the bias of noise in the regressors for each
second. With the samples of that fit alone it gives its values; the more seconds are new, the further it may be from a
fit from scratch, which is made anew now and then.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row, body_levers
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress
from lacet.identify.regression.assembly import Assembly, Piece
from lacet.identify.regression.corrected_scores import NoiseMoments
from lacet.identify.regression.finished_pieces import LinearSums, ScoreSums, Values, scores_of, spread_from
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import Equations, RunEquations
from lacet.identify.regression.sensitivity import ExpansionPoint
from lacet.identify.regression.sums.linear_fit import FittedModel, solve_linear
from lacet.identify.regression.tolerances import SheetEntry, sheet_responses
from lacet.identify.regression.wls import Fit
from lacet.identify.signals.filters import poles
from lacet.identify.signals.reconstruct import Recording

CHUNK = 5.0
"""Length of the pieces that are finished once [s]: long beside the filters' memory, short beside a drive."""
EXACT = 60.0
"""Length of the last finished pieces whose residuals are computed at the present values [s]; those of the pieces before
stay at the values of when they left it, in what the intervals take from them."""


class ChangedRunError(Exception):
    """Change of a run's rows, channels or groups of parameters, with which no fit goes on: fit it from scratch."""


@dataclass(frozen=True, repr=False)
class GrownFit(FittedModel):
    """An extended fit, without its runs.

    Attributes
    ----------
    equations : the equations as R factors.
    totals : row → (z + p + 1,) sums over the samples of the columns and of the left side.
    searched : (p,) factors on the σ of `covariance` and of `covariance_sheet` from what is not known of shape
        constants, as they were in the fit that went on.
    """

    equations: Equations
    totals: Mapping[Row, Array]
    searched: tuple[Array, Array]

    @property
    def covariances_searched(self) -> tuple[Array, Array]:
        """`covariance` and `covariance_sheet`, widened by the uncertainty of shape constants."""
        own, sheet = self.searched
        return self.covariance * np.outer(own, own), self.covariance_sheet * np.outer(sheet, sheet)


@dataclass(frozen=True)
class _Linearised:
    """Equations that are there already."""

    equations: Equations

    def reweighted(self, x: Array, sigma: Mapping[Row, float]) -> Self:
        """Not to be had: robust weights need the samples."""
        raise NotImplementedError

    def noise_moments(self, sigma: Mapping[Row, float], draws: int, progress: Progress) -> NoiseMoments:
        """Not to be had: they are those of the fit that goes on."""
        raise NotImplementedError


@dataclass(frozen=True)
class _Sums:
    """Sums over the pieces of one run, as a fit asks for them (`RunSums`): in every parameter, and with its zeros."""

    assembly: Assembly
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
    ) -> _Linearised:
        """Equations with sensitivities, at the values of the fit that goes on."""
        if not np.array_equal(keep, self.assembly.keep):
            raise ChangedRunError
        return _Linearised(Equations([self.own], known, rows))

    def without_faults(self, values: Array) -> _Sums:
        """Not to be had: the model has no sensor faults."""
        raise NotImplementedError


class RecursiveFit:
    """A fit that goes on with its run.

    Parameters
    ----------
    fitted : the fit from scratch that it goes on from: of one run, with zeros, of a model without sensor faults.

    Attributes
    ----------
    before : the values of that fit; neither its run nor its equations are kept.
    """

    def __init__(self, fitted: Fit):
        like, run = fitted.assembly, fitted.runs[0]
        assert like.at is not None
        self.before = FittedModel(**{one.name: getattr(fitted, one.name) for one in fields(FittedModel)})
        self._searched = _wider(fitted)
        self._rows, self._channels = run.rows, set(run.recording.signals.value)
        # One sample stands for the run: rig, vehicle and filters are needed, and what a piece is made with.
        bare = PreparedRun(run.recording.at(np.zeros(1, np.intp)), is_piece=True)
        self._like = Assembly(
            like.physics, like.keep, like.faults, (bare,), like.at, like.zeros, None, like.seeds, like.payload
        )
        filters = run.recording.filters
        self._filters, step, rate = filters, filters.step, filters.rate
        self._margin = math.ceil(filters.memory * rate / step) * step
        # The pre-filter's transient lies before the parallel filter's.
        before = 0.0 if filters.pre_cutoff is None else _memory(filters.pre_cutoff, rate, filters.order)
        self._settled = self._margin + math.ceil(before / step) * step + step
        self._chunk = max(step, round(CHUNK * rate / step) * step)
        self._size = _samples(fitted.equations.runs[0])
        self._physics = RunEquations((), np.zeros(0))
        self._own: RunEquations | None = None
        self._linear = LinearSums()
        self._scores: ScoreSums | None = None
        self._last = deque[tuple[int, Piece]]()
        self._at = _Found(fitted.solution, dict(zip(fitted.zeros[0][0], fitted.zeros[0][2], strict=True)), fitted.sigma)
        self._done = self._summed = 0
        self._finish(run, 0)

    @property
    def recording(self) -> Recording:
        """One sample of the recording that was fitted: rig, vehicle and filters."""
        return self._like.runs[0].recording

    @property
    def first_needed(self) -> float:
        """Time since the grid's first instant from which on samples are needed to go on [s]."""
        filters = self._filters
        return max(0.0, (self._done - self._margin - self._settled) / filters.rate - 2.0 * filters.edge)

    def extended(self, run: PreparedRun, first: int = 0) -> GrownFit:
        """The fit of the run as it is now: of the samples kept as sums, and of those that `run` adds.

        Parameters
        ----------
        run : the run's last seconds, from `first_needed` on or earlier, up to now, on the grid of the fitted run.
        first : place of its first sample in the whole run.

        Raises ChangedRunError where rows or channels are others than before, so that a fit from scratch is needed.
        """
        if run.rows != self._rows or set(run.recording.signals.value) != self._channels:
            raise ChangedRunError
        self._finish(run, first)
        size = first + run.recording.t.size
        pieces, physics, linear = [piece for _, piece in self._last], _copy(self._physics), self._linear.copy()
        own = None if self._own is None else _copy(self._own)
        if (part := self._part(run, first, self._done, size)) is not None:
            own = part.add(physics, own, linear)
            pieces.append(part.piece)
        if own is None:
            raise ChangedRunError
        before = self.before
        grown = _samples(own) / self._size
        moments = NoiseMoments(grown * before.moments.slopes, grown * before.moments.constants)
        sums, at = _Sums(self._like, physics, own), self._like.at
        assert at is not None
        found = solve_linear(before.model, sums, before.options, moments, near=at.values)
        equations = found.runs.equations
        zeros = equations.zeros(found.x, found.sigma)[0]
        self._at = _Found(found.x, dict(zip(own.zeros, zeros, strict=True)), found.sigma)
        instants = size // self._filters.step + 1
        values = self._at.on(own)
        scores = scores_of(pieces, self._summed, instants - self._summed, values)
        covariance = (self._scores or ScoreSums(len(values.both))).covariance(scores, instants)
        spread = spread_from(covariance, linear, own, found.sigma)
        plain = FittedModel.of(before.model, before.options, found, spread)
        return GrownFit(
            **{one.name: getattr(plain, one.name) for one in fields(FittedModel)},
            equations=equations,
            totals=linear.totals,
            searched=self._searched,
        )

    def _finish(self, run: PreparedRun, first: int) -> None:
        """Add the pieces of which the filters' transient at the run's end is over."""
        last = first + run.recording.t.size - self._settled
        for start, end in pairwise(range(self._done, last + 1, self._chunk)):
            part = self._part(run, first, start, end)
            self._done = end
            if part is None:
                continue
            self._own = part.add(self._physics, self._own, self._linear)
            # What remains of it are its equations: its channels are not needed any more.
            bare = self._like.runs[0]
            self._last.append((end, replace(part.piece, prepared=bare, zeros=None, sensitivity=None)))
        self._sum_up()

    def _sum_up(self) -> None:
        """Put the scores of pieces that lie before the last `EXACT` seconds into their sums."""
        oldest = self._done - EXACT * self._filters.rate
        while self._last and self._last[0][0] <= oldest:
            assert self._own is not None
            end, piece = self._last.popleft()
            values, until = self._at.on(self._own), end // self._filters.step
            scores = scores_of([piece], self._summed, until - self._summed, values)
            self._scores = self._scores or ScoreSums(len(values.both))
            self._scores.add(scores)
            self._summed = until

    def _part(self, run: PreparedRun, first: int, start: int, end: int) -> _Part | None:
        """The samples from `start` to `end` of the whole run as a piece of it; None where there are none."""
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
        piece = self._like.made(0, 0, drive)
        assert piece.sensitivity is not None
        return _Part(piece, columns, sheet_responses(drive, piece.sensitivity))


@dataclass(frozen=True)
class _Found:
    """Values of a fit: `x` (p,) parameters kept, `zeros` by name, `sigma` row → weight's σ."""

    x: Array
    zeros: Mapping[str, float]
    sigma: Mapping[Row, float]

    def on(self, run: RunEquations) -> Values:
        """The values in the columns of a run's equations; zeros that the fit did not have are zero."""
        return Values(np.array([*(self.zeros.get(name, 0.0) for name in run.zeros), *self.x]), self.sigma)


@dataclass(frozen=True)
class _Part:
    """A piece of the run, its columns in every parameter (row → (n, p)), and its responses to the sensor sheet."""

    piece: Piece
    columns: Mapping[Row, Array]
    responses: Mapping[SheetEntry, Mapping[Row, Array]]

    def add(self, physics: RunEquations, own: RunEquations | None, linear: LinearSums) -> RunEquations:
        """Add it to equations in all parameters, to those with zeros, which are begun if need be, and to sums."""
        piece = self.piece
        assert piece.zeros is not None
        own = RunEquations(piece.zeros.names, piece.zeros.sigma) if own is None else own
        for row, right in piece.right.items():
            physics.add(row, self.columns[row], right)
            own.add(row, piece.blocks[row], right)
        linear.add(piece, self.responses)
        return own


def _wider(fitted: Fit) -> tuple[Array, Array]:
    """Factors (p,) on σ, and on that of the sensor sheet, from what is not known of shape constants."""
    found: list[Array] = []
    for wider, plain in zip(fitted.covariances_searched, (fitted.covariance, fitted.covariance_sheet), strict=True):
        own = np.diag(plain)
        found.append(np.sqrt(np.divide(np.diag(wider), own, out=np.ones(len(own)), where=own > 0.0)))
    return found[0], found[1]


def _memory(cutoff: float, rate: float, order: int) -> float:
    """Samples after which a filter has forgotten one but for one part in 10¹²."""
    return math.log(1e-12) / math.log(float(np.max(np.abs(poles(cutoff, rate, order)))))


def _samples(run: RunEquations) -> int:
    return sum(run.counts.values())


def _copy(run: RunEquations) -> RunEquations:
    return RunEquations(run.zeros, run.priors, dict(run.triangles), dict(run.counts))
