"""Encompassing: whether laws found stand beside simple laws of no catalogue, where the cause of a rest is unlisted.

An unknown force looks like the listed law that is nearest to it. Where a rest is unlisted, every law found is therefore
compared with the laws of the grammar in its place. If one of these explains more than it would by chance where the law
found is the truth (Cox's test of separate families, of the largest margin over the grammar), it joins the model, and
the law found must stand beside it: explain more than chance, and more than laws in a model may be inexact.

Source: D. R. Cox, Further results on tests of separate families of hypotheses, Journal of the Royal Statistical Society
B 24 (1962); G. E. Mizon and J.-F. Richard, The encompassing principle and its application to testing non-nested
hypotheses, Econometrica 54 (1986).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.cross_products import Extent
from lacet.identify.selection.joint.refits import Joint, less_a_part, with_all_tested
from lacet.identify.selection.laws.formulas import laws_at
from lacet.identify.selection.laws.search import null_products, without_noise
from lacet.identify.selection.laws.settings import LAWS
from lacet.identify.selection.rest import AddedLaw, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION

Standing = Callable[[float, Array], bool]
"""Whether a fall of the weighted squares is more than chance, by it and (D,) those in simulated runs."""


def only_encompassing(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same without the laws found that do not stand beside simple laws that are not listed.

    Rows of several wheels at once, of rigs without wheel loads, have no such laws: what acts in these alone stands.
    """
    tried, before = joint.space, joint
    doubted = {law.key for law in joint.laws if law.key in joint.keys}

    def stands(fall: float, null: Array) -> bool:
        return tried.family_wise_of(fall, null) <= SELECTION.level(tried.draws)

    while doubted:
        space = without_noise(joint.space)
        laws = [law for law in added_laws(space) if law.key in doubted]
        places = {effect.key: effect.where for effect in joint.effects}
        failing = [law for law in laws if not encompasses(space, law, places[law.key], stands, progress)]
        if not failing:
            break
        weakest = min(failing, key=lambda law: law.force)
        joint = less_a_part(joint, weakest.key, seed, progress)
        doubted = {law.key for law in failing} - {weakest.key}
    return joint if joint is before else with_all_tested(joint, seed, progress)[0]


def encompasses(
    space: ScoreTests, law: AddedLaw, where: str, stands: Standing, progress: Progress = silent
) -> bool:  # fmt: skip
    """Whether a law of the model stands beside the laws of the grammar that explain more in its place.

    `space` : score tests without the noise in the columns, which is not known of the grammar's; `where` the law acts.
    """
    kinds = dict.fromkeys((str(row), "") if row.kind == "chassis" else (row.kind, where) for row in law.rows)
    pool = [one for kind, place in kinds for one in laws_at(space, kind, place)]
    beside: list[OneLine] = []
    for _ in range(LAWS.most_terms):
        better = _better(space, law, beside, pool, progress)
        if better is None:
            return True
        beside.append(better)
        place = _Place.of(space, law, beside)
        if not stands(place.fall, place.null) or place.fall <= SELECTION.selected_inexactness**2 * place.force_beside:
            return False
    return True


def _better(
    space: ScoreTests, law: AddedLaw, beside: Sequence[OneLine], pool: Sequence[OneLine], progress: Progress
) -> OneLine | None:
    """The law of the pool that explains most in the place of a law of the model, if that is not due to chance."""
    best, most, drawn = None, -np.inf, np.full(space.draws, -np.inf)
    for start in range(0, len(pool), LAWS.together):
        progress(Step(Stage.ENCOMPASSING, start, len(pool), law.key))
        place = _Place.of(space, law, beside, pool[start : start + LAWS.together])
        margins, null = place.margins()
        drawn = np.maximum(drawn, np.max(null, axis=0, initial=-np.inf))
        if margins.size and np.max(margins) > most:
            most = float(np.max(margins))
            best = pool[start + int(place.others[np.argmax(margins)]) - place.k]
    p = (1 + np.count_nonzero(drawn >= most)) / (1 + space.draws)
    return best if most > SELECTION.least_refinement_fall and p <= SELECTION.level(space.draws) else None


@dataclass(frozen=True)
class _Place:
    """The equations of a law of the model and of others in its place, all else removed.

    Attributes
    ----------
    normal, right : (m, m) and (m,) of the k columns of the law, then n others, without what is `beside` it.
    noise : (m, D) right sides in simulated runs that lack all of them.
    whole : (m,) energy of the columns with all else in the data, to which rounding compares.
    k : number of columns of the law.
    force_beside : weighted squares of what is beside the law.
    """

    normal: Array
    right: Array
    noise: Array
    whole: Array
    k: int
    force_beside: float

    @classmethod
    def of(cls, space: ScoreTests, law: AddedLaw, beside: Sequence[OneLine], others: Sequence[OneLine] = ()) -> _Place:
        known, trials = space.beside([*beside, *others], Extent.SIMULATED)
        at = np.array([trial.place.start for trial in trials], np.intp)
        null, model = null_products(space, known), known.sums.layout.model
        # The law is a part of the model: its own equations follow from the inverse of all.
        rows = known.sums.turn[list(law.places)]
        inverse = rows @ known.inverse[:model]
        spread = inverse[:, :model] @ rows.T
        own = np.linalg.inv(spread)
        across = own @ rows @ known.gain[:model, at]
        values, moved = law.values[:, None], inverse @ null[known.nuisance]
        reduced = null[at] - known.gain[:, at].T @ null[known.nuisance]
        others_own = known.reduced[np.ix_(at, at)] + across.T @ spread @ across
        normal = np.asarray(np.block([[own, across], [across.T, others_own]]), float)
        right = np.concatenate([own @ values, known.reduced[at, -1:] + across.T @ values])[:, 0]
        noise = np.concatenate([own @ moved, reduced + across.T @ moved])
        k, t = len(law.places), len(law.places) + len(beside)
        there, rest = slice(k, t), np.r_[:k, t : len(right)]
        gain = solved(normal[there, there], normal[there])
        return cls(
            (normal - normal[:, there] @ gain)[np.ix_(rest, rest)], (right - gain.T @ right[there])[rest],
            (noise - gain.T @ noise[there])[rest], np.array(np.diag(normal)[rest], float), k,
            float(right[there] @ solved(normal[there, there], right[there, None])[:, 0]),
        )  # fmt: skip

    @property
    def values(self) -> Array:
        """(k,) parameters of the law."""
        return solved(self.normal[: self.k, : self.k], self.right[: self.k, None])[:, 0]

    @property
    def fall(self) -> float:
        """Fall of the weighted squares by the law."""
        return float(self.values @ self.right[: self.k])

    @property
    def null(self) -> Array:
        """(D,) the same in simulated runs that lack it."""
        noise = self.noise[: self.k]
        return np.einsum("kd,kd->d", noise, solved(self.normal[: self.k, : self.k], noise))

    @cached_property
    def others(self) -> NDArray[np.intp]:
        """Indices of the others that are neither explained by all else, nor one with the law on these runs."""
        k, energy = self.k, np.diag(self.normal)
        shared = np.einsum("kn,kn->n", self.normal[:k], solved(self.normal[:k, :k], self.normal[:k]))
        shown = energy > SELECTION.gone_share * self.whole
        alike = shared > SELECTION.same_correlation**2 * energy
        return k + np.flatnonzero((shown & ~alike)[k:])

    def margins(self) -> tuple[Array, Array]:
        """(n,) weighted squares that each of `others` explains more than the law, and (n, D) where the law is true."""
        k, energy = self.k, np.diag(self.normal)[self.others]
        true = self.noise + (self.normal[:, :k] @ self.values)[:, None]

        def margin(right: Array) -> Array:
            own = np.einsum("kd,kd->d", right[:k], solved(self.normal[:k, :k], right[:k]))
            return right[self.others] ** 2 / energy[:, None] - own

        return margin(self.right[:, None])[:, 0], margin(true)
