"""What is left of every column once some of them are partialled out, from sums of products alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.cross_products import FOLDS, Layout, Trial, TrialColumns, TrialSums

GONE = 1e-10
"""Part of a column's energy below which nothing of it is left."""
MOST = 0.8
"""No more of a direction of the columns partialled out is taken for noise."""


class Partialled:
    """All columns of `sums` less what some of them, with priors, explain.

    Noise in the columns partialled out would make what they explain too small, and noise they share with the residual
    is no explanation: both are taken out of the sums first.

    Parameters
    ----------
    sums : products of all columns.
    taken : places of the columns partialled out.
    prior : (a, a) normal matrix of what is known of their parameters.
    noise : (w, w) what noise adds to the sums, but to the residual's own square.
    pull : (a,) right side that goes with `prior`: where what is known is not zero.

    Attributes
    ----------
    column_noise : that noise, where a direction is mostly noise a part of it.
    total : (w, w) products without it.
    gain : (a, w) what the columns taken explain of each.
    left : (w, w) products of what is left, without noise.
    noise : (w, w) products of the noise in what is left.
    """

    def __init__(
        self, sums: TrialSums, taken: NDArray[np.intp], prior: Array, noise: Array | None = None,
        pull: Array | None = None,
    ):  # fmt: skip
        self.sums, self.taken, self.prior = sums, taken, prior
        self.pull = np.zeros(len(taken)) if pull is None else pull
        self.column_noise = np.zeros_like(sums.total) if noise is None else _bounded(noise, sums.total, taken, prior)
        self.total = sums.total - self.column_noise
        self.gain, self.left = self._without(self.total)
        self.noise = at_gain(self.column_noise, taken, self.gain)

    @property
    def whole(self) -> Array:
        """(w, w) products of what is left, noise and all."""
        return self.left + self.noise

    @cached_property
    def inverse(self) -> Array:
        """(a, a) of the normal matrix of the columns taken."""
        return _inverted(self.total[np.ix_(self.taken, self.taken)] + self.prior)

    @cached_property
    def outside(self) -> list[tuple[Array, Array, Array]]:
        """For each fold, `inverse`, `gain` and `left` of the samples outside it."""
        out: list[tuple[Array, Array, Array]] = []
        for normal in self.sums.train - (1.0 - 1.0 / FOLDS) * self.column_noise:
            inverse = _inverted(normal[np.ix_(self.taken, self.taken)] + self.prior)
            out.append((inverse, *self._without(normal)))
        return out

    @cached_property
    def inside(self) -> Array:
        """(FOLDS, w, w) products of the samples in each fold, without noise."""
        return self.sums.test - self.column_noise / FOLDS

    @cached_property
    def folds(self) -> list[tuple[Array, Array]]:
        """For each fold, `left` of the samples outside it, and the products inside at the gain found outside."""
        return [
            (left, at_gain(inside, self.taken, gain))
            for (_, gain, left), inside in zip(self.outside, self.inside, strict=True)
        ]

    def _without(self, normal: Array) -> tuple[Array, Array]:
        right = normal[self.taken]
        right[:, -1] += self.pull
        gain = _solved(normal[np.ix_(self.taken, self.taken)] + self.prior, right)
        return gain, normal - normal[self.taken].T @ gain

    def fall(self, place: slice) -> float:
        """Fall of the weighted squares in blocked cross-validation when the columns at `place` are added."""
        right, total, noise = self.sums.layout.right, 0.0, self.noise[place, place]
        for train, test in self.folds:
            beta = _solved(train[place, place] + (1.0 - 1.0 / FOLDS) * noise, train[place, right])
            total += float(2.0 * beta @ test[place, right] - beta @ (test[place, place] + noise / FOLDS) @ beta)
        return total

    def scores(self, place: slice, null: Array) -> tuple[float, Array]:
        """Fall of the weighted squares on all data, and (D,) that in simulated runs with products `null` (w, D)."""
        G, score = self.whole[place, place], self.left[place, self.sums.layout.right]
        drawn = null[place] - self.gain[:, place].T @ null[self.taken]
        return float(score @ _solved(G, score)), np.einsum("kd,kd->d", drawn, _solved(G, drawn))

    def values(self, place: slice) -> tuple[Array, Array]:
        """Parameters of the columns at `place` when they are added, and 1 σ as if residuals were independent."""
        G, sound = self.whole[place, place], self.left[place, place]
        score = self.left[place, self.sums.layout.right]
        if np.any(np.linalg.eigvalsh(sound) <= 0.0):
            sound = G
        inverse = np.linalg.inv(sound)
        return inverse @ score, np.sqrt(np.diag(inverse @ G @ inverse.T))

    def remaining(self, place: slice) -> Array:
        """(k,) part of each column's energy that is left."""
        whole = np.diag(self.sums.total)[place]
        return np.diag(self.whole)[place] / np.where(whole > 0.0, whole, 1.0)

    def noisy_part(self, place: slice) -> float:
        """Largest part of the energy left in a direction of the columns that is noise in them."""
        root = np.linalg.cholesky(self.whole[place, place])
        half = np.linalg.solve(root, self.noise[place, place])
        return float(np.linalg.eigvalsh(np.linalg.solve(root, half.T))[-1])

    def coefficients(self, places: Array) -> Array:
        """(w, k) coefficients, for `TrialSums.series`, of combinations `places` (w, k) less what is partialled out."""
        out = places.copy()
        out[self.taken] -= self.gain @ places
        return out


def _bounded(noise: Array, total: Array, taken: NDArray[np.intp], prior: Array) -> Array:
    """`noise` that leaves something of every direction of the columns taken: it is drawn, and not known exactly."""
    inside = np.ix_(taken, taken)
    B = total[inside] + prior
    values, vectors = scipy.linalg.eigh(noise[inside], B)
    beyond = np.maximum(0.0, values - MOST)
    out = noise.copy()
    turned = B @ vectors
    out[inside] -= (turned * beyond) @ turned.T
    return out


def at_gain(normal: Array, taken: NDArray[np.intp], gain: Array) -> Array:
    """(w, w) products of the columns less those taken times `gain` (a, w)."""
    across = gain.T @ normal[taken]
    return normal - across - across.T + gain.T @ normal[np.ix_(taken, taken)] @ gain


def _inverted(G: Array) -> Array:
    return np.asarray(np.linalg.inv(G), float)


def _solved(G: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(G, right), float)


def beside(
    columns: TrialColumns, before: Partialled, effects: Sequence[Effect], grid: Mapping[str, slice] | None
) -> tuple[Partialled, tuple[Trial, ...]]:
    """Columns of some effects at their present shapes, less what model, zeros and sheet explain, as in `before`.

    `grid` : key → place among `columns` of an effect's best shape, whose noise it has; None without simulated runs.
    """
    fitted, floor, old_layout = columns.reading.fitted, columns.reading.floor, columns.sums.layout
    own = {trial.place.start: trial.effect for trial in old_layout.trials}
    faults = [place for place in before.taken.tolist() if place in own]
    layout = Layout.of(old_layout.model, old_layout.sheet, [*(own[place] for place in faults), *effects])
    floor = floor.without_draws() if grid is None else floor
    sums = TrialSums.of(fitted, floor, layout, columns.sums.temper, {}, np.random.default_rng(0))
    # The sheet's faults now stand one behind the other; their priors stay those of the space.
    plain = before.taken[: len(before.taken) - len(faults)]
    moved = [trial.place.start for trial in layout.trials[: len(faults)]]
    taken = np.concatenate([plain, moved]).astype(np.intp)
    # Noise in a shape off the grid is nearly that of the best on it; shapes are compared by their own columns alone.
    pairs = [(t.place, grid[t.effect.key]) for t in layout.trials[len(faults) :] if grid and t.effect.key in grid]
    new = np.concatenate([taken, *(np.r_[place] for place, _ in pairs), [layout.right]]).astype(np.intp)
    old = np.concatenate([before.taken, *(np.r_[place] for _, place in pairs), [old_layout.right]]).astype(np.intp)
    noise = np.zeros_like(sums.total)
    noise[np.ix_(new, new)] = before.column_noise[np.ix_(old, old)]
    inside = Partialled(sums, taken, before.prior, noise, before.pull)
    return inside, layout.trials[len(faults) :]
