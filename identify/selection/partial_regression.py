"""Partial regression (Frisch, Waugh and Lovell) of columns on nuisance columns, from their cross products.

Source: M. C. Lovell, Seasonal adjustment of economic time series, Journal of the American Statistical Association 58
(1963); noise in the columns: W. A. Fuller, Measurement Error Models (1987).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import add
from typing import Any, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.candidate_columns import CandidateColumns
from lacet.identify.selection.columns.cross_products import CrossProducts, Extent
from lacet.identify.selection.columns.layout import Layout, Trial
from lacet.identify.selection.columns.regressor_noise import combined
from lacet.identify.selection.columns.samples import RunSamples
from lacet.identify.selection.settings import SELECTION

V = TypeVar("V", bound=Any)


class PartialRegression:
    """Cross products of all columns after regression on the nuisance columns, with Gaussian priors (ridge).

    Noise in the nuisance columns makes their regression coefficients too small, and noise that they share with the
    residual correlates with it: the cross products are corrected for both first (errors in variables).

    Parameters
    ----------
    sums : cross products of all columns.
    nuisance : (a,) places of the nuisance columns.
    prior : (a, a) normal matrix of their priors.
    noise : (w, w) expected products of the noise in the columns; 0 for the residual's square.
    prior_side : (a,) right side of the priors; None for means of zero.

    Attributes
    ----------
    column_noise : (w, w) the noise as corrected for, limited where a direction of the nuisance columns is mostly noise.
    total : (w, w) cross products less that noise.
    gain : (a, w) regression of each column on the nuisance columns.
    reduced : (w, w) reduced normal matrix: products of the remainders of the columns, less noise.
    noise : (w, w) expected products of the noise in the remainders.
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
        """(w, w) reduced normal matrix without the correction for noise."""
        return self.reduced + self.noise

    @cached_property
    def inverse(self) -> Array:
        """(a, a) inverse of the normal matrix of the nuisance parameters."""
        return _inverted(self.total[np.ix_(self.nuisance, self.nuisance)] + self.prior)

    @cached_property
    def outside(self) -> list[tuple[Array, Array, Array]]:
        """For each fold, `inverse`, `gain` and `reduced` of the samples outside it."""
        out: list[tuple[Array, Array, Array]] = []
        for train in self.sums.over_runs.train:
            normal = train - (1.0 - 1.0 / SELECTION.folds) * self.column_noise
            inverse = _inverted(normal[np.ix_(self.nuisance, self.nuisance)] + self.prior)
            out.append((inverse, *self._without(normal)))
        return out

    def inside(self, fold: int, *places: NDArray[np.intp]) -> Array:
        """Products of the samples in a fold, without noise: of all columns, or of those at two `places`."""
        part = np.ix_(*places) if places else ...
        return np.asarray(self.sums.over_runs.test[fold][part] - self.column_noise[part] / SELECTION.folds)

    @cached_property
    def folds(self) -> list[tuple[Array, Array]]:
        """For each fold (w, w) `reduced` of the samples outside, and products inside with the gain found outside."""
        return [
            (remainder, at_gain(self.inside(fold), self.nuisance, gain))
            for fold, (_, gain, remainder) in enumerate(self.outside)
        ]

    def _without(self, normal: Array) -> tuple[Array, Array]:
        right = normal[self.nuisance]
        right[:, -1] += self.prior_side
        gain = _solved(normal[np.ix_(self.nuisance, self.nuisance)] + self.prior, right)
        return gain, normal - normal[self.nuisance].T @ gain

    def fall(self, place: slice, above_noise: bool = False) -> float:
        """Fall of the weighted squares in blocked cross-validation when the columns at `place` are added.

        `above_noise` : of what exceeds the noise of the equations, which is another with the columns than without.
        """
        right, total = self.sums.layout.right, 0.0
        noise = (self.column_noise if above_noise else self.noise)[place, place]
        for train, test in self.folds:
            beta = _solved(train[place, place] + (1.0 - 1.0 / SELECTION.folds) * noise, train[place, right])
            total += float(
                2.0 * beta @ test[place, right] - beta @ (test[place, place] + noise / SELECTION.folds) @ beta
            )
        return total

    def scores(self, place: slice, null: Array) -> tuple[float, Array]:
        """Fall of the weighted squares on all data by the columns at `place`, and (D,) with simulated `null` (w, D)."""
        G, score = self.reduced_noisy[place, place], self.reduced[place, self.sums.layout.right]
        drawn = null[place] - self.gain[:, place].T @ null[self.nuisance]
        return float(score @ _solved(G, score)), np.einsum("kd,kd->d", drawn, _solved(G, drawn))

    def values(self, place: slice) -> tuple[Array, Array]:
        """Estimates of the parameters of the columns at `place`, and their 1 σ for independent residuals."""
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
        """Largest share of noise in the energy of a direction of the reduced columns at `place`."""
        root = np.linalg.cholesky(self.reduced_noisy[place, place])
        half = np.linalg.solve(root, self.noise[place, place])
        return float(np.linalg.eigvalsh(np.linalg.solve(root, half.T))[-1])

    def own_noisy_part(self, place: slice) -> float:
        """The same of the noise in the columns themselves, without what the nuisance columns bring into the remainders.

        The latter does not hide what an effect would do: it is the noise that the equations have at the parameters of
        a model with the effect.
        """
        scale = np.sqrt(np.diag(self.reduced_noisy)[place])
        sound, own = (one[place, place] / np.outer(scale, scale) for one in (self.reduced, self.column_noise))
        if np.linalg.eigvalsh(sound)[0] <= SELECTION.shared_eigenvalue:
            return 1.0
        # The noise is an estimate from draws, and of a direction it may be less than nothing.
        ratio = max(0.0, float(scipy.linalg.eigvalsh(own, sound)[-1]))
        return ratio / (1.0 + ratio)

    def coefficients(self, places: Array) -> Array:
        """(w, k) coefficients for `CrossProducts.series` of combinations `places` (w, k), less their regression."""
        out = places.copy()
        out[self.nuisance] -= self.gain @ places
        return out


@dataclass(frozen=True)
class BlockGains:
    """Falls of the weighted squares, block by block, by m effects, each added alone at its estimated size.

    Attributes
    ----------
    blocks : (B, m) fall in each block of the cross-validation, all rows together.
    before : row → (m,) sum of squares of the residual before the effect is added; `taken` its fall.
    counts : row → number of samples.
    whole : sum of squares of the residual.
    """

    blocks: Array
    before: Mapping[Row, Array]
    taken: Mapping[Row, Array]
    counts: Mapping[Row, int]
    whole: float


@dataclass(frozen=True)
class GainsTask:
    """Gains by m effects, as a task for the samples of each run.

    Attributes
    ----------
    effects : (w, m + 1) coefficients of the columns: of each effect at its estimated size, and of the residual.
    before : (w, m) coefficients of the residual before each effect: for a sensor fault without its own tolerance.
    """

    effects: Array
    before: Array

    def of_run(self, run: RunSamples) -> BlockGains:
        """The gains in one run."""
        m = self.before.shape[1]
        blocks = np.zeros((run.block_count, m))
        squares: dict[Row, Array] = {}
        taken: dict[Row, Array] = {}
        counts: dict[Row, int] = {}
        whole = 0.0
        for block, series in run.series(np.concatenate([self.effects, self.before], axis=1)):
            effect, remainder, without = series[:, :m], series[:, m : m + 1], series[:, m + 1 :]
            after = (without - effect) ** 2
            _add_by_number(blocks, block.number, remainder**2 - after)
            squares[block.row] = squares.get(block.row, 0.0) + np.sum(without**2, axis=0)
            taken[block.row] = taken.get(block.row, 0.0) + np.sum(without**2 - after, axis=0)
            counts[block.row] = counts.get(block.row, 0) + len(series)
            whole += float(np.sum(remainder**2))
        return BlockGains(blocks, squares, taken, counts, whole)

    def merged(self, parts: Sequence[BlockGains]) -> BlockGains:
        """The gains in several runs."""

        def added(each: Sequence[Mapping[Row, V]]) -> dict[Row, V]:
            rows = dict.fromkeys(row for part in each for row in part)
            return {row: reduce(add, (part[row] for part in each if row in part)) for row in rows}

        return BlockGains(
            np.concatenate([part.blocks for part in parts]), added([part.before for part in parts]),
            added([part.taken for part in parts]), added([part.counts for part in parts]),
            sum(part.whole for part in parts),
        )  # fmt: skip


@dataclass(frozen=True)
class EnergyTask:
    """Energy of trials by blocks, as a task for the samples of each run.

    Attributes
    ----------
    columns : (w, k) coefficients of the trials' columns, nuisance removed.
    owner : (k,) number of each column's trial, of `count` trials.
    """

    columns: Array
    owner: NDArray[np.intp]
    count: int

    def of_run(self, run: RunSamples) -> Array:
        """(2, count) sums over the blocks of one run: of each trial's energy, and of its square."""
        energy = np.zeros((run.block_count, self.columns.shape[1]))
        for block, series in run.series(self.columns):
            _add_by_number(energy, block.number, series**2)
        joined = np.zeros((run.block_count, self.count))
        np.add.at(joined.T, self.owner, energy.T)
        return np.stack([joined.sum(axis=0), np.sum(joined**2, axis=0)])

    def merged(self, parts: Sequence[Array]) -> Array:
        """The sums over several runs."""
        return np.sum(parts, axis=0)


def _add_by_number(sums: Array, number: NDArray[np.intp], values: Array) -> None:
    """Add values (n, k) to the `sums` (b, k) of their blocks, whose numbers (n,) do not fall from sample to sample."""
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    sums[number[begins]] += np.add.reduceat(values, begins, axis=0)


def _bounded(noise: Array, total: Array, nuisance: NDArray[np.intp], prior: Array) -> Array:
    """(w, w) `noise` limited to a share of every direction of the nuisance columns, as it is an estimate from draws."""
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
    columns: CandidateColumns, before: PartialRegression, effects: Sequence[Effect], extent: Extent = Extent.ALL
) -> tuple[PartialRegression, tuple[Trial, ...]]:
    """Partial regression of effects at their present shapes on the nuisance columns of `before`, and their trials.

    Noise in a shape between values of a grid is interpolated. `extent` : which sums it has.
    """
    linearisation, old_layout = columns.linearisation, columns.sums.layout
    known = {trial.place.start: trial for trial in old_layout.trials}
    kept = [known[place] for place in before.nuisance.tolist() if place in known]
    layout = Layout.of(old_layout.model, old_layout.sheet, [*(trial.effect for trial in kept), *effects])
    floor = linearisation.floor.without_draws() if extent is Extent.TOTAL else linearisation.floor
    stiffening = columns.sums.weighting.prior_stiffening
    sums = linearisation.runs.products(floor, layout, stiffening, {}, 0, extent, columns.sums)
    # The sheet's faults and the selected effects stand one behind the other; their priors stay those of the space.
    plain = before.nuisance[before.nuisance < old_layout.model + len(old_layout.sheet)]
    nuisance = np.concatenate([plain, *(np.r_[trial.place] for trial in layout.trials[: len(kept)])]).astype(np.intp)
    weights = np.zeros((layout.width, old_layout.width))
    weights[np.append(nuisance, layout.right), np.append(before.nuisance, old_layout.right)] = 1.0
    plain, tried = columns.plain_layout, {effect.key for effect in columns.effects}
    for trial in layout.trials[len(kept) :]:
        for place, weight in plain.interpolation(trial.effect) if trial.effect.key in tried else []:
            weights[trial.place, place] = weight * np.eye(place.stop - place.start)
    noise = combined(weights, before.column_noise)
    inside = PartialRegression(sums, nuisance, before.prior, noise, before.prior_side)
    return inside, layout.trials[len(kept) :]
