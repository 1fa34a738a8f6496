"""Joint tables T(own travel, other wheel's travel, rack): rows against Lagrange's equations of the same linkage.

Places and attitudes of the bodies are written down here by SciPy's rotations; velocities, momenta, energies and their
derivatives are differences of these. Nothing of `identify` but the tables themselves is used for what is expected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.joint_tables import JointTables
from lacet.identify.car.car_tree import WHEEL, car_chain, kinematics
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import Row
from lacet.identify.effects.body.rigid_body import RigidBody
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Signals
from tests.identify import cars

PLAIN, RIG = cars.reference_car()
VEHICLE = cars.with_joints(PLAIN)
BARE = replace(RIG, sensors=tuple(s for s in RIG.sensors if s.name != "imu"))
N, STEP = 6, 1e-3
_WEIGHTS = {1: 45.0 / 60.0, 2: -9.0 / 60.0, 3: 1.0 / 60.0}


def slope(of: Callable[[float], Array]) -> Array:
    """Derivative at 0 by differences of the sixth order."""
    return sum(w * (of(k * STEP) - of(-k * STEP)) for k, w in _WEIGHTS.items()) / STEP  # type: ignore[return-value]


@dataclass(frozen=True)
class Course:
    """Polynomials in time: travels by corner, rack, the body's place and angles (yaw, pitch, roll); (4, …, N)."""

    travel: Mapping[str, Array]
    rack: Array
    place: Array
    angles: Array

    @staticmethod
    def at(of: Array, t: float) -> Array:
        return of[0] + t * (of[1] + t * (of[2] + t * of[3]))

    @classmethod
    def random(cls, seed: int) -> Course:
        """Travels and rack of some centimetres, away from the knots at 0; the body moves anyhow."""
        rng = np.random.default_rng(seed)

        def around(least: float, most: float) -> Array:
            start = rng.uniform(least, most, (1, N)) * rng.choice([-1.0, 1.0], (1, N))
            return np.concatenate([start, rng.normal(0, 1.0, (3, N)) * [[0.4], [2.0], [5.0]]])

        place = rng.normal(0, 1.0, (4, 3, N)) * np.array([1.0, 10.0, 2.0, 2.0])[:, None, None]
        return cls({c: around(0.02, 0.06) for c in CORNERS}, around(0.01, 0.03), place, rng.normal(0, 0.3, (4, 3, N)))


def carrier(course: Course, c: str, travel: Mapping[str, Array], t: float) -> tuple[Array, Array, Array]:
    """Wheel centre (3, N) and attitude (N, 3, 3) in body axes for travels, and steer, camber (2, N) of the cameras."""
    corner = VEHICLE.corners[c]
    tables = corner.joints
    assert isinstance(tables, JointTables)
    rack = course.at(course.rack, t)
    T = tables.at(travel[c], travel[other_corner(c)], rack).T
    steer = -corner.side * (corner.static_toe + T[2])
    camber = -corner.side * (corner.static_camber + T[3])
    x, y, z = corner.position
    attitude = Rotation.from_euler("ZXY", np.stack([steer, camber, T[4]], axis=1)).as_matrix()
    return np.stack([x + T[1], y + corner.side * T[0], z + travel[c]]), attitude, np.stack([steer, camber])


def body_at(course: Course, t: float) -> tuple[Array, Array]:
    """Place (3, N) and attitude (N, 3, 3) of the body."""
    return course.at(course.place, t), Rotation.from_euler("ZYX", course.at(course.angles, t).T).as_matrix()


def rotation_rate(R: Callable[[float], Array]) -> Array:
    """(3, N) angular velocity in space of attitudes."""
    W = slope(R) @ R(0.0).transpose(0, 2, 1)
    return np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]])


def turned(R: Array, v: Array) -> Array:
    """R (N, 3, 3) on v (3, N)."""
    return np.einsum("nij,jn->in", R, v)


def back(R: Array, v: Array) -> Array:
    """Its inverse on v."""
    return np.einsum("nji,jn->in", R, v)


Speeds = Mapping[str, Array]
SPIN = np.linspace(60.0, 80.0, N)
"""Wheels' rotation on their carriers [rad/s]."""


@dataclass(frozen=True)
class Bodies:
    """Parameters of axle bodies and wheels, about the wheel centres."""

    axle: Array
    wheel: Array

    def momenta(self, course: Course, c: str, travel: Speeds, speed: Speeds, t: float) -> tuple[Array, ...]:
        """Of carrier and wheel of a corner: kinetic and potential energy (N,), momentum, and angular momentum about
        the ground's origin (3, N)."""

        def place(tau: float) -> Array:
            x, R = body_at(course, t + tau)
            at = carrier(course, c, {k: s + tau * speed[k] for k, s in travel.items()}, t + tau)[0]
            return x + turned(R, at)

        def attitude(tau: float) -> Array:
            moved = {k: s + tau * speed[k] for k, s in travel.items()}
            return body_at(course, t + tau)[1] @ carrier(course, c, moved, t + tau)[1]

        p, v, R, omega = place(0.0), slope(place), attitude(0.0), rotation_rate(attitude)
        axis = R[:, :, 1].T
        zz, xx, mz, m = self.wheel
        sign = car_chain().to_body[WHEEL[c] - 1][1, 2]
        parts = []
        xx_, xy, xz, yy, yz, zz_, *first, mass = self.axle
        tensor = np.array([[xx_, xy, xz], [xy, yy, yz], [xz, yz, zz_]])
        parts.append((mass, turned(R, np.repeat(np.array(first)[:, None], N, 1)), omega, turned(
            R, tensor @ back(R, omega))))  # fmt: skip
        rotating = omega + sign * SPIN * axis
        along = np.sum(rotating * axis, axis=0)
        parts.append((m, sign * mz * axis, rotating, xx * rotating + (zz - xx) * along * axis))
        T, V = np.zeros(N), np.zeros(N)
        linear, angular = np.zeros((3, N)), np.zeros((3, N))
        for mass, lever, w, spin in parts:
            swing = np.cross(w, lever, axis=0)
            T += 0.5 * mass * np.sum(v * v, axis=0) + np.sum(v * swing, axis=0) + 0.5 * np.sum(w * spin, axis=0)
            V += STANDARD_GRAVITY * (mass * p[2] + lever[2])
            own = mass * v + swing
            linear += own
            angular += np.cross(p, own, axis=0) + spin + np.cross(lever, v, axis=0)
        return T, V, linear, angular


def signals_of(course: Course, seed: int) -> Signals:
    """What the instruments read at t = 0, with random loads."""
    rng = np.random.default_rng(seed)
    signals = cars.random_signals(seed, N)
    value, rate, accel = dict(signals.value), dict(signals.rate), dict(signals.accel)
    felt = slope(lambda a: slope(lambda b: body_at(course, a + b)[0])) + np.array([[0.0], [0.0], [STANDARD_GRAVITY]])

    def turning(t: float) -> Array:
        return back(body_at(course, t)[1], rotation_rate(lambda b: body_at(course, t + b)[1]))

    R = body_at(course, 0.0)[1]
    value["imu.accel"], value["imu.rate"], rate["imu.rate"] = back(R, felt), turning(0.0), slope(turning)
    flat = build_motion(cars.recording(signals, VEHICLE, BARE))
    for c in CORNERS:
        first, second, third = (course.travel[c][k] * (1.0, 1.0, 2.0)[k] for k in range(3))
        # The hub laser of a travel: its reading at another one, moved by the difference.
        value[f"laser.{c}.hub"] = value[f"laser.{c}.hub"] - (first - flat.corners[c].travel)
        rate[f"laser.{c}.hub"], accel[f"laser.{c}.hub"] = -second[None], -third[None]

        def angles(t: float, c: str = c) -> Array:
            return carrier(course, c, {k: course.at(p, t) for k, p in course.travel.items()}, t)[2]

        for k, what in enumerate(("steer", "camber")):
            name = f"camera.{c}.{what}"
            value[name], rate[name] = angles(0.0)[k][None], slope(angles)[k][None]
            accel[name] = slope(lambda a, angles=angles: slope(lambda b: angles(a + b)))[k][None]
        value[f"wheel.{c}.speed"] = SPIN[None]
        rate[f"wheel.{c}.speed"] = np.zeros((1, N))
        value[f"wheel.{c}.force"], value[f"wheel.{c}.moment"] = rng.normal(0, 2000, (3, N)), rng.normal(0, 300, (3, N))
    return Signals(value, rate, accel)


@pytest.fixture(scope="module", params=[1, 2])
def case(request: pytest.FixtureRequest) -> tuple[Course, Motion]:
    """A course and its motion as lacet makes it of the signals."""
    course = Course.random(request.param)
    rig = cars.in_reference(BARE, "contact")
    return course, build_motion(cars.recording(signals_of(course, request.param), VEHICLE, rig))


def travels(course: Course, t: float) -> dict[str, Array]:
    return {c: course.at(p, t) for c, p in course.travel.items()}


def speeds(course: Course, t: float) -> dict[str, Array]:
    return {c: p[1] + t * (2.0 * p[2] + 3.0 * t * p[3]) for c, p in course.travel.items()}


def test_places_and_attitudes_are_those_of_the_tables(case: tuple[Course, Motion]) -> None:
    """The rack found from the steer is the rack: wheel centres and pitch move with both travels and with it."""
    course, motion = case
    for c, corner in motion.corners.items():
        place, attitude, _ = carrier(course, c, travels(course, 0.0), 0.0)
        np.testing.assert_allclose(corner.centre, place, atol=1e-12)
        np.testing.assert_allclose(corner.axes, attitude.transpose(1, 2, 0), atol=1e-12)


def test_inertia_is_that_of_lagranges_equations(case: tuple[Course, Motion]) -> None:
    """Suspension rows are d/dt ∂T/∂ṡ − ∂T/∂s + ∂V/∂s of both wheels of the axle; chassis rows the change of momenta."""
    course, motion = case
    rng = np.random.default_rng(5)
    bodies = {c: Bodies(rng.normal(0, 1, 10) + 5 * np.eye(10)[9], rng.normal(0, 1, 4)) for c in CORNERS}
    found: dict[str, Array] = {}
    for effect in RigidBody.variants(VEHICLE, "contact"):
        kind, _, c = effect.where.partition(".")
        if kind == "chassis":
            continue
        values = getattr(bodies[c], kind)
        for row, force in effect.force(motion, values).items():
            found[row] = found.get(row, 0.0) + force
    for c in CORNERS:
        pair = (c, other_corner(c))

        def energy(t: float, ahead: float = 0.0, faster: float = 0.0, c: str = c, pair=pair, of: int = 0) -> Array:
            s, v = travels(course, t), speeds(course, t)
            s[c], v[c] = s[c] + ahead, v[c] + faster
            return sum(bodies[k].momenta(course, k, s, v, t)[of] for k in pair)  # type: ignore[return-value]

        # T is quadratic in ṡ: differences are its derivatives.
        impulse = slope(lambda t: 0.5 * (energy(t, faster=1.0) - energy(t, faster=-1.0)))
        expected = impulse - slope(lambda h: energy(0.0, h)) + slope(lambda h: energy(0.0, h, of=1))
        scale = np.max(np.abs(expected))
        np.testing.assert_allclose(found[f"suspension.{c}"], expected, rtol=0, atol=2e-7 * scale)

    def momenta(t: float, of: int) -> Array:
        s, v = travels(course, t), speeds(course, t)
        return sum(bodies[k].momenta(course, k, s, v, t)[of] for k in CORNERS)  # type: ignore[return-value]

    weight = np.zeros((3, N))
    place, R = body_at(course, 0.0)
    moment = np.zeros((3, N))
    for c in CORNERS:  # the weight of each, at its own place
        at, attitude, _ = carrier(course, c, travels(course, 0.0), 0.0)
        own = R @ attitude
        sign = car_chain().to_body[WHEEL[c] - 1][1, 2]
        mass = bodies[c].axle[9] + bodies[c].wheel[3]
        lever = turned(own, np.repeat(bodies[c].axle[6:9, None], N, 1)) + sign * bodies[c].wheel[2] * own[:, :, 1].T
        up = np.array([[0.0], [0.0], [STANDARD_GRAVITY]])
        weight = weight + mass * up
        moment = moment + np.cross(mass * turned(R, at) + lever, np.repeat(up, N, 1), axis=0)
    force = slope(lambda t: momenta(t, 2)) + weight
    about = slope(lambda t: momenta(t, 3)) - np.cross(place, slope(lambda t: momenta(t, 2)), axis=0) + moment
    for k, (row, expected) in enumerate(
        [*zip(("fx", "fy", "fz"), back(R, force), strict=True), *zip(("mx", "my", "mz"), back(R, about), strict=True)]
    ):
        scale = np.max(np.abs(force if k < 3 else about))
        np.testing.assert_allclose(found[f"chassis.{row}"], expected, rtol=0, atol=2e-7 * scale, err_msg=row)


def test_the_left_side_is_the_work_of_both_wheels_loads(case: tuple[Course, Motion]) -> None:
    """Σ over both wheels of F·∂p/∂s + M·∂φ/∂s, by differences of places and attitudes at a fixed rack."""
    course, motion = case
    for c in CORNERS:
        expected = np.zeros(N)
        for k in (c, other_corner(c)):

            def moved(h: float, k: str = k, c: str = c) -> tuple[Array, Array, Array]:
                s = travels(course, 0.0)
                s[c] = s[c] + h
                return carrier(course, k, s, 0.0)

            wheel = motion.corners[k]
            turning = rotation_rate(lambda h, moved=moved: moved(h)[1])
            expected += np.sum(wheel.force * slope(lambda h, moved=moved: moved(h)[0]), axis=0)
            expected += np.sum(wheel.moment * turning, axis=0)
        np.testing.assert_allclose(motion.measured(Row.parse(f"suspension.{c}")), expected, rtol=0, atol=1e-7 * 2000)


def test_the_rate_of_deflection_is_its_derivative() -> None:
    """Every signal moved along its rate: the deflection moves by its own, with both travels and the rack."""
    signals, h = cars.random_signals(3), 1e-6

    def deflections(step: float) -> dict[str, Array]:
        value = {name: x + step * signals.rate.get(name, 0.0) for name, x in signals.value.items()}
        made = build_motion(cars.recording(replace(signals, value=value), VEHICLE, RIG))
        return {c: corner.deflection for c, corner in made.corners.items()}

    ahead, behind = deflections(h), deflections(-h)
    for c, corner in build_motion(cars.recording(signals, VEHICLE, RIG)).corners.items():
        np.testing.assert_allclose(corner.deflection_rate, (ahead[c] - behind[c]) / (2 * h), atol=1e-6)


def test_bump_and_roll_of_joint_tables_are_both_wheels_moved() -> None:
    """`kinematics` of one travel: the other wheel moved with it, against it, or held."""
    s = np.array([0.013, -0.024])
    for c in CORNERS:
        corner = VEHICLE.corners[c]
        tables = corner.joints
        assert tables is not None
        signs = np.array([corner.side, 1.0, -corner.side, -corner.side, 1.0])[:, None]
        for other in (1.0, -1.0, 0.0):
            expected = signs * tables.at(s, other * s, np.zeros(2)).T
            found = kinematics(corner, s, other)
            np.testing.assert_allclose(found.change, expected, atol=1e-14)
            ends = [kinematics(corner, s + h, other).change for h in (1e-6, -1e-6)]
            np.testing.assert_allclose(found.slope, (ends[0] - ends[1]) / 2e-6, atol=1e-7)
            ends = [kinematics(corner, s + h, other).slope for h in (1e-6, -1e-6)]
            np.testing.assert_allclose(found.curvature, (ends[0] - ends[1]) / 2e-6, atol=1e-6)
