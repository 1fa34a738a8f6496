"""Replacement: equations of laws of a model and of others in their place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.cross_products import Extent
from lacet.identify.selection.laws.search import null_products
from lacet.identify.selection.rest import AddedLaw
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION

Places = NDArray[np.intp]


@dataclass(frozen=True)
class Replacement:
    """The equations of laws of a model and of others in their place, all else removed.

    Attributes
    ----------
    normal, right : (m, m) and (m,) of the k columns of the laws, then n others.
    noise : (m, D) right sides in simulated runs that lack all of them.
    whole : (m,) energy of the columns with all else in the data, to which rounding compares.
    k : number of columns of the laws.
    """

    normal: Array
    right: Array
    noise: Array
    whole: Array
    k: int

    @classmethod
    def of(cls, space: ScoreTests, laws: Sequence[AddedLaw], others: Sequence[OneLine]) -> Replacement:
        """Equations of `laws` of the model of `space`, and of `others`, which are not in it."""
        known, trials = space.beside(others, Extent.SIMULATED)
        at = np.array([trial.place.start for trial in trials], np.intp)
        null, model = null_products(space, known), known.sums.layout.model
        # The laws are a part of the model: their own equations follow from the inverse of all.
        rows = known.sums.turn[[place for law in laws for place in law.places]]
        inverse = rows @ known.inverse[:model]
        spread = inverse[:, :model] @ rows.T
        own = np.linalg.inv(spread)
        across = own @ rows @ known.gain[:model, at]
        values, moved = np.concatenate([law.values for law in laws])[:, None], inverse @ null[known.nuisance]
        reduced = null[at] - known.gain[:, at].T @ null[known.nuisance]
        others_own = known.reduced[np.ix_(at, at)] + across.T @ spread @ across
        normal = np.asarray(np.block([[own, across], [across.T, others_own]]), float)
        right = np.concatenate([own @ values, known.reduced[at, -1:] + across.T @ values])[:, 0]
        noise = np.concatenate([own @ moved, reduced + across.T @ moved])
        return cls(normal, right, noise, np.array(np.diag(normal), float), len(own))

    def given(self, at: Places) -> Replacement:
        """The same with the columns at these places among all else."""
        if not len(at):
            return self
        rest = np.setdiff1d(np.arange(len(self.right)), at)
        gain = solved(self.normal[np.ix_(at, at)], self.normal[at])
        return Replacement(
            (self.normal - self.normal[:, at] @ gain)[np.ix_(rest, rest)], (self.right - gain.T @ self.right[at])[rest],
            (self.noise - gain.T @ self.noise[at])[rest], self.whole[rest], self.k - int(np.count_nonzero(at < self.k)),
        )  # fmt: skip

    def force_at(self, at: Places) -> float:
        """Fall of the weighted squares by the columns at these places alone."""
        return float(self.right[at] @ solved(self.normal[np.ix_(at, at)], self.right[at, None])[:, 0])

    @property
    def values(self) -> Array:
        """(k,) parameters of the laws."""
        return solved(self.normal[: self.k, : self.k], self.right[: self.k, None])[:, 0]

    @property
    def fall(self) -> float:
        """Fall of the weighted squares by the laws."""
        return self.force_at(np.arange(self.k))

    @property
    def null(self) -> Array:
        """(D,) the same in simulated runs that lack them."""
        noise = self.noise[: self.k]
        return np.einsum("kd,kd->d", noise, solved(self.normal[: self.k, : self.k], noise))

    @cached_property
    def others(self) -> Places:
        """Places of the others that are neither explained by all else, nor one with the laws on these runs."""
        k, energy = self.k, np.diag(self.normal)
        shared = np.einsum("kn,kn->n", self.normal[:k], solved(self.normal[:k, :k], self.normal[:k]))
        shown = energy > SELECTION.gone_share * self.whole
        alike = shared > SELECTION.same_correlation**2 * energy
        return k + np.flatnonzero((shown & ~alike)[k:])

    def margins(self) -> tuple[Array, Array]:
        """(n,) weighted squares that each of `others` explains more than the laws, and (n, D) where these are true."""
        k, energy = self.k, np.diag(self.normal)[self.others]
        true = self.noise + (self.normal[:, :k] @ self.values)[:, None]

        def margin(right: Array) -> Array:
            own = np.einsum("kd,kd->d", right[:k], solved(self.normal[:k, :k], right[:k]))
            return right[self.others] ** 2 / energy[:, None] - own

        return margin(self.right[:, None])[:, 0], margin(true)


@dataclass(frozen=True)
class Winner:
    """A law in the place of laws of a model.

    Attributes
    ----------
    law : it.
    place : the laws' equations and its own, which is the last.
    margin : weighted squares that it explains more than the laws.
    """

    law: OneLine
    place: Replacement = field(repr=False)
    margin: float


@dataclass(frozen=True)
class Best:
    """The law of a pool that explains most in the place of laws of a model.

    Attributes
    ----------
    draws : number of simulated runs.
    winner : the law; None before any was tried.
    drawn : (D,) the largest margin over the pool in simulated runs of the model with the laws.
    """

    draws: int
    winner: Winner | None = None
    drawn: Array = field(default_factory=lambda: np.array(-np.inf), repr=False)

    def over(self, place: Replacement, batch: Sequence[OneLine]) -> Best:
        """The best of those before and of a further part of the pool, in the laws' place with these equations."""
        margins, null = place.margins()
        drawn = np.maximum(self.drawn, np.max(null, axis=0, initial=-np.inf))
        if not margins.size or (self.winner is not None and np.max(margins) <= self.winner.margin):
            return replace(self, drawn=drawn)
        i = int(place.others[np.argmax(margins)])
        at = np.r_[: place.k, i]
        own = Replacement(place.normal[np.ix_(at, at)], place.right[at], place.noise[at], place.whole[at], place.k)
        return replace(self, winner=Winner(batch[i - place.k], own, float(np.max(margins))), drawn=drawn)

    @property
    def p(self) -> float:
        """Probability of such a margin where the laws are the truth (Cox); 1 before any law was tried."""
        if self.winner is None:
            return 1.0
        return float((1 + np.count_nonzero(self.drawn >= self.winner.margin)) / (1 + self.draws))


def family_wise(best: Sequence[Best]) -> list[float]:
    """Probability, for each, that any of these margins is as large where all the laws of the model are the truth; 1
    before any was tried.

    Margins are compared in units of their own standard deviation over simulated and measured runs, which are
    exchangeable then.
    Source: P. H. Westfall and S. S. Young, Resampling-based multiple testing (1993), chapter 2 (max T).
    """
    margins = {i: one.winner.margin for i, one in enumerate(best) if one.winner is not None}
    if not margins:
        return [1.0] * len(best)
    scores = {i: _standardised(np.append(best[i].drawn, margin)) for i, margin in margins.items()}
    worst = np.max([score[:-1] for score in scores.values()], axis=0)
    above = {i: int(np.count_nonzero(worst >= score[-1])) for i, score in scores.items()}
    return [(1 + above[i]) / (1 + one.draws) if i in above else 1.0 for i, one in enumerate(best)]


def _standardised(values: Array) -> Array:
    """Less their mean, in units of their standard deviation; zeros where all are equal."""
    off: Array = values - np.mean(values)
    return off / (np.std(off) or 1.0)
