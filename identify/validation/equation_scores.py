"""Scores of a fit's rows from its equations alone: the error ÷ noise floor of `score.compare`, without the run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sensor_offsets import Zeros
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.noise_floor import SCORE_DRAWS, simulate_floor
from lacet.identify.validation.score import RowScore, profile_zeros, score_row


def floor_by_row(fitted: Fit, seed: int = 1) -> Mapping[Row, float]:
    """Row → RMS that noise alone leaves on a fit's only run, from the draws of `score.compare` [N or N·m]."""
    return simulate_floor(fitted.runs, fitted.sensitive_pieces, SCORE_DRAWS, seed).by_run[0]


def row_scores(fitted: Fit, floor: Mapping[Row, float]) -> dict[Row, RowScore]:
    """Scores of a fit of one run by row, without colour; `floor` : RMS that noise alone leaves, by row."""
    run, equations = fitted.runs[0], fitted.equations.runs[0]
    z, x = len(equations.zeros), fitted.theta[fitted.place]
    columns: dict[Row, list[Array]] = {row: [] for row in run.rows}
    residual: dict[Row, list[Array]] = {row: [] for row in run.rows}
    measured: dict[Row, list[Array]] = {row: [] for row in run.rows}
    for piece in fitted.assembly.pieces_of(0):
        for row, block in piece.blocks.items():
            columns[row].append(block[:, :z])
            residual[row].append(piece.right[row] - block[:, z:] @ x)
            measured[row].append(piece.right[row])
    table = {row: np.concatenate(parts) for row, parts in columns.items()}
    left = {row: np.concatenate(parts) for row, parts in residual.items()}
    offsets = profile_zeros(run, Zeros(equations.zeros, equations.priors, table), left, floor)
    return {
        row: score_row(row, np.concatenate(measured[row]), left[row] - table[row] @ offsets, floor[row])
        for row in run.rows
    }
