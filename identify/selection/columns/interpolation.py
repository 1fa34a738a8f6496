"""Interpolation of an effect's columns between the values of a shape constant's grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.selection.settings import SELECTION


def searched_in_ratios(effect: Effect, constant: str) -> bool:
    """Whether a shape constant is searched in ratios: its bounds are positive, and far apart."""
    low, high = effect.bounds_of(constant)
    return low > 0.0 and high >= SELECTION.least_ratio_of_bounds * low


def interpolation_weights(values: Sequence[float], at: float, ratios: bool) -> list[tuple[float, float]]:
    """Values of a grid with their weights in the interpolation of a column at `at`; beyond the grid the outermost.

    Linear between two values; where the constant is searched in `ratios`, quadratic in its logarithm over three, as the
    values are far apart (Lagrange).
    """
    grid = np.array(sorted(values))
    at = float(np.clip(at, grid[0], grid[-1]))
    if at in grid:
        return [(at, 1.0)]
    above = int(np.searchsorted(grid, at))
    if not ratios or grid.size <= 2:
        near = grid[above - 1 : above + 1]
        own, place = near, at
    else:
        # The third is the neighbour that is nearer in ratio.
        lower = above >= 2 and (above + 1 == grid.size or at / grid[above - 2] < grid[above + 1] / at)
        first = above - 2 if lower else above - 1
        near = grid[first : first + 3]
        own, place = np.log(near), np.log(at)
    weights = [
        float(np.prod([(place - other) / (one - other) for k, other in enumerate(own.tolist()) if k != i]))
        for i, one in enumerate(own.tolist())
    ]
    return list(zip(near.tolist(), weights, strict=True))
