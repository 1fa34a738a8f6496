"""The R factor of a least-squares problem: all that its equations say, in a square, however many equations there were.

Factors of parts are merged by stacking them and factorising again, exactly: that is how chunks of a run, and runs, add
up (Golub and Van Loan, Matrix Computations, section 5.3).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from lacet.identify.multibody.vectors import Array


def triangle(part: Array, *others: Array) -> Array:
    """The R factor of parts stacked over each other, (k, k), filled up with zeros when there are fewer rows."""
    stacked = np.concatenate([part, *others]) if others else part
    width = stacked.shape[1]
    R = np.asarray(scipy.linalg.qr(stacked, mode="r")[0], float)[:width]
    lacking = width - R.shape[0]
    return np.concatenate([R, np.zeros((lacking, width))]) if lacking else R


def scaled_triangle(stacked: Array) -> tuple[Array, Array]:
    """R factor of the matrix with its columns brought to unit length, and their lengths (1 for an empty column)."""
    lengths = np.linalg.norm(stacked, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    return triangle(stacked / lengths), lengths


def narrow_triangle(stacked: Array) -> Array:
    """The R factor, only its active columns factorised: columns without any entry stay empty at no cost."""
    active = np.flatnonzero(np.any(stacked != 0.0, axis=0))
    out = np.zeros((len(active), stacked.shape[1]))
    out[:, active] = triangle(stacked[:, active])
    return out
