"""Constant of a law that is not linear, searched between the values of its grid, with its interval."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.chains.effects import JointEffect
from lacet.identify.chains.weights import serial_quantile
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.uncertainty import hac

_CLOSE = 1e-3
"""Ratio of a constant's neighbours, less 1, at which the search ends, and that of the differences that give how columns
change with it [ratio]: numerical."""

Columns = Callable[[JointEffect], Array | None]
"""Weighted columns (r, k) of a law beside the model's; None where nothing of them remains."""


def searched(effect: JointEffect, columns: Columns, residual: Array) -> JointEffect:
    """The law with the constant at which it takes most squares off a residual (r,).

    The search goes from the value that it has, which is the best of its grid, to its neighbours there, and no further
    than the grid's ends: beyond them the law has the shape of others.
    """
    grid, here = np.log(effect.grid), np.log(effect.constant)

    def remaining(logarithm: float) -> float:
        X = columns(effect.at(float(np.exp(logarithm))))
        return 0.0 if X is None else -float(residual @ X @ np.linalg.solve(X.T @ X, X.T @ residual))

    low = max(grid[grid < here - _CLOSE], default=here)
    high = min(grid[grid > here + _CLOSE], default=here)
    best = scipy.optimize.minimize_scalar(remaining, bounds=(low, high), method="bounded", options={"xatol": _CLOSE})
    return effect.at(float(np.exp(best.x))) if best.fun < remaining(here) else effect


def half_of_constant(
    effect: JointEffect, columns: Columns, residual: Array, given: Array, instant: NDArray[np.intp]
) -> float:  # fmt: skip
    """Half of the 95 % interval of a law's constant [SI], of a residual (r,) whose rows belong to so many instants.

    By how the law's columns change with it, at the sizes found: that change is one more column, beside which residuals
    are correlated in time and across joints. `given` : (r,) factor that gives back what the fit takes off a residual.
    """
    X, *near = (columns(effect.at(effect.constant * factor)) for factor in (1.0, 1.0 - _CLOSE, 1.0 + _CLOSE))
    less, more = near
    if X is None or less is None or more is None:
        return float("inf")
    beta = np.asarray(np.linalg.solve(X.T @ X, X.T @ residual), float)
    Z = np.column_stack([X, (more - less) @ beta / (2.0 * _CLOSE)])
    G = np.asarray(np.linalg.pinv(Z.T @ Z), float)
    each = Z * (given * (residual - Z @ (G @ (Z.T @ residual))))[:, None]
    scores = np.zeros((int(instant.max()) + 1, Z.shape[1]))
    np.add.at(scores, instant, each)
    variance = max(float(G[-1] @ S @ G[-1]) for S in (hac(scores), each.T @ each))
    return effect.constant * serial_quantile(len(scores)) * variance**0.5
