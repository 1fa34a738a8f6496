"""Smooth functions of states as regressors of a residual.

Columns are computed at full rate and filtered as the residual was. Smooth functions: of each state a line and a broken
line with knots at its quantiles, of velocities also a step with a soft edge (friction), and products of two of the
nearest states. History: the same states after first-order lags and lightly damped resonators, which covers what a
hidden linear mass, spring or damper can add.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lacet.daq.set_aside import ArraysOnDisk, DiskSpace
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

_TOGETHER = 2**20
"""So many samples of columns at full rate are filtered at once: of a long run all columns would not fit in memory."""

_STRETCH = 4096
"""So many samples of all columns are in memory at once."""
_T = TypeVar("_T")


@dataclass(frozen=True)
class Columns:
    """Regressor columns of one row over the runs that have it, m smooth functions of the present and then the history.

    Attributes
    ----------
    names : the states.
    of : (m,) place in `names` of the state of each, −1 for a product.
    lines : (l,) places of the columns that the model itself is linear in (spring, damper, inertia).
    parts : of each run the columns at the instants of its `comb`, on disk, and the row's places (n,) among these.
    stored : (m + h,) numbers of the columns on disk; `mean`, `size` (m + h,) mean of each, and RMS about it.
    """

    names: tuple[str, ...]
    of: NDArray[np.intp]
    lines: NDArray[np.intp]
    parts: tuple[tuple[ArraysOnDisk[int], NDArray[np.intp]], ...]
    stored: NDArray[np.intp]
    mean: Array
    size: Array

    def stretch(self, run: int, start: int, stop: int, places: NDArray[np.intp] | None = None) -> Array:
        """(stop − start, c) columns, of zero mean and unit RMS, at some of the row's samples in one of the runs.

        `places` : (c,) of the columns wanted; default: all, the history last.
        """
        disk, kept = self.parts[run]
        places = np.arange(self.stored.size) if places is None else places
        first = int(kept[start])
        within = kept[start:stop] - first
        out = np.empty((places.size, stop - start))
        for series, place in zip(out, places, strict=True):
            series[:] = disk.stretch(int(self.stored[place]), first, first + int(within[-1]) + 1)[within]
        return ((out - self.mean[places, None]) / self.size[places, None]).T

    def stretches(self, places: NDArray[np.intp] | None = None) -> Iterator[Array]:
        """(n, c) columns at all samples of all runs, some after the other."""
        for run, (_, kept) in enumerate(self.parts):
            for start in range(0, kept.size, _STRETCH):
                yield self.stretch(run, start, min(start + _STRETCH, kept.size), places)


class ColumnMaker:
    """Maker of the columns of rows, which keeps those made last: the rows of one corner share them.

    `history` : also lagged and resonating states.
    """

    def __init__(self, clear: ClearStates, history: bool = True):
        self.clear, self.runs, self.history = clear, clear.runs, history
        self._last: tuple[_Key, tuple[NDArray[np.intp], tuple[ArraysOnDisk[int], ...]]] | None = None

    def group(self, row: Row, names: tuple[str, ...]) -> Hashable:
        """What the columns of a row depend on: rows of the same group have the same columns but for `lines`."""
        key = self._key(row, names)
        return key, tuple(self.runs[i].kept(row).tobytes() for i in key[2])

    def _key(self, row: Row, names: tuple[str, ...]) -> _Key:
        return row.corner or "chassis", names, tuple(i for i, run in enumerate(self.runs) if row in run.index)

    def columns(self, row: Row, names: tuple[str, ...]) -> Columns:
        """Columns of a row from some of its states (`validation.states`)."""
        having = (key := self._key(row, names))[2]
        if self._last is None or self._last[0] != key:
            self._last = key, self._make(row, names, having)
        of, disks = self._last[1]
        parts = tuple((disk, self.runs[i].kept(row)) for i, disk in zip(having, disks, strict=True))
        each = (np.concatenate([disk[number][kept] for disk, kept in parts]) for number in disks[0])
        mean, size = np.array([(x.mean(), x.std()) for x in each]).T
        stored = np.flatnonzero(size > 1e-9 * max(1e-300, float(size.max(initial=0.0))))
        own = of[stored[stored < of.size]]
        starts = [int(np.argmax(own == names.index(name))) for name in MODEL_STATES[row.kind] if name in names]
        lines = np.asarray([k for k in starts if own[k] >= 0], np.intp)
        return Columns(names, own, lines, parts, stored, mean[stored], size[stored])

    def _make(
        self, row: Row, names: tuple[str, ...], having: tuple[int, ...]
    ) -> tuple[NDArray[np.intp], tuple[ArraysOnDisk[int], ...]]:
        """Each column's state, and each run's decimated columns."""
        scales = {name: _Scale.of([self.clear.blurred(i, row, name) for i in having]) for name in names}
        of: list[int] = []
        disks: list[ArraysOnDisk[int]] = []
        for i in having:

            def scaled(name: str, i: int = i) -> Array:
                return scales[name].scaled(self.clear.blurred(i, row, name))

            recording = self.runs[i].recording
            of = []
            series = chain(
                _numbered(_present(scales, scaled), of),
                _history(scales, scaled, recording.filters.rate) if self.history else (),
            )
            batches = _batches(series, max(1, _TOGETHER // recording.t.size))
            decimated_ = (one for batch in batches for one in decimated(np.stack(batch), recording.filters))
            disks.append(DiskSpace().put_each(enumerate(decimated_)))
        return np.asarray(of, np.intp), tuple(disks)


_Key = tuple[str, tuple[str, ...], tuple[int, ...]]
"""Corner or chassis, names of states, numbers of runs."""


def _batches(series: Iterable[_T], size: int) -> Iterator[list[_T]]:
    remaining = iter(series)
    while batch := list(islice(remaining, size)):
        yield batch


def _numbered(functions: Iterable[tuple[int, Array]], of: list[int]) -> Iterator[Array]:
    """The functions alone; each one's state is appended to `of`."""
    for number, series in functions:
        of.append(number)
        yield series


@dataclass(frozen=True)
class _Scale:
    """Scale of a state over all runs: the middle 96 % have length 2 about `middle`; `knots` scaled."""

    velocity: bool
    middle: float
    unit: float
    knots: Array

    @classmethod
    def of(cls, states: Sequence[State]) -> _Scale:
        """From the state in each run."""
        everything = np.concatenate([s.series for s in states])
        low, middle, high = np.quantile(everything, (0.02, 0.5, 0.98))
        if states[0].velocity and low < 0.0 < high:
            middle = 0.0  # friction steps where the velocity changes its sign, not at its median
        unit = 0.5 * float(high - low) or float(np.std(everything)) or 1.0
        knots = np.unique(np.quantile(everything, KNOTS))
        return cls(states[0].velocity, float(middle), unit, (knots - middle) / unit)

    def scaled(self, state: State) -> Array:
        """The state's series in one run."""
        return (state.series - self.middle) / self.unit


def _present(scales: Mapping[str, _Scale], scaled: Callable[[str], Array]) -> Iterator[tuple[int, Array]]:
    """Smooth functions (N,) of a run's `scaled` states, each with the place of its state, −1 for a product."""
    for number, (name, scale) in enumerate(scales.items()):
        x = scaled(name)
        yield number, x
        if scale.knots.size > 2:
            for line in np.eye(scale.knots.size):
                yield number, np.asarray(np.interp(x, scale.knots, line), float)
        if scale.velocity:
            yield number, np.tanh(x / (SOFT * (float(np.sqrt(np.mean(x**2))) or 1.0)))
    paired = [name for name in _PAIRED if name in scales]
    for k, name in enumerate(paired):
        x = scaled(name)
        for other in paired[k:]:
            yield -1, x * scaled(other)


def _history(names: Iterable[str], scaled: Callable[[str], Array], rate: float) -> Iterator[Array]:
    """Lagged and resonating states (N,), in equilibrium at the run's first value."""
    for name in (name for name in _DRIVING if name in names):
        x = scaled(name)
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
