"""Listed effects beside a force of unknown cause: found, and what is not listed is described."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import pytest

from lacet.daq.channels import CORNERS
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Reason
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.joint.refits import Joint
from lacet.identify.selection.laws import described
from lacet.identify.selection.laws.formulas import Formula, Law
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.services.render.candidate_reasons import why
from lacet.services.render.verdicts import says, simple_laws
from tests.identify.exact_car import KNOWN, VEHICLE, driven, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES

LAW = "hidden = suspension.front: p * travel**2*tanh(rate/v0) + q * tanh(rate/v1), v0 = 30 mm/s, v1 = 10 mm/s"
OTHER_LAW = "hidden = suspension.front: p * tanh(abs(travel)/s0)*rate, s0 = 10 mm"
FRICTION = 60.0
BAR = "anti_roll_bar.rear"


@pytest.fixture(scope="module")
def lacks_both() -> Fit:
    """The model on a run of a car with friction and a law of no catalogue."""
    (both,) = one_line_effects(LAW, VEHICLE, "hub")
    return fit_of(driven(exact_with(both, 200000.0, FRICTION), 1))


@pytest.fixture(scope="module")
def found(lacks_both: Fit, floor: NoiseFloor) -> Diagnosis:
    return diagnose(lacks_both, floor, CANDIDATES)


def test_friction_is_found_beside_damping_that_is_not_listed(found: Diagnosis):
    """With its own size: a fit without the law that describes the rest has twice the friction."""
    assert [c.key for c in found.found] == ["coulomb.front"], says(found)
    assert set(found.unlisted_rows) == {"suspension.fl", "suspension.fr"}
    assert found.grounds.assumed == {}
    law = found.formulas[0].of_one_term
    assert law.text.startswith("suspension.front: p * travel**2*tanh(rate/v0)")
    assert law.explained > 0.8
    assert f"The sizes above are from a fit that has '{law.text}', too" in says(found)
    assert found.found[0].values[0] == pytest.approx(FRICTION, abs=20.0)
    assert found.after is not None
    assert found.after.formulas == found.formulas


def test_where_a_stand_in_leaves_noise_alone_an_unlisted_law_is_said_to_explain_more(found: Diagnosis):
    """And each law at another place is named."""
    assert "something that is not listed remains in" in says(found)
    rows, spring = found.unlisted_rows, "spring_cubic.front"
    quiet = replace(found.grounds, ratios=dict.fromkeys(found.grounds.ratios, 1.0))
    candidates = [replace(c, reason=Reason.PART_OF_REST) if c.key == spring else c for c in found.candidates]
    (law,) = found.formulas[:1]
    elsewhere = replace(law, text="suspension.rear: p * travel**2", law=replace(law.law, explained=0.5))
    other = replace(found, grounds=quiet, candidates=tuple(candidates), formulas=(law, elsewhere))
    assert f"acts in {', '.join(rows)}: with {spring} in its place hardly more than noise" in says(other)
    assert "And at other places: 'suspension.rear: p * travel**2' (50 %)." in says(other)
    for changed in (replace(other, grounds=found.grounds), replace(other, candidates=found.candidates)):
        assert "in its place hardly more than noise" not in says(changed)


def test_what_acts_on_the_body_alone_and_follows_nothing_is_said_to_come_from_outside(found: Diagnosis):
    rows = (Row.parse("chassis.fy"), Row.parse("chassis.mz"))
    (law,) = found.formulas[:1]
    little = replace(law, law=replace(law.law, explained=0.2), front=(replace(law.law, explained=0.1),))
    wind = replace(found, found=(), unlisted_rows=rows, formulas=(little,))
    assert "wind, a trailer, or a mass that moves in the car" in says(wind)
    assert simple_laws(wind) == []
    for other in (replace(wind, formulas=(law,)), replace(wind, unlisted_rows=found.unlisted_rows)):
        assert "wind, a trailer" not in says(other)
    assert simple_laws(found) == [law.of_one_term.text]


def test_several_laws_of_the_travel_at_one_axle_are_said_to_be_one_spring(found: Diagnosis):
    """An air spring is found as a sum of powers and of a stop without a gap."""
    (friction,) = found.found
    keys = ("spring_quadratic.front", "spring_cubic.front", "bump_stop.front")
    springs = [replace(friction, key=key, shape={}, values=(9.0,), interval=(1.0,)) for key in keys]
    effects = {**found.effects, **{key: KNOWN[key] for key in keys}}
    for some, said in ((springs, True), (springs[:2], False)):
        text = says(replace(found, effects=effects, found=(friction, *some)))
        assert (f"one spring whose rate changes ({', '.join(keys)})" in text) is said
        assert ("lacet effect DIR 'air = suspension: f*((h/(h - travel))**1.3 - 1)" in text) is said


def test_of_two_that_explain_as_much_the_simpler_is_named(found: Diagnosis):
    (friction,) = found.found
    simple, longer = "spring_cubic.front", "bump_stop.front"  # a size; a size, a gap and an exponent
    found = replace(found, effects={**found.effects, **{key: KNOWN[key] for key in (simple, longer)}})
    said = why(found, replace(friction, ties=(), margin=0.5, rival=longer))
    assert f"{longer}, the best in its place, explains as much but for 0.5 weighted squares" in said
    assert "the simpler law is named" in said
    for rival, margin in ((longer, 50.0), (simple, 0.5)):
        said = why(found, replace(friction, ties=(), margin=margin, rival=rival))
        assert f"It explains {margin:g} weighted squares more than {rival}, the best in its place." in said


def test_rows_on_assumed_channels_may_have_no_more_than_the_error_of_these(
    lacks_both: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    assumed = {Row("suspension.fl"): tuple(f"laser.{c}.hub" for c in CORNERS)}
    monkeypatch.setattr("lacet.identify.selection.columns.ranked_runs.assumed_channels", lambda *_: assumed)
    sentence = "What remains in suspension.fl may be the error of assumed channels (laser.*.hub)"
    found = diagnose(lacks_both, floor, CANDIDATES[:3])
    assert sentence in says(found)
    alone = replace(found, found=(), grounds=replace(found.grounds, not_constant={}))
    assert sentence in says(alone)
    assert "and the cause is not listed" in says(alone)
    every = replace(alone.grounds, assumed=dict.fromkeys(found.unlisted_rows, ("laser.fl.hub",)))
    assert "times the floor) in rows that stand on assumed channels: no" in says(replace(alone, grounds=every))
    assert sentence not in says(replace(alone, grounds=replace(alone.grounds, assumed={})))


def test_beside_an_unknown_table_a_size_is_of_the_fit_with_the_laws_that_describe_the_rest(
    lacks_both: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    """At another axle than that of the table, where something unlisted would leave it open."""
    place, spaces = "lacet.identify.selection", list[ScoreTests]()
    for module in ("diagnose", "joint.unknown_tables"):
        monkeypatch.setattr(f"{place}.{module}.axles_without_tables", lambda *_: ("rear",))
    monkeypatch.setattr(f"{place}.diagnose.beside_tables", lambda space, *_: spaces.append(space) or {})
    found = diagnose(lacks_both, floor, CANDIDATES[:3])
    values = {q.name: spaces[0].fitted.value(q.name) for q in KNOWN["coulomb.front"].parameters}
    assert list(values.values()) == pytest.approx([FRICTION], abs=20.0)
    assert found.found[0].values == pytest.approx(tuple(values.values()))


def test_what_acts_in_one_run_only_is_no_name_beside_a_description(lacks_both: Fit, floor: NoiseFloor):
    """It may be a part of what is not described; the same law of all runs is found above."""
    friction = KNOWN["coulomb.front"]
    kind = type("OfRun", (type(friction),), {"is_of_run": lambda self: True})
    of_run = cast(Effect, kind(friction.where, friction.shape))
    found = diagnose(lacks_both, floor, [of_run if one is friction else one for one in CANDIDATES[:3]])
    assert found.described
    assert found.found == (), says(found)


def test_a_law_that_describes_less_than_remains_joins_no_fit(
    lacks_both: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    useless = Law("suspension.front: p * ay", 1, 0, 0.1)
    formula = Formula(useless.text, "front", (), 0.1, 1.0, 0.01, useless, (useless,))
    monkeypatch.setattr(described, "propose", lambda space, rows: [formula])
    found = diagnose(lacks_both, floor, CANDIDATES[:3])
    assert found.formulas == (formula,)
    assert found.described == ()


def test_a_stand_in_is_no_name_where_nothing_describes_the_rest(floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch):
    (hidden,) = one_line_effects(OTHER_LAW, VEHICLE, "hub")
    monkeypatch.setattr(described, "propose", lambda space, rows: [])
    stand_in = KNOWN["damper_stroke_symmetric.front"]
    found = diagnose(fit_of(driven(exact_with(hidden, 2500.0), 1)), floor, [*CANDIDATES, stand_in])
    assert found.unlisted_rows
    assert stand_in.key not in [c.key for c in found.found], says(found)


def test_what_is_found_anew_is_in_the_last_fit_once(fitted: Fit, space: ScoreTests):
    """Where the base fit had it with other constants, had another that is gone, and one that stays."""
    bar, old, gone, stays = (KNOWN[key] for key in ("axle_damping.front", "coulomb.front", "coulomb.rear", BAR))
    new = replace(old, shape={**old.shape, "v0": 0.003})
    base = fitted.with_effects([stays, old, gone])
    before = Joint(space, (), space, (), (stays, old, gone), (), base=base)
    found = replace(before, effects=(stays, new, bar), added=(new, bar))
    last = described.on_base_of(before, found).fit.model
    assert [effect.key for effect in last.physics if not effect.base] == [BAR, new.key, bar.key]
    assert new in last.physics
