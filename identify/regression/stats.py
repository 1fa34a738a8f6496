"""Uncertainty of estimates from residuals that are correlated in time and across rows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array


def clustered_scores(
    rows: Mapping[str, tuple[Array, Array, float]], instants: Mapping[str, NDArray[np.intp]], count: int
) -> Array:
    """Scores g_t = Σ_rows W_tᵀ r_t / σ², (count, p): rows of one instant are added before anything is squared.

    Parameters
    ----------
    rows : by row, (n, p) columns, (n,) residual, σ.
    instants : by row, (n,) index of each sample's instant.
    """
    width = next(iter(rows.values()))[0].shape[1]
    scores = np.zeros((count, width))
    for row, (W, r, sigma) in rows.items():
        scores[instants[row]] += W * (r / sigma**2)[:, None]
    return scores


def hac(scores: Array) -> Array:
    """Driscoll–Kraay covariance of the summed scores with Bartlett weights, (p, p).

    Bandwidth after Newey and West (1994): 4 (T/100)^(2/9), at least 4, doubled because filtered residuals are coloured
    up to the fit's cut-off.
    """
    length = scores.shape[0]
    lags = min(length - 1, 2 * int(np.ceil(4.0 * (length / 100.0) ** (2.0 / 9.0))))
    out = scores.T @ scores
    for lag in range(1, lags + 1):
        cross = scores[lag:].T @ scores[:-lag]
        out += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    # Bartlett's weights keep it positive; what rounding leaves below zero is cut.
    return 0.5 * (out + out.T)
