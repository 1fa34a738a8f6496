"""The simulated car behaves as a car: ISO 8855 signs."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.simulate import IDEAL, Sheet, find_car, make_manoeuvre, measure, run
from lacet.simulate.motion import euler_zyx
from tests.simulate.simulated_drives import drive, make_rig

QUIET = Sheet(zeros=False)


def test_left_turn() -> None:
    motion = drive("spiral", amplitude=0.03)
    late = motion.t > 2.5
    blocks = measure(motion, make_rig(), noise=False, sheet=QUIET, timing=IDEAL)
    assert blocks["camera.fl.steer"].values[-1, 0] > blocks["camera.fl.steer"].values[0, 0]  # left is positive
    assert np.all(motion.turn[late, 2] > 0.0)  # yaw to the left
    assert blocks["imu.accel"].values[-20:, 1].mean() > 0.5  # and so the acceleration
    load = motion.force[late][..., 2].mean(0)
    assert load[1] > load[0]  # the outer wheels load up: right
    assert load[3] > load[2]
    assert np.all(euler_zyx(motion.attitude)[late, 0] > 0.0)  # the left side rises: roll about +x
    assert np.all(motion.travel[late][:, 0, 1] > 0.0)  # right compressed
    assert np.all(motion.travel[late][:, 0, 0] < 0.0)
    assert np.all(motion.force[late][..., :2, 1].sum(-1) > 0.0)  # road pushes the front to the left


def test_braking_dives_and_driving_squats() -> None:
    braking = drive("braking")
    hard = (braking.t > 1.8) & (braking.t < 2.3)
    assert np.all(euler_zyx(braking.attitude)[hard, 1] > 0.0)  # pitch positive nose down
    assert np.all(braking.travel[hard][:, 0, :2] > 0.0)
    assert np.all(braking.force[hard][..., 0] < 0.0)
    assert braking.acceleration[hard, 0].mean() == pytest.approx(-4.0, rel=0.15)
    lift = drive("liftoff")
    assert np.all(euler_zyx(lift.attitude)[(lift.t > 2.0) & (lift.t < 2.9), 1] < 0.0)
    assert np.all(lift.force[(lift.t > 2.0) & (lift.t < 2.9)][:, :2, 0] > 0.0)


def test_uneven_brakes_turn_the_car_to_the_stronger_side() -> None:
    manoeuvre = make_manoeuvre("braking", duration=2.0, uneven_front=0.2, uneven_rear=-0.1)
    motion = run(find_car("peugeot-406"), manoeuvre, seed=1, settle=0.2)
    hard = (motion.t > 1.4) & (motion.t < 1.9)
    brake = np.abs(motion.brake[hard])
    for left, uneven in ((0, 0.2), (2, -0.1)):
        both = brake[:, left : left + 2].sum(axis=1)
        np.testing.assert_allclose(brake[:, left] - brake[:, left + 1], uneven * both, rtol=1e-9)
    assert motion.force[hard][:, 0, 0].mean() < 1.2 * motion.force[hard][:, 1, 0].mean() < 0.0
    assert motion.turn[hard, 2].mean() > 0.0


def test_rolling_forward_is_positive_spin() -> None:
    motion = drive("liftoff")
    rolling = motion.spin[:, 1] * (0.317 - 0.02 / 3)
    assert rolling == pytest.approx(np.tile(motion.velocity[:, :1], 4), rel=0.03)


def test_top_of_the_left_wheel_leans_inward_with_positive_camber_about_x() -> None:
    motion = drive("liftoff")
    degree = np.pi / 180
    assert motion.camber[0] == pytest.approx(np.array([0.5, -0.5, 1.0, -1.0]) * degree, abs=1e-4)
    assert motion.steer[0] == pytest.approx(np.array([-0.1, 0.1, -0.1, 0.1]) * degree, abs=1e-5)
    up = motion.carrier_attitude[0, :, :, 2]
    assert up[0, 1] < 0 < up[1, 1]


def test_imu_reads_g_upwards_at_rest() -> None:
    car = find_car("peugeot-406")
    motion = run(car, make_manoeuvre("straight", speed=0.0, duration=0.2), settle=0.0)
    rig = make_rig()
    blocks = measure(motion, rig, noise=False, sheet=QUIET, timing=IDEAL)
    accel = blocks["imu.accel"].values
    assert np.linalg.norm(accel, axis=1) == pytest.approx(car.gravity, rel=1e-5)
    roll, pitch, _ = blocks["imu.attitude"].values[-1]
    assert (roll, pitch) == pytest.approx((0.02, -0.03), abs=5e-6)
    c, s = np.cos, np.sin
    up = car.gravity * np.array([-s(pitch), c(pitch) * s(roll), c(pitch) * c(roll)])
    assert accel[-1] == pytest.approx(up, abs=1e-4)
    assert blocks["laser.rl.hub"].values[-1, 0] == pytest.approx(0.30, abs=3e-6)
    assert blocks["laser.rl.ground"].values[-1, 0] == pytest.approx(0.30 + car.heights[2], abs=3e-6)
    for i, corner in enumerate(("fl", "fr", "rl", "rr")):
        assert blocks[f"wheel.{corner}.force"].values[-1, 2] == pytest.approx(car.static_loads[i], rel=1e-3)
    hub = measure(motion, make_rig("hub"), noise=False, sheet=QUIET, timing=IDEAL)
    body = measure(motion, make_rig("hub", "body"), noise=False, sheet=QUIET, timing=IDEAL)
    assert body["wheel.fl.force"].values[-1] == pytest.approx([0, 0, car.static_loads[0] - 20 * car.gravity], abs=0.05)
    assert np.linalg.norm(hub["wheel.fl.force"].values[-1]) == pytest.approx(
        np.linalg.norm(body["wheel.fl.force"].values[-1])
    )
