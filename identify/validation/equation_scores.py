"""Scores of a fit's rows from its equations alone: the error ÷ noise floor of `score.compare`, without the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.finished_pieces import piece_totals
from lacet.identify.regression.qr_accumulation import RunEquations
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.noise_floor import SCORE_DRAWS, simulate_floor
from lacet.identify.validation.score import weighted_zeros


@dataclass(frozen=True)
class RowLevel:
    """RMS of a row's residual and the RMS that noise alone would leave, its floor [`Row.unit`]."""

    rms: float
    floor: float

    @property
    def ratio(self) -> float:
        """Residual ÷ floor."""
        return self.rms / self.floor if self.floor else 0.0


def floor_by_row(fitted: Fit, seed: int = 1) -> Mapping[Row, float]:
    """Row → RMS that noise alone leaves on a fit's only run, from the draws of `score.compare` [N or N·m]."""
    return simulate_floor(fitted.runs, fitted.sensitive_pieces, SCORE_DRAWS, seed).by_run[0]


def column_totals(fitted: Fit) -> dict[Row, Array]:
    """Row → (z + p + 1,) sums over the samples of a fit's only run: of its columns, and of its left side."""
    out: dict[Row, Array] = {}
    for piece in fitted.assembly.pieces_of(0):
        for row, total in piece_totals(piece).items():
            out[row] = out.get(row, 0.0) + total
    return out


def row_levels(
    run: RunEquations, totals: Mapping[Row, Array], x: Array, floor: Mapping[Row, float]
) -> dict[Row, RowLevel]:
    """Levels of a run's residual at parameters `x` by row, the run's zeros estimated as in `score.compare`.

    `totals` : sums over its samples (`column_totals`); `floor` : RMS that noise alone leaves, by row.
    """
    z = len(run.zeros)
    counts = {row: run.counts[row] for row in floor if row in run.triangles}
    columns = {row: run.triangles[row][:, :z] for row in counts}
    right = {row: run.triangles[row][:, -1] - run.triangles[row][:, z:-1] @ x for row in counts}
    sigma: dict[Row, float] = {}
    for row, count in counts.items():
        mean = float(totals[row][-1] - totals[row][z:-1] @ x) / count
        variance = float(right[row] @ right[row]) / count - mean**2
        sigma[row] = max(floor[row], float(np.sqrt(max(0.0, variance))))
    offsets = weighted_zeros(run.priors, columns, right, counts, sigma, floor) if z else np.zeros(0)
    return {
        row: RowLevel(float(np.sqrt(np.sum((right[row] - columns[row] @ offsets) ** 2) / counts[row])), floor[row])
        for row in counts
    }
