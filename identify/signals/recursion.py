"""Recursive filters: difference equations with constant coefficients, solved as banded linear systems."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from lacet.identify.multibody.vectors import Array


def recursion(b: Sequence[float], a: Sequence[float], x: Array) -> Array:
    """The series y (…, N) with Σ a_k y[n−k] = Σ b_k x[n−k], at rest before the first sample of `x` (…, N).

    The same as `scipy.signal.lfilter`, whose module takes longer to import than a run to fit.
    """
    n = x.shape[-1]
    right = np.zeros_like(x)
    for lag, factor in enumerate(b):
        right[..., lag:] += factor * x[..., : n - lag]
    band = np.repeat(np.asarray(a, float)[:, None], n, axis=1)
    solved = scipy.linalg.solve_banded((len(a) - 1, 0), band, right.reshape(-1, n).T)
    return np.ascontiguousarray(np.asarray(solved, float).T).reshape(x.shape)
