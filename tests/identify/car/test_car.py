"""The car's chain, its kinematics, and the rows of the equations against the full 42-joint chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lacet.daq.channels import CORNERS
from lacet.identify.car.car_tree import (
    AXLE,
    CARRIER,
    CHASSIS,
    FIRST_JOINT,
    WHEEL,
    car_chain,
    carrier_axes,
    kinematics,
    kingpin_pitch,
)  # fmt: skip
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import CHASSIS_ROWS
from lacet.identify.effects.body.rigid_body import RigidBody
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY, move_parameters
from lacet.identify.multibody.vectors import turned
from tests.identify import cars

CHAIN = car_chain().chain
VEHICLE, RIG = cars.reference_car()


def test_the_table_is_the_papers() -> None:
    """42 joints; posture, then four branches; wheels and tyres both hang on the carrier."""
    assert CHAIN.n == 42
    assert [j.sigma for j in CHAIN.joints[:6]] == [1, 1, 1, 0, 0, 0]
    assert tuple(FIRST_JOINT[c] for c in ("rl", "rr", "fl", "fr")) == (7, 16, 25, 34)
    assert [AXLE[c] for c in ("rl", "rr", "fl", "fr")] == [11, 20, 29, 38]
    assert [WHEEL[c] for c in ("rl", "rr", "fl", "fr")] == [14, 23, 32, 41]
    for c in CORNERS:
        first, branch = FIRST_JOINT[c], CHAIN.joints[FIRST_JOINT[c] - 1 : FIRST_JOINT[c] + 8]
        assert [j.sigma for j in branch] == [1, 1, 1, 0, 0, 0, 0, 0, 1]
        assert branch[0].ant == CHASSIS
        assert branch[7].ant == branch[8].ant == CARRIER[c] == first + 6


def test_every_joint_acts_along_its_named_axis() -> None:
    """One joint moved at a time: the bodies move along, or turn about, the body axis the paper names."""
    axes = "yxzzyx" + "yxzzxyyyz" * 4
    zero = np.zeros((42, 1))
    for k, axis in enumerate(axes):
        rate = zero.copy()
        rate[k] = 1.0
        frame = CHAIN.propagate(zero, rate, zero)[k]
        moved = CHAIN.propagate(zero, zero, rate)[k]
        assert frame is not None
        assert moved is not None
        to_body, e = car_chain().to_body[k], np.eye(3)["xyz".index(axis)]
        turned = CHAIN.joints[k].sigma == 0
        np.testing.assert_allclose(to_body @ frame.omega[:, 0], e if turned else 0.0 * e, atol=1e-12)
        np.testing.assert_allclose(
            to_body @ moved.accel[:, 0] - [0, 0, STANDARD_GRAVITY], 0.0 * e if turned else e, atol=1e-12
        )


def full_chain_states(motion: Motion, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint states (N, 42) of a car whose branches move as in `motion`, in a posture and wheel angle of their own."""
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-0.8, 0.8, (3, 42, motion.t.size))
    signals = cars.random_signals(seed, motion.t.size)
    for c, corner in motion.corners.items():
        first, design = FIRST_JOINT[c] - 1, VEHICLE_T.corners[c]
        table = kinematics(design, corner.travel)
        kingpin, slope, curvature = kingpin_pitch(design, corner.steer)
        s, ds, dds = corner.travel, corner.rate, corner.accel
        for joint, k, offset in ((0, 0, design.position[1]), (1, 1, design.position[0]), (5, 4, 0.0)):
            q[first + joint] = offset + table.change[k]
            qd[first + joint] = table.slope[k] * ds
            qdd[first + joint] = table.slope[k] * dds + table.curvature[k] * ds**2
        q[first + 2], qd[first + 2], qdd[first + 2] = design.position[2] + s, ds, dds
        for joint, what in ((3, "steer"), (4, "camber")):
            parts = (signals.value, signals.rate, signals.accel)
            q[first + joint], qd[first + joint], qdd[first + joint] = (p[f"camera.{c}.{what}"][0] for p in parts)
        rate, accel = signals.rate[f"camera.{c}.steer"][0], signals.accel[f"camera.{c}.steer"][0]
        q[first + 6], qd[first + 6], qdd[first + 6] = kingpin, slope * rate, slope * accel + curvature * rate**2
        qd[first + 7], qdd[first + 7] = corner.spin, corner.spin_accel
    return q.T, qd.T, qdd.T


VEHICLE_T = cars.with_tables(VEHICLE)
BARE = replace(RIG, sensors=tuple(s for s in RIG.sensors if s.name != "imu"))  # body axes, at the origin


def matched(seed: int, reference: str = "contact") -> tuple[Motion, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """A motion and the states of the full chain that has the same body motion."""
    signals = cars.random_signals(seed)
    rig = cars.in_reference(BARE, reference)
    motion = build_motion(cars.recording(signals, VEHICLE_T, rig))
    q, qd, qdd = full_chain_states(motion, seed)
    frames = CHAIN.propagate(q.T, qd.T, qdd.T)
    body, T = frames[CHASSIS - 1], car_chain().to_body[CHASSIS - 1]
    assert body is not None
    value = {**signals.value, "imu.accel": T @ body.accel, "imu.rate": T @ body.omega}
    rate = {**signals.rate, "imu.rate": T @ body.omega_dot}
    moved = replace(signals, value=value, rate=rate)
    return build_motion(cars.recording(moved, VEHICLE_T, rig)), (q, qd, qdd)


@pytest.fixture(scope="module")
def case() -> tuple[Motion, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """One matched case, shared."""
    return matched(11)


def test_branches_move_as_in_the_full_chain(case) -> None:
    """Axles and wheels propagated from the measured body motion, against posture joints that make it."""
    motion, states = case
    frames = CHAIN.propagate(*(x.T for x in states))
    for c, corner in motion.corners.items():
        axle, to_body = frames[CARRIER[c] - 1], car_chain().to_body[CARRIER[c] - 1]
        wheel = frames[WHEEL[c] - 1]
        assert axle is not None
        assert wheel is not None
        for name in ("omega", "omega_dot", "accel"):
            np.testing.assert_allclose(getattr(corner.axle, name), to_body @ getattr(axle, name), atol=1e-8)
        # The wheel turned by another angle: its motion along the spin axis and across it is the same.
        for name in ("omega", "omega_dot", "accel"):
            mine, full = getattr(corner.wheel, name), getattr(wheel, name)
            np.testing.assert_allclose(mine[2], full[2], atol=1e-8)
            np.testing.assert_allclose(np.hypot(*mine[:2]), np.hypot(*full[:2]), atol=1e-8)


def projected(motion: Motion, states: tuple[np.ndarray, np.ndarray, np.ndarray]) -> dict[str, np.ndarray]:
    """Rows of the equations (N, 420) from the joint torques of the full chain."""
    W = CHAIN.regressor(*states)
    # (N, 6 joints, 6): τ = J (force, moment) in frame 6
    J = CHAIN.jacobian(CHASSIS, states[0])[:, :, :6].transpose(0, 2, 1)
    base = np.linalg.solve(J, W[:, :6])
    T = car_chain().to_body[CHASSIS - 1]
    wrench = np.concatenate([T @ base[:, :3], T @ base[:, 3:]], axis=1)
    out = {row: wrench[:, k] for k, row in enumerate(CHASSIS_ROWS)}
    for c, corner in motion.corners.items():
        first = FIRST_JOINT[c] - 1
        slope = kinematics(VEHICLE_T.corners[c], corner.travel).slope
        tied = ((0, slope[0]), (1, slope[1]), (2, np.ones_like(slope[0])), *zip((3, 4, 5), slope[2:], strict=True))
        out[f"suspension.{c}"] = np.sum([dq[:, None] * W[:, first + k] for k, dq in tied], axis=0)
        out[f"spin.{c}"] = W[:, first + 7]
    return out


def standard(effect: RigidBody) -> np.ndarray:
    """(420, p) standard parameters of the chain per parameter of a rigid body's effect."""
    number, p = effect.number, len(effect.parameters)
    number += CARRIER["fl"] - AXLE["fl"] if effect.where.startswith("axle") else 0  # the carrier pitches
    to_body = car_chain().to_body[number - 1]
    out = np.zeros((420, p))
    for k in range(p):
        values = np.eye(p)[k]
        if p == 4:
            zz, xx, mz, m = values
            ten = np.array([xx, 0, 0, xx, 0, zz, 0, 0, mz, m])
        else:  # from body-like axes to the joint's frame
            ten = move_parameters(values, to_body.T, np.zeros(3))
        out[10 * number - 10 : 10 * number, k] = ten
    return out


def test_rigid_bodies_act_as_in_the_full_chain(case) -> None:
    """Chassis rows are the base wrench in body axes, suspension rows Σ ∂q/∂s Γ, spin rows Γ of the wheel's joint."""
    motion, states = case
    rows = projected(motion, states)
    for effect in RigidBody.variants(VEHICLE_T, "contact"):
        S = standard(effect)
        columns = effect.columns(motion)
        for row, W in rows.items():
            expected = (W @ S).T
            found = columns.get(row, np.zeros_like(expected))
            scale = np.max(np.abs(expected)) or 1.0
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * scale, err_msg=f"{effect.key} {row}")


def test_whole_car_forces_are_those_of_inverse_dynamics(case) -> None:
    """All bodies at once by Newton and Euler: the joint torques, projected, are the sum of the effects' forces."""
    motion, states = case
    rng = np.random.default_rng(3)
    X, total = np.zeros(420), dict.fromkeys(projected(motion, states), 0.0)
    for effect in RigidBody.variants(VEHICLE_T, "contact"):
        values = rng.normal(size=len(effect.parameters))
        X += standard(effect) @ values
        for row, force in effect.force(motion, values).items():
            total[row] = total[row] + force
    tau = CHAIN.inverse_dynamics(*states, X)
    for c, corner in motion.corners.items():
        first = FIRST_JOINT[c] - 1
        slope = kinematics(VEHICLE_T.corners[c], corner.travel).slope
        gamma = tau[:, first : first + 6].T
        work = slope[0] * gamma[0] + slope[1] * gamma[1] + gamma[2] + np.sum(slope[2:] * gamma[3:6], axis=0)
        np.testing.assert_allclose(total[f"suspension.{c}"], work, rtol=0, atol=1e-9 * np.max(np.abs(work)))
        np.testing.assert_allclose(total[f"spin.{c}"], tau[:, first + 7], atol=1e-8)
    force_up = (
        Rotation.from_euler("ZYX", states[0][:, 3:6]).as_matrix()
        @ np.stack([total[row] for row in CHASSIS_ROWS[:3]], axis=1)[:, :, None]
    )
    # Posture joints 2, 1, 3 push along the ground's x, y, z.
    np.testing.assert_allclose(force_up[:, :, 0], tau[:, [1, 0, 2]], atol=1e-8 * np.max(np.abs(tau)))


# ---- kinematics


@settings(deadline=None, max_examples=80)
@given(st.sampled_from(CORNERS), st.floats(-0.2, 0.25), st.floats(-0.1, 0.35), st.floats(-0.7, 0.7))
def test_kingpin_pitch_is_the_turn_about_the_kingpin(corner: str, caster: float, inclination: float, delta: float):
    """The carrier turned about its kingpin, taken apart as yaw, roll, pitch: the pitch belongs to that steer angle."""
    design = replace(VEHICLE.corners[corner], caster=caster, kingpin_inclination=inclination)
    # Top rearward by the caster in side view, inward by the inclination in rear view.
    axis = np.array([-np.tan(caster), -design.side * np.tan(inclination), 1.0])
    yaw, _, pitch = Rotation.from_rotvec(delta * axis / np.linalg.norm(axis)).as_euler("ZXY")
    yaw -= design.side * design.static_toe  # the camera sees the static toe, the kingpin does not turn by it
    value, slope, curvature = kingpin_pitch(design, np.array([yaw]))
    assert value[0] == pytest.approx(pitch, abs=1e-8)
    h = 1e-4
    around = kingpin_pitch(design, yaw + h * np.arange(-1.0, 2.0))[0]
    assert slope[0] == pytest.approx((around[2] - around[0]) / (2 * h), abs=1e-6)
    assert curvature[0] == pytest.approx((around[2] - 2 * around[1] + around[0]) / h**2, abs=1e-4)


@settings(deadline=None, max_examples=60)
@given(st.floats(-0.6, 0.6), st.floats(-0.2, 0.2), st.floats(-0.3, 0.3), st.integers(0, 2**32 - 1))
def test_carrier_attitude(steer: float, camber: float, pitch: float, seed: int) -> None:
    """Rz(steer) Rx(camber) Ry(pitch), by SciPy; and the chain's carrier frame has the same attitude."""
    v = np.random.default_rng(seed).normal(size=(3, 1))
    R = Rotation.from_euler("ZXY", [steer, camber, pitch]).as_matrix()
    np.testing.assert_allclose(
        turned(carrier_axes(*(np.array([a]) for a in (steer, camber, pitch))), v), R @ v, atol=1e-12
    )
    q = np.zeros((42, 1))
    for c in CORNERS:
        first = FIRST_JOINT[c] - 1
        q[first + 3], q[first + 4], q[first + 5], q[first + 6] = steer, camber, 0.4 * pitch, 0.6 * pitch
    for c in CORNERS:
        x = car_chain().to_body[CARRIER[c] - 1].T @ v
        for k in range(CARRIER[c] - 1, CHASSIS - 1, -1):
            if k in range(FIRST_JOINT[c] - 1, CARRIER[c]):
                x = CHAIN.from_frame(k, q[k], x)
        np.testing.assert_allclose(car_chain().to_body[CHASSIS - 1] @ x, R @ v, atol=1e-12)


def test_bench_tables_turn_to_joint_signs() -> None:
    """Outward is +y on the left; toe-in is a negative steer angle on the left; top outward is a negative x-rotation."""
    s = np.array([0.03])
    for c in CORNERS:
        design = VEHICLE_T.corners[c]
        assert design.table is not None
        table, left = design.table, c.endswith("l")
        change = kinematics(design, s).change[:, 0]
        at = {name: np.interp(0.03, table.travel, getattr(table, name)) for name in _COLUMNS}
        signs = {"half_track": left, "half_wheelbase": True, "toe": not left, "camber": not left, "pitch": True}
        for k, name in enumerate(_COLUMNS):
            expected = at[name] if signs[name] else -at[name]
            assert change[k] == pytest.approx(expected, rel=0.05, abs=1e-5), (c, name)


_COLUMNS = ("half_track", "half_wheelbase", "toe", "camber", "pitch")


@settings(deadline=None, max_examples=40)
@given(st.floats(-0.2, 0.2))
def test_slopes_of_bench_tables_are_derivatives(travel: float) -> None:
    """Inside and beyond the table; no jump in value or slope at its ends."""
    h = 1e-5
    for c in CORNERS:
        found = kinematics(VEHICLE_T.corners[c], travel + h * np.arange(-1.0, 2.0))
        np.testing.assert_allclose((found.change[:, 2] - found.change[:, 0]) / (2 * h), found.slope[:, 1], atol=2e-5)
        np.testing.assert_allclose(found.slope[:, 2], found.slope[:, 0], atol=2e-4)
        knots = np.abs(np.abs(travel) - 0.12) < 2 * h
        if not knots:
            np.testing.assert_allclose(
                (found.slope[:, 2] - found.slope[:, 0]) / (2 * h), found.curvature[:, 1], atol=1e-3
            )


def test_without_a_table_nothing_moves_with_travel() -> None:
    """Zero change, slope and curvature."""
    found = kinematics(VEHICLE.corners["fl"], np.linspace(-0.1, 0.1, 5))
    assert not np.any(found.change)
    assert not np.any(found.slope)
    assert not np.any(found.curvature)


def test_frame_motion_is_what_it_says() -> None:
    """A car at rest on a slope: every frame has minus gravity as its specific force and no rate."""
    q = np.random.default_rng(0).uniform(-0.3, 0.3, (42, 3))
    frames = CHAIN.propagate(q, 0 * q, 0 * q)
    for frame in frames:
        assert isinstance(frame, FrameMotion)
        np.testing.assert_allclose(np.linalg.norm(frame.accel, axis=0), STANDARD_GRAVITY, rtol=1e-12)
        assert not np.any(frame.omega)
