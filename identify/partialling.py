"""What is left of every column once some of them are partialled out, from sums of products alone."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identify.trial_sums import FOLDS, TrialSums
from identify.vectors import Array


class Partialled:
    """All columns of `sums` less what some of them, with priors, explain.

    Parameters
    ----------
    sums : products of all columns.
    taken : places of the columns partialled out.
    prior : (a, a) normal matrix of what is known of their parameters.

    Attributes
    ----------
    gain : (a, w) what the columns taken explain of each.
    left : (w, w) products of what is left.
    shift : (w,) what noise in the columns adds to their products with the residual.
    noise : place → (k, k) what it adds to the products of the columns of a trial.
    """

    def __init__(self, sums: TrialSums, taken: NDArray[np.intp], prior: Array):
        self.sums, self.taken, self.prior = sums, taken, prior
        self.gain, self.left = _without(sums.total, taken, prior)
        self.shift = np.zeros(sums.layout.width)
        self.noise = {t.place.start: np.zeros((t.place.stop - t.place.start,) * 2) for t in sums.layout.trials}

    @cached_property
    def inverse(self) -> Array:
        """(a, a) of the normal matrix of the columns taken."""
        return _inverted(self.sums.total[np.ix_(self.taken, self.taken)] + self.prior)

    @cached_property
    def outside(self) -> list[tuple[Array, Array, Array]]:
        """For each fold, `inverse`, `gain` and `left` of the samples outside it."""
        out: list[tuple[Array, Array, Array]] = []
        for normal in self.sums.train:
            inverse = _inverted(normal[np.ix_(self.taken, self.taken)] + self.prior)
            out.append((inverse, *_without(normal, self.taken, self.prior)))
        return out

    @cached_property
    def folds(self) -> list[tuple[Array, Array]]:
        """For each fold, `left` of the samples outside it, and the products inside at the gain found outside."""
        return [
            (left, at_gain(inside, self.taken, gain))
            for (_, gain, left), inside in zip(self.outside, self.sums.test, strict=True)
        ]

    def fall(self, place: slice) -> float:
        """Fall of the weighted squares in blocked cross-validation when the columns at `place` are added."""
        right, total = self.sums.layout.right, 0.0
        shift = self.shift[place]
        for train, test in self.folds:
            outside = 1.0 - 1.0 / FOLDS
            beta = _solved(train[place, place], train[place, right] - outside * shift)
            total += float(2.0 * beta @ (test[place, right] - shift / FOLDS) - beta @ test[place, place] @ beta)
        return total

    def scores(self, place: slice, null: Array) -> tuple[float, Array]:
        """Fall of the weighted squares on all data, and (D,) that in simulated runs with products `null` (w, D)."""
        G = self.left[place, place]
        score = self.left[place, self.sums.layout.right] - self.shift[place]
        drawn = null[place] - self.gain[:, place].T @ null[self.taken]
        return float(score @ _solved(G, score)), np.einsum("kd,kd->d", drawn, _solved(G, drawn))

    def values(self, place: slice) -> tuple[Array, Array]:
        """Parameters of the columns at `place` when they are added, and 1 σ as if residuals were independent."""
        G = self.left[place, place]
        sound = G - self.noise[place.start]
        score = self.left[place, self.sums.layout.right] - self.shift[place]
        if np.any(np.linalg.eigvalsh(sound) <= 0.0):
            sound = G
        inverse = np.linalg.inv(sound)
        return inverse @ score, np.sqrt(np.diag(inverse @ G @ inverse.T))

    def remaining(self, place: slice) -> Array:
        """(k,) part of each column's energy that is left."""
        whole = np.diag(self.sums.total)[place]
        return np.diag(self.left)[place] / np.where(whole > 0.0, whole, 1.0)

    def noisy_part(self, place: slice) -> float:
        """Largest part of the energy left in a direction of the columns that is noise in them."""
        G = self.left[place, place]
        root = np.linalg.cholesky(G)
        half = np.linalg.solve(root, self.noise[place.start])
        return float(np.linalg.eigvalsh(np.linalg.solve(root, half.T))[-1])

    def coefficients(self, places: Array) -> Array:
        """(w, k) coefficients, for `TrialSums.series`, of combinations `places` (w, k) less what is partialled out."""
        out = places.copy()
        out[self.taken] -= self.gain @ places
        return out


def _without(normal: Array, taken: NDArray[np.intp], prior: Array) -> tuple[Array, Array]:
    gain = _solved(normal[np.ix_(taken, taken)] + prior, normal[taken])
    return gain, normal - normal[taken].T @ gain


def at_gain(normal: Array, taken: NDArray[np.intp], gain: Array) -> Array:
    """(w, w) products of the columns less those taken times `gain` (a, w)."""
    across = gain.T @ normal[taken]
    return normal - across - across.T + gain.T @ normal[np.ix_(taken, taken)] @ gain


def _inverted(G: Array) -> Array:
    return np.asarray(np.linalg.inv(G), float)


def _solved(G: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(G, right), float)
