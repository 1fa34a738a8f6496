"""Ridge regressions in cross-validation by folds of blocks, from sums over stretches of the samples.

The samples are passed over twice, a stretch at a time: once for the sums of products by fold, from which every ridge is
judged, and once for what the best ridges miss in each block.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array

FOLDS = 5
RIDGE = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Candidates of ridge ÷ number of samples, for columns of unit size; the best is used, or no column at all."""


class Stretch(NamedTuple):
    """Some samples: `columns` (n, m) of unit size, `targets` (n, k), `blocks` (n,) increasing block numbers from 0."""

    columns: Array
    targets: Array
    blocks: NDArray[np.intp]


@dataclass(frozen=True)
class FoldSums:
    """Sums over the samples of each fold, every fifth block: `grams` (F, m, m) of the columns' products, `moments`
    (F, m, k) of columns and targets, `squares` (F, k) of the targets, `counts` (F,) of samples."""

    grams: Array
    moments: Array
    squares: Array
    counts: NDArray[np.intp]

    @classmethod
    def of(cls, stretches: Iterable[Stretch]) -> FoldSums:
        """Of all stretches. Raises ValueError without any."""
        sums: FoldSums | None = None
        for columns, targets, blocks in stretches:
            if sums is None:
                m, k = columns.shape[1], targets.shape[1]
                zeros = np.zeros((FOLDS, m, m)), np.zeros((FOLDS, m, k)), np.zeros((FOLDS, k)), np.zeros(FOLDS, np.intp)
                sums = cls(*zeros)
            for fold in range(FOLDS):
                own = blocks % FOLDS == fold
                part, aims = columns[own], targets[own]
                sums.grams[fold] += part.T @ part
                sums.moments[fold] += part.T @ aims
                sums.squares[fold] += np.sum(aims**2, axis=0)
                sums.counts[fold] += len(aims)
        if sums is None:
            raise ValueError("no samples")
        return sums

    def ridges(self, columns: NDArray[np.intp], weights: Array | None = None) -> Ridges:
        """Ridge regressions on some of the columns, each multiplied by its weight."""
        return Ridges.of(self, columns, np.ones(columns.size) if weights is None else weights)


@dataclass(frozen=True)
class Ridges:
    """Ridge regressions on (c,) `columns` times `weights` (c,), one for each fold, on the samples of the others.

    Attributes
    ----------
    among : number m of all columns.
    values, vectors : (F, c), (F, c, c) eigenvalues and eigenvectors of the products' sums; `turned` (F, c, k) sums of
        products with the targets in the vectors' axes; `trained` (F,) number of samples.
    squares : (1 + L, k) what is missed of the targets in all folds: without any column, then for each of `RIDGE`.
    """

    columns: NDArray[np.intp]
    weights: Array
    among: int
    values: Array
    vectors: Array
    turned: Array
    trained: NDArray[np.intp]
    squares: Array

    @classmethod
    def of(cls, sums: FoldSums, columns: NDArray[np.intp], weights: Array) -> Ridges:
        """From the sums of the folds."""
        grams = sums.grams[:, columns[:, None], columns] * (weights[:, None] * weights)
        moments = sums.moments[:, columns] * weights[:, None]
        found = np.linalg.eigh(grams.sum(axis=0) - grams)
        values, vectors = np.maximum(found[0], 0.0), np.asarray(found[1], float)
        turned = vectors.transpose(0, 2, 1) @ (moments.sum(axis=0) - moments)
        trained = np.asarray(sums.counts.sum() - sums.counts, np.intp)
        own, aims = vectors.transpose(0, 2, 1) @ grams @ vectors, vectors.transpose(0, 2, 1) @ moments
        squares = [sums.squares.sum(axis=0)]
        for ridge in RIDGE:
            x = turned / (values + ridge * trained[:, None])[..., None]
            squares.append(np.sum(sums.squares + np.sum(x * (own @ x - 2.0 * aims), axis=1), axis=0))
        return cls(columns, weights, sums.grams.shape[1], values, vectors, turned, trained, np.stack(squares))

    def coefficients(self, choice: NDArray[np.intp]) -> Array:
        """(F, c, k) coefficients of the columns, target by target by the regression `choice` (k,) of `squares`."""
        ridge = np.array([np.inf, *RIDGE])[choice]
        damped = self.values[:, :, None] + self.trained[:, None, None] * ridge
        return self.weights[:, None] * (self.vectors @ (self.turned / damped))


def best(candidates: Sequence[Ridges]) -> tuple[Array, Array]:
    """The best of all candidates for each target: (k,) squares missed, and coefficients (F, m, k) of all columns."""
    squares = np.concatenate([one.squares for one in candidates])
    place = np.asarray(np.argmin(squares, axis=0), np.intp)
    each = 1 + len(RIDGE)
    out = np.zeros((FOLDS, candidates[0].among, place.size))
    for number, one in enumerate(candidates):
        own = np.flatnonzero(place // each == number)
        if own.size:
            out[:, one.columns[:, None], own] = one.coefficients(place % each)[:, :, own]
    return np.min(squares, axis=0), out


def missed(stretches: Iterable[Stretch], coefficients: Sequence[Array], blocks: int) -> list[Array]:
    """(blocks, k) squares of the targets that each regression misses, and before these the targets' own.

    `coefficients` : of each regression (F, m, k), those of the fold that holds a block being from the others.
    """
    out: list[Array] = []
    for columns, targets, number in stretches:
        if not out:
            out = [np.zeros((blocks, targets.shape[1])) for _ in range(1 + len(coefficients))]
        for fold in range(FOLDS):
            own = np.flatnonzero(number % FOLDS == fold)
            if not own.size:
                continue
            within, starts = np.unique(number[own], return_index=True)
            part, aims = columns[own], targets[own]
            out[0][within] += np.add.reduceat(aims**2, starts, axis=0)
            for sums, x in zip(out[1:], coefficients, strict=True):
                error = aims - part @ x[fold]
                sums[within] += np.add.reduceat(error**2, starts, axis=0)
    return out
