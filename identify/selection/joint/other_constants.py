"""Sets of laws with other shape constants than those found, to be fitted: with a law more, with one less, one
exchanged, or the same.

An effect selected early gets the constants with which it does the work of those that are missing beside it: a bump stop
without a gap that of a progressive spring, which then explains nothing more. Or it is another law than the true one,
and a further law was added for what they differ by: then one law takes the place of both.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress, Stage, Step
from lacet.identify.selection.columns.candidate_columns import WITHOUT_COLUMN
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.free_constants import FreeConstants, FreeStep, least_gain
from lacet.identify.selection.joint.refits import Joint, beside_removed, less
from lacet.identify.selection.joint.shape_constants import (
    constants_found,
    fall_of,
    implausible_together,
    with_best_constants,
)
from lacet.identify.selection.joint.subset_search import inexactness_of
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class OtherLaws:
    """Laws to be fitted in place of those found.

    Attributes
    ----------
    laws : all of them, with constants searched together.
    needed : keys of those that must stand in the fit, with plausible sizes.
    replaced : keys of laws found that others have taken the place of, not to be tried again beside these.
    """

    laws: list[Effect]
    needed: frozenset[str]
    replaced: frozenset[str] = frozenset()


def with_other_constants(joint: Joint, seed: int, progress: Progress) -> list[OtherLaws]:
    """Laws in place of those found, with constants searched in one fit.

    With other constants of one law another may be missing; where laws act on common rows, one may not be needed, or a
    simpler one, and two may be another one. Laws that are needed and would have an implausible size are none.
    """
    laws = [effect for effect in joint.effects if effect.as_physics is not None]
    rows, keys = {law.key: law.rows for law in joint.laws}, [law.key for law in laws]
    apart = all(rows[a.key].isdisjoint(rows[b.key]) for a, b in itertools.combinations(laws, 2))
    if apart and not any(law.grids for law in laws):
        return []
    alone = _tests_without(joint, keys, seed, progress)
    best = with_best_constants(alone, laws, progress)
    free = FreeConstants(alone.given([*joint.removed, *best], progress), keys)
    sets = [
        ([*_exchanged(best, step.other), step.candidate], {step.candidate.key, step.other.key})
        for step in _missing(joint, free)
    ]
    weakest_first = sorted((law for law in joint.laws if law.key in keys), key=lambda law: law.force)
    for law in () if apart else weakest_first:
        loss, other = free.loss_without(law.key)
        near = [one for one in joint.laws if one.key != law.key]
        if other is not None and loss <= inexactness_of(law.family, law.rows, near):
            less_one = [one for one in _exchanged(best, other) if one.key != law.key]
            sets.append((less_one, {one.key for one in less_one}))
    out = [OtherLaws(with_best_constants(alone, wanted, progress), frozenset(needed)) for wanted, needed in sets]
    if not apart:
        out += _one_for_one(joint, alone, free, best, progress)
        out += itertools.islice(_one_for_two(joint, alone, free, best, progress), SELECTION.most_free_steps)
    fewer = constants_found(best) < constants_found(laws)
    if fewer or fall_of(alone, best) - fall_of(alone, laws) > SELECTION.least_refinement_fall:
        # With the new constants of one law another may fall out of the fit: it is not needed.
        out.append(OtherLaws(best, frozenset([_strongest(alone, best).key])))
    return [one for one in out if one.needed.isdisjoint(implausible_together(alone, one.laws))]


def _strongest(alone: ScoreTests, laws: Sequence[Effect]) -> Effect:
    """The law without which the others explain least."""
    without = {law.key: [one for one in laws if one is not law] for law in laws}
    return min(laws, key=lambda law: fall_of(alone, without[law.key]) if without[law.key] else 0.0)


def _one_for_one(
    joint: Joint, alone: ScoreTests, free: FreeConstants, best: Sequence[Effect], progress: Progress
) -> Iterator[OtherLaws]:
    """Laws with a candidate in the place of one, if they explain more, or with fewer constants as much."""
    present = fall_of(alone, best)
    by_key = {law.key: law for law in best}
    for step, key in free.in_place_of_one(_candidates(joint))[: SELECTION.most_free_steps]:
        kept = [one for one in _exchanged(best, step.other) if one.key != key]
        wanted = with_best_constants(alone, [step.candidate, *kept], progress)
        if fall_of(alone, wanted) - present > least_gain(step.candidate, by_key[key]):
            yield OtherLaws(wanted, frozenset([step.candidate.key, step.other.key]))


def _candidates(joint: Joint) -> list[str]:
    """Keys of the laws of all runs that are tested beside those found."""
    return [c.key for c in joint.beside if c.tested and not joint.first.effects[c.key].is_of_run()]


def _one_for_two(
    joint: Joint, alone: ScoreTests, free: FreeConstants, best: Sequence[Effect], progress: Progress
) -> Iterator[OtherLaws]:
    """Laws with one candidate in the place of two, beside which chance alone explains the weaker of the two.

    On its grid the candidate must explain more than the stronger alone.
    """
    laws = {law.key: law for law in joint.laws if law.key in {effect.key for effect in best}}
    both = [(a, b) for a, b in itertools.combinations(laws.values(), 2) if not a.rows.isdisjoint(b.rows)]
    pairs = {(a.key, b.key): min(a.force, b.force) for a, b in both}
    present = fall_of(alone, best)
    for _, candidate, pair in free.in_place_of_two(_candidates(joint), pairs)[: SELECTION.most_rivals]:
        wanted = with_best_constants(alone, [candidate, *(one for one in best if one.key not in pair)], progress)
        weaker = min((laws[key] for key in pair), key=lambda law: law.force)
        p = joint.space.family_wise_of(max(0.0, present - fall_of(alone, wanted)), weaker.null)
        if p > SELECTION.level(joint.space.draws):
            yield OtherLaws(wanted, frozenset([candidate.key]), frozenset(pair))


def _exchanged(laws: Sequence[Effect], other: Effect) -> list[Effect]:
    """The laws with `other` in place of the one of its key."""
    return [other if law.key == other.key else law for law in laws]


def _missing(joint: Joint, free: FreeConstants) -> list[FreeStep]:
    """Steps with a candidate that is missing beside the laws, by what the simulated runs and inexact laws allow."""
    tests = {key: test for key, test in joint.space.best_tests.items() if not test.trial.fault}
    rows = {c.key: c.rows for c in joint.beside if c.key in tests}
    found: list[FreeStep] = []
    for step in free.steps(rows.keys()):
        key, name = step.candidate.key, step.candidate.name
        p = joint.space.family_wise_of(step.fall, tests[key].null)
        if p <= SELECTION.level(joint.space.draws) and step.fall > inexactness_of(name, rows[key], joint.laws):
            found.append(step)
    return found[: SELECTION.most_free_steps]


def _tests_without(joint: Joint, keys: Collection[str], seed: int, progress: Progress) -> ScoreTests:
    """Score tests of the laws beside the present fit without some of its effects, with the floor of that fit.

    Of sensor faults those are there that stand for a tolerance of their own.
    """
    linearisation = joint.space.linearisation
    progress(Step(Stage.SHAPE_CONSTANTS, subject=", ".join(keys)))
    plain = Linearisation.of(less(joint, keys).fit, linearisation.floor)
    plain = replace(plain, latencies=linearisation.latencies)
    tried = [
        effect
        for effect in joint.first.effects.values()
        if effect.as_physics is not None or effect.sheet_kind not in WITHOUT_COLUMN or effect in joint.removed
    ]
    return beside_removed(joint, ScoreTests.of(plain, tried, seed, None, progress, joint.drawn), progress)
