"""Lowest and highest of each column of pixels or block of samples: what a picture shows without losing a peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST_A_COLUMN = 2
"""Samples to a column of pixels up to which a series is drawn as it is: no more are kept of a denser one."""


def envelope_places(x: NDArray[np.float64], y: NDArray[np.float64], columns: int) -> NDArray[np.intp]:
    """Places of the samples that a picture of so many columns of pixels shows: the ends, and each column's extremes.

    Parameters
    ----------
    x : (n,) ascending.
    y : (n,); a column with a value that is not finite keeps that place too, so that a hole remains one.
    columns : columns of pixels over the whole of `x`.
    """
    n = x.size
    if n <= MOST_A_COLUMN * columns:
        return np.arange(n)
    column = np.minimum(((x - x[0]) * (columns / (x[-1] - x[0]))).astype(np.intp), columns - 1)
    order = np.lexsort((y, column))  # NaN comes last of its column
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    ends = np.append(starts[1:], n) - 1
    holes = np.flatnonzero(~np.isfinite(y))
    finite = ends - np.bincount(np.searchsorted(starts, holes, "right") - 1, minlength=starts.size)
    highest = order[np.maximum(finite, starts)]
    return np.unique(np.concatenate([[0, n - 1], order[starts], highest, order[ends]]))


def block_extremes(values: NDArray[np.float32], block: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lowest and highest of each block of samples, NaN where a block has none: shape (⌈n / block⌉,) each.

    Parameters
    ----------
    values : (n,); NaN are holes.
    block : samples of a block; the last may have fewer.
    """
    blocks = -(-values.size // block)
    padded = np.full(blocks * block, np.nan, values.dtype)
    padded[: values.size] = values
    across = np.ascontiguousarray(padded.reshape(blocks, block).T)  # ten times as fast as along the blocks
    return np.fmin.reduce(across, axis=0), np.fmax.reduce(across, axis=0)


def thinned(x: ArrayLike, y: ArrayLike, step: float, most: int) -> NDArray[np.intp]:
    """Places of the dots that a picture of a cloud shows: one of those within each square.

    Parameters
    ----------
    x, y : (n,) places of the dots.
    step : side of a square.
    most : dots above which larger squares are taken.
    """
    places = np.stack([np.asarray(x, float), np.asarray(y, float)])
    while True:
        cells = np.round(places / step).T @ np.array([1.0, 1j])
        kept = np.sort(np.unique(cells, return_index=True)[1])
        if kept.size <= most:
            return kept
        step *= 1.25
