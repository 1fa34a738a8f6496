"""Search for the set of effects that together explain the residual: forward steps, then drops and exchanges.

Each step tests all candidates beside those selected, whose parameters are estimated jointly and whose shape constants
are searched again after each step. The search stops when no candidate passes the max-score statistic of simulated runs
(family-wise), or explains more than the selected laws may be inexact. Source: J. Zhu et al., A polynomial algorithm for
best-subset selection problem (splicing), PNAS 117 (2020); P. H. Westfall and S. S. Young, Resampling-Based Multiple
Testing (1993), for the family-wise probability.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.rivals import rivals
from lacet.identify.selection.joint.shape_constants import with_best_constants
from lacet.identify.selection.score_tests import Answer, Candidate, ScoreTests, judged
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class Settled:
    """An effect found, and added to the model.

    Attributes
    ----------
    effect : the effect, with its shape constants.
    force : weighted squares of its force.
    rows : rows that it acts on.
    """

    effect: Effect
    force: float
    rows: frozenset[Row]


@dataclass(frozen=True)
class Subset:
    """Effects selected together, beside the model of a fit.

    Attributes
    ----------
    alone : score tests without any of them.
    first : all candidates, each alone beside the model.
    space : score tests beside all of them.
    effects : the selected effects, with their shape constants.
    settled : effects that were found before and are in the model of the fit.
    """

    alone: ScoreTests
    first: tuple[Candidate, ...]
    space: ScoreTests
    effects: tuple[Effect, ...] = ()
    settled: tuple[Settled, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the selected effects."""
        return tuple(effect.key for effect in self.effects)

    def with_effects(self, effects: Sequence[Effect], progress: Progress) -> Subset:
        """The subset of these effects instead, at the shape constants that explain most together."""
        if not effects:
            return replace(self, space=self.alone, effects=())
        found = with_best_constants(self.alone, effects, progress)
        return replace(self, space=self.alone.given(found, progress), effects=tuple(found))

    @cached_property
    def force(self) -> Mapping[str, float]:
        """Weighted squares of each selected effect's force, which the model without them does not explain."""
        known, alone = self.space.regression, self.space.regression_without(self.keys)
        position = {place: i for i, place in enumerate(known.nuisance.tolist())}
        out: dict[str, float] = {}
        for trial in self.space.columns.selected:
            at = np.r_[trial.place]
            values = known.gain[[position[i] for i in at.tolist()], self.space.layout.right]
            out[trial.effect.key] = float(values @ alone.reduced_noisy[np.ix_(at, at)] @ values)
        return out

    @cached_property
    def rows(self) -> Mapping[str, frozenset[Row]]:
        """Rows that each selected effect acts on."""
        acting = self.space.sums.over_runs.acting
        return {
            trial.effect.key: frozenset(row for row, there in acting.items() if np.any(there[trial.place]))
            for trial in self.space.columns.selected
        }

    def inexactness(self, c: Candidate) -> float:
        """Weighted squares that a candidate may explain as the laws found are not exact."""
        rows, family = c.rows, self.alone.effects[c.key].name
        near = sum(self.force[key] for key in self.keys if not self.rows[key].isdisjoint(rows))
        before = 0.0
        for one in self.settled:
            share = SELECTION.selected_inexactness if one.effect.name == family else SELECTION.law_inexactness
            before += 0.0 if one.rows.isdisjoint(rows) else share**2 * one.force
        return SELECTION.selected_inexactness**2 * near + before

    def all_settled(self) -> tuple[Settled, ...]:
        """All effects found, for a fit with those selected in its model."""
        found = (Settled(effect, self.force[effect.key], self.rows[effect.key]) for effect in self.effects)
        return (*self.settled, *found)


def found_together(first: ScoreTests, seed: int, progress: Progress = silent) -> Subset:
    """The effects found in all, settled in a fit, and the score tests of all others beside them.

    What a selection leaves is judged by a new fit with the selected effects in its model, and a noise floor of it.
    Raises ValueError for runs that cannot be fitted again here.
    """
    found, candidates = search(first, (), progress), dict(first.effects)
    for _ in range(SELECTION.most_refits):
        linearisation = found.space.linearisation
        before = linearisation.runs.refittable
        if before is None:
            raise ValueError("these runs cannot be fitted again here")
        progress(Step(Stage.FIT_WITH_EFFECTS, subject=", ".join(found.keys)))
        fitted, kept = _fitted_with(before, found.effects, len(first.effects))
        for key in set(found.keys) - {effect.key for effect in kept}:
            del candidates[key]
        if not kept:
            return replace(found, space=found.alone, effects=())
        progress(Step(Stage.FLOOR_BESIDE_EFFECT, subject=", ".join(effect.key for effect in kept)))
        floor = linearisation.floor.redrawn(fitted)
        closer = replace(Linearisation.of(fitted, floor), latencies=linearisation.latencies)
        tests = ScoreTests.of(closer, list(candidates.values()), seed, None, progress)
        found = search(tests, replace(found, effects=tuple(kept)).all_settled(), progress)
        if not found.effects:
            break
    return found


def _fitted_with(before: Fit, effects: Sequence[Effect], count: int) -> tuple[Fit, list[Effect]]:
    """Fit with further effects, without those whose size is not significant in it (Wald tests, Bonferroni).

    `count` : number of candidates that they were selected from.
    """
    kept = list(effects)
    while kept:
        fitted = before.with_effects(kept)
        covariance = fitted.covariance + fitted.covariance_sheet
        p = dict[str, float]()
        for effect in kept:
            at = [fitted.model.names.index(q.name) for q in effect.parameters]
            values = fitted.theta[at]
            wald = float(values @ solved(covariance[np.ix_(at, at)], values[:, None])[:, 0])
            p[effect.key] = count * float(scipy.special.chdtrc(len(at), wald))
        worst = max(kept, key=lambda effect: p[effect.key])
        if p[worst.key] <= SELECTION.significance:
            return fitted, kept
        kept.remove(worst)
    return before, kept


def search(alone: ScoreTests, settled: Sequence[Settled] = (), progress: Progress = silent) -> Subset:
    """The effects that these runs show to be missing, from the score tests of all candidates alone.

    `settled` : effects found before, which are in the model.
    """
    progress(Step(Stage.SCORE_TESTS))
    first = tuple(alone.family_wise(alone.try_all()))
    found, tried = Subset(alone, first, alone, settled=tuple(settled)), first
    seen: set[frozenset[str]] = set()
    while True:
        while len(found.effects) < SELECTION.most_selected and (step := _strongest(found, tried)) is not None:
            progress(Step(Stage.FORWARD_SELECTION, len(found.effects) + 1, subject=step.key))
            added = replace(alone.effects[step.key], shape=step.shape)
            found = found.with_effects([*found.effects, added], progress)
            tried = found.space.family_wise(found.space.try_all())
        if frozenset(found.keys) in seen:
            return found
        seen.add(frozenset(found.keys))
        better = _improved(found, progress)
        if better is found:
            return found
        found = better
        tried = found.space.family_wise(found.space.try_all())


def _strongest(found: Subset, tried: Sequence[Candidate]) -> Candidate | None:
    """The candidate that explains most beside the selected ones, of those that pass; None without any."""
    passing = [c for c in tried if passes(found, c)]
    return max(passing, key=strength, default=None)


def passes(found: Subset, c: Candidate) -> bool:
    """Whether a candidate beside the selected effects is missing too, and not what their laws leave."""
    if not c.tested or judged(c, found.alone.effects[c.key], found.alone.draws).answer is not Answer.MISSING:
        return False
    return c.drop > found.inexactness(c)


def strength(c: Candidate) -> float:
    """Weighted squares that a candidate explains: its gain, at most its drop, which counts other clocks' tolerances."""
    return min(c.total_gain, c.drop)


def _improved(found: Subset, progress: Progress) -> Subset:
    """A subset with an effect dropped or exchanged that explains as much or more; the same where there is none."""
    for key in _weakest_first(found):
        others = [effect for effect in found.effects if effect.key != key]
        free = found.space.releasing([key])
        tried = free.family_wise(free.try_all())
        (own,) = (c for c in tried if c.key == key)
        beside = replace(found, space=free, effects=tuple(others))
        if not passes(beside, own):
            return found.with_effects(others, progress)
        stands = {c.key for c in tried if passes(beside, c)}
        others_like_it = [r for r in rivals(free, own, tried) if r.effect.key in stands]
        better = [r for r in others_like_it if r.margin < -SELECTION.least_refinement_fall]
        if better:
            best = min(better, key=lambda r: r.margin)
            return found.with_effects([*others, best.effect], progress)
    return found


def _weakest_first(found: Subset) -> list[str]:
    return sorted(found.keys, key=lambda key: found.force[key])
