"""What is a name where something unlisted remains beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.effects.body.payload import Payload
from lacet.identify.progress import Progress, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Answer, Reason
from lacet.identify.selection.chow_test import ParameterConstancy
from lacet.identify.selection.diagnose import _as_found, _concluded, _not_constant, _without_doubted, diagnose
from lacet.identify.selection.joint.refits import (
    Joint,
    _not_standing_elsewhere,
    less_a_part,
    not_part_of_the_rest,
    with_all_tested,
)
from lacet.identify.selection.laws.described import described
from lacet.identify.selection.laws.encompassing import standing_beside_rest
from lacet.identify.selection.rest import (
    Rest,
    added_faults,
    added_laws,
    departures_on_rows,
    laws_on_rows,
)
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.services.render.candidate_reasons import why
from lacet.services.render.verdicts import says
from tests.identify.exact_car import KNOWN
from tests.identify.selection.exact_ranking import DRAWS
from tests.identify.selection.joint.three_hidden import KEYS, LAWS, STOP, WithFault


def test_what_explains_no_more_than_is_unlisted_in_its_rows_is_no_name(subset: Joint):
    """It may be a part of the same unknown cause; a law of other rows stays."""
    rest = Rest.of(subset.space, subset.laws)
    (damper,) = (law for law in subset.laws if law.key == "damper_asymmetry.front")
    row = min(damper.rows)
    for much, names in ((0.5, set(subset.keys)), (2.0, set(subset.keys) - {damper.key})):
        lack = replace(rest.lack, squares={**rest.lack.squares, row: much * damper.force})
        found, _ = not_part_of_the_rest(subset, replace(rest, lack=lack, unlisted=(row,)), 0)
        assert set(found.keys) == names


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


def test_a_fault_that_explains_no_more_than_is_unlisted_in_its_main_row_is_no_name(with_fault: WithFault):
    """Judged as a law is, though it is none; the laws of other rows stay."""
    fault = KNOWN["sensor_gain.hub.fl"]
    _, joint = with_fault(fault.key, "coulomb.rear")
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


def test_what_a_law_leaves_that_does_not_stand_counts_beside_the_others(subset: Joint, monkeypatch: pytest.MonkeyPatch):
    """A law of no catalogue did the bar's work: what the bar explained is unlisted in the damper's rows.

    What is left without the damper is compared with laws of no catalogue again.
    """
    bar, damper = (effect.key for effect in LAWS)

    asked: list[tuple[str, ...]] = []

    def unchanged(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
        asked.append(joint.keys)
        return joint

    monkeypatch.setattr("lacet.identify.selection.laws.encompassing.only_encompassing", unchanged)
    without, rest = with_all_tested(less_a_part(subset, bar, 0, silent), 0, silent)
    assert {row.kind for row in rest.unlisted} >= {"suspension"}
    found, left = standing_beside_rest(without, rest, 0)
    assert (found.keys, found.parts, asked) == ((STOP.key,), {bar, damper}, [(STOP.key,)])
    assert left.excess > rest.excess
    monkeypatch.setattr("lacet.identify.selection.laws.described.propose", lambda *_: [])
    undescribed = described(without, rest, 0, silent)
    assert (undescribed.joint.keys, undescribed.beside.keys) == ((STOP.key,), (STOP.key,)), "nothing describes it"
    whole = Rest.of(subset.space, subset.laws)
    assert standing_beside_rest(subset, whole, 0) == (subset, whole), "nothing is unlisted"


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


def test_beside_a_rest_in_its_rows_an_effect_of_one_run_is_no_name(subset: Joint):
    """In other runs there is none of it."""
    payload, chassis = Payload("exact"), {Row("chassis.fz"): 100.0}
    law = replace(subset.laws[0], key=payload.key, row_force=chassis)
    joint = replace(subset, effects=(*subset.effects, payload), laws=(*subset.laws, law))
    rest = Rest.of(subset.space, subset.laws)
    assert payload.key in _not_standing_elsewhere(joint, replace(rest, unlisted=(Row("chassis.my"),)), subset.space)
    assert payload.key not in _not_standing_elsewhere(joint, replace(rest, unlisted=(Row("tyre.fl"),)), subset.space)
