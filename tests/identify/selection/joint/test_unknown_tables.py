"""Laws of an axle without a bench table whose wheels move sideways with the travel: those that the table explains, and
those whose size is open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lacet.daq.compliance import JOINTS
from lacet.daq.joint_tables import JointCurve, JointTables
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.effects.suspension.anti_roll_bar import AntiRollBar
from lacet.identify.effects.suspension.centre_slopes import Jacking
from lacet.identify.effects.suspension.spring_progression import SpringQuadratic
from lacet.identify.effects.unknown_table import By, TableTerm, table_terms
from lacet.identify.properties.sums_of_places import SumOfPlaces
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import residual
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.chow_test import ParameterConstancy
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.joint.unknown_tables import (
    BesideTable,
    LackingTables,
    beside_tables,
    with_open_sizes,
    with_sizes_beside,
)
from lacet.identify.selection.rest import Rest, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording, Signals
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.services.render import tables
from lacet.services.render.verdict_card import verdict_card
from lacet.services.render.verdicts import says
from lacet.services.workspace.results import diagnosis_result
from tests.identify import cars, exact_car

PLAIN, RIG = cars.reference_car()
FILTERS = Filters(rate=100.0, pre_cutoff=None)
BAR, RISING, SLOPE = AntiRollBar("rear"), SpringQuadratic("rear"), Jacking("rear")
RISE = -3.6
"""Curvature of the half track by the travel [1/m], of a double wishbone."""
LITTLE = -0.3
"""The same, so small that a bar and the slope are named beside what is not listed."""


def with_table(rise: float) -> Vehicle:
    """The car whose rear wheels move sideways, with a slope that changes with the travel by `rise`."""
    s = np.linspace(-0.1, 0.1, 41)
    curve = JointCurve(s, np.outer(0.1 * s + 0.5 * rise * s**2, np.eye(len(JOINTS))[0]))
    tables = JointTables(curve, None, None, {})
    corners = {c: replace(one, joints=tables, driven=False) if c[0] == "r" else one for c, one in PLAIN.corners.items()}
    return replace(PLAIN, corners=corners)


def drive(rise: float, rising: float) -> Recording:
    """A drive of that car with a bar of 9 kN/m and a rate that rises by `rising`, read with a file without tables.

    The rear rolls and has side force with the lateral acceleration, the roll being half of what it could be alone.
    """
    t = np.arange(1500) / FILTERS.rate
    curves = cars.drive_curves(np.random.default_rng(21))
    signals = cars.exact_signals(curves, t)
    parts = {part: dict(getattr(signals, part)) for part in ("value", "rate", "accel")}
    for order, part in enumerate(parts.values()):
        ay = curves["imu.accel"].at(t, order)[1]
        for c in ("rl", "rr") if order == 0 else ():
            part[f"wheel.{c}.force"] = np.outer([0.0, 1.0, 0.0], 100.0 * ay)
        left, right = (part[f"laser.{c}.hub"] for c in ("rl", "rr"))
        heave, roll = 0.5 * (left + right), 0.5 * (left - right)
        roll = 0.001 * ay[None] + 0.5 * roll
        part["laser.rl.hub"], part["laser.rr.hub"] = heave + roll, heave - roll
    model = exact_car.MODEL + BAR + RISING
    record = cars.recording(replace(signals, **parts), with_table(rise), RIG, FILTERS)
    record = cars.fulfil(record, model.physics, np.append(exact_car.theta(), [9000.0, rising]))
    noise = draw_noise(record, record.signals.value, np.random.default_rng(22))
    values = {name: a + noise[name] for name, a in record.signals.value.items()}
    return replace(record.with_signals(Signals.differentiated(values, FILTERS.rate)), vehicle=PLAIN)


def fitted(record: Recording) -> Fit:
    """With the bar, the rising rate and the slope of the half track, without its curvature."""
    return fit(exact_car.MODEL + BAR + RISING + SLOPE, [PreparedRun(record)], FitOptions(draws=2))


def beside(record: Recording) -> tuple[dict[str, float], dict[str, BesideTable]]:
    """Sizes without a table, and what is left of each law beside the terms of an unknown one."""
    one = fitted(record)
    space = ScoreTests.of(Linearisation.of(one, floor_of(one, 19)), [SLOPE], 0)
    return {law.key: float(law.values[0]) for law in added_laws(space)}, beside_tables(space, ["rear"], 0)


def test_a_rate_that_the_table_explains_does_not_stand_and_a_bar_does() -> None:
    """And the bar, far off without a table, is right beside its terms."""
    was, now = beside(drive(RISE, 0.0))
    assert abs(was[RISING.key]) > 100_000.0
    assert abs(was[BAR.key] - 9000.0) > 1000.0
    assert not now[RISING.key].stands
    assert now[BAR.key].stands
    assert now[BAR.key].values[0] == pytest.approx(9000.0, rel=0.02)
    assert SLOPE.key not in now


def test_a_rate_that_rises_stands() -> None:
    _, now = beside(drive(0.0, 60_000.0))
    assert now[RISING.key].stands
    assert now[RISING.key].values[0] == pytest.approx(60_000.0, rel=0.1)


def test_what_stands_has_its_size_beside_the_terms() -> None:
    """With what they add to the interval; of a sum of places the size stays; what does not stand is set apart."""
    total = SumOfPlaces(("c.rear", "d.rear"), "k", "N/m", 5.0, 1.0, 1.0, inseparable=True)
    names = ("a.rear", "b.rear", "c.rear", "other")
    found = [Candidate(key, {}, values=(10.0,), interval=(3.0,)) for key in names]
    found[2] = replace(found[2], total=total)
    law = BesideTable(np.array([7.0]), np.array([(4.0 / 1.96) ** 2]), stands=True)
    kept, hidden = with_sizes_beside(found, {"a.rear": law, "b.rear": replace(law, stands=False), "c.rear": law})
    assert [(c.key, c.values, c.interval) for c in kept] == [
        ("a.rear", (7.0,), pytest.approx((5.0,), rel=1e-3)), ("c.rear", (10.0,), (3.0,)), ("other", (10.0,), (3.0,)),
    ]  # fmt: skip
    assert [c.key for c in hidden] == ["b.rear"]


@cache
def lacking(rise: float) -> tuple[Fit, NoiseFloor]:
    """The fit to that car, of which the file lacks a bar and the half track's slope and curvature, and its floor."""
    one = fit(exact_car.MODEL, [PreparedRun(drive(rise, 0.0))], FitOptions(draws=2))
    return one, floor_of(one, 39)


def diagnosed(rise: float) -> Diagnosis:
    """The diagnosis of that car."""
    return diagnose(*lacking(rise), [BAR, SLOPE])


def test_beside_what_a_table_would_explain_the_size_of_a_bar_is_open() -> None:
    """In the verdict, the table, JSON and on the page's card: named, without a number."""
    found = diagnosed(LITTLE)
    assert found.without_tables == LackingTables(("rear",), (), ("rear",))
    assert {(c.key, c.values, c.interval, c.open_at) for c in found.found} == {
        (key, (), (), ("rear",)) for key in (BAR.key, SLOPE.key)
    }
    text, result = says(found), diagnosis_result(found)
    why = "the bench table of the rear axle is not known, and something unlisted remains there"
    assert f"Of {SLOPE.key} and {BAR.key} the size is open: {why}." in text
    assert "±" not in text
    assert "sizes above" not in text
    kept = next(c for c in result["candidates"] if c["effect"] == BAR.key)
    assert (kept["values"], kept["half95"], kept["open_at"]) == ([], [], ["rear"])
    assert f"Its size is open: {why}" in kept["why"]
    assert "missing, size open" in tables.candidates(result)
    lines = [line["text"] for line in verdict_card(result, {BAR.key: BAR, SLOPE.key: SLOPE})["lines"]]
    assert "Size open: no bench table of the rear axle, and something unlisted there" in lines
    assert not any("±" in line for line in lines)


def test_a_slope_that_changes_from_run_to_run_says_that_wheels_may_move(monkeypatch: pytest.MonkeyPatch) -> None:
    """And leaves the size of a bar open, which is printed where the slope is the same in all runs."""
    sure = diagnosed(0.0)
    assert sure.without_tables == LackingTables(("rear",))
    assert "these runs show that they do not" in says(sure)
    assert next(c for c in sure.found if c.key == BAR.key).values[0] == pytest.approx(9000.0, rel=0.1)
    values = {run: np.array([slope]) for run, slope in (("a", 0.0), ("b", 0.2))}
    runs = ParameterConstancy(values, np.eye(2).reshape(2, 1, 2, 1), 1.0, 1.0, 1.0, np.ones(9), {})
    monkeypatch.setattr("lacet.identify.selection.diagnose._not_constant", lambda *_: {SLOPE.key: runs})
    unsure = diagnosed(0.0)
    assert unsure.without_tables == LackingTables(("rear",), ("rear",), ("rear",))
    assert [(c.key, c.open_at) for c in unsure.found] == [(BAR.key, ("rear",))]
    assert "straight up, and they may not." in says(unsure)
    assert diagnosis_result(unsure)["tables_unsure"] == ["rear"]
    assert "show that they do not" not in says(unsure)


@pytest.mark.parametrize(
    ("named", "left_out", "rows", "expected"),
    [
        ([BAR], [], ["suspension.rl"], LackingTables()),
        ([BAR, SLOPE], [], [], LackingTables(("rear",))),
        ([BAR, SLOPE], [], ["suspension.fl", "tyre.fl"], LackingTables(("rear",))),
        ([BAR, SLOPE], [], ["tyre.rl"], LackingTables(("rear",), (), ("rear",))),
        ([BAR, SLOPE], [], ["suspension.rl"], LackingTables(("rear",), (), ("rear",))),
        ([BAR, SLOPE], [], ["chassis.fx"], LackingTables(("rear",), (), ("rear",))),
        ([BAR, SLOPE], [AntiRollBar("front")], [], LackingTables(("rear",))),
        ([BAR, SLOPE], [RISING], [], LackingTables(("rear",), (), ("rear",))),
        ([BAR], [SLOPE], [], LackingTables(("rear",), ("rear",), ("rear",))),
    ],
)
def test_something_unlisted_is_at_an_axle_by_its_rows_or_an_effect_left_out(
    space: ScoreTests, named: Sequence[Effect], left_out: Sequence[Effect], rows: Sequence[str], expected: LackingTables
) -> None:
    """By its suspensions and tyres or any row of the body, which count as one; not by those of the other axle."""
    rest = replace(Rest.of(space), unlisted=tuple(Row(row) for row in rows))
    assert LackingTables.of(named, left_out, rest, PLAIN) == expected


def test_a_sum_with_a_law_at_such_an_axle_is_open_and_others_keep_their_sizes() -> None:
    front, fault = AntiRollBar("front"), exact_car.KNOWN["sensor_gain.hub.rl"]
    total = SumOfPlaces((front.key, BAR.key), "k", "N/m", 5.0, 1.0, 1.0, inseparable=True)
    effects = [front, BAR, fault]
    found = [Candidate(effect.key, {}, values=(10.0,), interval=(3.0,)) for effect in effects]
    assert [c.open_at for c in with_open_sizes(found, effects, ["rear"])] == [(), ("rear",), ()]
    assert with_open_sizes(found, effects, []) == found
    of_both, *_ = with_open_sizes([replace(found[0], total=total)], effects, ["rear"])
    assert of_both.open_at == ("rear",)
    assert not of_both.values
    assert of_both.total is not None
    assert math.isnan(of_both.total.value)
    assert math.isnan(of_both.total.half)


def test_terms_are_the_change_of_the_motion_by_a_table() -> None:
    """Columns of the curvature and of the other wheel's travel, against the rows of a car with such a table.

    Of pitch also that of the wheel's inertia: what the change is more, of wheels of 1 kg·m² about their axes.
    """
    signals = cars.exact_signals(cars.drive_curves(np.random.default_rng(3)), np.arange(50) / FILTERS.rate)
    rng = np.random.default_rng(4)
    for name, most in (("force", 3000.0), ("moment", 300.0)):
        loads = {f"wheel.{c}.{name}": rng.uniform(-most, most, (3, 50)) for c in PLAIN.corners}
        signals = replace(signals, value={**signals.value, **loads})
    s = np.linspace(-0.2, 0.2, 81)
    eps, joint = 1e-4, list(JOINTS)
    wheels = [exact_car.KNOWN[f"body.wheel.{c}"] for c in ("rl", "rr")]

    def residual_of(values: np.ndarray, curve: str, spin: float) -> dict[str, np.ndarray]:
        zero = np.zeros((s.size, 5))
        curves = {"own": JointCurve(s, zero), "other": JointCurve(s, zero), curve: JointCurve(s, values)}
        tables = JointTables(curves["own"], curves["other"], None, {}, product=np.zeros(5))
        rear = {c: replace(PLAIN.corners[c], joints=tables, table=None, driven=False) for c in ("rl", "rr")}
        corners = {**PLAIN.corners, **rear}
        motion = build_motion(cars.recording(signals, replace(PLAIN, corners=corners), RIG, FILTERS))
        return {str(row): a for row, a in residual(motion, wheels, np.array([spin, 0.0, 0.0, 0.0] * 2)).items()}

    motion = build_motion(cars.recording(signals, PLAIN, RIG, FILTERS))
    for term in table_terms("rear"):
        if not isinstance(term, TableTerm):
            continue
        name = {"jacking": "half_track", "anti_dive": "half_wheelbase"}.get(term.slope.name, term.slope.name[:-7])
        what, curve = (0.5 * s**2, "own") if term.by is By.RISE else (s, "other")
        values = np.outer(what, np.eye(5)[joint.index(name)])
        changes: list[dict[str, np.ndarray]] = []
        for spin in (0.0, 1.0)[: len(term.parameters)]:
            after, before = residual_of(eps * values, curve, spin), residual_of(0.0 * values, curve, spin)
            changes.append({row: (after[row] - before[row]) / eps for row in after})
        columns = term.columns(motion)
        assert {"suspension.rl", "suspension.rr"} <= set(columns)
        for row, table in columns.items():
            change = np.stack([changes[0][row], *(one[row] - changes[0][row] for one in changes[1:])])
            assert np.max(np.abs(change)) > 0.01, f"{term.key} {row}"
            # Toe: the effect turns about z of the car, whatever the attitude of the wheel. Pitch: the sine of it.
            close = {"toe_change": 0.06, "pitch_change": 1e-4}.get(term.slope.name, 1e-6) * np.max(np.abs(change))
            np.testing.assert_allclose(-table, change, atol=close, err_msg=f"{term.key} {row}")
