"""Rounds of search and refit: the effects found are at their best before further ones are sought."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress
from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.regression.wls import Fit
from lacet.identify.selection import diagnose
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint import free_constants, other_constants, rounds, subset_search
from lacet.identify.selection.joint.alternatives import Alternative
from lacet.identify.selection.joint.free_constants import FreeConstants, least_gain
from lacet.identify.selection.joint.other_constants import OtherLaws, with_other_constants
from lacet.identify.selection.joint.refits import Joint, fitted_together, less
from lacet.identify.selection.joint.rounds import improved, with_a_fault
from lacet.identify.selection.joint.shape_constants import fall_of, implausible_together, with_best_constants
from lacet.identify.selection.joint.subset_search import Subset, search
from lacet.identify.selection.relinearisation import relinearise
from lacet.identify.selection.rest import AddedLaw, Rest, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from tests.identify.exact_car import KNOWN, driven, fit_of
from tests.identify.selection.exact_ranking import DRAWS
from tests.identify.selection.joint.three_hidden import with_all

STOP = replace(KNOWN["bump_stop.rear"], shape={"gap": 0.01, "n": 1.0})
TOO_SOON = replace(STOP, shape={"gap": 0.0, "n": 2.0})
"""The stop with constants that do the work of the spring, too."""
TOO_LATE = replace(STOP, shape={"gap": 0.02, "n": 1.0})
BAR = KNOWN["anti_roll_bar.rear"]
SPRING, CUBIC = KNOWN["spring_quadratic.rear"], KNOWN["spring_cubic.rear"]
HELPER = KNOWN["helper_spring.rear"]
HELPER_AT_10 = replace(HELPER, shape={"gap": 0.01})
MISSING = [(STOP, 30000.0), (SPRING, 60000.0), (BAR, 6000.0)]
GAIN = KNOWN["sensor_gain.hub.fl"]
LATE = KNOWN["sensor_latency.imu"]
TRIED = [
    STOP, SPRING, CUBIC, HELPER, BAR, KNOWN["coulomb.front"], GAIN,
    KNOWN["sensor_gain.hub.rr"], LATE,
]  # fmt: skip


@pytest.fixture(scope="module")
def fitted() -> Fit:
    return fit_of(driven(with_all(MISSING), 3))


@pytest.fixture(scope="module")
def floor(fitted: Fit) -> NoiseFloor:
    return floor_of(fitted, DRAWS)


@pytest.fixture(scope="module")
def space(fitted: Fit, floor: NoiseFloor) -> ScoreTests:
    candidates = [replace(KNOWN[effect.key], shape={}) for effect in TRIED]
    return ScoreTests.of(Linearisation.of(fitted, floor), candidates, 0)


def begun(space: ScoreTests, added: list[Effect]) -> Joint:
    """The model with these effects, as if a search had found them."""
    alone = tuple(space.family_wise(space.try_all()))
    base = space.linearisation.runs.refittable
    joint = Joint(space, alone, space, alone, (), added_laws(space), base=base, added=tuple(added))
    return fitted_together(joint, 0, lambda _: None)


def test_gain_and_loss_with_free_constants_are_those_of_the_sets(space: ScoreTests):
    selected = [TOO_SOON, BAR]
    free = FreeConstants(space.given(selected), [effect.key for effect in selected])
    step = free.steps([SPRING.key])[0]
    assert step.other.shape != TOO_SOON.shape
    with_step = [step.other, selected[1], step.candidate]
    # The tests beside the selected effects have other priors of the tolerances than `space`.
    rightly = ScoreTests(space.given(selected).columns.given([]), space.noise)
    assert step.gain == pytest.approx(fall_of(rightly, with_step) - fall_of(rightly, selected), rel=1e-6)


def test_loss_with_free_constants_is_that_of_the_set_without(space: ScoreTests):
    selected = [TOO_LATE, SPRING]
    beside = space.given(selected)
    loss, other = FreeConstants(beside, [effect.key for effect in selected]).loss_without(SPRING.key)
    rightly = ScoreTests(beside.columns.given([]), space.noise)
    assert other is not None
    assert loss == pytest.approx(fall_of(rightly, selected) - fall_of(rightly, [other]), rel=1e-6)
    assert loss < fall_of(rightly, selected) - fall_of(rightly, [TOO_LATE])


def test_a_spring_that_a_stop_with_wrong_constants_stands_for_is_found(space: ScoreTests):
    wrong = replace(begun(space, [TOO_SOON, BAR]), dropped=frozenset({GAIN.key, SPRING.key, "coulomb.front"}))
    assert {*wrong.keys} == {STOP.key, BAR.key}
    right = improved(wrong, 0)
    (stop,) = (effect for effect in right.effects if effect.key == STOP.key)
    assert {*right.keys} == {STOP.key, BAR.key, SPRING.key}
    assert right.dropped == {GAIN.key}  # a law may stand beside others, a fault that was denied is not tried again
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)


def test_a_law_alone_in_its_rows_may_do_the_work_of_two(space: ScoreTests):
    """With its constants it leaves no row to others; one without constants is what it is."""
    fitted = fit_of(driven(with_all(MISSING[:2]), 3))
    linearisation = Linearisation.of(fitted, floor_of(fitted, DRAWS))
    candidates = [replace(KNOWN[one.key], shape={}) for one in (STOP, SPRING, CUBIC, KNOWN["coulomb.front"])]
    alone = ScoreTests.of(linearisation, candidates, 0)
    wrong = begun(alone, [TOO_SOON])
    assert [law.key for law in wrong.laws] == [STOP.key]
    others = with_other_constants(wrong, 0, lambda _: None)
    assert any(other.needed == {STOP.key, SPRING.key} for other in others)
    assert with_other_constants(begun(space, [BAR]), 0, lambda _: None) == []


def test_constants_are_searched_again_in_the_fit_with_all(space: ScoreTests):
    """A law that falls out of that fit is not needed, even if its constants moved, but the strongest is."""
    wrong = begun(space, [TOO_LATE, SPRING, BAR])
    (strongest,) = with_other_constants(wrong, 0, lambda _: None)[-1].needed
    laws = [STOP, SPRING, BAR]
    falls = {law.key: fall_of(space, [one for one in laws if one is not law]) for law in laws}
    assert strongest == min(falls, key=lambda key: falls[key])
    right = improved(wrong, 0)
    (stop,) = (effect for effect in right.effects if effect.key == STOP.key)
    assert {*right.keys} == {*wrong.keys}
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)


def test_constants_that_the_runs_do_not_show_are_given_up(space: ScoreTests):
    """A stop a little bent explains no less than one that is not: the straight one has a constant less."""
    (best,) = (one for one in with_best_constants(space, [STOP, SPRING, BAR]) if one.key == STOP.key)
    bent = replace(best, shape={"gap": best.shape["gap"], "n": 1.01})
    others = with_other_constants(begun(space, [bent, SPRING, BAR]), 0, lambda _: None)
    assert [one.shape["n"] for one in others[-1].laws if one.key == STOP.key] == [1.0]
    assert fall_of(space, [best, SPRING, BAR]) - fall_of(space, [bent, SPRING, BAR]) < SELECTION.least_refinement_fall


def test_constants_with_which_nothing_stands_in_the_fit_are_not_taken(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch
):
    """The only law found, whose size with better constants no car has, say: it would be lost."""
    found = begun(space, [TOO_LATE])
    assert [law.key for law in found.laws] == [STOP.key]
    (*_, moved) = with_other_constants(found, 0, lambda _: None)
    assert moved.needed == {STOP.key}
    monkeypatch.setattr(rounds, "with_other_constants", lambda *given: [moved])
    monkeypatch.setattr(rounds, "exchanged", lambda joint, seed, progress: joint)
    assert improved(found, 0).effects[0].shape != TOO_LATE.shape
    monkeypatch.setattr(rounds, "_refitted", lambda joint, without, *given: without)
    assert improved(found, 0).effects == found.effects


@pytest.mark.parametrize("stuck", [False, True])
def test_a_law_that_right_constants_make_needless_is_dropped(
    floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch, stuck: bool
):
    """Beside a stop with wrong constants a spring stands that the car does not have; also where a search for those of
    both together changes nothing."""
    plain = fit_of(driven(with_all([(STOP, 30000.0), (BAR, 6000.0)]), 3))
    candidates = [replace(KNOWN[effect.key], shape={}) for effect in TRIED]
    wrong = begun(ScoreTests.of(Linearisation.of(plain, floor), candidates, 0), [TOO_LATE, SPRING, BAR])
    assert SPRING.key in wrong.keys
    if stuck:
        monkeypatch.setattr(other_constants, "with_best_constants", lambda space, laws, progress: list(laws))
    right = improved(wrong, 0)
    assert {*right.keys} == {STOP.key, BAR.key}


def test_laws_that_did_not_stand_are_not_fitted_again(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    """Beside a stop, a bar and a spring no cubic spring stands; better constants of the stop do, as often as asked."""
    joint = begun(space, [TOO_LATE, SPRING, BAR])
    needless = OtherLaws([STOP, SPRING, BAR, CUBIC], frozenset([CUBIC.key]))
    better = OtherLaws([STOP, SPRING, BAR], frozenset())
    monkeypatch.setattr(rounds, "with_other_constants", lambda *given: [needless, better])
    tried: list[Collection[str]] = []
    fitted = rounds._refitted

    def counted(joint: Joint, without: Joint, other: OtherLaws, seed: int, progress: Progress) -> Joint:
        tried.append({law.key for law in other.laws})
        return fitted(joint, without, other, seed, progress)

    monkeypatch.setattr(rounds, "_refitted", counted)
    once = improved(joint, 0)
    assert {*once.keys} == {*joint.keys}
    improved(once, 0)
    assert [CUBIC.key in keys for keys in tried] == [True, False, False]


def test_a_law_is_not_exchanged_back(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    """Of two laws each may seem to explain more where the other is in the fit."""

    def nearest(space: ScoreTests, law: AddedLaw) -> list[Alternative]:
        other = {SPRING.key: CUBIC, CUBIC.key: SPRING}.get(law.key)
        return [Alternative(other, -100.0, 1.0, 0.0, 0.0)] if other else []

    monkeypatch.setattr(rounds, "alternatives", nearest)
    once = rounds.exchanged(begun(space, [STOP, SPRING, BAR]), 0)
    assert {*once.keys} == {STOP.key, CUBIC.key, BAR.key}
    monkeypatch.delattr(rounds, "fitted_together")  # nothing is left to be fitted
    assert rounds.exchanged(once, 0) is once


@pytest.mark.parametrize(("share", "exchanged"), [(0.9, False), (0.1, True)])
def test_what_is_missing_beside_a_law_does_not_take_its_place(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch, share: float, exchanged: bool
):
    """It explains more than the law, and little of what the law does."""
    joint = begun(space, [STOP, SPRING, BAR])
    law = joint.laws[0]
    other = Alternative(KNOWN["coulomb.front"], -100.0, 1.0, 0.0, share * law.force)
    monkeypatch.setattr(rounds, "alternatives", lambda space, law: [other])
    assert rounds._in_place_of(joint, law) == ([other] if exchanged else [])


def test_constancy_of_a_removed_latency_is_tested_beside_what_was_found(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch
):
    joint = begun(space, [STOP, SPRING, BAR])
    joint = replace(joint, removed=(LATE,), space=joint.space.given([LATE]))
    tested: list[ScoreTests] = []
    monkeypatch.setattr(diagnose, "chow_test", lambda tests, c: tested.append(tests))
    (late,) = (c for c in joint.beside if c.key == LATE.key)
    assert diagnose._not_constant(joint, Rest.of(joint.space, joint.laws), [late], lambda _: None) == {}
    assert [tests.fitted for tests in tested] == [joint.space.fitted]
    assert LATE.key not in tested[0].selected


def test_a_search_keeps_what_is_in_the_model_already(space: ScoreTests):
    """A latency that was removed from the runs stays in the model of each of its steps, and is not found again."""
    beside = space.given([LATE])
    found = search(beside, beside.family_wise(beside.try_all()))
    assert found.effects
    assert LATE.key not in found.keys
    assert LATE.key in found.space.selected


@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_a_fault_is_tried_where_it_is_significant(fitted: Fit, floor: NoiseFloor, wrong: float):
    record = recording_without_faults(with_all(MISSING), [GAIN], np.array([-wrong]))
    off = fit_of(driven(record, 3), fitted) if wrong else fitted
    joint = begun(ScoreTests.of(Linearisation.of(off, floor), TRIED, 0), [STOP, SPRING, BAR])
    assert [set(new.keys) - set(joint.keys) for new in with_a_fault(joint, 0)] == ([{GAIN.key}] if wrong else [])


def test_latencies_beside_what_is_missing_are_nearer_the_truth(fitted: Fit, floor: NoiseFloor):
    late = 0.01
    record = recording_without_faults(with_all(MISSING), [LATE], np.array([-late]))
    present = Linearisation.of(fit_of(driven(record, 3), fitted), floor)
    alone, beside = (relinearise(present, beside=effects) for effects in ((), (STOP, SPRING, BAR)))
    assert not beside.fitted.model.effects[len(present.fitted.model.effects) :]

    def error(found: Linearisation) -> float:
        """Of the inertial unit's latency against the wheels': the time that all have in common is in no run."""
        by_channel = {channel: seconds for (_, channel, _), seconds in found.latencies.items()}
        others = [seconds for channel, seconds in by_channel.items() if not channel.startswith("imu")]
        return abs(by_channel["imu.accel"] - float(np.mean(others)) - late)

    assert error(beside) < 0.5 * error(alone)
    # Linearised there, they are found to be what was removed.
    again = relinearise(beside, largest_phase=0.0, beside=(STOP, SPRING, BAR))
    for entry, seconds in beside.latencies.items():
        assert again.latencies[entry] == pytest.approx(seconds, abs=5e-4)


def test_rise_with_one_law_in_the_place_of_two_is_that_of_the_set(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    selected = [STOP, SPRING, BAR]
    beside = space.given(selected)
    pair = (STOP.key, SPRING.key)
    free = FreeConstants(beside, [effect.key for effect in selected])
    monkeypatch.setattr(free_constants, "SELECTION", replace(SELECTION, exchanged_share=np.inf))
    ((rise, candidate, of),) = free.in_place_of_two([CUBIC.key], {pair: np.inf})
    rightly = ScoreTests(beside.columns.given([]), space.noise)
    assert (candidate.key, of) == (CUBIC.key, pair)
    assert rise == pytest.approx(fall_of(rightly, selected) - fall_of(rightly, [CUBIC, BAR]), rel=1e-6)
    assert free.in_place_of_two([CUBIC.key], {pair: 0.9 * rise}) == []
    both, with_it = fall_of(rightly, selected) - fall_of(rightly, [BAR]), fall_of(rightly, [*selected, CUBIC])
    work = with_it - fall_of(rightly, [CUBIC, BAR])
    for share, there in ((1.01 * work / both, True), (0.99 * work / both, False)):
        monkeypatch.setattr(free_constants, "SELECTION", replace(SELECTION, exchanged_share=share))
        assert bool(free.in_place_of_two([CUBIC.key], {pair: np.inf})) is there


def test_gain_with_a_law_in_the_place_of_one_is_that_of_the_set(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    selected = [TOO_SOON, HELPER_AT_10, BAR]
    beside = space.given(selected)
    free = FreeConstants(beside, [effect.key for effect in selected])
    ((step, _),) = [one for one in free.in_place_of_one([SPRING.key]) if one[1] == HELPER.key]
    rightly = ScoreTests(beside.columns.given([]), space.noise)
    assert (step.candidate.key, step.other.key) == (SPRING.key, STOP.key)
    assert step.other.shape == STOP.shape
    with_step = [step.other, step.candidate, BAR]
    assert step.gain == pytest.approx(fall_of(rightly, with_step) - fall_of(rightly, selected), rel=1e-6)
    for share, there in ((0.99, True), (1.01, False)):
        monkeypatch.setattr(free_constants, "least_gain", lambda candidate, law, share=share: share * step.gain)
        assert bool([key for _, key in free.in_place_of_one([SPRING.key]) if key == HELPER.key]) is there


@pytest.mark.parametrize(("rival", "margin", "exchanged"), [
    (SPRING, 0.7, True), (SPRING, 4.1, False), (STOP, -0.7, False), (STOP, -4.1, True), (HELPER_AT_10, -0.7, False),
])  # fmt: skip
def test_a_rival_with_fewer_sizes_takes_the_place_of_a_law_that_explains_hardly_more(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch, rival: Effect, margin: float, exchanged: bool
):
    """A helper spring has a size and a gap, a spring a size, a stop an exponent as well."""
    joint = begun(space, [HELPER_AT_10, BAR])
    law = next(law for law in joint.laws if law.key == HELPER.key)
    other = Alternative(rival, margin, 1.0, 0.0, 0.0)
    monkeypatch.setattr(rounds, "alternatives", lambda space, law: [other])
    assert rounds._in_place_of(joint, law) == ([other] if exchanged else [])


def test_a_law_with_fewer_constants_need_not_explain_more():
    """A stop has a size, a gap and an exponent, a helper spring a size and a gap, a spring a size."""
    assert least_gain(SPRING, HELPER) == least_gain(HELPER, STOP) < 0.0
    assert least_gain(HELPER, SPRING) == least_gain(CUBIC, SPRING) == SELECTION.least_refinement_fall


@pytest.mark.parametrize("better", [True, False])
def test_a_law_takes_the_place_of_one_found_beside_wrong_constants(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch, better: bool
):
    """A cubic spring beside a stop with other constants is a quadratic one beside the stop; not if all explain less."""
    wrong = replace(begun(space, [TOO_SOON, CUBIC, BAR]), dropped=frozenset({GAIN.key}))
    assert CUBIC.key in wrong.keys
    if not better:
        monkeypatch.setattr(
            other_constants, "fall_of", lambda tests, laws: float(CUBIC.key in [law.key for law in laws])
        )
    exchanged = [
        one for one in with_other_constants(wrong, 0, lambda _: None)
        if one.needed == {SPRING.key, STOP.key} and CUBIC.key not in [law.key for law in one.laws]
    ]  # fmt: skip
    assert bool(exchanged) is better
    if better:
        (stop,) = (law for law in exchanged[0].laws if law.key == STOP.key)
        assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)


@pytest.mark.parametrize("allowed", [True, False])
def test_one_law_takes_the_place_of_two_that_a_wrong_start_found(
    floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch, allowed: bool
):
    """A stop is described by two springs; not where chance does not explain what the second adds."""
    plain = fit_of(driven(with_all([(STOP, 30000.0), (BAR, 6000.0)]), 3))
    candidates = [replace(KNOWN[effect.key], shape={}) for effect in TRIED]
    wrong = begun(ScoreTests.of(Linearisation.of(plain, floor), candidates, 0), [SPRING, CUBIC, BAR])
    assert {SPRING.key, CUBIC.key} <= {*wrong.keys}
    if not allowed:
        monkeypatch.setattr(ScoreTests, "family_wise_of", lambda self, fall, null: 0.0)
    found = [one for one in with_other_constants(wrong, 0, lambda _: None) if one.replaced]
    assert bool(found) is allowed
    if allowed:
        assert (found[0].needed, found[0].replaced) == ({STOP.key}, {SPRING.key, CUBIC.key})
        right = improved(wrong, 0)
        assert {*right.keys} == {STOP.key, BAR.key}
        assert {SPRING.key, CUBIC.key} <= right.dropped


def test_a_size_that_no_car_has_is_seen_before_a_fit(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    """In place of a stop and a spring, a helper spring alone would push the wrong way."""
    assert implausible_together(space, [HELPER_AT_10, BAR]) == {HELPER.key}
    assert implausible_together(space, [STOP, SPRING, BAR]) == set()
    seen: list[tuple[float, float]] = []
    monkeypatch.setattr(type(STOP), "implausible", lambda stop, size, half: seen.append((size[0], half[0])))
    implausible_together(space, [STOP, SPRING, BAR])
    ((size, half),) = seen
    assert size == pytest.approx(MISSING[0][1], abs=2 * half)
    assert 0.0 < half < 0.2 * size


def test_laws_of_a_size_that_no_car_has_are_not_fitted(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    wrong = begun(space, [TOO_SOON, BAR])
    assert any(other.needed for other in with_other_constants(wrong, 0, lambda _: None))
    monkeypatch.setattr(other_constants, "implausible_together", lambda space, laws: {law.key for law in laws})
    assert not any(other.needed for other in with_other_constants(wrong, 0, lambda _: None))


def test_a_fit_that_falls_back_to_a_set_that_was_left_is_no_better(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    """Of four laws three stand, which the search had before."""
    left = frozenset([STOP.key, SPRING.key, BAR.key])
    other = OtherLaws([STOP, SPRING, BAR, CUBIC], frozenset())
    monkeypatch.setattr(rounds, "with_other_constants", lambda joint, seed, progress: [other])
    monkeypatch.setattr(rounds, "exchanged", lambda joint, seed, progress: joint)
    joint = begun(space, [STOP, BAR])
    assert {*improved(joint, 0).keys} == left
    assert {*improved(replace(joint, refused=frozenset([left])), 0).keys} == {STOP.key, BAR.key}


def test_other_laws_of_implausible_size_are_no_better(space: ScoreTests, monkeypatch: pytest.MonkeyPatch):
    wrong = begun(space, [STOP, BAR])
    backwards = OtherLaws([HELPER_AT_10, BAR], frozenset([HELPER.key]))
    monkeypatch.setattr(rounds, "with_other_constants", lambda joint, seed, progress: [backwards])
    monkeypatch.setattr(rounds, "exchanged", lambda joint, seed, progress: joint)
    other = rounds._refitted(wrong, less(wrong, wrong.keys), backwards, 0, lambda _: None)
    assert other.laws[0].implausible is not None
    assert improved(wrong, 0).effects == wrong.effects


@pytest.mark.parametrize("case", ["of one run", "none fitted"])
def test_what_takes_no_place_of_two(space: ScoreTests, monkeypatch: pytest.MonkeyPatch, case: str):
    """An effect of one run; and none where processor time allows no fit."""
    wrong = begun(space, [SPRING, CUBIC, BAR])
    assert any(one.replaced for one in with_other_constants(wrong, 0, lambda _: None))
    if case == "of one run":
        for law in (STOP, HELPER):
            monkeypatch.setattr(type(law), "is_of_run", classmethod(lambda cls: True))
    else:
        monkeypatch.setattr(other_constants, "SELECTION", replace(SELECTION, most_free_steps=0))
    assert not any(one.replaced for one in with_other_constants(wrong, 0, lambda _: None))


@pytest.mark.parametrize(("noise", "shown"), [(0.99, True), (1.01, False)])
def test_a_column_that_is_mostly_noise_explains_nothing(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch, noise: float, shown: bool
):
    """`noise` : its energy ÷ what of the column's energy is none."""
    selected = [SPRING, CUBIC]
    beside, right = space.given(selected), ScoreTests.regression_without

    def noisy(tests: ScoreTests, keys: Collection[str]) -> SimpleNamespace:
        known = right(tests, keys)
        at = [trial.place.start for trial in space.layout.trials if trial.effect.key == STOP.key]
        out = np.zeros_like(known.reduced)
        out[at, at] = noise * known.reduced[at, at] * (known.reduced[at, at] > 0.0)
        # Beside the two that it takes the place of, the column is as it is beside none.
        return SimpleNamespace(reduced=known.reduced, noise=out)

    monkeypatch.setattr(ScoreTests, "regression_without", noisy)
    free = FreeConstants(beside, [effect.key for effect in selected])
    found = free.in_place_of_two([STOP.key], {(SPRING.key, CUBIC.key): np.inf})
    assert bool(found) is shown


@pytest.mark.parametrize("removed", [True, False])
def test_a_latency_removed_from_the_runs_is_in_no_fit(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch, removed: bool
):
    (late,) = (c for c in space.try_all() if c.key == LATE.key)
    monkeypatch.setitem(vars(space), "chance_of_faults", {LATE.key: 1.0})
    entry = ("latency", "imu.accel", 0)
    monkeypatch.setattr(
        space, "linearisation", replace(space.linearisation, latencies={entry: 0.01} if removed else {})
    )
    assert subset_search._beyond_sheet(Subset(space, (), space), late) is removed
