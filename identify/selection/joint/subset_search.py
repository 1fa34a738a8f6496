"""Search for the set of effects that together explain the residual: forward steps, then drops and exchanges.

Each step tests all candidates beside those selected, whose parameters are estimated jointly and whose shape constants
are searched again after each step. The search stops when no candidate passes the max-score statistic of simulated runs
(family-wise), or explains more than the selected laws may be inexact. Source: J. Zhu et al., A polynomial algorithm for
best-subset selection problem (splicing), PNAS 117 (2020); P. H. Westfall and S. S. Young, Resampling-Based Multiple
Testing (1993), for the family-wise probability.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.selection.candidate import Answer, Candidate, judged
from lacet.identify.selection.joint.rivals import rivals
from lacet.identify.selection.joint.shape_constants import with_best_constants
from lacet.identify.selection.rest import AddedLaw
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class Subset:
    """Effects selected together, beside the model of a fit.

    Attributes
    ----------
    alone : score tests without any of them; effects that are selected there already stay so.
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

    @property
    def without_tests(self) -> Subset:
        """The same without the tests beside its effects, whose memory is then free."""
        return replace(self, space=self.alone)

    def with_effects(self, effects: Sequence[Effect], progress: Progress) -> Subset:
        """The subset of these effects instead, at the shape constants that explain most together."""
        if not effects:
            return replace(self, space=self.alone, effects=())
        found = with_best_constants(self.alone, effects, progress)
        there = [trial.effect for trial in self.alone.columns.selected]
        return replace(self, space=self.alone.given([*there, *found], progress), effects=tuple(found))

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
        return SELECTION.selected_inexactness**2 * near + inexactness_of(family, rows, self.settled)


def inexactness_of(family: str, rows: Collection[Row], laws: Sequence[AddedLaw]) -> float:
    """Weighted squares that an effect on these rows may explain as the laws of the model are not exact.

    What a law is inexact by is a part of the force that nothing else explains; for an effect that looks like the law, a
    part of its whole force, most of which the two share.
    """
    out = 0.0
    for one in laws:
        if not one.rows.isdisjoint(rows):
            # Of the wheels that the law acts at, one: left and right are never equal, but where one part joins them.
            side = set(rows) < one.rows and not one.opposed
            alike = side or one.family == family or one.describes
            shared = sum(one.row_force[row] for row in one.rows & set(rows)) if family in one.looks_like else 0.0
            share = SELECTION.selected_inexactness if alike else SELECTION.law_inexactness
            out += share**2 * max(one.force, shared)
    return out


def search(
    alone: ScoreTests, first: Sequence[Candidate], settled: Sequence[AddedLaw] = (), progress: Progress = silent
) -> Subset:
    """The effects that these runs show to be missing.

    `first` : all candidates, each tested in `alone`; `settled` : laws found before, which are in the model.
    """
    found: Subset = Subset(alone, tuple(first), alone, settled=tuple(settled))
    tried: tuple[Candidate, ...] = tuple(first)
    seen: set[frozenset[str]] = set()
    while True:
        while len(found.effects) < SELECTION.most_selected and (steps := _strongest(found, tried)):
            progress(Step(Stage.FORWARD_SELECTION, len(found.effects) + 1, subject=", ".join(c.key for c in steps)))
            wanted = [*found.effects, *(replace(alone.effects[c.key], shape=c.shape) for c in steps)]
            found = found.without_tests  # hundreds of MB less while the next are computed
            found = found.with_effects(wanted, progress)
            tried = tuple(found.space.family_wise(found.space.try_all()))
        if frozenset(found.keys) in seen:
            return found
        seen.add(frozenset(found.keys))
        better = _improved(found)
        if better is None:
            return found
        found = found.without_tests
        found = found.with_effects(better, progress)
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
    return c.drop > found.inexactness(c) and _beyond_sheet(found, c)


def _beyond_sheet(found: Subset, c: Candidate) -> bool:
    """Whether errors within the sheet hardly give a sensor fault its size; also of a latency removed from the runs and
    of all that is no fault."""
    removed = found.alone.effects[c.key].sheet_kind == "latency" and found.alone.linearisation.latencies
    chance = found.space.chance_of_faults.get(c.key, 0.0)
    return bool(removed) or len(found.alone.effects) * chance <= SELECTION.level(found.alone.draws)


def strength(c: Candidate) -> float:
    """Weighted squares that a candidate explains: its gain, at most its drop, which counts other clocks' tolerances."""
    return min(c.total_gain, c.drop)


def _improved(found: Subset) -> Sequence[Effect] | None:
    """The effects with one dropped or exchanged that explain as much or more; None where there are none."""
    for key in _weakest_first(found):
        others = [effect for effect in found.effects if effect.key != key]
        free = found.space.releasing([key])
        tried = free.family_wise(free.try_all())
        (own,) = (c for c in tried if c.key == key)
        beside = replace(found, space=free, effects=tuple(others))
        if not passes(beside, own):
            return others
        stands = {c.key for c in tried if passes(beside, c)}
        others_like_it = [r for r in rivals(free, own, tried) if r.effect.key in stands]
        better = [r for r in others_like_it if r.margin < -SELECTION.least_refinement_fall]
        if better:
            best = min(better, key=lambda r: r.margin)
            return [*others, best.effect]
    return None


def _weakest_first(found: Subset) -> list[str]:
    return sorted(found.keys, key=lambda key: found.force[key])
