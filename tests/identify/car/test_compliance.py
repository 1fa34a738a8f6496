"""Compliance along a motion: which loads count, and that those on both wheels of an axle move and turn a wheel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.compliance import LOADS, Compliance
from lacet.identify.car.compliance import loads_on
from lacet.identify.car.kinematics import build_motion
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
    moment = 300.0 * axis
    free = loads_on(corner, {}, force, moment, axis)
    assert free["longitudinal"] == 0.0
    assert free["traction"] == -1000.0
    pressed = loads_on(corner, {"brake.pressure": np.array([[3e6]])}, force, moment, axis)
    np.testing.assert_allclose(pressed["longitudinal"], -300.0 / corner.height)
    np.testing.assert_allclose(pressed["traction"] + pressed["longitudinal"], -1000.0)
    measured = {"brake.pressure": np.array([[3e6]]), "brake.fl.torque": np.array([[200.0]])}
    np.testing.assert_allclose(loads_on(corner, measured, force, moment, axis)["longitudinal"], -200.0 / corner.height)
    inboard = loads_on(replace(corner, brakes="inboard"), measured, force, moment, axis)
    assert inboard["longitudinal"] == 0.0


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
