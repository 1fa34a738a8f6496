"""Several effects at once on the car that is exactly its model: those hidden are found, and no other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.effects.base import Implausible
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.joint.alternatives import alternatives, confidence_set
from lacet.identify.selection.joint.refits import (
    Joint,
    beside_of,
    only_plausible,
    only_standing,
)
from lacet.identify.selection.joint.rivals import rivals
from lacet.identify.selection.joint.rounds import exchanged, found_together
from lacet.identify.selection.joint.shape_constants import refined
from lacet.identify.selection.joint.subset_search import Subset, _strongest
from lacet.identify.selection.rest import (
    AddedLaw,
    Rest,
    added_laws,
)
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import floor_of
from tests.identify.exact_car import KNOWN, driven, exact, fit_of
from tests.identify.selection.exact_ranking import DRAWS
from tests.identify.selection.joint.three_hidden import HIDDEN, KEYS, LAWS, STOP


def test_all_that_are_hidden_are_found_and_no_other(subset: Joint):
    assert set(subset.keys) == {*(effect.key for effect in LAWS), STOP.key}
    assert {law.key for law in subset.laws} == set(subset.keys)


def test_sizes_of_the_fit_with_all_are_the_true_ones(subset: Joint):
    fitted = subset.space.fitted
    sigma = np.sqrt(np.diag(fitted.covariance + fitted.covariance_sheet))
    for effect, size in HIDDEN:
        i = fitted.model.names.index(effect.parameters[0].name)
        assert abs(fitted.theta[i] - size) <= max(3.0 * sigma[i], 0.02 * abs(size))


def test_constants_between_two_values_of_their_grids_are_found(subset: Joint):
    (stop,) = (effect for effect in subset.effects if effect.key == STOP.key)
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.0015)
    assert stop.shape["n"] == pytest.approx(STOP.shape["n"], abs=0.15)


def test_where_nothing_is_missing_nothing_is_found():
    plain = fit_of(driven(exact(), 0))
    nothing = ScoreTests.of(Linearisation.of(plain, floor_of(plain, DRAWS)), [KNOWN[key] for key in KEYS], 0)
    found = found_together(nothing, 0)
    assert not found.effects
    assert not found.laws
    assert found.space is nothing


def test_a_rival_that_explains_more_takes_the_place(space: ScoreTests):
    """A cubic spring in the place of a stop explains less, and the stop in its place more."""
    cubic = KNOWN["spring_cubic.rear"]
    free = space.given([*LAWS, cubic]).releasing([cubic.key])
    tried = free.try_all()
    (own,) = (c for c in tried if c.key == cubic.key)
    best, *_ = rivals(free, own, tried)
    assert best.effect.key == STOP.key
    assert best.margin < 0.0
    stop = refined(free, next(c for c in tried if c.key == STOP.key))
    assert all(rival.margin > 0.0 for rival in rivals(free, stop, tried))


def test_selected_effects_are_nuisance_and_released_ones_candidates(space: ScoreTests):
    bar = KNOWN["anti_roll_bar.front"]
    beside = space.given([bar])
    assert bar.key not in beside.best_tests
    again = beside.releasing([bar.key])
    # The same priors, but for their stiffening: the same test as alone.
    assert again.best_tests[bar.key].values == pytest.approx(space.best_tests[bar.key].values, rel=0.02)


def test_the_same_law_elsewhere_is_one_step_and_another_law_is_not(space: ScoreTests):
    """At both ends where it passes at both, beside wheels of neither end."""
    beside = Subset(space, (), space)
    bars, friction = ("anti_roll_bar.front", "anti_roll_bar.rear"), "coulomb.front"
    tried = [
        Candidate(key, {}, gain=0.5, drop=drop, total_gain=drop, p=1.0 / (1 + DRAWS), values=(9.0,), interval=(1.0,))
        for key, drop in zip((*bars, friction), (900.0, 400.0, 700.0), strict=True)
    ]
    assert [c.key for c in _strongest(beside, tried)] == list(bars)
    by_chance = replace(tried[1], p=0.5)
    assert [c.key for c in _strongest(beside, [tried[0], by_chance, tried[2]])] == [bars[0]]


def test_what_remains_of_one_wheel_is_compared_with_a_fifth_of_the_laws_force(subset: Joint):
    """Left and right are never equal, but a bar's; another law at both wheels is compared with a twentieth."""
    beside = Subset(subset.space, (), subset.space, settled=subset.laws)
    for key in (STOP.key, "anti_roll_bar.front"):
        (law,) = (law for law in subset.laws if law.key == key)
        both = Candidate("coulomb.front", {}, rows=tuple(sorted(law.rows)))
        one = replace(both, rows=both.rows[:1])
        others = [other for other in subset.laws if not other.rows.isdisjoint(both.rows)]
        shares = {other.key: 0.05 if other.key == "anti_roll_bar.front" else 0.2 for other in others}
        assert beside.inexactness(both) == pytest.approx(sum(0.05**2 * other.force for other in others))
        assert beside.inexactness(one) == pytest.approx(sum(shares[other.key] ** 2 * other.force for other in others))


def test_the_margin_over_a_rival_is_what_a_fit_with_it_leaves_more(subset: Joint):
    """Least squares with the law held at zero and the rival's columns beside, against least squares with the law."""
    space, (law,) = subset.space, [law for law in subset.laws if law.key == STOP.key]
    (found,) = (one for one in alternatives(space, law) if one.key == "spring_cubic.rear")
    known, model, right = space.regression, space.layout.model, space.layout.right
    trial = space.best_tests["spring_cubic.rear"].trial
    places = np.append(known.nuisance, trial.place.start)
    normal = known.total[np.ix_(places, places)].copy()
    normal[:-1, :-1] += known.prior
    normal[-1, -1] += known.noise[trial.place.start, trial.place.start] + trial.effect.parameters[0].prior ** -2.0
    side = np.append(known.total[known.nuisance, right] + known.prior_side, known.total[trial.place.start, right])
    held = np.zeros((len(law.places), len(places)))
    held[:, :model] = known.sums.turn[list(law.places)]
    size = space.fitted.theta[space.fitted.place][list(law.places)]
    whole = np.block([[normal, held.T], [held, np.zeros((len(size),) * 2)]])
    x = np.linalg.solve(whole, np.concatenate([side, -size]))[: len(places)]
    without = x @ normal @ x - 2.0 * side @ x
    free = np.linalg.solve(normal[:-1, :-1], side[:-1])
    assert found.margin == pytest.approx(without + side[:-1] @ free, rel=1e-6)
    assert found.p <= 1.0 / (1 + DRAWS)
    assert not confidence_set([found], DRAWS)


def test_what_all_leave_is_nothing_and_what_the_base_model_leaves_is_unlisted_or_small(
    space: ScoreTests, subset: Joint, monkeypatch: pytest.MonkeyPatch
):
    assert not Rest.of(subset.space, subset.laws).unlisted
    before = Rest.of(space)
    assert {"suspension.fl", "suspension.rl"} <= set(before.unlisted)
    assert before.excess > 0.0
    assert not before.small
    monkeypatch.setattr("lacet.identify.selection.rest.SELECTION", replace(SELECTION, effect_size=10.0))
    trifle = Rest.of(space)
    assert set(trifle.small) == set(before.unlisted)
    assert not trifle.unlisted


def test_an_effect_that_does_not_stand_in_its_model_is_removed_and_the_others_stay(subset: Joint):
    """As after latencies were removed from the runs: an effect of no size, in the fit beside those that are there."""
    idle, base = KNOWN["tyre_damping.rear"], subset.base
    assert base is not None
    fitted = base.with_effects([*subset.added, idle])
    tried = [KNOWN[key] for key in ("coulomb.rear", "coulomb.front", "spring_cubic.rear", "tyre_damping.front")]
    tests = ScoreTests.of(Linearisation.of(fitted, subset.space.floor.redrawn(fitted)), tried, 0)
    beside = beside_of(replace(subset, added=(*subset.added, idle), effects=(*subset.effects, idle)), tests)
    found = only_standing(beside, 0)
    assert set(found.keys) == set(subset.keys)
    assert idle.key in found.dropped
    assert idle.key not in found.space.fitted.model
    assert {law.key for law in found.laws} == set(subset.keys)


def test_a_law_in_the_model_is_exchanged_for_one_that_explains_more_in_its_place(subset: Joint):
    """The stop, with the constants of the runs, for a cubic spring; nothing is exchanged for what explains less."""
    assert exchanged(subset, 0) is subset
    cubic, base = KNOWN["spring_cubic.rear"], subset.base
    assert base is not None
    wrong = [cubic if effect.key == STOP.key else effect for effect in subset.effects]
    fitted = base.with_effects(wrong)
    others = [KNOWN[key] for key in KEYS if key not in fitted.model]
    tests = ScoreTests.of(Linearisation.of(fitted, subset.space.floor.redrawn(fitted)), others, 0)
    found = exchanged(beside_of(replace(subset, added=tuple(wrong), effects=tuple(wrong)), tests), 0)
    assert set(found.keys) == set(subset.keys)
    assert set(found.space.fitted.model.names) == set(subset.space.fitted.model.names)
    (stop,) = (effect for effect in found.effects if effect.key == STOP.key)
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)


def test_an_effect_of_a_size_that_no_car_has_is_not_found(subset: Joint) -> None:
    """In the fit with all of them: it looks like something else."""
    bar = "anti_roll_bar.front"
    assert only_plausible(subset, 0) is subset
    wrong = Implausible(KNOWN[bar].parameters[0], 2e6, 2.1e6)
    laws = tuple(replace(law, implausible=wrong if law.key == bar else None) for law in subset.laws)
    found = only_plausible(replace(subset, laws=laws), 0)
    assert set(found.keys) == set(subset.keys) - {bar}
    assert bar not in {law.key for law in found.laws}


def test_a_diagnosis_names_none_of_a_size_that_no_car_has(subset: Joint, monkeypatch: pytest.MonkeyPatch):
    bar, other = "anti_roll_bar.front", Implausible(KNOWN["anti_roll_bar.front"].parameters[0], 2e6, 2.1e6)

    def laws(space: ScoreTests) -> tuple[AddedLaw, ...]:
        return tuple(replace(law, implausible=other if law.key == bar else None) for law in added_laws(space))

    monkeypatch.setattr("lacet.identify.selection.joint.refits.added_laws", laws)
    first = subset.first
    found = diagnose(first.fitted, first.floor, list(first.effects.values()), noise=first.noise)
    assert bar in subset.keys
    assert bar not in {c.key for c in found.found}
    assert found.found
