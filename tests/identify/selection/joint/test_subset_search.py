"""Several effects at once on the car that is exactly its model: those hidden are found, and no other."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect, Implausible, SensorFault
from lacet.identify.effects.body.payload import Payload
from lacet.identify.progress import Progress, silent
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sums.prepared_runs import recording_without_faults, without_faults
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Answer, Candidate, Reason
from lacet.identify.selection.chow_test import ParameterConstancy
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import _as_found, _concluded, _not_constant, _without_doubted, diagnose
from lacet.identify.selection.joint import shape_constants
from lacet.identify.selection.joint.alternatives import alternatives, confidence_set
from lacet.identify.selection.joint.refits import (
    Joint,
    _not_standing_elsewhere,
    _tests_of_some,
    beside_of,
    fitted_with,
    less_a_part,
    not_part_of_the_rest,
    only_plausible,
    only_standing,
)
from lacet.identify.selection.joint.rivals import rivals
from lacet.identify.selection.joint.rounds import exchanged, found_together, started_with, without_denied_faults
from lacet.identify.selection.joint.shape_constants import constants_by_runs, refined, with_best_constants
from lacet.identify.selection.joint.subset_search import Subset, _strongest
from lacet.identify.selection.rest import (
    AddedLaw,
    Departure,
    Rest,
    added_faults,
    added_laws,
    departures_on_rows,
    laws_on_rows,
)
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.channels.speed_agreement import AgreeingSize
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.services.render.verdicts import says, why
from tests.identify import cars
from tests.identify.exact_car import KNOWN, MODEL, driven, exact, fit_of, theta
from tests.identify.selection.exact_ranking import DRAWS

KEYS = (
    "anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.front", "coulomb.rear", "bump_stop.front", "bump_stop.rear",
    "spring_cubic.front", "spring_cubic.rear", "damper_asymmetry.front", "damper_knee.front", "damper_knee.rear",
    "tyre_damping.rear", "sensor_gain.hub.fl", "sensor_gain.hub.rr",
)  # fmt: skip
STOP = replace(KNOWN["bump_stop.rear"], shape={"gap": 0.0065, "n": 1.6})
HIDDEN = [(KNOWN["anti_roll_bar.front"], 6000.0), (KNOWN["damper_asymmetry.front"], -300.0)]
LAWS = [effect for effect, _ in HIDDEN]


def with_all(hidden: Sequence[tuple[Effect, float]]) -> Recording:
    """The exact drive of a car that is the model and these effects, with their sizes."""
    laws, sizes = zip(*hidden, strict=True)
    return cars.fulfil(exact(), (*MODEL.effects, *laws), np.append(theta(), sizes))


@pytest.fixture(scope="module")
def fitted() -> Fit:
    return fit_of(driven(with_all([*HIDDEN, (STOP, 60000.0)]), 3))


@pytest.fixture(scope="module")
def floor(fitted: Fit) -> NoiseFloor:
    return floor_of(fitted, DRAWS)


@pytest.fixture(scope="module")
def space(fitted: Fit, floor: NoiseFloor) -> ScoreTests:
    return ScoreTests.of(Linearisation.of(fitted, floor), [KNOWN[key] for key in KEYS], 0)


@pytest.fixture(scope="module")
def subset(space: ScoreTests) -> Joint:
    return found_together(space, 0)


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


def test_constants_searched_together_explain_more_than_one_after_the_other(space: ScoreTests):
    chosen = [*LAWS, replace(KNOWN[STOP.key], shape={"gap": 0.02, "n": 1.0})]
    *_, stop = with_best_constants(space, chosen)
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)


def test_a_law_is_the_simplest_of_its_kind_unless_another_explains_more():
    """Noise alone would bend a linear stop: its exponent cannot be less than 1."""
    linear = replace(STOP, shape={**STOP.shape, "n": 1.0})
    fitted = fit_of(driven(with_all([*HIDDEN, (linear, 60000.0)]), 3))
    space = ScoreTests.of(Linearisation.of(fitted, floor_of(fitted, DRAWS)), [KNOWN[key] for key in KEYS], 0)
    begun = [*LAWS, replace(linear, shape={"gap": 0.02, "n": 2.0})]
    *others, stop = with_best_constants(space, begun)
    assert others == LAWS
    assert stop.shape == {"gap": pytest.approx(linear.shape["gap"], abs=0.0005), "n": 1.0}


@pytest.mark.parametrize(
    ("falls", "chosen"),
    [
        ((100.0, 103.0, 111.0), 0),  # none beats it by 4 for each further constant
        ((100.0, 107.0, 112.5), 1),  # common ones beat the simplest, own ones these by less than 8
        ((100.0, 105.0, 114.0), 2),
        ((9900.0, 9910.0, 9920.0), 0),  # of a law of 10,000 weighted squares 25 are inexact
    ],
)
def test_a_law_has_the_fewest_constants_that_are_good_enough(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch, falls: tuple[float, ...], chosen: int
):
    """Simplest, common and own constants of a stop at both axles, beside an effect that has none."""
    stops = [KNOWN["bump_stop.front"], KNOWN["bump_stop.rear"]]
    shapes = [({"gap": 0.01, "n": n}, {"gap": gap, "n": other}) for n, gap, other in
              ((1.0, 0.01, 1.0), (1.2, 0.01, 1.2), (1.2, 0.02, 1.3))]  # fmt: skip
    answers = [[*(replace(e, shape=own) for e, own in zip(stops, both, strict=True)), LAWS[0]] for both in shapes]
    found = {None: 0.0, **dict(enumerate(falls))}
    monkeypatch.setattr(shape_constants._Falls, "of", lambda *_: shape_constants._Falls(None, [], None))
    monkeypatch.setattr(shape_constants._Falls, "of_choice", lambda self, at: found[at[0]])
    assert [shape_constants.constants_found(answer) for answer in answers] == [1, 2, 4]
    assert shape_constants._fewest_constants(space, answers, [[0, 1], [2]]) == answers[chosen]


def test_an_effect_that_is_added_without_a_ranking_gets_the_constants_of_the_runs(fitted: Fit, floor: NoiseFloor):
    *bars, stop = constants_by_runs(fitted, floor, [*LAWS, KNOWN[STOP.key]])
    assert bars == LAWS
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)
    assert stop.shape["n"] == pytest.approx(STOP.shape["n"], abs=0.2)


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
    """Left and right are never equal; another law at both wheels is compared with a twentieth."""
    beside = Subset(subset.space, (), subset.space, settled=subset.laws)
    (bar,) = (law for law in subset.laws if law.key == "anti_roll_bar.front")
    both = Candidate("coulomb.front", {}, rows=tuple(sorted(bar.rows)))
    one = replace(both, rows=both.rows[:1])
    others = [law for law in subset.laws if not law.rows.isdisjoint(both.rows)]
    assert beside.inexactness(both) == pytest.approx(sum(0.05**2 * law.force for law in others))
    assert beside.inexactness(one) == pytest.approx(sum(0.2**2 * law.force for law in others))


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


def test_what_explains_no_more_than_is_unlisted_in_its_rows_is_no_name(subset: Joint):
    """It may be a part of the same unknown cause; a law of other rows stays."""
    rest = Rest.of(subset.space, subset.laws)
    (damper,) = (law for law in subset.laws if law.key == "damper_asymmetry.front")
    row = min(damper.rows)
    for much, names in ((0.5, set(subset.keys)), (2.0, set(subset.keys) - {damper.key})):
        lack = replace(rest.lack, squares={**rest.lack.squares, row: much * damper.force})
        found, _ = not_part_of_the_rest(subset, replace(rest, lack=lack, unlisted=(row,)), 0)
        assert set(found.keys) == names


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


def test_the_rest_beside_a_law_counts_by_the_laws_force_in_each_row(subset: Joint):
    """A sensor's fault changes most rows a little: what is unlisted in these is not what it could be a part of."""
    rest, law = Rest.of(subset.space, subset.laws), subset.laws[0]
    first, second, *_ = rest.lack.squares
    known = replace(
        rest, lack=replace(rest.lack, squares={**rest.lack.squares, first: 7.0, second: 100.0}),
        unlisted=(first, second),
    )  # fmt: skip
    assert known.beside(replace(law, row_force={first: 50.0, second: 0.5})) == pytest.approx(7.0 + 100.0 * 0.01)
    assert known.beside(replace(law, row_force={})) == 0.0


def test_beside_a_fault_in_the_bodys_rows_all_that_remains_in_these_counts(subset: Joint):
    """An unknown force that goes with the body's motion acts in all six; not a law's, nor a fault's elsewhere."""
    rest, law = Rest.of(subset.space, subset.laws), subset.laws[0]
    main, pitch, wheel = Row("chassis.fx"), Row("chassis.my"), Row("suspension.fl")
    squares = {row: 7.0 if row == main else 0.0 for row in rest.lack.squares} | {pitch: 60.0, wheel: 100.0}
    known = replace(rest, lack=replace(rest.lack, squares=squares), unlisted=(pitch, wheel))
    force = {main: 50.0, pitch: 0.5, wheel: 0.5}
    fault = replace(law, row_force=force, sheet_entries=frozenset({("gain", "imu.acceleration")}))
    assert known.beside(fault) == pytest.approx(7.0 + 60.0 + 100.0 * 0.01)
    assert replace(known, unlisted=(wheel,)).beside(fault) == pytest.approx(100.0 * 0.01)
    assert known.beside(replace(law, row_force=force)) == pytest.approx(160.0 * 0.01)
    elsewhere = replace(fault, row_force={wheel: 50.0, pitch: 0.5})
    assert known.beside(elsewhere) == pytest.approx(100.0 + 60.0 * 0.01)


def test_a_fault_that_explains_no_more_than_is_unlisted_in_its_main_row_is_no_name(subset: Joint):
    """Judged as a law is, though it is none; the laws of other rows stay."""
    fault, base = KNOWN["sensor_gain.hub.fl"], subset.base
    assert base is not None
    fitted = base.with_effects([*subset.added, fault])
    tests = ScoreTests.of(Linearisation.of(fitted, subset.space.floor.redrawn(fitted)), [KNOWN["coulomb.rear"]], 0)
    joint = beside_of(replace(subset, added=(*subset.added, fault), effects=(*subset.effects, fault)), tests)
    assert fault.key not in {law.key for law in joint.laws}
    (own,) = added_faults(joint.space, {})
    row = max(own.row_force, key=lambda row: own.row_force[row])
    rest = Rest.of(joint.space, joint.laws)
    for much, names in ((0.5, set(joint.keys)), (2.0, set(joint.keys) - {fault.key})):
        lack = replace(rest.lack, squares={**rest.lack.squares, row: much * own.force})
        found, _ = not_part_of_the_rest(joint, replace(rest, lack=lack, unlisted=(row,)), 0)
        assert set(found.keys) == names


@pytest.mark.parametrize("effect_size", [SELECTION.effect_size, 10.0])
def test_beside_a_law_that_changes_weaker_ones_of_its_rows_are_no_names(
    subset: Joint, monkeypatch: pytest.MonkeyPatch, effect_size: float
):
    """They may stand for the same unlisted cause, and happen to change less; however small that is."""
    for room in ("rest", "settings"):
        monkeypatch.setattr(f"lacet.identify.selection.{room}.SELECTION", replace(SELECTION, effect_size=effect_size))
    bar, damper = (next(law for law in subset.laws if law.key == effect.key) for effect in LAWS)
    assert bar.rows == damper.rows
    assert 2.0 * damper.force < bar.force
    found, rows = _without_doubted(subset, [bar.key], 0, silent)
    assert found.keys == (STOP.key,)
    assert found.parts == {bar.key, damper.key}
    assert rows == bar.rows
    assert bool(Rest.of(found.space, found.laws).unlisted) == (effect_size < 1.0)
    assert rows <= {*Rest.of(found.space, found.laws, rows).unlisted}
    found, _ = _without_doubted(subset, [STOP.key], 0, silent)
    assert set(found.keys) == {bar.key, damper.key}
    without = less_a_part(subset, bar.key, 0, silent)
    found, rest = not_part_of_the_rest(without, Rest.of(without.space, without.laws, bar.rows), 0)
    assert (damper.key in found.keys, rest.doubted, bar.rows <= {*rest.unlisted}) == (False, bar.rows, True)


def test_where_nothing_else_is_unlisted_what_changes_is_said_and_weaker_laws_may_be_parts_of_it(
    fitted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    bar, damper = (effect.key for effect in LAWS)
    runs = ParameterConstancy({"a": np.ones(1)}, np.ones((1, 1, 1, 1)), 1.0, 1.0, 2.0, np.zeros(99), {})
    for room in ("rest", "settings"):
        monkeypatch.setattr(f"lacet.identify.selection.{room}.SELECTION", replace(SELECTION, effect_size=10.0))
    monkeypatch.setattr("lacet.identify.selection.diagnose._not_constant", lambda *_: {bar: runs})
    said = diagnose(fitted, floor, [KNOWN[key] for key in KEYS])
    assert {c.key for c in said.found} == {STOP.key}
    assert {*said.grounds.not_constant} == {bar}
    assert damper in {c.key for c in said.candidates if c.answer is Answer.UNDECIDED}


@pytest.mark.parametrize(("spread", "constant"), [(0.15, True), (0.25, False)])
def test_beside_a_rest_a_laws_parameters_may_differ_by_as_much_as_a_selected_law_may_be_inexact(
    subset: Joint, monkeypatch: pytest.MonkeyPatch, spread: float, constant: bool
):
    """In each run; without a rest in its rows only all runs count."""
    runs = ParameterConstancy(
        {}, np.zeros((0, 1, 0, 1)), 10_000.0, 10_000.0, 20.0, np.full(99, 2.0), {"a": 0.0, "b": spread**2}
    )  # fmt: skip
    monkeypatch.setattr("lacet.identify.selection.diagnose.chow_test_in_model", lambda *_: runs)
    bar = next(law for law in subset.laws if law.key == "anti_roll_bar.front")
    rest = Rest.of(subset.space, subset.laws)
    lack = replace(rest.lack, squares={**rest.lack.squares, min(bar.rows): bar.force})
    found = [_as_found(subset, effect, DRAWS) for effect in subset.effects if effect.key == bar.key]
    assert not _not_constant(subset, rest, found, silent)
    assert bool(_not_constant(subset, replace(rest, lack=lack, unlisted=(min(bar.rows),)), found, silent)) != constant


@pytest.mark.parametrize(("correlation", "named"), [(0.9, False), (0.99, True)])
def test_beside_an_unlisted_cause_a_law_that_another_equals_is_no_name(subset: Joint, correlation: float, named: bool):
    """Unless the two are one law on these runs."""
    bar, other = "anti_roll_bar.front", "coulomb.rear"
    found = [_as_found(subset, effect, DRAWS) for effect in subset.effects]
    found = [replace(c, ties=((other, correlation),)) if c.key == bar else c for c in found]
    rest = replace(Rest.of(subset.space, subset.laws), unlisted=(Row("chassis.fx"),))
    runs, floor = subset.first.linearisation.runs, subset.first.floor
    said = _concluded(runs, floor, subset, rest, found, dict(subset.first.effects), 0, silent)
    assert ({c.key for c in said.found} == set(subset.keys)) == named
    assert said.unlisted
    told = [c for c in said.candidates if c.reason is Reason.TIED]
    assert [c.key for c in told] == ([] if named else [bar])
    assert (f"{bar} or in its place {other}" in says(said)) != named
    assert all(c.answer is Answer.UNDECIDED and other in why(said, c) for c in told)


def test_a_law_stands_in_a_fit_beside_tolerances_that_the_runs_show_and_a_fault_does_not():
    """Both as large as the sheet allows instruments to be wrong, and a hundred times their own standard error."""
    effects = [KNOWN["anti_roll_bar.front"], KNOWN["sensor_gain.hub.fl"]]

    def with_effects(kept: Sequence[Effect]) -> SimpleNamespace:
        one = np.eye(len(kept))
        names = [effect.parameters[0].name for effect in kept]
        return SimpleNamespace(
            theta=np.ones(len(kept)), covariance=1e-4 * one, covariance_sheet=one, model=SimpleNamespace(names=names)
        )

    _, kept = fitted_with(cast(Fit, SimpleNamespace(with_effects=with_effects)), effects, len(KEYS), DRAWS)
    assert [effect.key for effect in kept] == ["anti_roll_bar.front"]


def test_laws_on_all_rows_are_those_of_the_fit(subset: Joint):
    """And a bar, which acts in suspension rows alone, has most of its force in these: masses and zeros are known better
    from all rows."""
    space = subset.space
    rows = list(space.sums.over_runs.rows)
    whole, again = added_laws(space), laws_on_rows(space, rows)
    assert [law.key for law in again] == [law.key for law in whole]
    for law, same in zip(whole, again, strict=True):
        np.testing.assert_allclose(same.values, law.values, rtol=1e-6)
        assert same.force == pytest.approx(law.force, rel=1e-6)
    bar = "anti_roll_bar.front"
    (own,) = (law for law in laws_on_rows(space, [row for row in rows if row.kind == "suspension"]) if law.key == bar)
    (law,) = (law for law in whole if law.key == bar)
    assert 0.5 * law.force < own.force < law.force
    assert own.values[0] == pytest.approx(law.values[0], rel=0.05)


def test_beside_an_unknown_force_on_the_body_a_law_must_stand_in_the_other_rows(
    subset: Joint, monkeypatch: pytest.MonkeyPatch
):
    rest = replace(Rest.of(subset.space, subset.laws), unlisted=(Row("chassis.my"),))
    assert all(row.kind != "chassis" for row in rest.without_unlisted())
    assert _not_standing_elsewhere(subset, rest, subset.space) == set()
    bar = "anti_roll_bar.front"
    weak = tuple(replace(law, force=1e-3) if law.key == bar else law for law in subset.laws)
    monkeypatch.setattr("lacet.identify.selection.joint.refits.laws_on_rows", lambda space, rows: weak)
    assert _not_standing_elsewhere(subset, rest, subset.space) == {bar}
    found, _ = not_part_of_the_rest(subset, rest, 0)
    assert bar not in found.keys


def test_what_some_rows_want_changed_is_their_own_estimate_less_that_of_all(subset: Joint):
    """In the norm of what these rows know of it; what all rows want changed is what tolerances make of it."""
    space = subset.space
    rows = [row for row in space.sums.over_runs.rows if row.kind == "suspension"]
    laws = {law.key: law for law in laws_on_rows(space, rows)}
    for one in departures_on_rows(space, subset.effects, rows, {}):
        law = laws[one.key]
        size = space.fitted.solution[list(law.places)]
        normal = law.force / float(law.values @ law.values)
        if len(size) == 1:
            assert one.squares == pytest.approx(normal * float((law.values - size) @ (law.values - size)), rel=1e-6)
            assert one.force == pytest.approx(normal * float(size @ size), rel=1e-6)
        assert one.null.shape == (DRAWS,)


def with_fault(subset: Joint, fault: Effect, others: Sequence[Effect]) -> tuple[Fit, Joint]:
    """A fit with a sensor fault beside what was found, and that as effects found; `others` are tested beside them."""
    base = subset.base
    assert base is not None
    fitted = base.with_effects([*subset.added, fault])
    tests = ScoreTests.of(Linearisation.of(fitted, subset.space.floor.redrawn(fitted)), others, 0)
    return fitted, beside_of(replace(subset, added=(*subset.added, fault), effects=(*subset.effects, fault)), tests)


@pytest.mark.parametrize(("change", "stands"), [(0.1, True), (1.0, False)])
def test_beside_a_rest_a_fault_that_rows_of_other_kinds_want_back_is_no_name(
    subset: Joint, monkeypatch: pytest.MonkeyPatch, change: float, stands: bool
):
    """And no other fault is tried in its place; a law of the car is."""
    fault, other = KNOWN["sensor_gain.hub.fl"], "sensor_gain.hub.rr"
    _, joint = with_fault(subset, fault, [KNOWN["coulomb.rear"]])
    rest = Rest.of(joint.space, joint.laws)
    assert without_denied_faults(joint, replace(rest, unlisted=()), 0)[0] is joint
    asked: list[object] = []

    def departures(
        space: ScoreTests, effects: Sequence[Effect], rows: Sequence[Row], removed: Mapping[str, float]
    ) -> list[Departure]:
        asked.append([effect.key for effect in effects])
        assert rows
        assert all(row.kind != "chassis" for row in rows)
        return [Departure(fault.key, change**2 * 5000.0, np.full(DRAWS, 2.0), 5000.0)]

    monkeypatch.setattr("lacet.identify.selection.joint.rounds.departures_on_rows", departures)
    found, _ = without_denied_faults(joint, replace(rest, unlisted=(Row("chassis.my"),)), 0)
    assert asked == [[fault.key]]
    assert (fault.key in found.keys) == stands
    assert set(subset.keys) <= set(found.keys)
    if not stands:
        assert {fault.key, other} <= found.dropped
        assert found.space.effects.keys().isdisjoint(found.dropped)
        assert "coulomb.rear" in found.space.effects


@pytest.mark.parametrize("beside_a_rest", [False, True])
@pytest.mark.parametrize(
    ("removed", "change", "sigma", "stands"),
    [(0.08, 0.1, 0.01, True), (0.08, 1.0, 2.0, True), (0.005, 1.0, 0.01, True), (0.08, 1.0, 0.01, False)],
)
def test_a_fault_that_the_speed_sensor_denies_is_no_name(
    subset: Joint, monkeypatch: pytest.MonkeyPatch, removed: float, change: float, sigma: float, stands: bool,
    beside_a_rest: bool,
):  # fmt: skip
    """Within a fifth of its size, or by the chance of either, it may differ. Other faults may be tried where nothing is
    unlisted."""
    fault, other = KNOWN["sensor_gain.accel.x"], "sensor_gain.hub.rr"
    fitted, joint = with_fault(subset, fault, [KNOWN["coulomb.rear"]])
    joint = replace(joint, sizes={fault.key: removed}, shown=frozenset({"sensor_position.imu.x"}))
    at = fitted.model.names.index(f"{fault.key}.g")
    known = float(np.sqrt(fitted.covariance[at, at] + fitted.covariance_sheet[at, at]))
    assert 0.005 < 2.5 * known < 0.01
    size = removed + float(fitted.theta[at])

    class Agreement:
        @staticmethod
        def of(runs: Sequence[PreparedRun]) -> Agreement:
            assert list(runs) == list(fitted.runs)
            return Agreement()

        def sizes(self, keys: Collection[str]) -> dict[str, AgreeingSize]:
            assert set(keys) == {fault.key, "sensor_position.imu.x"}
            return {fault.key: AgreeingSize((1.0 - change) * size - removed, sigma * abs(size))}

    monkeypatch.setattr("lacet.identify.selection.joint.rounds.SpeedAgreement", Agreement)
    monkeypatch.setattr("lacet.identify.selection.joint.rounds._denied_by_rows", lambda *_: set())
    rest = replace(Rest.of(joint.space, joint.laws), unlisted=(Row("chassis.my"),) if beside_a_rest else ())
    found, _ = without_denied_faults(joint, rest, 0)
    assert (fault.key in found.keys) == stands
    assert set(subset.keys) <= set(found.keys)
    if not stands:
        assert fault.key in found.dropped
        assert (other in found.dropped) == beside_a_rest


def test_what_the_instruments_show_stands_whatever_rows_and_sizes_say(subset: Joint, monkeypatch: pytest.MonkeyPatch):
    fault = KNOWN["sensor_gain.hub.fl"]
    _, joint = with_fault(subset, fault, [])
    joint = replace(joint, shown=frozenset({fault.key}))
    for name in ("_denied_by_rows", "_denied_by_speed"):
        monkeypatch.setattr(
            f"lacet.identify.selection.joint.rounds.{name}", lambda joint, *rest: {fault.key for fault in rest[-1]}
        )
    rest = replace(Rest.of(joint.space, joint.laws), unlisted=(Row("chassis.my"),))
    assert without_denied_faults(joint, rest, 0)[0] is joint
    wrong = Implausible(fault.parameters[0], 0.3, 0.4)
    no_sensor = [replace(one, implausible=wrong, force=0.0) for one in joint.faults]
    monkeypatch.setattr(Joint, "faults", property(lambda joint: no_sensor))
    assert only_plausible(joint, 0) is joint
    monkeypatch.setattr(Rest, "beside", lambda rest, law: np.inf if law.key == fault.key else 0.0)
    monkeypatch.setattr("lacet.identify.selection.joint.refits._not_standing_elsewhere", lambda *_: set())
    assert not_part_of_the_rest(joint, rest, 0)[0] is joint


def test_other_starts_begin_with_what_the_instruments_show(subset: Joint, monkeypatch: pytest.MonkeyPatch):
    first = subset.first
    begun: list[tuple[str, ...]] = []

    def fitted_together(joint: Joint, seed: int, progress: Progress) -> Joint:
        begun.append(tuple(effect.key for effect in joint.added))
        return replace(joint, effects=joint.added[1:])

    monkeypatch.setattr("lacet.identify.selection.joint.rounds.fitted_together", fitted_together)
    joint = replace(subset, shown=frozenset({"sensor_gain.hub.fl"}))
    other = started_with(joint, first.effects["coulomb.rear"], 0)
    assert begun == [("coulomb.rear", "sensor_gain.hub.fl")]
    assert not other.effects
    assert other.shown == joint.shown


@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_a_search_begins_with_a_fault_that_the_speed_sensor_shows(
    fitted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch, wrong: float
):
    """Any fault will do for one; it is in the fit if it stands there, and if not it may be found later."""
    fault = KNOWN["sensor_gain.hub.rr"]
    assert isinstance(fault, SensorFault)
    record = recording_without_faults(with_all(HIDDEN), [fault], np.array([-wrong]))
    drive = fit_of(driven(record, 3), fitted)
    space = ScoreTests.of(Linearisation.of(drive, floor), [*LAWS, fault], 0)
    begun: list[Joint] = []
    monkeypatch.setattr(
        "lacet.identify.selection.joint.rounds.SpeedAgreement",
        SimpleNamespace(of=lambda runs: SimpleNamespace(beyond_sheet=lambda significance: [fault])),
    )
    monkeypatch.setattr(
        "lacet.identify.selection.joint.rounds.continued", lambda joint, *_: begun.append(joint) or joint
    )
    found_together(space, 0)
    (first,) = begun
    assert first.keys == ((fault.key,) if wrong else ())
    assert first.shown == {fault.key}
    assert not first.dropped


def test_a_removed_latency_has_its_column_where_nothing_else_is_tried(subset: Joint):
    """Any effect of the first tests will do for one: what remains of it is estimated with the others."""
    removed = KNOWN["sensor_gain.hub.rr"]
    joint = replace(subset, removed=(removed,))
    space = _tests_of_some(joint, joint.fit, (), 0, silent)
    assert [trial.effect.key for trial in space.columns.selected] == [removed.key]
    assert not space.best_tests


def test_a_fault_that_a_model_does_without_is_in_its_runs_again():
    """To first order of what was removed."""
    gain = KNOWN["sensor_gain.hub.fl"]
    plain = fit_of(driven(exact(), 0))
    wrong = replace(plain, runs=tuple(without_faults(run, [gain], np.array([-0.03])) for run in plain.runs))
    found = wrong.with_effect(gain)
    removed = found.refitted_to(found)
    values = [
        one.runs[0].recording.signals.value["laser.fl.hub"]
        for one in (wrong, removed, removed.without_effects([gain.key], {gain.key: float(found.theta[-1])}))
    ]
    assert found.theta[-1] == pytest.approx(0.03, abs=0.003)
    assert np.max(np.abs(values[1] / values[0] - 1.0)) > 0.02
    np.testing.assert_allclose(values[2], values[0], rtol=2e-3)
    assert removed.without_effects([gain.key]).runs[0].recording is removed.runs[0].recording


def test_beside_a_rest_in_its_rows_an_effect_of_one_run_is_no_name(subset: Joint):
    """In other runs there is none of it."""
    payload, chassis = Payload("exact"), {Row("chassis.fz"): 100.0}
    law = replace(subset.laws[0], key=payload.key, row_force=chassis)
    joint = replace(subset, effects=(*subset.effects, payload), laws=(*subset.laws, law))
    rest = Rest.of(subset.space, subset.laws)
    assert payload.key in _not_standing_elsewhere(joint, replace(rest, unlisted=(Row("chassis.my"),)), subset.space)
    assert payload.key not in _not_standing_elsewhere(joint, replace(rest, unlisted=(Row("tyre.fl"),)), subset.space)


def test_an_effect_of_a_size_that_no_car_has_is_not_found(subset: Joint) -> None:
    """In the fit with all of them: it looks like something else."""
    bar = "anti_roll_bar.front"
    assert only_plausible(subset, 0) is subset
    wrong = Implausible(KNOWN[bar].parameters[0], 2e6, 2.1e6)
    laws = tuple(replace(law, implausible=wrong if law.key == bar else None) for law in subset.laws)
    found = only_plausible(replace(subset, laws=laws), 0)
    assert set(found.keys) == set(subset.keys) - {bar}
    assert bar not in {law.key for law in found.laws}


@pytest.mark.parametrize(("removed", "stands"), [(0.05, True), (1.1, False)])
def test_a_fault_of_a_size_that_no_sensor_has_is_not_found(
    subset: Joint, removed: float, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its size is what was removed from the runs and what remains in the fit: a scale of 1 + 1.1 is none."""
    gain = KNOWN["sensor_gain.hub.fl"]
    fault = replace(subset.laws[0], key=gain.key, values=np.array([0.01]), force=100.0, implausible=None)

    def faults(_: ScoreTests, gone: Mapping[str, float]) -> tuple[AddedLaw, ...]:
        return (
            replace(fault, implausible=gain.implausible(fault.values + gone.get(gain.key, 0.0), np.array([0.001]))),
        )

    monkeypatch.setattr("lacet.identify.selection.joint.refits.added_faults", faults)
    monkeypatch.setattr("lacet.identify.selection.joint.refits.without_effects", lambda *_: subset)
    joint = replace(subset, effects=(*subset.effects, gain), sizes={gain.key: removed})
    assert (only_plausible(joint, 0) is joint) == stands


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
