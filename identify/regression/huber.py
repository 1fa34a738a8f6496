"""Robust weights (Huber) of the rows, second by second: a second with a large residual gets less weight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Assembly
from lacet.identify.regression.qr_accumulation import Equations

SECOND = 1.0
"""Length of the interval that has one weight [s]."""
THRESHOLD = 2.5
"""RMS residual of a second ÷ median of its row, above which its weight falls in inverse proportion [ratio]."""


@dataclass(frozen=True)
class BadSecond:
    """Interval of a row with a reduced weight: `start`, `stop` [s since the run's start], `weight` below 1."""

    run: str
    row: Row
    start: float
    stop: float
    weight: float


@dataclass(frozen=True)
class SecondSizes:
    """RMS of the residual, second by second.

    Attributes
    ----------
    sizes : run, piece, row → (s,) RMS of each second [N or N·m].
    second : run, piece, row → (n,) place of each sample's second in `sizes`.
    """

    sizes: Mapping[tuple[int, int | None, Row], Array]
    second: Mapping[tuple[int, int | None, Row], NDArray[np.intp]]

    @classmethod
    def of(cls, assembly: Assembly, equations: Equations, x: Array, sigma: Mapping[Row, float]) -> SecondSizes:
        """Those of the residuals at `x`."""
        zeros = equations.zeros(x, sigma)
        size: dict[tuple[int, int | None, Row], Array] = {}
        second: dict[tuple[int, int | None, Row], NDArray[np.intp]] = {}
        for piece in assembly.pieces():
            filters = piece.prepared.recording.filters
            for row, block in piece.blocks.items():
                residual = piece.right[row] - block @ np.concatenate([zeros[piece.run], x])
                place = np.floor(piece.instants[row] * filters.step / filters.rate / SECOND).astype(int)
                numbers, which, counts = np.unique(place, return_inverse=True, return_counts=True)
                key = (piece.run, piece.number, row)
                size[key] = np.sqrt(np.bincount(which, residual**2, len(numbers)) / counts)
                second[key] = which
        return cls(size, second)

    def by_row(self) -> dict[Row, Array]:
        """Row → the sizes of all its seconds."""
        rows = dict.fromkeys(row for _, _, row in self.sizes)
        return {row: np.concatenate([s for (_, _, r), s in self.sizes.items() if r == row]) for row in rows}

    def weights(self, usual: Mapping[Row, float]) -> dict[tuple[int, int | None], Mapping[Row, Array]]:
        """Roots of the samples' weights: (run, piece) → row → (n,), where `usual` are the rows' median seconds."""
        roots: dict[tuple[int, int | None], dict[Row, Array]] = {}
        for (run, number, row), rms in self.sizes.items():
            weight = np.minimum(1.0, THRESHOLD * usual[row] / np.maximum(rms, 1e-300))
            roots.setdefault((run, number), {})[row] = np.sqrt(weight)[self.second[run, number, row]]
        return dict(roots)


def usual_sizes(by_row: Mapping[Row, Array]) -> dict[Row, float]:
    """Row → its median second over all runs, which bad seconds do not move: the measure of the row (Huber, 1964)."""
    return {row: float(np.median(sizes)) for row, sizes in by_row.items()}


def bad_seconds(assembly: Assembly, names: Sequence[str]) -> list[BadSecond]:
    """Intervals with a weight below 1, smallest weight first."""
    out: list[BadSecond] = []
    for piece in assembly.pieces():
        if piece.weights is None:
            continue
        filters = piece.prepared.recording.filters
        for row, roots in piece.weights.items():
            t = piece.instants[row] * filters.step / filters.rate
            place = np.floor(t / SECOND).astype(int)
            for number in np.unique(place[roots < 1.0]):
                weight = float(roots[place == number][0] ** 2)
                out.append(BadSecond(names[piece.run], row, float(number) * SECOND, float(number + 1) * SECOND, weight))
    return sorted(out, key=lambda bad: bad.weight)
