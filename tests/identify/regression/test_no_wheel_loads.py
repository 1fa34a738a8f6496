"""Rows of the body without any wheel load: vertical forces cancel, the sprung mass sets the scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from lacet.daq.assumptions import ASSUMABLE, SETS_SCALE
from lacet.daq.channels import CORNERS
from lacet.daq.errors import LacetError
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.rows import (
    BODY_ROWS,
    CHASSIS_ROWS,
    CORNER_ROWS,
    PARAMETER_OF,
    SPRUNG_MASS,
    SUSPENSION_ROWS,
    Absence,
    body_levers,
)
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import cross
from lacet.identify.properties.derived import derived_values
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import residual
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.channels.fault_columns import FaultColumns
from lacet.identify.validation.channels.single_faults import column_faults
from lacet.identify.validation.noise_floor import floor_of
from lacet.identify.validation.parameter_estimates import GivenBeforehand, SeenAside, estimates
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.row_sources import RowKind, row_sources
from lacet.services.render.candidate_reasons import reason_text, short_reason
from lacet.services.render.identifiability import unidentified
from lacet.services.render.row_needs import no_rows, to_add
from lacet.services.render.verdicts import says
from tests.identify import cars
from tests.identify.regression.test_fewer_instruments import expected, standing

BARS = ("anti_roll_bar.front", "anti_roll_bar.rear")
CAR, RIG = cars.reference_car()[0], replace(cars.reference_car()[1], wheel_reference="contact")


def with_mass(sprung: float = 1270.0) -> Vehicle:
    """The reference car with its masses stated."""
    stated = f"""
[assumed]
sprung_mass = {{ value = {sprung}, tolerance = 15, unit = "kg", source = "scales less unsprung masses" }}
unsprung_mass.front = {{ value = 56, tolerance = 3, unit = "kg", source = "drawing" }}
unsprung_mass.rear = {{ value = 48, tolerance = 3, unit = "kg", source = "drawing" }}
"""
    return Vehicle.parse(CAR.text + stated)


def without_loads(name: str, start: float, stop: float, *more: str) -> Run:
    """Inertial unit, travel, speed, steer and `more` channels, by the ends of their names, of a run."""
    whole, ends = cars.piece(name, start, stop), (".hub", ".steer", *more)
    kept = {n: s for n, s in whole.signals.items() if n.startswith(("imu.", "correvit.")) or n.endswith(ends)}
    return replace(whole, signals=kept, wheel_reference=None)


def fitted_to(runs: Sequence[Run], vehicle: Vehicle) -> Fit:
    """The base model and both bars."""
    known = catalogue(vehicle, "contact")
    model = Model.of([*base_model(vehicle, "contact"), *(known[key] for key in BARS)])
    return fit(model, [PreparedRun.of(run, vehicle, RIG) for run in runs], FitOptions(draws=2))


@cache
def moving() -> tuple[Run, ...]:
    """Three runs without wheel loads."""
    return tuple(without_loads(name, 5.0, 20.0) for name in ("sine", "liftoff", "rough"))


@cache
def found() -> Fit:
    """The fit to them."""
    return fitted_to(moving(), with_mass())


@pytest.mark.parametrize("reference", ["contact", "hub"])
def test_true_loads_fulfil_the_rows_and_vertical_forces_cancel(reference: str) -> None:
    """Loads that fulfil all rows of a model fulfil the body's with every mass on the left; F_z moves none of them.

    Likewise with a parameter on the left and the sprung mass on the right, whatever value the model has of the former.
    """
    rng = np.random.default_rng(3)
    rig, t = cars.in_reference(RIG, reference), np.arange(100) / cars.RATE
    model = Model.of(base_model(CAR, reference))
    theta = np.array([rng.uniform(0.02, 0.1) * q.largest for q in model.parameters])
    value = dict(zip(model.names, theta.tolist(), strict=True))
    exact = cars.fulfil(
        cars.recording(cars.exact_signals(cars.drive_curves(rng), t), CAR, rig), model.physics, theta
    )  # fmt: skip
    loaded = build_motion(exact)
    names = {"fl": ("M29", "M32"), "fr": ("M38", "M41"), "rl": ("M11", "M14"), "rr": ("M20", "M23")}
    masses = {f"axle.{c}": np.full(t.size, sum(value[name] for name in of)) for c, of in names.items()}
    combined = (*BODY_ROWS, *CORNER_ROWS)
    assert all({*loaded.weights(row)} == {*row.parts} for row in combined)
    body = replace(loaded, rows=combined, masses={**masses, "chassis": np.full(t.size, value["M6"])})
    for effect in model.physics:
        acting = {*body.with_body_rows(effect.columns(body))} & {*combined}
        assert acting <= {row for row in combined if effect.acts_on(row)}, effect.key
    assert not catalogue(CAR, reference)["coulomb.front"].acts_on(CORNER_ROWS[2])
    for row, series in residual(body, model.physics, theta).items():
        assert np.max(np.abs(series)) < 1e-12 * np.max(np.abs(body.measured(row))) + 5e-9, row
    for name in ("offset.fl.f0", "spring.rr.k", "damper.fr.c", "tyre_stiffness.rl.kt", "XX6", "YY6"):
        of = model.names.index(name)
        given = replace(body, masses=masses, known={name: np.full(t.size, theta[of])})
        without = np.where(np.arange(theta.size) == of, 0.0, theta)
        assert any(np.any(series) for series in residual(replace(given, known={}), model.physics, without).values())
        for values in (theta, without):
            for row, series in residual(given, model.physics, values).items():
                assert np.max(np.abs(series)) < 1e-12 * np.max(np.abs(body.measured(row))) + 5e-9, (name, row)
    more = {
        c: replace(corner, force=corner.force + np.outer([0.0, 0.0, 1.0], rng.normal(0, 3000, t.size)))
        for c, corner in body.corners.items()
    }
    for row in combined:
        np.testing.assert_allclose(replace(body, corners=more).measured(row), body.measured(row), atol=1e-8)


def test_horizontal_forces_in_the_contact_patches_cancel() -> None:
    """With wheel centres that move straight up, on a flat road, their levers are that of the mean height."""
    rng, t = np.random.default_rng(4), np.arange(100) / cars.RATE
    model = Model.of(base_model(CAR, "contact"))
    theta = np.array([0.05 * q.largest for q in model.parameters])
    signals = cars.exact_signals(cars.drive_curves(rng), t)
    motion = build_motion(cars.fulfil(cars.recording(signals, CAR, RIG), model.physics, theta))
    push = np.outer([800.0, 1000.0, 0.0], np.ones(t.size))
    pushed = {
        c: replace(
            corner, force=corner.force + push,
            moment=corner.moment + cross(np.outer([0.0, 0.0, -CAR.corners[c].height], np.ones(t.size)), push),
        )
        for c, corner in motion.corners.items()
    }  # fmt: skip
    for row in BODY_ROWS:
        np.testing.assert_allclose(replace(motion, corners=pushed).measured(row), motion.measured(row), atol=1e-8)


def test_the_body_s_rows_weigh_by_the_car_s_levers() -> None:
    """σ of the rows are in the proportions of the car's own tracks and wheelbase."""
    levers = body_levers(CAR)
    front, rear = CAR.corners["fl"].position, CAR.corners["rl"].position
    assert levers[BODY_ROWS[1]] == pytest.approx(np.hypot(front[1], rear[1]) / np.sqrt(2.0))
    assert levers[BODY_ROWS[2]] == pytest.approx(abs(rear[0]) / np.sqrt(2.0))
    sigma = found().sigma
    for row in BODY_ROWS:
        assert sigma[row] / sigma[BODY_ROWS[0]] == pytest.approx(levers[row], rel=1e-6), row


def test_what_the_body_s_rows_show_aside_is_refused() -> None:
    """Yaw inertia acts by gyroscopic products alone: refused with its own row and what that needs.

    All that is identified is known to a quarter, with sheet.
    """
    every = {e.name: e for e in estimates(found(), None, found().runs)}
    why = every["ZZ6"].why
    assert isinstance(why, SeenAside)
    assert why.row == "chassis.mz"
    assert "wheel.*.force" in unidentified(why)
    assert "sprung_mass" in unidentified(every["M6"].why)
    # A ground laser is enough for a tyre.
    assert unidentified(every["tyre_stiffness.fl.kt"].why) == "corner.fl left out: needs: laser.fl.ground"
    assert "unsprung_mass.rear" in unidentified(every["M11"].why)
    for name in ("spring.fl.k", "damper.rr.c", "MX6", "XX6", "YY6"):
        assert every[name].identifiable
        assert every[name].half_sheet < 0.25 * abs(every[name].value), name


@pytest.mark.parametrize(("law", "axle"), [("spring_cubic", "front"), ("coulomb", "rear"), ("damper_knee", "front")])
def test_a_law_of_an_axle_is_the_sum_of_its_wheels(law: str, axle: str) -> None:
    """Both wheels act on the same rows of the body."""
    known, run = catalogue(with_mass(), "contact"), found().runs[2]
    each = [known[f"{law}.{place}"].as_physics for place in (axle, f"{axle[0]}l", f"{axle[0]}r")]
    whole, left, right = (run.columns(one) for one in each if one is not None)
    assert np.any(left[BODY_ROWS[1]])
    for row in BODY_ROWS:
        np.testing.assert_allclose(whole[row], left[row] + right[row], atol=1e-9 * np.max(np.abs(left[row])))


def test_measured_loads_leave_no_row_of_the_body() -> None:
    """A car with dynamometers has the same rows whether its sprung mass is given or not."""
    whole = cars.piece("sine", 5.0, 8.0)
    plain, stated = (PreparedRun.of(whole, vehicle, RIG) for vehicle in (CAR, with_mass()))
    assert plain.rows == stated.rows
    assert not {*BODY_ROWS} & {*plain.rows, *plain.measured_rows.left_out}


def test_the_truth_is_in_the_intervals(truth: dict[str, Any]) -> None:
    """Springs, dampers and bars of the reference car, nine of ten within and all within twice.

    On a rough road each bar is known by itself: no sum is given.
    """
    fitted = found()
    assert fitted.rows == BODY_ROWS
    right = expected(truth)
    off = {
        e.name: abs(e.value - right[e.name]) / e.half_sheet
        for e in estimates(fitted, None, fitted.runs)
        if e.identifiable and e.name in right
    }
    assert {f"{kind}.{c}.{k}" for c in CORNERS for kind, k in (("spring", "k"), ("damper", "c"))} <= set(off)
    assert max(off.values()) < 2.0, off
    assert np.mean([size < 1.0 for size in off.values()]) >= 0.8, off
    assert {f"{key}.k" for key in BARS} <= set(off)
    assert derived_values(fitted, with_mass(), Knowledge.of(fitted)) == []


def test_every_parameter_is_in_proportion_to_the_mass() -> None:
    """A tenth more mass, sprung and unsprung, makes all springs a tenth stiffer."""
    vehicle = with_mass()
    assumed = {n: replace(a, value=1.1 * a.value) for n, a in vehicle.assumed.items()}
    heavier = fitted_to(moving(), replace(vehicle, assumed=assumed))
    for c in CORNERS:
        name = f"spring.{c}.k"
        assert heavier.value(name) == pytest.approx(1.1 * found().value(name), rel=1e-3)


GIVEN = {
    "spring_rate.front": (("spring.fl.k", "spring.fr.k"), 500.0),
    "damper_rate.rear": (("damper.rl.c", "damper.rr.c"), 40.0),
    "static_load.front": (("offset.fl.f0", "offset.fr.f0"), 30.0),
    "tyre_rate.front": (("tyre_stiffness.fl.kt", "tyre_stiffness.fr.kt"), 4000.0),
    "roll_inertia": (("XX6",), 10.0),
    "pitch_inertia": (("YY6",), 60.0),
}
"""Assumption that may set the scale → the parameters that it gives, its tolerance."""


def giving(name: str, value: float) -> Vehicle:
    """The reference car with its unsprung masses and a parameter stated, not its sprung mass."""
    stated = with_mass().text.splitlines(keepends=True)
    unsprung = "".join(part for part in stated if not part.startswith("sprung_mass"))
    return Vehicle.parse(unsprung + _line(name, value, GIVEN[name][1]))


def _line(name: str, value: float, tolerance: float = 10.0) -> str:
    unit = ASSUMABLE[name.partition(".")[0]].unit
    return f'{name} = {{ value = {value}, tolerance = {tolerance}, unit = "{unit}", source = "bench" }}\n'


def all_true(truth: dict[str, Any]) -> dict[str, float]:
    """Parameters of the reference car; inertia of the sprung mass alone, about the body's origin."""
    body, (x, y, z) = truth["chassis"], truth["chassis"]["cog_m"]
    mass = body["mass_kg"]
    inertia = {"XX6": body["Ixx"] + mass * (y * y + z * z), "YY6": body["Iyy"] + mass * (x * x + z * z)}
    loads = {f"offset.{c}.f0": load for c, load in truth["static_suspension_load_N"].items()}
    return {**expected(truth), **loads, **inertia, "M6": mass}


@pytest.mark.parametrize("name", GIVEN)
def test_any_parameter_given_sets_the_scale(name: str, truth: dict[str, Any]) -> None:
    """In place of the sprung mass, which is then identified; what is given is none of the parameters.

    Its tolerance is in the intervals of the others.
    """
    right, (parameters, tolerance), runs = all_true(truth), GIVEN[name], moving()
    if name == "tyre_rate.front":
        runs = tuple(without_loads(one, 5.0, 20.0, ".ground") for one in ("sine", "liftoff"))
    fitted = fitted_to(runs, giving(name, right[parameters[0]]))
    every = {e.name: e for e in estimates(fitted, None, fitted.runs)}
    assert {*BODY_ROWS} <= {*fitted.rows}
    for parameter in parameters:
        assert isinstance(why := every[parameter].why, GivenBeforehand)
        assert why.assumption.startswith(name.partition(".")[0])
    for one in {"M6", "spring.fl.k", "spring.rl.k", "damper.fl.c", "damper.rr.c"} - {*parameters}:
        assert every[one].identifiable, one
        assert abs(every[one].value - right[one]) < 1.2 * every[one].half_sheet < 0.4 * right[one], one
    share = TWO_SIDED_95 * tolerance / right[parameters[0]]
    at_least = every["spring.rr.k"].half_sheet / right["spring.rr.k"]
    assert at_least > (0.2 if name.startswith("static") else 0.9) * share


def test_a_given_parameter_counts_where_its_row_is_formed() -> None:
    """A tyre's stiffness needs a ground laser, static loads those of an axle; no value is 0."""
    tyre = giving("tyre_rate.front", 220_000.0)
    bare, seen = (PreparedRun.of(without_loads("sine", 5.0, 8.0, *more), tyre, RIG) for more in ((), (".ground",)))
    assert bare.rows == ()
    assert seen.rows == (*BODY_ROWS, *CORNER_ROWS)
    diagonal = Vehicle.parse(
        CAR.text + "[assumed]\n" + "".join(_line(f"static_load.{c}", 3000.0) for c in ("fl", "rr"))
    )
    assert PreparedRun.of(without_loads("sine", 5.0, 8.0), diagonal, RIG).rows == ()
    with pytest.raises(LacetError, match="must be positive"):
        giving("damper_rate.rear", 0.0)


def test_ground_lasers_part_the_bars_and_give_tyres_and_static_loads(truth: dict[str, Any]) -> None:
    """Each corner's load by its tyre's deflection: smooth runs are enough, and cross-weight has an interval."""
    fitted = fitted_to([without_loads(name, 5.0, 20.0, ".ground") for name in ("sine", "liftoff")], with_mass())
    assert fitted.rows == (*BODY_ROWS, *CORNER_ROWS)
    right = expected(truth) | {f"offset.{c}.f0": load for c, load in truth["static_suspension_load_N"].items()}
    every = {e.name: e for e in estimates(fitted, None, fitted.runs)}
    off = {n: abs(every[n].value - right[n]) / every[n].half_sheet for n in right if every.get(n)}
    kinds = ("spring.{}.k", "damper.{}.c", "tyre_stiffness.{}.kt", "offset.{}.f0")
    names = [kind.format(c) for kind in kinds for c in CORNERS] + [f"{key}.k" for key in BARS]
    assert all(every[name].identifiable and every[name].group == name for name in names)
    assert max(off[name] for name in names) < 2.0, off
    assert np.mean([off[name] < 1.0 for name in names]) >= 0.8, off
    assert derived_values(fitted, with_mass(), Knowledge.of(fitted)) == []


def test_cross_weight_needs_corner_scales() -> None:
    """Three groups of the four static offsets without scales; four of them with a run that stands on scales."""
    fitted = found()
    kept = [name for name in fitted.columns if name.startswith("offset.")]
    assert len(kept) == 3
    assert not any(e.identifiable and e.name == e.group and e.name.startswith("offset.")
                   for e in estimates(fitted, None, fitted.runs))  # fmt: skip
    scaled = fitted_to([*moving(), replace(standing(), wheel_reference=None)], with_mass())
    assert {*BODY_ROWS, *SUSPENSION_ROWS} <= {*scaled.rows}
    assert len([name for name in scaled.columns if name.startswith("offset.")]) == 4


def test_what_is_impossible_is_named() -> None:
    """Yaw and lateral rows with what to add; without the sprung mass all rows, and what to give."""
    sources = {one.row: one for one in row_sources(found())}
    for row in CHASSIS_ROWS:
        assert sources[row].kind is RowKind.IMPOSSIBLE
        assert "wheel.*.force" in to_add(row, sources[row].absence)
    assert all(sources[row].kind is RowKind.ASSUMED for row in BODY_ROWS)
    estimated = {e.name for e in estimates(found(), None, found().runs) if e.identifiable}
    assert not estimated & {"M6", "tyre_stiffness.fl.kt"}
    refused = PreparedRun.of(moving()[0], CAR, RIG)
    assert refused.rows == ()
    left_out = refused.measured_rows.left_out
    assert {left_out[row].cause for row in BODY_ROWS} == {Absence.NO_KNOWN_LOAD}
    assert "give one of sprung_mass, static_load, spring_rate" in " ".join(no_rows(left_out).split())
    assert {SPRUNG_MASS, *PARAMETER_OF} == {*SETS_SCALE}
    assert not [law for law in refused.recording.laws if law.channel.startswith("wheel.")]


def test_what_cannot_be_tested_says_what_the_runs_lack() -> None:
    """A tyre's damping one ground laser, cross-talk and an air force with a moment in yaw the dynamometers."""
    known = catalogue(with_mass(), "contact")
    candidates = [known[key] for key in ("tyre_damping.front", "sensor_crosstalk.all.zx", "aero_side")]
    tests = ScoreTests.of(Linearisation.of(found(), floor_of(found(), 20)), candidates, 0)
    words = {c.key: short_reason(c) for c in tests.try_all()}
    assert words["tyre_damping.front"] == "needs: laser.fl.ground"
    assert words["sensor_crosstalk.all.zx"] == "these runs have none of its channels"
    assert words["aero_side"] == "needs: wheel.*.force"
    (damping,) = (c for c in tests.try_all() if c.key == "tyre_damping.front")
    assert "form no row that it acts on; its first needs: laser.fl.ground" in reason_text(damping, candidates[0], 20)


def test_missing_bars_are_named(truth: dict[str, Any]) -> None:
    """Of the base model both bars, and nothing else, with sizes that hold the truth."""
    known = catalogue(with_mass(), "contact")
    plain = fit(Model.of(base_model(with_mass(), "contact")), found().runs, FitOptions(draws=2))
    candidates = [known[key] for key in (*BARS, "spring_cubic.front", "damper_asymmetry.rear")]
    diagnosis = diagnose(plain, floor_of(plain, 60), candidates)
    assert {one.key for one in diagnosis.found} == {*BARS}
    assert not diagnosis.unlisted
    for one in diagnosis.found:
        assert abs(one.values[0] - expected(truth)[f"{one.key}.k"]) < 1.5 * one.interval[0]


def test_bars_on_smooth_runs_are_one_class_with_their_sum(truth: dict[str, Any]) -> None:
    """Either bar alone would explain what both do, with the size of both: they are named as one, and fitted as two."""
    known, both = catalogue(with_mass(), "contact"), sum(expected(truth)[f"{key}.k"] for key in BARS)
    runs = [PreparedRun.of(without_loads(name, 5.0, 14.0), with_mass(), RIG) for name in ("sine", "liftoff")]
    plain = fit(Model.of(base_model(with_mass(), "contact")), runs, FitOptions(draws=2))
    diagnosis = diagnose(plain, floor_of(plain, 40), [known[key] for key in (*BARS, "spring_cubic.front")])
    assert {one.key for one in diagnosis.found} == {*BARS}
    assert not diagnosis.unlisted
    total = diagnosis.found[0].total
    assert total is not None
    assert all(one.total == total and one.interval[0] > 0.25 * both for one in diagnosis.found)
    assert abs(total.value - both) < total.half < 0.25 * both
    assert "do not show how it is split" in says(diagnosis)
    assert diagnosis.after is not None
    assert not {*BARS} & {one.key for one in diagnosis.after.candidates}
    with_both = plain.with_effects([known[key] for key in BARS])
    (printed,) = derived_values(with_both, with_mass(), Knowledge.of(with_both))
    assert printed.name == "anti_roll_bar.sum.k"
    assert printed.value == pytest.approx(total.value, rel=0.01)


def test_noise_makes_no_assumption_wrong() -> None:
    """Columns of assumptions are made of noisy channels; a smaller mass would leave less noise, and is not needed."""
    fitted = found()
    linearisation = Linearisation.of(fitted, floor_of(fitted, 60))
    law = catalogue(with_mass(), "contact")["spring_cubic.front"]
    use = ScoreTests.of(linearisation, [law], 0).tolerance_use()
    assert not use.tolerance_exceeded
    assert abs(use.sizes["assumed sprung_mass"]) < 3.0, use.sizes


def test_the_scale_of_a_column_is_no_fault_where_the_car_s_parameters_take_it() -> None:
    """Here a_x is 0.4 of the true one, and the equations ask for a scale far from 2.5: the height of the centre of
    gravity is free."""
    run = moving()[0]
    accel = run.signals["imu.accel"]
    wrong = accel.values * np.array([0.4, 1.0, 1.0])
    run = replace(run, signals={**run.signals, "imu.accel": replace(accel, values=wrong)})
    prepared = PreparedRun.of(run, with_mass(), RIG)
    products = FaultColumns.of(prepared)
    assert products
    (asked,) = (one for one in products.estimates() if one.column == "imu.accel.x")
    assert abs(asked.scale - 2.5) > 1.5
    assert column_faults([prepared]) == []
