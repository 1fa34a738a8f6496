"""Rounds of a selection: a search beside the effects found, a fit with what it adds, until nothing is added.

After each fit the effects in it are improved first: what a wrong one among them leaves looks like others missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from lacet.identify.effects.base import Effect, SensorFault
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import sheet_products
from lacet.identify.selection.joint.alternatives import Alternative, alternatives
from lacet.identify.selection.joint.free_constants import least_gain
from lacet.identify.selection.joint.other_constants import OtherLaws, with_other_constants
from lacet.identify.selection.joint.refits import (
    Joint,
    beside_of,
    beside_removed,
    fitted_together,
    less,
    only_standing,
    without_effects,
)
from lacet.identify.selection.joint.shape_constants import constants_by_runs
from lacet.identify.selection.joint.subset_search import search
from lacet.identify.selection.relinearisation import relinearise
from lacet.identify.selection.rest import AddedLaw, Rest, added_laws, departures_on_rows
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.channels.speed_agreement import SpeedAgreement


def found_together(first: ScoreTests, seed: int, progress: Progress = silent) -> Joint:
    """The effects found in all, in a fit with them, and the score tests of all others beside them.

    What a selection leaves is judged by a new fit with the selected effects in its model, and a noise floor of it.
    Where the runs cannot be fitted again here, nothing is found.
    """
    progress(Step(Stage.SCORE_TESTS))
    alone = tuple(first.family_wise(first.try_all()))
    base = first.linearisation.runs.refittable
    joint = Joint(first, alone, first, alone, (), added_laws(first), base=base)
    if base is None:
        return joint
    shown = _shown_by_speed(first, base)
    if shown:
        keys = frozenset(fault.key for fault in shown)
        # One that does not stand beside the model as it is may do so beside what is missing in that.
        joint = replace(fitted_together(replace(joint, added=shown), seed, progress), shown=keys, dropped=joint.dropped)
    return continued(joint, seed, progress)


def _shown_by_speed(first: ScoreTests, base: Fit) -> tuple[Effect, ...]:
    """Faults without which the inertial unit and the speed sensor disagree.

    A search begins with them: no force on the car, listed or not, sets these instruments apart.
    """
    agreement = SpeedAgreement.of(base.runs)
    found = agreement.beyond_sheet(SELECTION.significance) if agreement else []
    return tuple(first.effects[fault.key] for fault in found if fault.key in first.effects)


def started_with(joint: Joint, effect: Effect, seed: int, progress: Progress = silent) -> Joint:
    """The effects found by a search that begins with `effect` in the fit; none where it does not stand in that."""
    first, base = joint.first, joint.first.linearisation.runs.refittable
    none = Joint(first, joint.alone, first, joint.alone, (), added_laws(first), base=base, shown=joint.shown)
    others = (first.effects[key] for key in sorted(joint.shown - {effect.key}))
    begun = fitted_together(replace(none, added=(effect, *others)), seed, progress)
    return continued(begun, seed, progress) if effect.key in begun.keys else none


def with_a_fault(joint: Joint, seed: int, progress: Progress = silent) -> Iterator[Joint]:
    """The effects found with a sensor fault that is significant beside them, the likeliest first.

    A search does not add what the laws found may be inexact by. Where the sensor sheet would have to be wrong instead,
    a fault is the simpler answer; another one found before for lack of it does not stand beside it.
    """
    effects = joint.first.effects
    tested = [c for c in joint.beside if c.tested and effects[c.key].as_fault is not None]
    faults = [c for c in tested if c.p <= SELECTION.level(joint.space.draws)]
    for c in sorted(faults, key=lambda c: -c.drop)[: SELECTION.most_starts - 1]:
        wanted = replace(joint, added=(*joint.added, effects[c.key]))
        new = fitted_together(wanted, seed, progress)
        if c.key in new.keys:
            yield new


def continued(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same with what is found beside the effects found before."""
    for _ in range(SELECTION.most_refits):
        found = search(joint.space, joint.beside, joint.laws, progress).effects  # free the memory of its tests
        if not found:
            break
        # A latency that was removed from the runs would be fitted as what remains of it.
        latencies = joint.space.linearisation.latencies
        late = [effect for effect in found if effect.sheet_kind == "latency" and latencies]
        others = [effect for effect in found if effect not in late]
        joint = replace(joint, effects=(*joint.effects, *late), removed=(*joint.removed, *late))
        present = joint.effects
        if others:
            joint = fitted_together(replace(joint, added=(*joint.added, *others)), seed, progress)
            for _ in range(SELECTION.most_refits if joint.effects != present else 0):
                before, joint = joint.effects, improved(joint, seed, progress)
                if joint.effects == before:
                    break
        if joint.effects == present:
            if not late:
                break
            joint = beside_of(joint, beside_removed(joint, joint.space, progress), progress)
    return joint


def improved(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The effects found, one step better fitted; the same where they are at their best.

    The runs are linearised at the latencies beside them; the shape constants of the laws are searched again together; a
    law is exchanged. A set of effects that did not stand, or that another took the place of, is not fitted again.
    """
    if joint.space.linearisation.latencies:
        joint = relinearised(joint, seed, progress)
    laws = [effect.key for effect in joint.effects if effect.as_physics is not None]
    others = frozenset(joint.keys) - {*laws}
    without: Joint | None = None
    for other in with_other_constants(joint, seed, progress):
        wanted = others | {law.key for law in other.laws}
        if wanted in joint.refused:
            continue
        without = without or less(joint, laws)
        new = _refitted(joint, without, other, seed, progress)
        stands = other.needed <= {law.key for law in new.laws if law.key in new.keys and law.implausible is None}
        if stands and frozenset(new.keys) not in joint.refused:
            return joint.replaced_by(new)
        joint = replace(joint, refused=joint.refused | {wanted})
    return exchanged(joint, seed, progress)


def relinearised(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The effects found that stand where the runs are linearised at their latencies beside all of them."""
    space = joint.space
    closer = relinearise(space.linearisation, progress, SELECTION.settled_phase)
    if closer is space.linearisation:
        return joint
    tests = ScoreTests.of(closer, list(space.effects.values()), seed, None, progress, joint.drawn)
    tests = beside_removed(joint, tests, progress)
    return only_standing(beside_of(joint.based_on(tests), tests, progress), seed, progress)


def with_floor_at_tolerances(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same with the noise floor at the parameters estimated with sensor tolerances in place of the fit's."""
    space, fitted = joint.space, joint.space.linearisation.runs.refittable
    assert fitted is not None
    progress(Step(Stage.FLOOR_AT_TOLERANCES))
    floor = space.floor.redrawn(fitted, space.tolerated_parameters)
    sums = sheet_products(space.linearisation.runs, floor)
    linearisation = replace(space.linearisation, floor=floor, sums=sums)
    # What noise adds cancels in what the model explains at this fit's zeros only.
    tests = ScoreTests.of(linearisation, list(space.effects.values()), seed, space.noise, progress, [space.drawn])
    return beside_of(joint, beside_removed(joint, tests, progress), progress)


def _refitted(joint: Joint, without: Joint, other: OtherLaws, seed: int, progress: Progress) -> Joint:
    """The model with other laws in place of those found, as far as they stand in the fit; `without` : it with none.

    A law of the car that did not stand beside those found is tried again: beside these it may.
    """
    out = frozenset(
        key
        for key in joint.dropped
        if key in joint.parts or joint.first.effects[key].as_fault is not None or joint.first.effects[key].is_of_run()
    )
    wanted = replace(without, added=(*without.added, *other.laws), dropped=out | other.replaced)
    return fitted_together(wanted, seed, progress)


def exchanged(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same with each law for which a candidate explains more in its place exchanged for it, and fitted again.

    The search compared them beside fewer effects, and with the noise of another model. A candidate beside which
    the law explains as much as alone is no exchange: both are missing. What was exchanged once is not exchanged back.
    """
    tried: set[str] = set()
    while True:
        better = [
            (nearest, law)
            for law in joint.laws
            if law.key in joint.keys and law.key not in tried
            for nearest in _in_place_of(joint, law)
            if nearest.key not in tried and (frozenset(joint.keys) - {law.key}) | {nearest.key} not in joint.refused
        ]
        if not better:
            return joint
        nearest, law = min(better, key=lambda pair: pair[0].margin)
        tried |= {law.key, nearest.key}
        without = less(joint, [law.key])
        rival = constants_by_runs(without.fit, joint.space.floor, [nearest.effect], progress, joint.drawn)
        other = fitted_together(replace(without, added=(*without.added, *rival)), seed, progress)
        if nearest.key in other.keys and frozenset(other.keys) not in joint.refused:
            joint = joint.replaced_by(other)


def _in_place_of(joint: Joint, law: AddedLaw) -> list[Alternative]:
    """The candidate that explains most in a law's place, if enough more than it, most of which it explains as well.

    One with fewer sizes and constants may explain a little less (`least_gain`).
    """
    allowed = SELECTION.exchanged_share * law.force
    effect = next(one for one in joint.effects if one.key == law.key)
    return [
        one
        for one in alternatives(joint.space, law)
        if one.margin < -least_gain(one.effect, effect) and one.law_beside <= allowed
    ][:1]


def without_denied_faults(
    joint: Joint, rest: Rest, seed: int, progress: Progress = silent
) -> tuple[Joint, Rest]:  # fmt: skip
    """The same without the sensor faults that a rest was taken for, with what is found among effects of the car alone
    in place of them, and what then remains.

    What an unknown force does to rows of one kind looks like a fault of the sensors in them; removed from the runs,
    such a fault makes rows of other kinds fail, which want it back, and instruments disagree that no force sets apart.
    A fault stands if those rows, and these instruments, want it changed by no more than chance, or than a law may be
    inexact. Other faults are not tried in place of one that does not stand while anything is unlisted. One that these
    instruments show by themselves stands whatever the rows want.
    """
    found = [fault for fault in joint.space.fitted.model.faults if fault.key in set(joint.keys) - joint.shown]
    denied = _denied_by_rows(joint, rest, found) | _denied_by_speed(joint, found)
    if not denied:
        return joint, rest
    others = (key for key, effect in joint.first.effects.items() if effect.as_physics is None)
    faults = set(others) - set(joint.keys) if rest.unlisted else set[str]()
    without = without_effects(replace(joint, dropped=joint.dropped | faults), denied, seed, progress)
    joint = continued(only_standing(without, seed, progress), seed, progress)
    return joint, Rest.of(joint.space, joint.laws)


def _denied_by_rows(joint: Joint, rest: Rest, found: Sequence[SensorFault]) -> set[str]:
    """Keys of the faults found that rows of other kinds than that in which most is unlisted want changed."""
    rows, space = rest.of_other_kinds(), joint.space
    if not found or not rows:
        return set()
    return {
        one.key
        for one in departures_on_rows(space, found, rows, joint.sizes)
        if space.family_wise_of(one.squares, one.null) <= SELECTION.level(space.draws)
        and one.squares > SELECTION.selected_inexactness**2 * one.force
    }


def _denied_by_speed(joint: Joint, found: Sequence[SensorFault]) -> set[str]:
    """Keys of the faults found with which the inertial unit and the speed sensor do not agree, whatever these show."""
    fitted = joint.space.linearisation.runs.refittable
    agreement = SpeedAgreement.of(fitted.runs) if fitted and found else None
    if fitted is None or agreement is None:
        return set()
    sizes, denied = agreement.sizes({*joint.shown, *(fault.key for fault in found)}), set[str]()
    for fault in found:
        if fault.key not in sizes:
            continue
        at = fitted.model.names.index(fault.parameters[0].name)
        one, remaining = sizes[fault.key], float(fitted.theta[at])
        sigma = float(np.sqrt(fitted.covariance[at, at] + fitted.covariance_sheet[at, at]))
        inexact = SELECTION.selected_inexactness * abs(joint.sizes.get(fault.key, 0.0) + remaining)
        chance = len(sizes) * one.chance(remaining, sigma)
        if chance <= SELECTION.significance and abs(one.value - remaining) > inexact:
            denied.add(fault.key)
    return denied
