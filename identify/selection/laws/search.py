"""Search for sums of laws that the residual follows, in the algebra of cross products.

Model, zeros and sensor tolerances are removed from the columns of all laws of a grammar (partial regression), and each
law is tried beside those found before: its fall of the weighted squares in blocked cross-validation, and that on all
data, which is compared with the max-score statistic of simulated runs. The constants of the best few are searched
jointly, and each of these is extended by a further term (beam search).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import NDArray

from lacet.identify.effects.base import Effect
from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.cross_products import Extent
from lacet.identify.selection.columns.regressor_noise import RegressorNoise, regressor_labels
from lacet.identify.selection.joint.shape_constants import with_best_constants
from lacet.identify.selection.laws.settings import LAWS
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION

Terms = tuple[OneLine, ...]
Places = NDArray[np.intp]


@dataclass(frozen=True)
class Found:
    """A sum of laws.

    Attributes
    ----------
    terms : the laws, with their constants.
    falls : (folds,) fall of the weighted squares in each fold of the cross-validation.
    p : family-wise probability that the last term explains as much by chance, over all laws tried in its place.
    """

    terms: Terms
    falls: Array
    p: float

    @property
    def fall(self) -> float:
        """Fall of the weighted squares in blocked cross-validation."""
        return float(np.sum(self.falls))

    @property
    def size(self) -> int:
        """Number of terms and constants."""
        return sum(1 + len(term.shape) for term in self.terms)


@dataclass(frozen=True)
class LawSearch:
    """Search for laws beside what is nuisance to score tests.

    Attributes
    ----------
    space : score tests of the listed candidates; what is nuisance there is so here.
    elsewhere : laws found at other places, in the model of each test.
    """

    space: ScoreTests
    elsewhere: Terms = ()

    def laws(self, pool: Sequence[OneLine], first: Sequence[Found]) -> list[Found]:
        """Laws of one to `most_terms` terms out of `pool`; `first` : those of one term, at the grids' values."""
        beam = distinct(self._sharpened(distinct(first, LAWS.sharpened)), LAWS.beam)
        found = list(beam)
        for _ in range(LAWS.most_terms - 1):
            before = max(one.fall for one in beam)
            beam = self._sharpened(distinct(self.extended([one.terms for one in beam], pool), LAWS.beam))
            found += beam
            if not beam or max(one.fall for one in beam) - before < SELECTION.least_gain * before:
                break
        return found

    def extended(self, bases: Sequence[Terms], pool: Sequence[OneLine]) -> list[Found]:
        """Each of the sums `bases` with each law of the `pool` added, where it explains more than chance does."""
        tried: list[tuple[int, OneLine, Array, float]] = []
        worst = np.zeros((len(bases), self.space.draws))
        for start in range(0, len(pool), LAWS.together):
            batch = pool[start : start + LAWS.together]
            columns = _Columns.of(self.space, self.elsewhere, [*bases, *((law,) for law in batch)])
            own = np.array([place[0] for place in columns.sums[len(bases) :]])
            for i, base in enumerate(columns.sums[: len(bases)]):
                test = _Added(columns, base, own)
                ratios, drawn = test.scores(self.space)
                worst[i] = np.maximum(worst[i], np.max(drawn, axis=0, initial=0.0))
                shown: list[OneLine] = [batch[k] for k in test.shown]
                tried += zip([i] * len(shown), shown, test.falls().T, ratios.tolist(), strict=True)
        p = [(1 + np.count_nonzero(worst[i] >= ratio)) / (1 + worst.shape[1]) for i, _, _, ratio in tried]
        level = SELECTION.level(self.space.draws)
        return [
            Found((*bases[i], law), falls, float(chance))
            for (i, law, falls, _), chance in zip(tried, p, strict=True)
            if chance <= level and np.sum(falls) > 0.0
        ]

    def _sharpened(self, found: Sequence[Found]) -> list[Found]:
        """What was found, with the constants between the grids' values at which the terms of each explain most."""
        if not found:
            return []
        groups = [i for i, one in enumerate(found) for _ in one.terms]
        sharper = with_best_constants(self.space, [term for one in found for term in one.terms], groups=groups)
        terms = [tuple(t for t, group in zip(_one_lines(sharper), groups, strict=True) if group == i)
                 for i in range(len(found))]  # fmt: skip
        columns = _Columns.of(self.space, self.elsewhere, terms)
        tests = [_Added(columns, at[:-1], at[-1:]) for at in columns.sums]
        return [
            replace(one, terms=now, falls=test.falls()[:, 0])
            for one, now, test in zip(found, terms, tests, strict=True)
            if test.shown.size
        ]


def distinct(found: Iterable[Found], most: int) -> list[Found]:
    """The best by their falls in cross-validation, of those of equal terms with other constants one alone."""
    out: dict[frozenset[str], Found] = {}
    for one in sorted(found, key=lambda one: -one.fall):
        out.setdefault(frozenset(term.key for term in one.terms), one)
    return list(out.values())[:most]


def simplest(found: Sequence[Found]) -> list[Found]:
    """The Pareto front: the best of each number of terms and constants, if it explains more than the smaller ones.

    More is what matters to the user: `least_gain` of what it explains.
    """
    out: list[Found] = []
    for one in sorted(found, key=lambda one: (one.size, -one.fall)):
        if not out or one.fall - out[-1].fall > SELECTION.least_gain * one.fall:
            out.append(one)
    return out


def chosen(front: Sequence[Found]) -> Found:
    """The simplest law of a Pareto front that is as good as its best, by the one-standard-error rule over the folds."""
    best = front[-1]

    def worse(one: Found) -> float:
        less = best.falls - one.falls
        error = float(np.std(less, ddof=1)) * np.sqrt(less.size)
        return float(np.sum(less)) - LAWS.standard_errors * error

    return next(one for one in front if one is best or worse(one) <= 0.0)


def without_noise(space: ScoreTests) -> ScoreTests:
    """The score tests without the correction for noise in the columns, which is not known of the laws tried here.

    Corrected for noise in the model's columns alone, a law that these nearly explain would have less than no energy.
    """
    labels, rows = regressor_labels(space.fitted, space.columns.plain_layout), space.floor.sigma
    return ScoreTests(space.columns, RegressorNoise(labels, (), rows), noise_ratio=space.noise_ratio)


def _one_lines(effects: Iterable[Effect]) -> Terms:
    return tuple(cast(OneLine, effect) for effect in effects)


@dataclass(frozen=True)
class _Columns:
    """Columns of sums of laws, nuisance parameters removed.

    `fixed` : places of the laws found elsewhere; `sums` those of the terms of each sum.
    """

    inside: PartialRegression
    fixed: Places
    sums: list[Places]

    @classmethod
    def of(cls, space: ScoreTests, elsewhere: Terms, sums: Sequence[Terms]) -> _Columns:
        inside, trials = space.beside([*elsewhere, *(term for terms in sums for term in terms)], Extent.FOLDS)
        places = np.array([trial.place.start for trial in trials], np.intp)
        ends = np.cumsum([len(elsewhere), *(len(terms) for terms in sums)])
        return cls(inside, places[: ends[0]], [places[a:b] for a, b in pairwise(ends.tolist())])


class _Added:
    """Laws at `own`, each added alone to those at `base` and to those found elsewhere."""

    def __init__(self, columns: _Columns, base: Places, own: Places):
        self.inside, self.fixed, self.base = columns.inside, columns.fixed, np.concatenate([columns.fixed, base])
        self.right = columns.inside.sums.layout.right
        whole = np.diag(columns.inside.sums.total)[own]
        with np.errstate(divide="ignore", invalid="ignore"):
            remains = self._without_base(columns.inside.reduced)[0][own] / whole
        self.shown: NDArray[np.intp] = np.flatnonzero(np.nan_to_num(remains) > SELECTION.gone_share)
        self.own = own[self.shown]

    def _without_base(self, normal: Array) -> tuple[Array, Array, Array]:
        """(w,) energies of the columns and (w,) products with the residual, less the base; (k, w) its coefficients."""
        gain = _solved(normal, self.base, normal[self.base])
        energy = np.diag(normal) - np.einsum("kw,kw->w", normal[self.base], gain)
        return energy, normal[:, self.right] - normal[:, self.base] @ gain[:, self.right], gain

    def scores(self, space: ScoreTests) -> tuple[Array, Array]:
        """(n,) fall on all data and (n, D) that in simulated runs, each in units of its mean over both."""
        inside, own = self.inside, self.own
        energy, score, gain = self._without_base(inside.reduced)
        null = null_products(space, inside)
        reduced = null - inside.gain.T @ null[inside.nuisance]
        drawn = (reduced[own] - gain[:, own].T @ reduced[self.base]) ** 2 / energy[own, None]
        drop = score[own] ** 2 / energy[own]
        mean = (np.sum(drawn, axis=1) + drop) / (1 + drawn.shape[1])
        return drop / mean, drawn / mean[:, None]

    def falls(self) -> Array:
        """(folds, n) fall of the weighted squares in cross-validation by base and law, less that by `fixed` alone."""
        out: list[Array] = []
        for train, test in self.inside.folds:
            energy, score, gain = self._without_base(train)
            size = score[self.own] / energy[self.own]
            base = gain[:, self.right, None] - gain[:, self.own] * size
            squares = np.einsum("kn,kl,ln->n", base, test[np.ix_(self.base, self.base)], base)
            squares += size**2 * np.diag(test)[self.own]
            squares += 2.0 * size * np.einsum("kn,kn->n", base, test[np.ix_(self.base, self.own)])
            across = base.T @ test[self.base, self.right] + size * test[self.own, self.right]
            out.append(2.0 * across - squares - _fall(train, test, self.fixed, self.right))
        return np.array(out)


def _fall(train: Array, test: Array, at: Places, right: int) -> float:
    """Fall of the weighted squares inside a fold, by the columns at `at` with the parameters found outside."""
    values = _solved(train, at, train[at, right, None])[:, 0]
    return float(2.0 * values @ test[at, right] - values @ test[np.ix_(at, at)] @ values)


def _solved(normal: Array, at: Places, sides: Array) -> Array:
    """(k, …) inverse of the products of the columns at `at` times `sides`; their units may be far apart."""
    scale = 1.0 / np.sqrt(np.diag(normal)[at])[:, None]
    return np.asarray(scale * np.linalg.solve(scale * normal[np.ix_(at, at)] * scale.T, scale * sides), float)


def null_products(space: ScoreTests, inside: PartialRegression) -> Array:
    """(w, D) products of all columns with simulated runs that lack nothing, as noisy as the rows are."""
    over_runs, tolerances = inside.sums.over_runs, inside.nuisance[space.columns.tolerances]
    noise = np.sum([space.noise_ratio[row] * products for row, products in over_runs.null.items()], axis=0)
    return over_runs.null_sheet + inside.total[:, tolerances] @ space.columns.drawn + noise
