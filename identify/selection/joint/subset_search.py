"""Search for the set of effects that together explain the residual: forward steps, then drops and exchanges.

Each step tests all candidates beside those selected, whose parameters are estimated jointly and whose shape constants
are searched again after each step. The search stops when no candidate passes the max-score statistic of simulated runs
(family-wise), or explains more than the selected laws may be inexact. Source: J. Zhu et al., A polynomial algorithm for
best-subset selection problem (splicing), PNAS 117 (2020); P. H. Westfall and S. S. Young, Resampling-Based Multiple
Testing (1993), for the family-wise probability.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
from lacet.identify.selection.rest import AddedLaw, added_laws
from lacet.identify.selection.score_tests import Answer, Candidate, ScoreTests, judged
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class Subset:
    """Effects selected together, beside the model of a fit.

    Attributes
    ----------
    alone : score tests without any of them.
    first : all candidates, each alone beside the model.
    space : score tests beside all of them.
    effects : the selected effects, with their shape constants.
    settled : laws beyond the base model that are in the fit.
    """

    alone: ScoreTests
    first: tuple[Candidate, ...]
    space: ScoreTests
    effects: tuple[Effect, ...] = ()
    settled: tuple[AddedLaw, ...] = ()

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
        return SELECTION.selected_inexactness**2 * near + _inexact(family, rows, self.settled)


@dataclass(frozen=True)
class Joint:
    """The effects found in all, and the model with all of them.

    Attributes
    ----------
    first : score tests of all candidates beside the model as it was, and `alone` their results.
    space : score tests of all others beside the model with the effects found, fitted again, and `beside` their results.
    effects : the effects found, with their shape constants.
    laws : all laws beyond the base model in that fit.
    removed : those of the effects found that are no part of the fit: latencies at which the runs were read again.
    base : the fit to which the effects are added, and `added` those that are; None where runs cannot be fitted here.
    sizes : sensor faults of the base fit that were removed from its runs, with their sizes.
    dropped : keys of effects that were selected and did not stand in a fit.
    """

    first: ScoreTests
    alone: tuple[Candidate, ...]
    space: ScoreTests
    beside: tuple[Candidate, ...]
    effects: tuple[Effect, ...]
    laws: tuple[AddedLaw, ...]
    removed: tuple[Effect, ...] = ()
    base: Fit | None = None
    added: tuple[Effect, ...] = ()
    sizes: Mapping[str, float] = field(default_factory=dict[str, float])
    dropped: frozenset[str] = frozenset()

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the effects found."""
        return tuple(effect.key for effect in self.effects)

    def based_on(self, space: ScoreTests) -> Joint:
        """The same effects in the model of another fit, which further ones are added to."""
        old, base = self.space.fitted, space.linearisation.runs.refittable
        sizes = dict(self.sizes)
        for fault in old.model.faults:
            at = old.model.names.index(fault.parameters[0].name)
            sizes[fault.key] = sizes.get(fault.key, 0.0) + float(old.theta[at])
        return replace(self, base=base, added=(), sizes=sizes)


def found_together(first: ScoreTests, seed: int, progress: Progress = silent) -> Joint:
    """The effects found in all, in a fit with them, and the score tests of all others beside them.

    What a selection leaves is judged by a new fit with the selected effects in its model, and a noise floor of it.
    Where the runs cannot be fitted again here, nothing is found.
    """
    progress(Step(Stage.SCORE_TESTS))
    alone = tuple(first.family_wise(first.try_all()))
    base = first.linearisation.runs.refittable
    joint = Joint(first, alone, first, alone, (), added_laws(first), base=base)
    return joint if base is None else continued(joint, seed, progress)


def continued(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same with what is found beside the effects found before."""
    for _ in range(SELECTION.most_refits):
        found = search(joint.space, joint.beside, joint.laws, progress)
        if not found.effects:
            break
        # A latency that was removed from the runs would be fitted as what remains of it.
        latencies = joint.space.linearisation.latencies
        late = [effect for effect in found.effects if effect.sheet_kind == "latency" and latencies]
        others = [effect for effect in found.effects if effect not in late]
        joint = replace(joint, effects=(*joint.effects, *late), removed=(*joint.removed, *late))
        before = joint
        if others:
            joint = _fitted(replace(joint, added=(*joint.added, *others)), seed, progress)
        if joint.effects == before.effects:
            if not late:
                break
            joint = beside_of(joint, joint.space.given(joint.removed), progress)
    return joint


def _fitted(joint: Joint, seed: int, progress: Progress) -> Joint:
    """The model fitted with all effects added, without those that do not stand in it; as it was where none is new."""
    linearisation, base, wanted = joint.space.linearisation, joint.base, joint.added
    assert base is not None
    while True:
        progress(Step(Stage.FIT_WITH_EFFECTS, subject=", ".join(effect.key for effect in wanted)))
        fitted, kept = fitted_with(base, wanted, len(joint.first.effects), joint.first.draws)
        old = [effect for effect in kept if effect.key in joint.keys]
        if len(kept) == len(old):
            gone = {effect.key for effect in joint.added} - set(joint.keys)
            return replace(
                joint, added=tuple(e for e in joint.added if e.key in joint.keys), dropped=joint.dropped | gone
            )
        progress(Step(Stage.FLOOR_BESIDE_EFFECT, subject=", ".join(effect.key for effect in kept)))
        floor = linearisation.floor.redrawn(fitted)
        closer = replace(Linearisation.of(fitted, floor), latencies=linearisation.latencies)
        gone = {effect.key for effect in joint.added} - {effect.key for effect in kept}
        others = [
            effect for key, effect in joint.first.effects.items()
            if key not in {one.key for one in kept} | gone | joint.dropped
        ]  # fmt: skip
        space = ScoreTests.of(closer, others, seed, None, progress)
        space = space.given(joint.removed) if joint.removed else space
        laws = added_laws(space)
        weak = [law for law in laws if law.key in {e.key for e in kept} and not _stands(law, laws, space)]
        if not weak:
            break
        weakest = min(weak, key=lambda law: law.force)
        wanted = tuple(effect for effect in kept if effect.key != weakest.key)
    there = {effect.key for effect in joint.added}
    # What is in the base fit stays, what was added is what is kept.
    effects = (*(effect for effect in joint.effects if effect.key not in there), *kept)
    return beside_of(replace(joint, effects=effects, added=tuple(kept), dropped=joint.dropped | gone), space, progress)


def _stands(law: AddedLaw, laws: Sequence[AddedLaw], space: ScoreTests) -> bool:
    """Whether a law of the model is there beside the others, and is not what these leave as they are not exact."""
    if space.family_wise_of(law.force, law.null) > SELECTION.level(space.draws):
        return False
    return law.force > _inexact(law.family, law.rows, [other for other in laws if other.force > law.force])


def _inexact(family: str, rows: Collection[Row], laws: Sequence[AddedLaw]) -> float:
    """Weighted squares that an effect on these rows may explain as the laws of the model are not exact."""
    out = 0.0
    for one in laws:
        if not one.rows.isdisjoint(rows):
            side = set(rows) < one.rows  # of the wheels that the law acts at, one: left and right are never equal
            alike = side or one.family == family
            out += (SELECTION.selected_inexactness if alike else SELECTION.law_inexactness) ** 2 * one.force
    return out


def beside_of(joint: Joint, space: ScoreTests, progress: Progress = silent) -> Joint:
    """The same effects, with the candidates beside them tested in `space`."""
    progress(Step(Stage.SCORE_TESTS))
    beside = tuple(space.family_wise(space.try_all()))
    return replace(joint, space=space, beside=beside, laws=added_laws(space))


def fitted_with(before: Fit, effects: Sequence[Effect], count: int, draws: int) -> tuple[Fit, list[Effect]]:
    """Fit with further effects, without those whose size is not significant in it (Wald tests, Bonferroni).

    `count` : number of candidates that they were selected from; `draws` : number of simulated runs behind that.
    """
    kept = list(effects)
    while kept:
        fitted = before.with_effects(kept)
        covariance, theta = fitted.covariance + fitted.covariance_sheet, fitted.theta.copy()
        places = {e.key: [fitted.model.names.index(q.name) for q in e.parameters] for e in kept}
        standing = list(kept)
        while standing:
            wald = {
                e.key: (float(theta[at] @ solved(covariance[np.ix_(at, at)], theta[at][:, None])[:, 0]), len(at))
                for e in standing
                for at in [places[e.key]]
            }
            p = {key: count * float(scipy.special.chdtrc(size, squares)) for key, (squares, size) in wald.items()}
            worst = max(standing, key=lambda e: p[e.key])
            if p[worst.key] <= SELECTION.level(draws):
                break
            standing.remove(worst)
            # Without it the others are those of the fit, given that it is zero.
            at = places[worst.key]
            gain = solved(covariance[np.ix_(at, at)], covariance[at]).T
            theta, covariance = theta - gain @ theta[at], covariance - gain @ covariance[at]
        if len(standing) == len(kept):
            return fitted, kept
        kept = standing
    return before, kept


def search(
    alone: ScoreTests, first: Sequence[Candidate], settled: Sequence[AddedLaw] = (), progress: Progress = silent
) -> Subset:
    """The effects that these runs show to be missing.

    `first` : all candidates, each tested in `alone`; `settled` : laws found before, which are in the model.
    """
    found, tried = Subset(alone, tuple(first), alone, settled=tuple(settled)), tuple(first)
    seen: set[frozenset[str]] = set()
    while True:
        while len(found.effects) < SELECTION.most_selected and (steps := _strongest(found, tried)):
            progress(Step(Stage.FORWARD_SELECTION, len(found.effects) + 1, subject=", ".join(c.key for c in steps)))
            added = [replace(alone.effects[c.key], shape=c.shape) for c in steps]
            found = found.with_effects([*found.effects, *added], progress)
            tried = tuple(found.space.family_wise(found.space.try_all()))
        if frozenset(found.keys) in seen:
            return found
        seen.add(frozenset(found.keys))
        better = _improved(found, progress)
        if better is found:
            return found
        found = better
        tried = tuple(found.space.family_wise(found.space.try_all()))


def _strongest(found: Subset, tried: Sequence[Candidate]) -> list[Candidate]:
    """The candidate that explains most beside the selected ones, of those that pass, with the same law elsewhere.

    A law that passes at other places, too, is one step: at the other end of the car, or at other wheels.
    """
    passing = [c for c in tried if passes(found, c)]
    if not passing:
        return []
    effects = found.alone.effects
    best = max(passing, key=strength)
    group, taken = [best], set(effects[best.key].corners())
    if effects[best.key].as_physics is None or not taken:
        return group
    for c in sorted(passing, key=lambda c: -strength(c)):
        own = set(effects[c.key].corners())
        alike = effects[c.key].name == effects[best.key].name and len(own) == len(effects[best.key].corners())
        if alike and not own & taken:
            group.append(c)
            taken |= own
    return group


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
