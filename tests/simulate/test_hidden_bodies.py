"""Bodies and states that a car can hide: what they do to the car is the reaction of their own motion, by Newton."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError
from lacet.simulate import IDEAL, KINDS, Hidden, Sheet, find_car, make_manoeuvre, measure, run
from lacet.simulate.engine import Engine
from lacet.simulate.motion import SimulatedMotion, rotate, rotate_back
from lacet.simulate.road import FLAT
from lacet.simulate.turning import rotation
from tests.simulate.simulated_drives import drive, make_rig, relative

CAR = find_car("peugeot-406")
K = np.array([CAR.axle(c).stiffness for c in CORNERS])
C = np.array([CAR.axle(c).damping for c in CORNERS])
UNSPRUNG = np.array([CAR.axle(c).unsprung_mass for c in CORNERS])
X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
INNER = slice(2, -2)


def wheels_need(motion: SimulatedMotion) -> np.ndarray:
    """(N, 4, 3) force that carries and accelerates each unsprung assembly."""
    return UNSPRUNG[:, None] * (motion.wheel_centre_motion[1] - motion.gravity[:, None])


def chassis_residual(motion: SimulatedMotion) -> np.ndarray:
    """(N, 3) what the base model's chassis force rows leave over [N]."""
    body = CAR.chassis
    felt = motion.at(np.asarray([body.com]))[1][:, 0] - motion.gravity
    return motion.force.sum(1) + motion.air[:, 0] - body.mass * felt - wheels_need(motion).sum(1)


def suspension_residual(motion: SimulatedMotion) -> np.ndarray:
    """(N, 4) what the base model's suspension row leaves over [N]."""
    s = motion.travel
    return (motion.force - wheels_need(motion))[..., 2] - K * s[:, 0] - C * s[:, 1] - CAR.offsets


def on_ground(motion: SimulatedMotion, points: np.ndarray) -> np.ndarray:
    """(N, 3) path of points given in body axes."""
    return motion.position + rotate(motion.attitude, points)


def first(x: np.ndarray, rate: float) -> np.ndarray:
    """First derivative of the inner samples, fourth order."""
    return (-x[4:] + 8 * x[3:-1] - 8 * x[1:-3] + x[:-4]) * rate / 12


def second(x: np.ndarray, rate: float) -> np.ndarray:
    """Second derivative of the inner samples, fourth order."""
    return (-x[4:] + 16 * x[3:-1] - 30 * x[2:-2] + 16 * x[1:-3] - x[:-4]) * rate**2 / 12


def felt_by(motion: SimulatedMotion, points: np.ndarray) -> np.ndarray:
    """(N-4, 3) acceleration less gravity of points given in body axes, from their path alone, ground axes."""
    return second(on_ground(motion, points), motion.rate) + CAR.gravity * Z


def test_engine_on_its_mounts_pushes_the_car_by_its_own_acceleration() -> None:
    motion = drive("rough", "engine_mount=180,frequency=9,damping=0.08", duration=1.5)
    z = motion.attached["engine_mount"][..., 0]
    w, wd = motion.turn, motion.turn_rate
    own, speed = z[:, :1] * Z, z[:, 1:2] * Z
    moved = z[:, 2:] * Z + np.cross(wd, own) + np.cross(w, np.cross(w, own)) + 2 * np.cross(w, speed)
    assert np.std(z[:, 0]) > 3e-4
    assert chassis_residual(motion) == pytest.approx(180 * moved, abs=1e-7)
    place = np.array([0.1, 0.0, 0.25]) + own
    felt = motion.at(place[:, None])[1][:, 0] - motion.gravity + z[:, 2:] * Z + 2 * np.cross(w, speed)
    pace = 2 * np.pi * 9
    law = 180 * (CAR.gravity - pace**2 * z[:, 0] - 2 * 0.08 * pace * z[:, 1])
    assert 180 * felt[:, 2] == pytest.approx(law, rel=1e-9)
    assert np.max(np.abs(suspension_residual(motion))) < 1e-8


def test_liquid_is_a_pendulum_that_pulls_at_its_pivot() -> None:
    motion = drive("sinus", "liquid_load=120,length=0.3,damping=0.1", duration=1.5)
    q = motion.attached["liquid_load"]
    zero = np.zeros(len(q))
    hang = rotation(np.stack([q[:, 0, 0], zero, zero], 1)) @ rotation(np.stack([zero, q[:, 0, 1], zero], 1))
    rod = hang @ np.array([0.0, 0.0, -0.3])
    pull = 120 * rotate_back(motion.attitude[INNER], felt_by(motion, np.array([-2.4, 0.0, 0.5]) + rod))
    assert np.max(np.abs(q[:, 0, 0])) > 0.1
    assert relative(chassis_residual(motion)[INNER] - pull, pull) < 1e-5
    # virtual work on both hinges: only the damping works on them
    axis_y = rotation(np.stack([q[:, 0, 0], zero, zero], 1)) @ np.array([0.0, 1.0, 0.0])
    c = 2 * 0.1 * 120 * 0.3**2 * np.sqrt(CAR.gravity / 0.3)
    for axis, rate in ((X, q[:, 1, 0]), (axis_y, q[:, 1, 1])):
        work = np.sum(np.cross(axis, rod)[INNER] * pull, 1)
        assert work == pytest.approx(-c * rate[INNER], abs=2e-3 * np.max(np.abs(pull)) * 0.3)


def trailer_points(motion: SimulatedMotion, local: np.ndarray) -> np.ndarray:
    """(N, 3) of a point of the trailer, given from the hitch, in body axes of the car."""
    q, zero = motion.attached["trailer"][:, 0], np.zeros(len(motion.t))
    turned = rotation(q[:, :1] * Z) @ rotation(np.stack([zero, q[:, 1], zero], 1)) @ rotation(q[:, 2:] * X)
    return np.array([-3.7, 0.0, 0.05]) + turned @ local


def test_trailer_loads_the_hitch_by_newton_and_its_tyres_lag() -> None:
    motion = drive("sinus", "trailer=700", amplitude=0.015)
    need = 700 * rotate_back(motion.attitude[INNER], felt_by(motion, trailer_points(motion, np.array([-2.4, 0, 0.2]))))
    hitch = need - motion.outside[INNER, 0]
    assert relative(chassis_residual(motion)[INNER] - hitch, need) < 1e-5
    assert np.ptp(hitch[:, 1]) > 100.0
    lateral = np.zeros(len(motion.t) - 4)
    for i, side in enumerate((1.0, -1.0)):
        path = on_ground(motion, trailer_points(motion, np.array([-2.5, side * 0.7, 0.0])))
        ahead = on_ground(motion, trailer_points(motion, np.array([-1.5, side * 0.7, 0.0]))) - path
        v, forward = first(path, motion.rate), ahead[INNER, :2]
        forward = forward / np.linalg.norm(forward, axis=1, keepdims=True)
        along, across = np.sum(v[:, :2] * forward, 1), forward[:, 0] * v[:, 1] - forward[:, 1] * v[:, 0]
        alpha = motion.memory[:, i]
        left = 0.5 * first(alpha, motion.rate) + np.abs(along) * alpha[INNER] + across
        assert np.max(np.abs(left)) < 1e-4 * 25
        lateral += -across / along
    # side force against the slip of the instant: largest when shifted later by σ/v = 20 ms, within 5 ms
    force = motion.outside[INNER, 0, 1]
    span = range(0, 60)
    fit = [np.corrcoef(lateral[1000 : -100 - n], force[1000 + n : len(force) - 100])[0, 1] for n in span]
    assert 10 <= int(np.argmax(fit)) <= 30


def test_trailer_and_car_stand_still_under_their_weight() -> None:
    motion = run(CAR, make_manoeuvre("straight", speed=0.0, duration=0.5), [Hidden("trailer", 700.0)], settle=2.5)
    nose = 700 * CAR.gravity * 0.1 / 2.5
    assert motion.force[-1, :, 2].sum() == pytest.approx(1668.5 * CAR.gravity + nose, rel=2e-3)
    assert motion.outside[-1, 0, 2] == pytest.approx(700 * CAR.gravity - nose, rel=2e-3)
    assert np.max(np.abs(motion.acceleration[-1])) < 2e-2
    plain = run(CAR, make_manoeuvre("straight", speed=0.0, duration=0.2), settle=1.0)
    rear = motion.force[-1, 2:, 2].sum() - plain.force[-1, 2:, 2].sum()
    # the tail goes down: the centre of mass moves back by the pitch times its height over the wheel centres, and the
    # trailer's, over its axle, forwards
    up = -np.arcsin(motion.attitude[-1, 0, 2])
    assert up > 1e-3
    nose += 700 * CAR.gravity * 0.2 / 2.5 * motion.attached["trailer"][-1, 0, 1] - 700 * CAR.gravity * 0.2 / 2.5 * up
    assert rear == pytest.approx((nose * 3.7 + 1668.5 * CAR.gravity * 0.2597 * up) / 2.7, rel=0.003)


def test_twisting_chassis_closes_its_force_rows_and_the_moment_about_its_hinge() -> None:
    motion = drive("rough", "chassis_torsion=400000,z=0.25,rear=0.4,damping=0.1", grade="C", duration=1.5)
    engine = Engine(CAR, FLAT, [Hidden("chassis_torsion", 4e5, shape={"z": 0.25, "rear": 0.4, "damping": 0.1})])
    twist = engine.twist
    assert twist is not None
    both = twist.front + twist.rear
    assert both.mass == pytest.approx(CAR.chassis.mass)
    assert both.com == pytest.approx(CAR.chassis.com)
    assert np.asarray(both.tensor) == pytest.approx(np.asarray(CAR.chassis.tensor))
    angle = motion.twist
    assert np.max(np.abs(angle[:, 0])) > 1e-4
    assert first(angle[:, 0], motion.rate) == pytest.approx(angle[INNER, 1], abs=1e-3 * np.max(np.abs(angle[:, 1])))
    com = motion.on_rear(np.asarray(twist.rear.com))
    back = rotate_back(motion.attitude[INNER], felt_by(motion, com))
    ahead = motion.at(np.asarray([twist.front.com]))[1][:, 0] - motion.gravity
    wheels = wheels_need(motion)
    left = motion.force.sum(1) - wheels.sum(1) - twist.front.mass * ahead
    assert relative(left[INNER] - twist.rear.mass * back, left) < 1e-4
    # moment equation of everything behind the hinge, about its axis
    w, wd = motion.turn, motion.turn_rate
    own, more = angle[:, 1:2] * X, angle[:, 2:] * X
    total, rate = w + own, wd + more + np.cross(w, own)
    R = motion.rear_attitude
    local, localrate = rotate_back(R, total), rotate_back(R, rate)
    tensor = np.asarray(twist.rear.tensor)
    turning = rotate(R, localrate @ tensor + np.cross(local, local @ tensor))
    hinge = np.array([0.0, 0.0, 0.25])
    arm = motion.wheel_centres - hinge
    spin = np.array([CAR.axle(c).spin_inertia for c in CORNERS])
    side = np.array([CAR.axle(c).inboard_transverse + CAR.axle(c).outboard_transverse for c in CORNERS])
    carriers = carrier_moment(motion) + motion.spinning_momentum_rate(spin, side)
    corner = np.cross(arm, motion.force - wheels) + motion.moment - carriers
    moment = corner[INNER, 2:].sum(1) - turning[INNER] - twist.rear.mass * np.cross((com - hinge)[INNER], back)
    law = twist.stiffness * angle[:, 0] + twist.damping * angle[:, 1] - twist.static
    assert relative(moment[:, 0] - law[INNER], law) < 2e-4
    assert np.max(np.abs(suspension_residual(motion)[:, :2])) < 1e-8


def carrier_moment(motion: SimulatedMotion) -> np.ndarray:
    """I·α + ω × (I·ω) of each carrier, (N, 4, 3), body axes."""
    inertia = np.array([CAR.axle(c).carrier_inertia for c in CORNERS])
    R = motion.carrier_attitude
    w, wd = (rotate_back(R, x) for x in motion.carrier_turn)
    return rotate(R, inertia * wd + np.cross(w, inertia * w))


def test_twisted_rear_wheels_move_as_their_path_says() -> None:
    motion = drive("kerb", "chassis_torsion=200000", "toe_change.rear=0.2", "camber_change.rear=-0.3", duration=1.5)
    v, a = motion.wheel_centre_motion
    for i in range(4):
        path = on_ground(motion, motion.wheel_centres[:, i])
        assert rotate_back(motion.attitude[INNER], first(path, motion.rate)) == pytest.approx(v[INNER, i], abs=1e-5)
        exact = rotate_back(motion.attitude[INNER], second(path, motion.rate))
        assert exact == pytest.approx(a[INNER, i], abs=1e-3 * np.max(np.abs(a)))
        R = motion.attitude @ motion.carrier_attitude[:, i]
        spin = rotate_back(R, rotate(motion.attitude, motion.carrier_turn[0][:, i]))[INNER]
        change = np.swapaxes(R[INNER], 1, 2) @ first(R, motion.rate)
        assert np.stack([change[:, 2, 1], change[:, 0, 2], change[:, 1, 0]], 1) == pytest.approx(spin, abs=2e-5)
        world = rotate(motion.attitude, motion.carrier_turn[0][:, i])
        turn_rate = rotate_back(motion.attitude[INNER], first(world, motion.rate))
        assert turn_rate == pytest.approx(motion.carrier_turn[1][INNER, i], abs=3e-3)


def test_stiff_chassis_is_the_rigid_one_and_an_uneven_one_stands_straight() -> None:
    plain = drive("sinus", duration=1.0)
    stiff = drive("sinus", "chassis_torsion=3e7,damping=0.3", duration=1.0)
    soft = drive("sinus", "chassis_torsion=3e5,damping=0.3", duration=1.0)
    far, near = (np.max(np.abs(m.travel[:, 0] - plain.travel[:, 0])) for m in (soft, stiff))
    assert near < far / 30
    leaning = find_car("peugeot-406-measured")
    motion = run(
        leaning, make_manoeuvre("straight", speed=0.0, duration=0.2), [Hidden("chassis_torsion", 1e5)], settle=0.5
    )
    assert np.max(np.abs(motion.twist[:, 0])) < 1e-6
    assert np.max(np.abs(motion.travel[:, 0])) < 1e-5


def test_lasers_and_cameras_of_a_twisted_rear_are_its_own() -> None:
    motion = drive("kerb", "chassis_torsion=100000", duration=1.5)
    value = measure(motion, make_rig(), noise=0.0, sheet=Sheet(zeros=False), timing=IDEAL)
    design = 0.30
    for i, corner in enumerate(CORNERS):
        hub = value[f"laser.{corner}.hub"].values[:, 0]
        assert hub == pytest.approx(design - motion.travel[::4, 0, i][: len(hub)], abs=1e-6)
        camber = value[f"camera.{corner}.camber"].values[:, 0]
        if corner[0] == "r":
            assert np.ptp(camber) < 1e-12
    assert np.ptp(np.arcsin(motion.carrier_attitude[:, 2, 2, 1])) > 1e-4


@pytest.mark.parametrize("axle", ["front", "rear"])
@pytest.mark.parametrize("name", ["toe_change", "camber_change", "pitch_change"])
def test_a_carrier_that_turns_with_travel_works_through_the_moments(name: str, axle: str) -> None:
    """By virtual work: one metre of travel turns the wheel, so the moments on it are felt by the spring."""
    manoeuvre = "braking" if name == "pitch_change" else "sinus"
    motion, there = drive(manoeuvre, f"{name}.{axle}=0.15", duration=1.5), [0, 1] if axle == "front" else [2, 3]
    n = motion.carrier_attitude[..., 1]
    spin = np.array([CAR.axle(c).spin_inertia for c in CORNERS])
    side = np.array([CAR.axle(c).inboard_transverse + CAR.axle(c).outboard_transverse for c in CORNERS])
    moment = motion.moment + motion.shaft[..., None] * n - carrier_moment(motion)
    moment -= motion.spinning_momentum_rate(spin, side)
    work = np.sum(moment * motion.turns, -1)
    assert suspension_residual(motion) == pytest.approx(-work, abs=1e-7)
    assert np.max(np.abs(work[:, there])) > (1.0 if name == "toe_change" else 30.0)
    assert np.max(np.abs(chassis_residual(motion))) < 1e-7
    if name == "pitch_change":
        forward = motion.carrier_attitude[:, there][..., 0]
        seen = np.arcsin(-forward[..., 2]) - 0.15 * motion.travel[:, 0][:, there]
        assert seen == pytest.approx(np.mean(seen, axis=0) * np.ones_like(seen), abs=1e-3)
    elif axle == "rear":
        seen = motion.camber if name == "camber_change" else motion.steer
        design = np.array([CAR.axle(c).camber if name == "camber_change" else CAR.axle(c).toe for c in CORNERS])
        outward = np.array([-1.0, 1.0, -1.0, 1.0])
        expected = outward * (design + 0.15 * motion.travel[:, 0])
        assert seen[:, there] == pytest.approx(expected[:, there], abs=1e-5)


def test_coupled_joints_are_held_by_forces_that_do_no_work() -> None:
    hidden = [Hidden("toe_change.front", 0.3), Hidden("camber_change.rear", -0.4), Hidden("chassis_torsion", 5e5)]
    engine = Engine(CAR, FLAT, hidden)
    rng = np.random.default_rng(2)
    G = engine._coupling
    assert G is not None
    free = np.linalg.svd(G)[2][len(G) :]
    for _ in range(5):
        v = free.T @ (free @ rng.standard_normal(engine.model.nv))
        engine.data.qvel[:] = v
        engine.data.qpos[7:] = 0.02 * rng.standard_normal(engine.model.nq - 7)
        for i in range(4):
            if engine.turn_dof[i] >= 0:
                engine.data.qpos[engine.turn_dof[i] + 1] = engine._ratios[i] * engine.data.qpos[engine.slide_dof[i] + 1]
        engine.load(engine.data.qpos.tolist(), v.tolist(), [0.0] * engine.states, 0.0, [10.0] * 4, [0.0] * 4, 5e-4)
        a = engine.accelerate().copy()
        assert G @ a == pytest.approx(0.0, abs=1e-8)
        pushed = np.empty(engine.model.nv)
        engine.lib.mj_mulM(engine.model, engine.data, pushed, a)
        held = pushed - engine.data.qfrc_applied + engine.data.qfrc_bias
        assert free @ held == pytest.approx(0.0, abs=1e-6)
        assert np.max(np.abs(held)) > 0.1


def test_hysteresis_remembers_and_keeps_its_size() -> None:
    motion = drive("rough", "damper_hysteresis.rear=120,length=0.004", duration=1.5)
    z, sd = motion.memory, motion.travel[:, 1, 2:]
    residual = suspension_residual(motion)
    assert residual[:, 2:] == pytest.approx(120 * z, abs=1e-8)
    assert np.max(np.abs(residual[:, :2])) < 1e-8
    assert np.max(np.abs(z)) < 1.0 + 1e-6
    rate = (sd - np.abs(sd) * z) / 0.004
    # the law has a corner where ṡ turns round, which a difference over 4 ms blurs
    assert np.std(first(z, motion.rate) - rate[INNER]) < 2e-3 * np.std(rate)
    # it is not a function of travel and speed: at the same speed it has both signs
    slow = np.abs(sd) < 0.003
    assert np.ptp(z[slow]) > 1.0
    lost = np.sum(120 * z * sd, 0) / motion.rate
    assert np.all(lost > 0.0)


def test_damper_in_series_follows_its_spring_and_damper() -> None:
    motion = drive("rough", "series_damper.front=60000,c=2000", duration=1.5)
    x, s = motion.memory, motion.travel[:, 0, :2]
    residual = suspension_residual(motion)
    assert residual[:, :2] == pytest.approx(60000 * (s - x), abs=1e-8)
    assert np.max(np.abs(residual[:, 2:])) < 1e-8
    assert 2000 * first(x, motion.rate) == pytest.approx(residual[INNER, :2], abs=1e-3 * np.max(np.abs(residual)))
    assert np.max(np.abs(residual[:, :2])) > 50.0


def test_side_wind_of_its_own_drift_is_a_force_and_a_yaw_moment() -> None:
    motion = drive("sinus", "aero_side=2,x=0.8", duration=1.5)
    v = motion.at(np.zeros((1, 3)))[0][:, 0]
    assert motion.air[:, 0, 1] == pytest.approx(-2 * v[:, 0] * v[:, 1])
    assert motion.air[:, 1, 2] == pytest.approx(0.8 * motion.air[:, 0, 1])
    assert np.max(np.abs(chassis_residual(motion))) < 1e-8
    assert np.max(np.abs(motion.air[:, 0, 1])) > 5.0


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_compliant_steering_turns_the_wheel_and_the_cameras_see_it(axle: str) -> None:
    size = 2e-6
    motion, plain = (drive("sinus", *hidden, duration=1.5) for hidden in ((f"steer_compliance.{axle}={size}",), ()))
    there = [0, 1] if axle == "front" else [2, 3]
    n = motion.carrier_attitude[..., 1]
    lateral = np.sum(motion.force * n, -1)[:, there]
    demanded = plain.kingpin[:, 0, there] if axle == "front" else 0.0
    given = motion.kingpin[:, 0, there] - demanded
    for j in (0, 1):
        assert np.polyfit(lateral[:, j], given[:, j], 1)[0] == pytest.approx(size, rel=0.15)
    for residual in (suspension_residual(motion), chassis_residual(motion)):
        assert np.max(np.abs(residual)) < 1e-7


MECHANICAL = [name for name in KINDS if not Hidden.is_of_sensor(name) and name != "chassis_torsion"]
SMALL = {
    "engine_mount": 1e-3, "liquid_load": 1e-3, "trailer": 1e-2, "payload": 1e-3, "steer_compliance": 1e-12,
    "toe_change": 1e-6, "camber_change": 1e-6, "pitch_change": 1e-6, "anti_dive": 1e-7, "jacking": 1e-7,
    "rolling_resistance": 1e-7, "camber_thrust": 1e-7, "aero_drag": 1e-5, "aero_lift": 1e-5, "aero_side": 1e-5,
    "slope": 1e-6, "tyre_damping": 1e-4, "spring_quadratic": 1.0, "spring_cubic": 100.0, "tyre_progression": 1.0,
    "bump_stop_quadratic": 100.0,
}  # fmt: skip
SHAPES = {"bump_stop": {"gap": 0.001}, "bump_stop_quadratic": {"gap": 0.0}, "rebound_stop": {"gap": 0.001}}


def small_run(name: str, size: float) -> np.ndarray:
    places = KINDS[name].places
    place = f"{name}.{places[0]}" if places else name
    manoeuvre = make_manoeuvre("sinus", duration=0.15, grade="B")
    return run(CAR, manoeuvre, [Hidden(place, size, shape=SHAPES.get(name, {}))], seed=1, settle=0.15).force


@pytest.mark.parametrize("name", MECHANICAL)
def test_no_size_is_no_effect_and_a_small_one_is_a_small_effect(name: str) -> None:
    plain = run(CAR, make_manoeuvre("sinus", duration=0.15, grade="B"), [], seed=1, settle=0.15).force
    assert np.array_equal(small_run(name, 0.0), plain)
    size = SMALL.get(name, 1e-2)
    one, two = small_run(name, size) - plain, small_run(name, 2 * size) - plain
    assert 0.0 < np.max(np.abs(one)) < 1.0
    assert relative(two - 2 * one, one) < 0.02


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("chassis_torsion=0", "stiffness"),
        ("chassis_torsion=1e12", "stiffness"),
        ("chassis_torsion=1e5,rear=1.5", "rear"),
        ("engine_mount=-5", "negative"),
        ("engine_mount=5000", "spare"),
        ("trailer=500,ahead=3", "ahead"),
        ("liquid_load=50,length=0", "length"),
        ("damper_hysteresis.front=100,length=1e-5", "length"),
        ("series_damper.front=1e9", "larger c"),
    ],
)
def test_what_makes_no_car_is_refused_with_the_remedy(text: str, told: str) -> None:
    with pytest.raises(UsageError, match=told):
        Engine(CAR, FLAT, [Hidden.parse(text)])


def test_a_car_has_one_trailer() -> None:
    with pytest.raises(UsageError, match="2 times"):
        Engine(CAR, FLAT, [Hidden("trailer", 500.0), Hidden("trailer", 300.0)])


def test_tyres_are_given_the_engines_own_motion_of_their_wheels(monkeypatch: pytest.MonkeyPatch) -> None:
    hidden = [Hidden("toe_change.front", 0.3), Hidden("camber_change.rear", -0.4), Hidden("chassis_torsion", 5e5)]
    engine = Engine(CAR, FLAT, hidden)
    given: list[tuple] = []
    for tyre in engine._tyres:
        contact = tyre.contact
        monkeypatch.setattr(tyre, "contact", lambda *of, contact=contact: (given.append(of), contact(*of))[1])
    rng = np.random.default_rng(4)
    data, lib = engine.data, engine.lib
    data.qpos[3:7] = [0.995, 0.05, -0.04, 0.07]
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    data.qpos[7:] = 0.05 * rng.standard_normal(engine.model.nq - 7)
    data.qvel[:] = rng.standard_normal(engine.model.nv)
    for slide, turn, ratio in zip(engine.slide_dof, engine.turn_dof, engine._ratios, strict=True):
        if turn >= 0:
            data.qpos[turn + 1], data.qvel[turn] = ratio * data.qpos[slide + 1], ratio * data.qvel[slide]
    engine.load(data.qpos.tolist(), data.qvel.tolist(), [0.0] * engine.states, 0.0, [0.0] * 4, [0.0] * 4, 5e-4)
    engine.accelerate()
    R, moving = data.xmat[1].reshape(3, 3), np.empty(6)
    for i, corner in enumerate(CORNERS):
        body = lib.mj_name2id(engine.model, lib.mjtObj.mjOBJ_BODY, f"carrier_{corner}")
        lib.mj_objectVelocity(engine.model, data, lib.mjtObj.mjOBJ_XBODY, body, moving, 0)
        spin_axis, _, _, velocity, turn = given[i][:5]
        assert velocity == pytest.approx(R.T @ moving[3:], abs=1e-12)
        assert turn == pytest.approx(R.T @ moving[:3], abs=1e-12)
        assert spin_axis == pytest.approx(R.T @ data.xmat[body].reshape(3, 3)[:, 1], abs=1e-12)
        world_z = data.xpos[body][2]
        assert engine.now.distance[i] == pytest.approx(world_z / R[2, 2], rel=1e-12)
