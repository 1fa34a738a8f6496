"""Errors of bench tables: the motion is that of a table with other slopes, and intervals hold tables that are wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from lacet.daq.assumptions import AXLE_OF
from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.compliance import JOINTS
from lacet.daq.joint_tables import JointCurve, JointTables
from lacet.daq.rig import Rig, Sensor
from lacet.daq.table_tolerances import COMPLIANCE, CURVES, table_key
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.sources.completion import completed
from lacet.identify.car.table_errors import table_assumptions
from lacet.identify.effects.base import AXLES
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity, residual
from lacet.identify.regression.tolerances import sheet_responses
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording, Signals
from tests.identify import cars, exact_car
from tests.identify.car.test_compliance import VEHICLE as WITH_COMPLIANCE

PLAIN, RIG = cars.reference_car()
FILTERS = Filters(rate=100.0, pre_cutoff=None)


Slopes = dict[str, dict[str, np.ndarray]]
"""Corner → suffix of the curve (`CURVES`) → (5,) errors of the slopes."""


def moved(vehicle: Vehicle, slopes: Slopes) -> Vehicle:
    """The vehicle whose tables have slopes that are higher by these errors."""
    return replace(vehicle, corners={c: _moved(one, slopes.get(c)) for c, one in vehicle.corners.items()})


def _moved(corner: Corner, slopes: dict[str, np.ndarray] | None) -> Corner:
    if slopes is None:
        return corner
    if corner.joints is not None:
        curves = {}
        for suffix, name in (("", "own"), ("_other", "other"), ("_rack", "rack")):
            if (given := getattr(corner.joints, name)) is not None and suffix in slopes:
                curves[name] = JointCurve(given.at, given.values + np.outer(given.at, slopes[suffix]))
        tables: JointTables = replace(corner.joints, **curves)  # type: ignore[arg-type]
        return replace(corner, joints=tables)
    assert corner.table is not None
    columns = {
        name: getattr(corner.table, name) + e * corner.table.travel for name, e in zip(JOINTS, slopes[""], strict=True)
    }
    return replace(corner, table=replace(corner.table, **columns))


def slopes_of(errors: dict[str, float]) -> Slopes:
    """The slopes that errors by name make: those of the corner and those that its axle has in common."""
    found = {c: {curve: np.zeros(5) for curve in CURVES} for c in CORNERS}
    for c in CORNERS:
        for curve in CURVES:
            for k, joint in enumerate(JOINTS):
                key = table_key(joint, curve)
                found[c][curve][k] = errors.get(f"{key}.{c}", 0.0) + errors.get(f"{key}_axle.{AXLE_OF[c]}", 0.0)
    return found


def with_errors(recording: Recording, errors: dict[str, float]) -> Recording:
    """The recording of which these errors of tables, by name, are known; others are what the tables say."""
    assumed = {name: np.full_like(a, errors.get(name, a[0, 0])) for name, a in recording.signals.assumed.items()}
    return recording.with_signals(replace(recording.signals, assumed=assumed))


@pytest.mark.parametrize("vehicle", [cars.with_tables(PLAIN), cars.with_joints(PLAIN)], ids=["bump", "joints"])
def test_an_error_of_a_slope_is_a_table_with_another_slope(vehicle: Vehicle) -> None:
    """Every part of the motion at every corner, with errors of each curve, each corner and each axle at once."""
    rng = np.random.default_rng(3)
    record = completed(cars.recording(cars.random_signals(3), vehicle, RIG))
    errors = {one.name: float(rng.normal(0.0, 0.05)) for one in record.tables}
    found = build_motion(with_errors(record, errors))
    right = build_motion(cars.recording(cars.random_signals(3), moved(vehicle, slopes_of(errors)), RIG))
    off = build_motion(record)
    for c in CORNERS:
        for part in fields(right.corners[c]):
            one, other = (getattr(motion.corners[c], part.name) for motion in (found, right))
            if isinstance(one, np.ndarray):
                np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9, err_msg=f"{c} {part.name}")
        assert np.max(np.abs(off.corners[c].dphi_ds - right.corners[c].dphi_ds)) > 0.01


@pytest.mark.parametrize("curve", ["_other", "_rack"])
def test_each_curve_moves_the_wheel(curve: str) -> None:
    """An error of the axle's part, alone: the wheel centres are where the car with another curve has them."""
    vehicle = cars.with_joints(PLAIN)
    record = completed(cars.recording(cars.random_signals(6), vehicle, RIG))
    errors = {f"table_half_track{curve}_axle.front": 0.02, f"table_toe{curve}_axle.front": 0.3}
    found, off = (build_motion(one) for one in (with_errors(record, errors), record))
    right = build_motion(cars.recording(cars.random_signals(6), moved(vehicle, slopes_of(errors)), RIG))
    for c in ("fl", "fr"):
        np.testing.assert_allclose(found.corners[c].centre, right.corners[c].centre, atol=1e-12)
        assert np.max(np.abs(found.corners[c].centre - off.corners[c].centre)) > 1e-4


def test_an_error_of_the_compliance_is_a_table_with_another_one() -> None:
    """Wheel centre and attitude under load."""
    record = completed(cars.recording(cars.random_signals(4), WITH_COMPLIANCE, RIG))
    given = {f"{COMPLIANCE}.{c}": 1.2 for c in CORNERS} | {f"{COMPLIANCE}_axle.{axle}": 0.1 for axle in AXLES}
    found = build_motion(with_errors(record, given))

    def scaled(corner: Corner) -> Corner:
        assert corner.joints is not None
        assert corner.joints.compliance is not None
        given = corner.joints.compliance
        own, other = ({load: 1.3 * a for load, a in part.items()} for part in (given.own, given.other))
        return replace(corner, joints=replace(corner.joints, compliance=replace(given, own=own, other=other)))

    vehicle = replace(WITH_COMPLIANCE, corners={c: scaled(one) for c, one in WITH_COMPLIANCE.corners.items()})
    right = build_motion(cars.recording(cars.random_signals(4), vehicle, RIG))
    for c in CORNERS:
        np.testing.assert_allclose(found.corners[c].centre, right.corners[c].centre, atol=1e-12)
        np.testing.assert_allclose(found.corners[c].axes, right.corners[c].axes, atol=1e-12)


def test_what_is_assumed_of_tables() -> None:
    """Slopes of each curve where there is one, compliance where it has one, and what the vehicle file gives."""

    def names(vehicle: Vehicle) -> set[str]:
        return {one.name for one in table_assumptions(vehicle)}

    def expected(curve: str, places: Sequence[str], axles: Sequence[str]) -> set[str]:
        keys = [table_key(joint, curve) for joint in JOINTS]
        return {f"{key}.{c}" for key in keys for c in places} | {f"{key}_axle.{a}" for key in keys for a in axles}

    both = ("front", "rear")
    assert not names(PLAIN)
    assert names(cars.with_tables(PLAIN)) == expected("", CORNERS, both)
    assert names(cars.with_joints(PLAIN)) == {
        *expected("", CORNERS, both), *expected("_other", CORNERS, both), *expected("_rack", ("fl", "fr"), ("front",)),
    }  # fmt: skip
    with_compliance = names(WITH_COMPLIANCE) - names(cars.with_joints(PLAIN))
    assert with_compliance == {*(f"{COMPLIANCE}.{c}" for c in CORNERS), *(f"{COMPLIANCE}_axle.{axle}" for axle in both)}
    stated = '\n[assumed]\ntable_camber.rear = { value = 0.4, tolerance = 0.1, unit = "rad/m", source = "drawing" }\n'
    given = Vehicle.parse(PLAIN.text + stated)
    assert {(one.name, one.value, one.tolerance) for one in table_assumptions(given)} == {
        ("table_camber.rl", 0.4, 0.1), ("table_camber.rr", 0.4, 0.1),
    }  # fmt: skip
    # It stands in for the table that the file lacks.
    signals = cars.random_signals(5)
    found = build_motion(completed(cars.recording(signals, given, RIG)))
    slope = np.array([0.0, 0.0, 0.0, 0.4, 0.0])
    table = cars.with_tables(PLAIN).corners["rl"].table
    assert table is not None
    bare = replace(table, **dict.fromkeys(JOINTS, 0.0 * table.travel))
    corners = {c: replace(one, table=bare) if c[0] == "r" else one for c, one in PLAIN.corners.items()}
    right = build_motion(
        cars.recording(signals, moved(replace(PLAIN, corners=corners), {"rl": {"": slope}, "rr": {"": slope}}), RIG)
    )
    for c in CORNERS:
        np.testing.assert_allclose(found.corners[c].dphi_ds, right.corners[c].dphi_ds, atol=1e-12)


# -- in a fit ----------------------------------------------------------------------------------------------------------


def only_tables(rig: Rig) -> Rig:
    """The rig without tolerances of gains and latencies: what the sheet adds to an interval is the tables' alone."""

    def exactly(sensor: Sensor) -> Sensor:
        gains = {key: 0.0 for channel in sensor.channels for key in (f"{CHANNELS[channel].family}.gain", "latency")}
        return replace(sensor, tolerance={**sensor.tolerance, **gains})

    return replace(rig, sensors=tuple(exactly(one) for one in rig.sensors))


@cache
def exact() -> tuple[Recording, Model, np.ndarray]:
    """Eight seconds of a lively drive whose loads fulfil a model exactly, of a car with joint tables."""
    vehicle = cars.with_joints(PLAIN)
    rng = np.random.default_rng(12)
    t = np.arange(800) / FILTERS.rate
    bare = cars.recording(cars.exact_signals(cars.drive_curves(rng), t), vehicle, only_tables(RIG), FILTERS)
    model, theta = exact_car.MODEL, exact_car.theta()
    record = completed(cars.fulfil(bare, model.physics, theta))
    # A tenth of the default, so that the weights of the rows are the same whatever is drawn.
    tables = tuple(replace(one, tolerance=0.1 * one.tolerance) for one in record.tables)
    return replace(record, tables=tables), model, theta


def fitted(recording: Recording) -> Fit:
    """The fit of a recording to which noise is added, always the same."""
    noise = draw_noise(recording, recording.signals.value, np.random.default_rng(15))
    values = {name: a + noise[name] for name, a in recording.signals.value.items()}
    noisy = recording.with_signals(Signals.differentiated(values, FILTERS.rate))
    return fit(exact()[1], [PreparedRun(noisy)], FitOptions(unbias=False))


def test_columns_of_the_sheet_are_changes_of_the_residual() -> None:
    """A table off by one tolerance, against the difference of two residuals through the same filter."""
    record, model, theta = exact()
    run = PreparedRun(record)
    found = sheet_responses(run, Sensitivity.of(record, model.physics, theta))
    for name in (
        "table_camber.rl",
        "table_half_track.fl",
        "table_pitch_other.rr",
        "table_toe_rack.fl",
        "table_camber_axle.rear",
    ):
        tolerance = record.assumptions[name].tolerance
        after = residual(build_motion(with_errors(record, {name: tolerance})), model.physics, theta)
        right = run.decimated(after)  # before it is zero
        for row, series in right.items():
            one = found["assumed", name, 0].get(row, np.zeros(series.size))
            np.testing.assert_allclose(one, series, atol=0.02 * np.max(np.abs(series)) + 1e-6, err_msg=f"{name} {row}")


def test_intervals_with_sheet_hold_tables_that_are_wrong() -> None:
    """The car's tables are drawn off those of its file by the stated tolerances: what that moves, ÷ σ of the sheet."""
    record, model, theta = exact()
    right = fitted(record)
    at = right.base.independent
    rng = np.random.default_rng(14)
    squares: list[np.ndarray] = []
    for _ in range(6):
        drawn = {one.name: float(rng.normal(one.value, one.tolerance)) for one in record.tables}
        slopes = slopes_of(drawn)
        signals = replace(record.signals, assumed={})
        car = replace(record, vehicle=moved(record.vehicle, slopes), tables=(), signals=signals)
        loads = cars.fulfil(car, model.physics, theta).signals.value
        found = fitted(record.with_signals(replace(record.signals, value=loads)))
        squares.append((found.theta[at] - right.theta[at]) ** 2 / np.diag(found.covariance_sheet)[at])
    every = np.concatenate(squares)
    # The mean of thirty draws is 1.2, each draw's about 1 off: few errors of axles make most of it.
    assert 0.85 < np.mean(every < TWO_SIDED_95**2) < 0.99
    assert 0.5 < np.mean(every) < 1.8
