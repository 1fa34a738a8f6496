"""Sums over the finished pieces of a run, from which the spread of an estimate is computed without their samples.

The covariance of the summed scores (`uncertainty.hac`) is a sum over pairs of instants, so that a matrix for each lag
holds all of it; responses to the sensor sheet and means are sums over the samples. Their size does not grow with the
run. Scores are kept in the columns of zeros and parameters, which lets the zeros be eliminated at any weights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.qr_accumulation import RunEquations
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.regression.uncertainty import Spread, bandwidth, bartlett

LAGS = 70
"""Number of lags kept: as many as a run of 24 h has at 14 samples/s (`uncertainty.bandwidth`)."""


@dataclass(frozen=True)
class Values:
    """Values at which residuals are computed: `both` (z + p,) zeros and parameters; `sigma` row → weight's σ."""

    both: Array
    sigma: Mapping[Row, float]


@dataclass
class LinearSums:
    """Sums over samples that do not depend on any value.

    Attributes
    ----------
    sheet : entry of the sensor sheet → row → (z + p,) columnsᵀ · response to one tolerance.
    totals : row → (z + p + 1,) sums of the columns and of the left side.
    """

    sheet: dict[SheetEntry, dict[Row, Array]] = field(default_factory=dict[SheetEntry, dict[Row, Array]])
    totals: dict[Row, Array] = field(default_factory=dict[Row, Array])

    def copy(self) -> LinearSums:
        """The same sums, to which others can be added."""
        return LinearSums({entry: dict(rows) for entry, rows in self.sheet.items()}, dict(self.totals))

    def add(self, piece: Piece, responses: Mapping[SheetEntry, Mapping[Row, Array]]) -> None:
        """Add a piece with its responses to the sensor sheet."""
        for row, total in piece_totals(piece).items():
            self.totals[row] = self.totals.get(row, 0.0) + total
        for entry, rows in responses.items():
            known = self.sheet.setdefault(entry, {})
            for row, series in rows.items():
                if row in piece.blocks:
                    known[row] = known.get(row, 0.0) + piece.blocks[row].T @ series


def piece_totals(piece: Piece) -> dict[Row, Array]:
    """Row → (z + p + 1,) sums of a piece's columns and of its left side."""
    return {row: np.append(block.sum(axis=0), piece.right[row].sum()) for row, block in piece.blocks.items()}


class ScoreSums:
    """Sums of the products of scores by lag, over the instants of finished pieces one after the other.

    `size` : number of zeros and parameters.
    """

    def __init__(self, size: int):
        self._by_lag = np.zeros((LAGS + 1, size, size))
        self._last = np.zeros((LAGS, size))

    def add(self, scores: Array) -> None:
        """Add the scores (n, z + p) of the instants that follow."""
        self._by_lag += _products(self._last, scores)
        self._last = np.concatenate([self._last, scores])[-LAGS:]

    def covariance(self, scores: Array, length: int) -> Array:
        """(z + p, z + p) `hac` of the instants added and of `scores`, which follow; `length` of the run in instants."""
        lags = min(bandwidth(length), LAGS)
        found = self._by_lag[: lags + 1] + _products(self._last, scores, lags)
        return bartlett(found)


def _products(before: Array, scores: Array, lags: int = LAGS) -> Array:
    """(lags + 1, k, k) Σ s_t s_{t−lag}ᵀ over the instants of `scores`; `before` : the `LAGS` scores before them."""
    both, n = np.concatenate([before, scores]), len(before)
    return np.stack([scores.T @ both[n - lag : len(both) - lag] for lag in range(lags + 1)])


def scores_of(pieces: Sequence[Piece], first: int, count: int, values: Values) -> Array:
    """(count, z + p) scores Σ_rows columnsᵀ residual ÷ σ² of the instants from `first` on, by samples of `pieces`."""
    out = np.zeros((count, len(values.both)))
    for piece in pieces:
        for row, block in piece.blocks.items():
            left = piece.right[row] - block @ values.both
            out[piece.instants[row] - first] += block * (left / values.sigma[row] ** 2)[:, None]
    return out


def spread_from(covariance: Array, linear: LinearSums, run: RunEquations, sigma: Mapping[Row, float]) -> Spread:
    """The spread of a run's estimate, its zeros eliminated; `covariance` (z + p, z + p) of its summed scores."""
    gain = run.following(sigma)[0]
    eliminated = np.concatenate([-gain.T, np.eye(gain.shape[1])], axis=1)
    meat = eliminated @ covariance @ eliminated.T
    if gain.size:
        following = gain / run.priors[:, None]
        meat = following.T @ following + meat
    sheet = {
        entry: eliminated @ np.sum([moved / sigma[row] ** 2 for row, moved in rows.items()], axis=0)
        for entry, rows in linear.sheet.items()
        if rows
    }
    return Spread(meat, sheet)
