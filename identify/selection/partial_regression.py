"""Partial regression (Frisch, Waugh and Lovell) from cross products: columns less what nuisance parameters explain.

Source: M. C. Lovell, Seasonal adjustment of economic time series, Journal of the American Statistical Association 58
(1963); noise in the columns: W. A. Fuller, Measurement Error Models (1987).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.cross_products import CandidateColumns, CrossProducts, Layout, Trial
from lacet.identify.selection.settings import SELECTION


class PartialRegression:
    """Cross products of all columns after regression on the nuisance columns, with Gaussian priors (ridge).

    Noise in the nuisance columns would make what they explain too small, and noise they share with the residual is no
    explanation: the cross products are corrected for both first (errors in variables).

    Parameters
    ----------
    sums : products of all columns.
    nuisance : (a,) places of the nuisance columns.
    prior : (a, a) normal matrix of what is known of their parameters.
    noise : (w, w) what noise adds to the sums, but to the residual's own square.
    prior_side : (a,) right side that goes with `prior`, where the means of the priors are not zero.

    Attributes
    ----------
    column_noise : that noise, less where a direction of the nuisance columns is mostly noise.
    total : (w, w) products without it.
    gain : (a, w) regression of each column on the nuisance columns.
    reduced : (w, w) reduced normal matrix: products of what the nuisance parameters do not explain, without noise.
    noise : (w, w) products of the noise in the reduced columns.
    """

    def __init__(
        self, sums: CrossProducts, nuisance: NDArray[np.intp], prior: Array, noise: Array | None = None,
        prior_side: Array | None = None,
    ):  # fmt: skip
        self.sums, self.nuisance, self.prior = sums, nuisance, prior
        self.prior_side = np.zeros(len(nuisance)) if prior_side is None else prior_side
        self.column_noise = np.zeros_like(sums.total) if noise is None else _bounded(noise, sums.total, nuisance, prior)
        self.total = sums.total - self.column_noise
        self.gain, self.reduced = self._without(self.total)
        self.noise = at_gain(self.column_noise, nuisance, self.gain)

    @cached_property
    def reduced_noisy(self) -> Array:
        """(w, w) reduced normal matrix with the noise in it."""
        return self.reduced + self.noise

    @cached_property
    def inverse(self) -> Array:
        """(a, a) inverse of the normal matrix of the nuisance parameters."""
        return _inverted(self.total[np.ix_(self.nuisance, self.nuisance)] + self.prior)

    @cached_property
    def outside(self) -> list[tuple[Array, Array, Array]]:
        """For each fold, `inverse`, `gain` and `reduced` of the samples outside it."""
        out: list[tuple[Array, Array, Array]] = []
        for normal in self.sums.train - (1.0 - 1.0 / SELECTION.folds) * self.column_noise:
            inverse = _inverted(normal[np.ix_(self.nuisance, self.nuisance)] + self.prior)
            out.append((inverse, *self._without(normal)))
        return out

    @cached_property
    def inside(self) -> Array:
        """(SELECTION.folds, w, w) products of the samples in each fold, without noise."""
        return self.sums.test - self.column_noise / SELECTION.folds

    @cached_property
    def folds(self) -> list[tuple[Array, Array]]:
        """For each fold, `reduced` of the samples outside it, and the products inside at the gain found outside."""
        return [
            (remainder, at_gain(inside, self.nuisance, gain))
            for (_, gain, remainder), inside in zip(self.outside, self.inside, strict=True)
        ]

    def _without(self, normal: Array) -> tuple[Array, Array]:
        right = normal[self.nuisance]
        right[:, -1] += self.prior_side
        gain = _solved(normal[np.ix_(self.nuisance, self.nuisance)] + self.prior, right)
        return gain, normal - normal[self.nuisance].T @ gain

    def fall(self, place: slice) -> float:
        """Fall of the weighted squares in blocked cross-validation when the columns at `place` are added."""
        right, total, noise = self.sums.layout.right, 0.0, self.noise[place, place]
        for train, test in self.folds:
            beta = _solved(train[place, place] + (1.0 - 1.0 / SELECTION.folds) * noise, train[place, right])
            total += float(
                2.0 * beta @ test[place, right] - beta @ (test[place, place] + noise / SELECTION.folds) @ beta
            )
        return total

    def scores(self, place: slice, null: Array) -> tuple[float, Array]:
        """Fall of the weighted squares on all data, and (D,) that in simulated runs with products `null` (w, D)."""
        G, score = self.reduced_noisy[place, place], self.reduced[place, self.sums.layout.right]
        drawn = null[place] - self.gain[:, place].T @ null[self.nuisance]
        return float(score @ _solved(G, score)), np.einsum("kd,kd->d", drawn, _solved(G, drawn))

    def values(self, place: slice) -> tuple[Array, Array]:
        """Parameters of the columns at `place` when they are added, and 1 σ as if residuals were independent."""
        G, sound = self.reduced_noisy[place, place], self.reduced[place, place]
        score = self.reduced[place, self.sums.layout.right]
        if np.any(np.linalg.eigvalsh(sound) <= 0.0):
            sound = G
        inverse = np.linalg.inv(sound)
        return inverse @ score, np.sqrt(np.diag(inverse @ G @ inverse.T))

    def remaining_energy(self, place: slice) -> Array:
        """(k,) part of each column's energy that the nuisance parameters do not explain."""
        whole = np.diag(self.sums.total)[place]
        return np.diag(self.reduced_noisy)[place] / np.where(whole > 0.0, whole, 1.0)

    def noisy_part(self, place: slice) -> float:
        """Largest part of a direction of the reduced columns that is noise in them."""
        root = np.linalg.cholesky(self.reduced_noisy[place, place])
        half = np.linalg.solve(root, self.noise[place, place])
        return float(np.linalg.eigvalsh(np.linalg.solve(root, half.T))[-1])

    def coefficients(self, places: Array) -> Array:
        """(w, k) coefficients, for `CrossProducts.series`, of combinations `places` (w, k) less their nuisance part."""
        out = places.copy()
        out[self.nuisance] -= self.gain @ places
        return out


@dataclass(frozen=True)
class BlockGains:
    """Falls of the weighted squares of m effects, each added by itself at the size found.

    Attributes
    ----------
    blocks : (B, m) fall in each block of the cross-validation, all rows together.
    before : row → (m,) squares of the residual that an effect is to lower; `taken` those that it takes away.
    counts : row → number of its samples.
    whole : squares of the residual.
    """

    blocks: Array
    before: Mapping[Row, Array]
    taken: Mapping[Row, Array]
    counts: Mapping[Row, int]
    whole: float

    @classmethod
    def of(cls, sums: CrossProducts, effects: Array, before: Array) -> BlockGains:
        """Go once over the samples.

        Parameters
        ----------
        effects : (w, m + 1) coefficients of the columns, as `CrossProducts.series` takes them: of each effect at the
            size found, and of the residual.
        before : (w, m) of the residual that each effect is to lower: without a sensor fault's own tolerance.
        """
        m, rows = before.shape[1], sums.null.keys()
        blocks = np.zeros((sums.block_count, m))
        squares, taken = ({row: np.zeros(m) for row in rows} for _ in range(2))
        counts, whole = dict.fromkeys(rows, 0), 0.0
        for block, series in sums.series(np.concatenate([effects, before], axis=1)):
            effect, remainder, without = series[:, :m], series[:, m : m + 1], series[:, m + 1 :]
            after = (without - effect) ** 2
            np.add.at(blocks, block.number, remainder**2 - after)
            squares[block.row] += np.sum(without**2, axis=0)
            taken[block.row] += np.sum(without**2 - after, axis=0)
            counts[block.row] += len(series)
            whole += float(np.sum(remainder**2))
        return cls(blocks, squares, taken, counts, whole)


def _bounded(noise: Array, total: Array, nuisance: NDArray[np.intp], prior: Array) -> Array:
    """`noise` that leaves something of every direction of the nuisance columns: it is drawn, and not known exactly."""
    inside = np.ix_(nuisance, nuisance)
    B = total[inside] + prior
    values, vectors = scipy.linalg.eigh(noise[inside], B)
    beyond = np.maximum(0.0, values - SELECTION.most_noise_of_direction)
    out = noise.copy()
    turned = B @ vectors
    out[inside] -= (turned * beyond) @ turned.T
    return out


def at_gain(normal: Array, nuisance: NDArray[np.intp], gain: Array) -> Array:
    """(w, w) products of the columns less the nuisance columns times `gain` (a, w)."""
    across = gain.T @ normal[nuisance]
    return normal - across - across.T + gain.T @ normal[np.ix_(nuisance, nuisance)] @ gain


def _inverted(G: Array) -> Array:
    return np.asarray(np.linalg.inv(G), float)


def _solved(G: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(G, right), float)


def beside(
    columns: CandidateColumns, before: PartialRegression, effects: Sequence[Effect], grid: Mapping[str, slice] | None
) -> tuple[PartialRegression, tuple[Trial, ...]]:
    """Partial regression of some effects at their present shapes, on the nuisance columns of `before`.

    `grid` : key → place among `columns` of an effect's best shape, whose noise it has; None without simulated runs.
    """
    fitted, floor, old_layout = columns.linearisation.fitted, columns.linearisation.floor, columns.sums.layout
    own = {trial.place.start: trial.effect for trial in old_layout.trials}
    faults = [place for place in before.nuisance.tolist() if place in own]
    layout = Layout.of(old_layout.model, old_layout.sheet, [*(own[place] for place in faults), *effects])
    floor = floor.without_draws() if grid is None else floor
    sums = CrossProducts.of(fitted, floor, layout, columns.sums.prior_stiffening, {}, np.random.default_rng(0))
    # The sheet's faults now stand one behind the other; their priors stay those of the space.
    plain = before.nuisance[: len(before.nuisance) - len(faults)]
    moved = [trial.place.start for trial in layout.trials[: len(faults)]]
    nuisance = np.concatenate([plain, moved]).astype(np.intp)
    # Noise in a shape off the grid is nearly that of the best on it; shapes are compared by their own columns alone.
    pairs = [(t.place, grid[t.effect.key]) for t in layout.trials[len(faults) :] if grid and t.effect.key in grid]
    new = np.concatenate([nuisance, *(np.r_[place] for place, _ in pairs), [layout.right]]).astype(np.intp)
    old = np.concatenate([before.nuisance, *(np.r_[place] for _, place in pairs), [old_layout.right]]).astype(np.intp)
    noise = np.zeros_like(sums.total)
    noise[np.ix_(new, new)] = before.column_noise[np.ix_(old, old)]
    inside = PartialRegression(sums, nuisance, before.prior, noise, before.prior_side)
    return inside, layout.trials[len(faults) :]
