"""Smooth functions of states as regressors, and their prediction of a residual in cross-validation.

Columns are computed at full rate and filtered as the residual was. Smooth functions: of each state a line and a broken
line with knots at its quantiles, of velocities also a step with a soft edge (friction), and products of two of the
nearest states. History: the same states after first-order lags and lightly damped resonators, which covers what a
hidden linear mass, spring or damper can add.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, islice
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.decimation import decimated
from lacet.identify.signals.recursion import recursion
from lacet.identify.validation.states import ClearStates, State

KNOTS = (0.02, 0.12, 0.3, 0.5, 0.7, 0.88, 0.98)
"""Knots of a broken line, as quantiles of the state over all runs."""
SOFT = 0.05
"""Edge of a velocity's step ÷ its RMS."""
LAGS = (0.1, 0.3, 1.0, 3.0)
"""Time constants of the lags [s]."""
RESONATORS = (0.4, 0.63, 1.0, 1.6, 2.5, 4.0)
"""Natural frequencies of the resonators [Hz]."""
DAMPING = 0.15
"""Damping ratio of the resonators: neighbours overlap at half their height."""
FOLDS = 5
RIDGE = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Candidates of ridge ÷ number of samples, for columns of unit size; the best is used, or no column at all."""
SHARES = (0.1, 1.0)
"""Candidate weights of the history columns beside the smooth functions of the present."""
_PAIRED = ("travel", "travel rate", "tyre deflection", "travel difference across the axle",
           "rate difference across the axle", "longitudinal acceleration", "lateral acceleration",
           "vertical acceleration", "roll rate", "pitch rate", "yaw rate", "speed", "heave", "heave, rate")  # fmt: skip
_DRIVING = ("travel rate", "deflection rate", "rate difference across the axle", "longitudinal acceleration",
            "lateral acceleration", "vertical acceleration", "roll rate", "pitch rate", "yaw rate")  # fmt: skip
MODEL_STATES: Mapping[str, tuple[str, ...]] = {
    "chassis": ("longitudinal acceleration", "lateral acceleration", "vertical acceleration", "roll acceleration",
                "pitch acceleration", "yaw acceleration"),
    "suspension": ("travel", "travel rate", "vertical acceleration"),
    "tyre": ("tyre deflection", "vertical acceleration"),
    "spin": (),
    "corner": ("travel", "travel rate", "tyre deflection", "travel difference across the axle",
               "vertical acceleration"),
    "body": ("lateral acceleration", "longitudinal acceleration", "vertical acceleration", "roll acceleration",
             "pitch acceleration", "heave", "roll of the wheels", "pitch of the wheels", "heave, rate",
             "roll of the wheels, rate", "pitch of the wheels, rate"),
}  # fmt: skip
"""Kind of row → states in which the base model is linear; a fit biases those terms to absorb a missing effect."""

_TOGETHER = 32
"""So many columns are at full rate at once."""

_T = TypeVar("_T")


@dataclass(frozen=True)
class Columns:
    """Regressor columns of one row over all runs, of zero mean and unit RMS.

    `present` : (n, m) smooth functions; `of` (m,) index of the state of each, −1 for a product; `names` of those
    states; `lines` (l,) places of the columns that the model itself is linear in (spring, damper, inertia); `history` :
    (n, h).
    """

    names: tuple[str, ...]
    present: Array
    of: NDArray[np.intp]
    lines: NDArray[np.intp]
    history: Array


class ColumnMaker:
    """Maker of the columns of rows, which keeps those that the rows of one corner share.

    `history` : also lagged and resonating states.
    """

    def __init__(self, clear: ClearStates, history: bool = True):
        self.clear, self.runs, self.history = clear, clear.runs, history
        self._made: dict[tuple[str, tuple[str, ...], tuple[int, ...]], tuple[NDArray[np.intp], list[Array], int]] = {}

    def group(self, row: Row, names: tuple[str, ...]) -> Hashable:
        """What the columns of a row depend on: rows of the same group have the same columns but for `lines`."""
        key = self._key(row, names)
        return key, tuple(self.runs[i].kept(row).tobytes() for i in key[2])

    def _key(self, row: Row, names: tuple[str, ...]) -> tuple[str, tuple[str, ...], tuple[int, ...]]:
        return row.corner or "chassis", names, tuple(i for i, run in enumerate(self.runs) if row in run.index)

    def columns(self, row: Row, names: tuple[str, ...]) -> Columns:
        """Columns of a row from some of its states (`validation.states`)."""
        having = (key := self._key(row, names))[2]
        if key not in self._made:
            self._made[key] = self._make(row, names, having)
        of, combs, present = self._made[key]
        parts: list[Array] = []
        for i, series in zip(having, combs, strict=True):
            run = self.runs[i]
            parts.append(series[:, run.kept(row)])
        stacked = np.asarray(np.concatenate(parts, axis=1).T, float)
        stacked = stacked - stacked.mean(axis=0)
        size = np.sqrt(np.mean(stacked**2, axis=0))
        keep = size > 1e-9 * max(1e-300, float(size.max(initial=0.0)))
        stacked = stacked / np.where(keep, size, 1.0)
        first, second = keep[:present], keep[present:]
        own = of[first]
        starts = [int(np.argmax(own == names.index(name))) for name in MODEL_STATES[row.kind] if name in names]
        lines = np.asarray([k for k in starts if own[k] >= 0], np.intp)
        return Columns(names, stacked[:, :present][:, first], own, lines, stacked[:, present:][:, second])

    def _make(
        self, row: Row, names: tuple[str, ...], having: tuple[int, ...]
    ) -> tuple[NDArray[np.intp], list[Array], int]:
        """Each column's state, for each run its decimated columns, and the number of columns of the present."""
        found = [self.clear.blurred(i, row, names) for i in having]
        scaled = {name: _scaled([states[name] for states in found]) for name in names}
        near = {name: found[0][name] for name in names}
        of: list[int] = []
        out: list[Array] = []
        for number, i in enumerate(having):
            z = {name: series[number] for name, (_, series) in scaled.items()}
            filters = self.runs[i].recording.filters
            functions = _present(near, z, {name: knots for name, (knots, _) in scaled.items()})
            of = list[int]()
            present: list[Array] = []
            for batch in _batches(functions):
                of += [number for number, _ in batch]
                present.append(decimated(np.stack([series for _, series in batch]), filters))
            if self.history:
                history = _batches(_history(z, filters.rate))
                present += [decimated(np.stack(batch), filters) for batch in history]
            out.append(np.concatenate(present))
        return np.asarray(of, np.intp), out, len(of)


def _batches(series: Iterable[_T]) -> Iterator[list[_T]]:
    """Some at a time: at full rate all columns of a long run would not fit in memory."""
    remaining = iter(series)
    while batch := list(islice(remaining, _TOGETHER)):
        yield batch


def _scaled(states: Sequence[State]) -> tuple[Array, list[Array]]:
    """Knots and each run's series, scaled: the middle 96 % of the state have length 2 about its median."""
    everything = np.concatenate([s.series for s in states])
    low, middle, high = np.quantile(everything, (0.02, 0.5, 0.98))
    if states[0].velocity and low < 0.0 < high:
        middle = 0.0  # friction steps where the velocity changes its sign, not at its median
    unit = 0.5 * float(high - low) or float(np.std(everything)) or 1.0
    knots = np.unique(np.quantile(everything, KNOTS))
    return (knots - middle) / unit, [(s.series - middle) / unit for s in states]


def _present(
    states: Mapping[str, State], z: Mapping[str, Array], knots: Mapping[str, Array]
) -> Iterator[tuple[int, Array]]:
    """Smooth functions (N,), each with the index of its state, −1 for a product."""
    for number, (name, x) in enumerate(z.items()):
        yield number, x
        if knots[name].size > 2:
            for line in np.eye(knots[name].size):
                yield number, np.asarray(np.interp(x, knots[name], line), float)
        if states[name].velocity:
            yield number, np.tanh(x / (SOFT * (float(np.sqrt(np.mean(x**2))) or 1.0)))
    paired = [name for name in _PAIRED if name in z]
    for a, b in combinations_with_replacement(paired, 2):
        yield -1, z[a] * z[b]


def _history(z: Mapping[str, Array], rate: float) -> Iterator[Array]:
    """Lagged and resonating states (N,), in equilibrium at the run's first value."""
    for name in (name for name in _DRIVING if name in z):
        x = z[name]
        for tau in LAGS:
            keep = float(np.exp(-1.0 / (tau * rate)))
            yield x[0] + recursion((1.0 - keep,), (1.0, -keep), x - x[0])
        for frequency in RESONATORS:
            w = 2.0 * np.pi * frequency
            decay, turn = np.exp(-DAMPING * w / rate), w * np.sqrt(1.0 - DAMPING**2) / rate
            a = [1.0, -2.0 * decay * np.cos(turn), decay**2]
            level = np.array([1.0 - decay * np.cos(turn), decay * np.sin(turn)])
            moved = x - x[0]
            # In phase with the run, and a quarter of a period later.
            for b in ([level[0], 0.0], [0.0, level[1]]):
                yield recursion(b, a, moved)


def blocked_losses(columns: Array, targets: Array, blocks: NDArray[np.intp]) -> Array:
    """Squared residual of every block, predicted by a ridge regression on the folds that do not hold it.

    Parameters
    ----------
    columns : (n, m) of unit size; m may exceed n.
    targets : (n, k).
    blocks : (n,) increasing block numbers.

    Returns (1 + L, B, k): without any column, then for each value of `RIDGE`.
    """
    number = np.asarray(np.unique(blocks, return_inverse=True)[1], np.intp)
    losses = np.zeros((1 + len(RIDGE), int(number[-1]) + 1, targets.shape[1]))
    gram, moments = columns.T @ columns, columns.T @ targets
    for fold in range(FOLDS):
        test = number % FOLDS == fold
        if not test.any():
            continue
        measured, part, own = targets[test], columns[test], np.unique(number[test])
        starts = np.searchsorted(number[test], own)
        losses[:, own] = np.add.reduceat(measured**2, starts, axis=0)
        if not columns.shape[1]:
            continue
        values, vectors = np.linalg.eigh(gram - part.T @ part)
        values = np.maximum(values, 0.0)
        turned = vectors.T @ (moments - part.T @ measured)
        seen = part @ vectors
        count = np.count_nonzero(~test)
        for k, ridge in enumerate(RIDGE, start=1):
            missed = measured - seen @ (turned / (values + ridge * count)[:, None])
            losses[k, own] = np.add.reduceat(missed**2, starts, axis=0)
    return losses


def best(losses: Array) -> Array:
    """(B, k): the losses (L, B, k) at the index with the least sum, target by target."""
    place = np.argmin(losses.sum(axis=1), axis=0)
    return np.take_along_axis(losses, place[None, None, :], axis=0)[0]
