"""Compliance along a motion: which loads count, and that those on both wheels of an axle move and turn a wheel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.compliance import LOADS, Compliance
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.compliance import APPLIED, brakes_act, loads_on
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.rows import PRESSURE, RELEASED
from lacet.identify.effects.body.rigid_body import RigidBody
from lacet.identify.regression.sensitivity import Sensitivity, residual
from tests.identify import cars

PLAIN, RIG = cars.reference_car()
JOINTED = cars.with_joints(PLAIN)
RNG = np.random.default_rng(6)
GIVES = {
    c: Compliance({k: RNG.normal(0, 2e-6, 5) for k in LOADS}, {k: RNG.normal(0, 2e-6, 5) for k in LOADS})
    for c in CORNERS
}
VEHICLE = replace(
    JOINTED,
    corners={c: replace(k, joints=replace(k.joints, compliance=GIVES[c])) for c, k in JOINTED.corners.items()},  # type: ignore[arg-type]
)
N = 12


def test_joints_change_by_the_loads_on_both_wheels() -> None:
    """Wheel centre and pitch of the rear wheels are those without loads and what the slopes make of these."""
    rig = cars.in_reference(RIG, "contact", {s.name: "body" for s in RIG.sensors if "wheel.fl.force" in s.channels})
    signals = cars.random_signals(3, N)
    assert "brake.pressure" not in signals.value
    with_loads, bare = (build_motion(cars.recording(signals, car, rig)) for car in (VEHICLE, JOINTED))
    for c in ("rl", "rr"):
        expected = np.zeros((5, N))
        for wheel, slopes in ((c, GIVES[c].own), (other_corner(c), GIVES[c].other)):
            side = VEHICLE.corners[wheel].side
            force, moment = signals.value[f"wheel.{wheel}.force"], signals.value[f"wheel.{wheel}.moment"]
            for load, series in (("traction", force[0]), ("lateral", side * force[1]), ("aligning", -side * moment[2])):
                expected += np.outer(slopes[load], series)
        change = with_loads.corners[c].centre - bare.corners[c].centre
        assert np.max(np.abs(change)) > 1e-3
        np.testing.assert_allclose(change[1], VEHICLE.corners[c].side * expected[0], atol=1e-12)
        np.testing.assert_allclose(change[0], expected[1], atol=1e-12)
        np.testing.assert_allclose(with_loads.corners[c].pitch - bare.corners[c].pitch, expected[4], atol=1e-12)


def test_a_brake_s_torque_is_on_the_carrier_and_a_half_shaft_s_is_not() -> None:
    corner = VEHICLE.corners["fl"]
    force, axis = np.array([[-1000.0], [0.0], [0.0]]), np.array([[0.0], [1.0], [0.0]])
    moment, released, pressed = 300.0 * axis, np.array([False]), np.array([True])
    free = loads_on(corner, {}, force, moment, axis, released)
    assert free["longitudinal"] == 0.0
    assert free["traction"] == -1000.0
    braked = loads_on(corner, {}, force, moment, axis, pressed)
    np.testing.assert_allclose(braked["longitudinal"], -300.0 / corner.height)
    np.testing.assert_allclose(braked["traction"] + braked["longitudinal"], -1000.0)
    measured = {"brake.fl.torque": np.array([[200.0]])}
    for known in (pressed, released):
        own = loads_on(corner, measured, force, moment, axis, known)
        np.testing.assert_allclose(own["longitudinal"], -200.0 / corner.height)
    inboard = loads_on(replace(corner, brakes="inboard"), measured, force, moment, axis, pressed)
    assert inboard["longitudinal"] == 0.0


def test_without_pressure_wheels_without_drive_show_that_the_driver_brakes() -> None:
    """Not driven wheels, which an engine brakes too, nor those with inboard brakes; never where declared off."""
    driven = {c: replace(corner, driven=c[0] == "f") for c, corner in VEHICLE.corners.items()}
    car = replace(VEHICLE, corners=driven)
    signals = cars.random_signals(3, 3)
    moments = {"f": [900.0, 900.0, 0.0], "r": [0.0, 2 * APPLIED, 2 * APPLIED]}
    value = {k: v for k, v in signals.value.items() if k != PRESSURE}
    value |= {f"wheel.{c}.moment": np.outer([0.0, 1.0, 0.0], moments[c[0]]) for c in CORNERS}

    def found(vehicle: Vehicle, brakes: str = "unknown", **more: np.ndarray) -> list[bool]:
        given = replace(signals, value={**value, **more})
        return brakes_act(cars.recording(given, vehicle, RIG, brakes=brakes)).tolist()

    assert found(car) == found(car, "used") == [False, True, True]
    assert found(car, "off") == [False, False, False]
    assert found(car, "off", **{PRESSURE: np.array([[2 * RELEASED, 0.0, 0.0]])}) == [True, False, False]
    for other in ({"driven": True}, {"brakes": "inboard"}):
        none = {c: replace(corner, **other) for c, corner in driven.items()}
        assert found(replace(car, corners=none)) == [False, False, False]
    # The mean of them counts.
    value["wheel.rl.moment"] = 0.0 * value["wheel.rl.moment"]
    value["wheel.rr.moment"] = value["wheel.rr.moment"] * 0.9
    assert found(car) == [False, False, False]


def test_derivatives_by_a_wheel_s_load_see_the_other_wheel_too() -> None:
    """Where only its load moves the other wheel, and not its travel."""
    corners = {
        c: replace(k, joints=replace(k.joints, other=None, product=np.zeros(5)))  # type: ignore[arg-type]
        for c, k in VEHICLE.corners.items()
    }
    car, signals = replace(VEHICLE, corners=corners), cars.random_signals(5, 40)
    recording = cars.recording(signals, car, RIG)
    effects = RigidBody.variants(car, "contact")
    theta = np.random.default_rng(1).normal(0, 5, sum(len(effect.parameters) for effect in effects))
    slopes = Sensitivity.of(recording, effects, theta, spacing=1e-9).slopes
    ahead, behind = (
        residual(
            build_motion(recording.with_signals(replace(signals, value={**signals.value, "wheel.rr.force": moved}))),
            effects, theta,
        )
        for moved in (signals.value["wheel.rr.force"] + h * np.array([[0.0], [1.0], [0.0]]) for h in (30.0, -30.0))
    )  # fmt: skip
    for row, after in ahead.items():
        if row.startswith("suspension.rl"):
            expected = (after - behind[row]) / 60.0
            assert np.max(np.abs(expected)) > 1e-6
            np.testing.assert_allclose(
                slopes["wheel.rr.force", 1, 0][row] * np.ones(40), expected, rtol=2e-2, atol=1e-6
            )
