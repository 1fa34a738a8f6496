"""Rows of a car with joint tables: what they need of the axle's other wheel, its torques, and their sensitivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.daq.channels import other_corner
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.rows import Row, needs
from lacet.identify.effects.body.rigid_body import RigidBody
from lacet.identify.effects.catalogue import base_model
from lacet.identify.multibody.vectors import dot
from lacet.identify.regression.sensitivity import Sensitivity, residual
from tests.identify import cars

PLAIN, RIG = cars.reference_car()
VEHICLE = cars.with_joints(PLAIN)
N = 6


def test_a_row_needs_what_the_other_wheel_brings() -> None:
    """Loads, travel and angles of the other wheel, where it moves with this one; else none of them."""
    row = Row.parse("suspension.rl")
    more = set(needs(row, "contact", vehicle=VEHICLE)) - set(needs(row, "contact"))
    assert {"wheel.rr.force", "wheel.rr.moment", "wheel.rr.speed", "laser.rr.hub", "camera.rr.steer"} <= more
    assert "laser.rr.hub" in needs(Row.parse("spin.rl"), "contact", vehicle=VEHICLE)
    assert "laser.rr.hub" in needs(Row.parse("tyre.rl"), "contact", vehicle=VEHICLE)
    still = {
        c: replace(k, joints=replace(k.joints, other=None, product=np.zeros(5)))  # type: ignore[arg-type]
        for c, k in VEHICLE.corners.items()
    }
    alone = replace(VEHICLE, corners=still)
    for kind in ("suspension", "tyre", "spin"):
        own = Row.parse(f"{kind}.rl")
        assert not any(".rr." in name for name in needs(own, "contact", ("rl",), alone))
    motion = build_motion(cars.recording(cars.random_signals(3), alone, RIG))
    assert all(corner.other_dp_ds is None for corner in motion.corners.values())
    columns = RigidBody("axle.rl").columns(motion)
    assert "suspension.rr" not in columns


def test_an_eliminated_half_shaft_is_eliminated_at_both_wheels() -> None:
    """The row without torques is the one with them less both spin rows, times n·∂φ/∂s of their wheels."""
    rng = np.random.default_rng(8)
    driven = replace(VEHICLE, corners={c: replace(k, driven=c[0] == "r") for c, k in VEHICLE.corners.items()})
    signals = cars.random_signals(4, N)
    torques = {f"shaft.{c}.torque": rng.normal(0, 500, (1, N)) for c in ("rl", "rr")}
    effects = RigidBody.variants(driven, "contact")
    theta = rng.normal(size=sum(len(effect.parameters) for effect in effects))
    rig, with_torques = cars.in_reference(RIG, "contact"), replace(signals, value={**signals.value, **torques})
    measured = build_motion(cars.recording(with_torques, driven, rig))
    eliminated = build_motion(cars.recording(signals, driven, rig))
    rest, rest_eliminated = (residual(motion, effects, theta) for motion in (measured, eliminated))
    assert not any(row.startswith("spin.r") for row in rest_eliminated)
    for c in ("rl", "rr"):
        own, other = measured.corners[c], measured.corners[other_corner(c)]
        assert other.other_dphi_ds is not None
        expected = rest[Row.parse(f"suspension.{c}")].copy()
        for k, wheel, slope in ((c, own, own.dphi_ds), (other_corner(c), other, other.other_dphi_ds)):
            expected -= dot(wheel.spin_axis, slope) * rest[Row.parse(f"spin.{k}")]
        found = rest_eliminated[Row.parse(f"suspension.{c}")]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.max(np.abs(expected)))


def test_a_brake_that_is_not_measured_leaves_out_the_rows_of_both_wheels() -> None:
    """The half-shaft of the other wheel works on this travel too: with brakes used both rows need its torque."""
    one = {c: replace(k, driven=c == "rr") for c, k in VEHICLE.corners.items()}
    motion = build_motion(cars.recording(cars.random_signals(4), replace(VEHICLE, corners=one), RIG, brakes="used"))
    assert {"suspension.rl", "suspension.rr"} <= set(motion.left_out)
    assert "suspension.fl" in motion.rows
    assert "shaft.rr.torque" in motion.left_out[Row.parse("suspension.rl")].channels


def test_sensitivities_see_the_other_wheel() -> None:
    """Slopes by a hub laser of the axle's other wheel are those of the whole car made anew."""
    record = cars.recording(cars.random_signals(6, 12), VEHICLE, RIG)
    effects = base_model(VEHICLE, "hub")
    theta = np.random.default_rng(2).normal(size=sum(len(e.parameters) for e in effects))
    slopes = Sensitivity.of(record, effects, theta, spacing=1.0 / record.filters.rate).slopes
    for order, part in enumerate(("value", "rate")):
        step = 1e-6
        ends = []
        for sign in (step, -step):
            series = getattr(record.signals, part)
            moved = {**series, "laser.rr.hub": series["laser.rr.hub"] + sign}
            changed = record.with_signals(replace(record.signals, **{part: moved}))
            ends.append(residual(build_motion(changed), effects, theta))
        for row in ("suspension.rl", "suspension.rr", "tyre.rl", "chassis.my"):
            key = Row.parse(row)
            expected = (ends[0][key] - ends[1][key]) / (2 * step)
            if np.max(np.abs(expected)) > 0.0:
                found = np.broadcast_to(slopes["laser.rr.hub", 0, order][key], N * 2)
                np.testing.assert_allclose(
                    found, expected, atol=2e-2 * np.max(np.abs(expected)), err_msg=f"{row} {part}"
                )
