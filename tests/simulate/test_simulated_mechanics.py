"""The equations of motion close at every recorded instant, whichever way they are written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.simulate import Hidden, SimulationFailed, find_car, make_manoeuvre, run
from lacet.simulate.drive import _motion, _Recorder
from lacet.simulate.engine import Engine
from lacet.simulate.motion import SimulatedMotion, rotate, rotate_back
from lacet.simulate.road import FLAT
from tests.simulate.simulated_drives import drive, relative

CAR = find_car("peugeot-406")
UNSPRUNG = np.array([CAR.axle(c).unsprung_mass for c in CORNERS])


def rigid_moment(motion: SimulatedMotion, tensor: np.ndarray) -> np.ndarray:
    """I·α + ω × (I·ω) of a body fixed to the chassis, (N, 3)."""
    return motion.turn_rate @ tensor + np.cross(motion.turn, motion.turn @ tensor)


def carrier_moment(motion: SimulatedMotion, inertia: np.ndarray) -> np.ndarray:
    """The same of each carrier, (N, 4, 3), body axes; `inertia` (4, 3) principal moments in carrier axes."""
    R = motion.carrier_attitude
    w, wd = (rotate_back(R, x) for x in motion.carrier_turn)
    return rotate(R, inertia * wd + np.cross(w, inertia * w))


def balance(motion: SimulatedMotion, force: np.ndarray, moment: np.ndarray, outboard: bool) -> tuple[float, float]:
    """How well ΣF = Σm·a and Σ(M + r×F) = Σ(r×m·a + dH/dt) close about the body origin, relative to the loads."""
    car, chassis = motion.car, motion.car.chassis
    axles = [car.axle(c) for c in CORNERS]
    out = [(a.outboard_mass, a.outboard_spin, a.outboard_transverse) if outboard else (0.0, 0.0, 0.0) for a in axles]
    mass = np.array([a.carrier_mass + a.inboard_mass for a in axles]) + np.array([o[0] for o in out])
    spin = np.array([a.inboard_spin for a in axles]) + np.array([o[1] for o in out])
    side = np.array([a.inboard_transverse for a in axles]) + np.array([o[2] for o in out])
    centre = np.asarray([chassis.com])
    felt = motion.at(centre)[1][:, 0] - motion.gravity
    wheel = mass[:, None] * (motion.wheel_centre_motion[1] - motion.gravity[:, None])
    inertia = np.array([a.carrier_inertia for a in axles])
    r = motion.wheel_centres
    need = chassis.mass * felt + wheel.sum(1)
    turn = (
        chassis.mass * np.cross(centre[0], felt)
        + rigid_moment(motion, np.asarray(chassis.tensor))
        + (np.cross(r, wheel) + carrier_moment(motion, inertia) + motion.spinning_momentum_rate(spin, side)).sum(1)
    )
    given = force.sum(1) + motion.air[:, 0]
    twist = (np.cross(r, force) + moment).sum(1) + motion.air[:, 1]
    return relative(given - need, need), relative(twist - turn, np.cross(r, force))


@pytest.mark.parametrize("reference", ["contact", "hub"])
def test_loads_gravity_and_accelerations_balance(motion: SimulatedMotion, reference: str) -> None:
    loads = (motion.force, motion.moment) if reference == "contact" else motion.hub
    force, moment = balance(motion, *loads, outboard=reference == "contact")
    assert force < 1e-11
    assert moment < 1e-11


def test_balance_holds_with_air_and_payload() -> None:
    motion = drive("sinus", "aero_drag=0.4", "aero_lift.front=0.1", "aero_lift.rear=0.15", "payload=75")
    force, moment = balance(motion, motion.force, motion.moment, outboard=True)
    assert force < 1e-11
    assert moment < 1e-11
    assert np.ptp(motion.air[:, 0, 0]) >= 0
    assert motion.air[0, 0, 0] == pytest.approx(-0.4 * 25**2, rel=0.02)


def test_suspension_row_closes_with_known_spring_damper_and_offset(motion: SimulatedMotion) -> None:
    felt = motion.wheel_centre_motion[1] - motion.gravity[:, None]
    left = motion.force[..., 2] - UNSPRUNG * felt[..., 2]
    k = np.array([CAR.axle(c).stiffness for c in CORNERS])
    c = np.array([CAR.axle(c).damping for c in CORNERS])
    right = k * motion.travel[:, 0] + c * motion.travel[:, 1] + CAR.offsets
    assert relative(left - right, left) < 1e-11


def test_tyre_row_closes_along_the_road_normal(motion: SimulatedMotion) -> None:
    n, e = motion.carrier_attitude[..., 1], motion.normal[:, None, :]
    height = motion.distance * motion.normal[:, 2:]
    deflection = CAR.front.radius - height / np.sqrt(1.0 - np.sum(n * e, -1) ** 2)
    along = np.sum(motion.force * e, -1)
    assert np.min(along) > 0.0  # no wheel leaves the road in the manoeuvres' default sizes
    assert relative(along - CAR.front.tyre_stiffness * deflection, along) < 1e-11


def test_spin_row_closes(motion: SimulatedMotion) -> None:
    n = motion.carrier_attitude[..., 1]
    spin = np.array([CAR.axle(c).spin_inertia for c in CORNERS])
    side = np.array([CAR.axle(c).inboard_transverse + CAR.axle(c).outboard_transverse for c in CORNERS])
    rate = np.sum(n * motion.spinning_momentum_rate(spin, side), -1)
    torque = np.sum(n * motion.moment, -1) + motion.shaft - motion.brake
    assert relative(torque - rate, np.sum(n * motion.moment, -1)) < 1e-10


def test_wheel_inertia_forces_are_the_engines_own() -> None:
    """Momentum rates by our kinematics against MuJoCo's recursive Newton–Euler, at random states."""
    rng = np.random.default_rng(5)
    engine = Engine(CAR, FLAT, [])
    record = _Recorder(1, engine.model.nq, engine.model.nv)
    for _ in range(20):
        engine.data.qpos[:] = 0.1 * rng.standard_normal(engine.model.nq)
        engine.data.qpos[3] = 1.0
        engine.data.qpos[3:7] /= np.linalg.norm(engine.data.qpos[3:7])
        engine.data.qvel[:] = rng.standard_normal(engine.model.nv)
        engine.data.qvel[engine.spin_dof] = 60.0 + 10.0 * rng.standard_normal(4)
        q, v = engine.data.qpos.tolist(), engine.data.qvel.tolist()
        engine.load(q, v, [0.0] * 8, 0.0, [50.0] * 4, [0.0] * 4, 0.0005)
        record.write(0, engine, engine.accelerate(), [50.0] * 4, [0.0] * 4)
        motion = _motion(engine, make_manoeuvre("straight"), record, (), 0)
        engine.lib.mj_rnePostConstraint(engine.model, engine.data)
        spin = np.array([CAR.axle(c).spin_inertia for c in CORNERS])
        side = np.array([CAR.axle(c).inboard_transverse + CAR.axle(c).outboard_transverse for c in CORNERS])
        mass = np.array([CAR.axle(c).inboard_mass + CAR.axle(c).outboard_mass for c in CORNERS])
        felt = motion.wheel_centre_motion[1][0] - motion.gravity[0]
        rate = motion.spinning_momentum_rate(spin, side)[0]
        R = motion.attitude[0]
        for i, corner in enumerate(CORNERS):
            body = engine.lib.mj_name2id(engine.model, engine.lib.mjtObj.mjOBJ_BODY, f"wheel_{corner}")
            torque, force = np.split(engine.data.cfrc_int[body], 2)
            arm = engine.data.xpos[body] - engine.data.subtree_com[1]
            ours = R @ (mass[i] * felt[i])
            assert ours == pytest.approx(force, rel=1e-9, abs=1e-7)
            assert R @ rate[i] == pytest.approx(torque - np.cross(arm, force), rel=1e-9, abs=1e-7)
            assert R @ motion.wheel_centres[0, i] + motion.position[0] == pytest.approx(engine.data.xpos[body])


def test_whole_vehicle_has_the_a_priori_values() -> None:
    whole = CAR.chassis
    for corner in CORNERS:
        whole = whole + CAR.unsprung(corner)
    assert whole.mass == pytest.approx(1668.5)
    assert whole.com == pytest.approx((-1.1125, 0.0, 0.2597))
    assert np.asarray(whole.tensor) == pytest.approx(np.array([[630, 0, -20], [0, 2250, 0], [-20, 0, 2734]]), abs=1e-9)
    assert np.linalg.eigvalsh(np.asarray(CAR.chassis.tensor)).min() > 0
    model = Engine(CAR, FLAT, []).model
    assert model.body_mass.sum() == pytest.approx(1668.5)


def test_design_position_is_an_equilibrium_at_rest() -> None:
    motion = run(CAR, make_manoeuvre("straight", speed=0.0, duration=0.5), settle=0.5)
    # camber × toe puts the contacts 5 µm ahead of the wheel centres: 0.05 N·m, a pitch of 1 µm at the wheels
    assert np.max(np.abs(motion.travel[:, 0])) < 3e-6
    assert np.max(np.abs(motion.acceleration)) < 1e-4
    assert motion.force[-1, :, 2] == pytest.approx(CAR.static_loads, abs=0.05)
    assert motion.force[-1, :, 2].sum() == pytest.approx(1668.5 * CAR.gravity, abs=0.02)
    assert motion.position[-1, 2] == pytest.approx(CAR.origin_height, abs=2e-6)


def test_integration_has_converged_and_derivatives_agree() -> None:
    motion = drive("rough")
    finer = run(CAR, make_manoeuvre("rough", duration=3.0), seed=1, settle=1.0, step=0.00025)
    assert np.max(np.abs(finer.travel[:, 0] - motion.travel[:, 0])) < 2e-6
    assert np.max(np.abs(finer.force - motion.force)) < 1.0
    for state in (motion.travel, motion.kingpin[..., :2]):
        by_difference = (-state[4:, 0] + 8 * state[3:-1, 0] - 8 * state[1:-3, 0] + state[:-4, 0]) / (12 / motion.rate)
        assert np.max(np.abs(by_difference - state[2:-2, 1])) < 2e-3 * np.max(np.abs(state[:, 1]))


def test_steering_follows_the_demand_and_is_exactly_what_the_camera_sees() -> None:
    motion = drive("sinus")
    R = motion.carrier_attitude
    c, s = np.cos, np.sin
    steer, camber, pitch = motion.steer, motion.camber, motion.carrier_pitch
    n = np.stack([-s(steer) * c(camber), c(steer) * c(camber), s(camber)], -1)
    assert n == pytest.approx(R[..., 1], abs=1e-14)
    x = np.stack(
        [
            c(steer) * c(pitch) - s(steer) * s(camber) * s(pitch),
            s(steer) * c(pitch) + c(steer) * s(camber) * s(pitch),
            -c(camber) * s(pitch),
        ],
        -1,
    )
    assert x == pytest.approx(R[..., 0], abs=1e-14)
    assert np.max(np.abs(motion.kingpin[:, 0])) == pytest.approx(0.025, rel=0.02)
    assert np.max(np.abs(motion.carrier_pitch[:, 2:])) < 1e-15


def test_a_car_that_flies_apart_before_its_run_begins_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Damping that falls without end with speed: the driven-in car is gone before the first sample."""
    monkeypatch.chdir(tmp_path)
    wild = Hidden("damper_digressive.rear", -1e4)
    with pytest.raises(SimulationFailed, match=r"flew apart -0\.\d+ s into 'rough'"):
        run(find_car("peugeot-406-measured"), make_manoeuvre("rough", duration=1.0), (wild,), 1002)
    assert not list(tmp_path.iterdir())  # the engine leaves no log of its own
