"""The second car's motion obeys the laws of mechanics, and its sensors see that motion."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.errors import UsageError
from lacet.simulate import Hidden, exchange_run, make_manoeuvre, run
from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.engine import LinkageEngine
from lacet.simulate.linkage.mechanism import Mechanism
from lacet.simulate.motion import rotate
from lacet.simulate.road import FLAT
from tests.simulate.linkage.second_cars import Undamped, drive
from tests.simulate.simulated_drives import make_rig

KERB = {"spacing": 1.5, "length": 1.5, "height": 0.008, "speed": 11.0}
DRIVES = [("second-engine", "sinus", {}), ("second-live-axle-rigid", "kerb", KERB)]


def slopes(values: np.ndarray, rate: float) -> np.ndarray:
    """Derivative by fourth-order central differences, two samples shorter at each end."""
    return rate * (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / 12.0


@pytest.mark.parametrize(("name", "manoeuvre", "settings"), DRIVES)
def test_contact_forces_and_weight_are_the_change_of_momentum(
    name: str, manoeuvre: str, settings: dict[str, float]
) -> None:
    motion = drive(name, manoeuvre, **settings)
    car = Mechanism(motion.car)
    momenta = []
    for q, v in zip(motion.q, motion.v, strict=True):
        car.data.qpos[:], car.data.qvel[:] = q, v
        car.refresh()
        momenta.append(np.concatenate(car.momentum()))
    change = slopes(np.array(momenta), motion.rate)
    attitude = motion.attitude[:, None]
    force = rotate(attitude, motion.force)
    at = motion.position[:, None] + rotate(attitude, motion.centres)
    moment = np.cross(at, force) + rotate(attitude, motion.moment)
    mass, weight = car.model.body_mass, np.array([0.0, 0.0, -motion.car.gravity])
    centre = np.empty((len(motion.t), 3))
    for i, q in enumerate(motion.q):
        car.data.qpos[:] = q
        car.lib.mj_kinematics(car.model, car.data)
        centre[i] = mass @ car.data.xipos / mass.sum()
    total = force.sum(axis=1) + mass.sum() * weight
    about = moment.sum(axis=1) + np.cross(centre, mass.sum() * weight)
    np.testing.assert_allclose(change[:, :3], total[2:-2], atol=0.01 + 2e-4 * np.max(np.abs(motion.force)))
    np.testing.assert_allclose(change[:, 3:], about[2:-2], atol=0.05 + 2e-4 * np.max(np.abs(moment)))


@pytest.mark.parametrize(("name", "manoeuvre", "settings"), DRIVES)
def test_velocities_and_accelerations_are_derivatives_of_the_wheels_places(
    name: str, manoeuvre: str, settings: dict[str, float]
) -> None:
    motion = drive(name, manoeuvre, **settings)
    place = motion.position[:, None] + rotate(motion.attitude[:, None], motion.centres)
    velocity, acceleration = (rotate(motion.attitude[:, None], x) for x in motion.wheel_centre_motion)
    np.testing.assert_allclose(slopes(place, motion.rate), velocity[2:-2], atol=1e-4)
    np.testing.assert_allclose(slopes(velocity, motion.rate), acceleration[2:-2], atol=0.05)
    R = motion.attitude[:, None] @ motion.attitudes
    turn = rotate(motion.attitude[:, None], motion.carrier_turn[0])
    rate = slopes(R, motion.rate) @ np.swapaxes(R[2:-2], -1, -2)
    np.testing.assert_allclose(np.stack([rate[..., 2, 1], rate[..., 0, 2], rate[..., 1, 0]], -1), turn[2:-2], atol=1e-3)
    change = rotate(motion.attitude[:, None], motion.carrier_turn[1])
    np.testing.assert_allclose(slopes(turn, motion.rate), change[2:-2], atol=0.2)


@pytest.mark.parametrize("name", ["second", "second-live-axle-rigid"])
def test_without_damping_and_road_energy_stays(name: str) -> None:
    engine = LinkageEngine(Undamped.named(name), FLAT)
    car, data, lib = engine.mechanism, engine.data, engine.lib
    data.qpos[2] += 5.0
    rng = np.random.default_rng(3)
    data.qvel[6:] = 0.4 * rng.standard_normal(engine.model.nv - 6)
    data.qvel[car.rack_dof] = 0.0
    state = data.qvel.copy()
    engine.close(state)
    step, energies, kinetic = 0.0002 if car.loops.count else 0.0001, [], []

    def rate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        data.qpos[:], data.qvel[:] = q, v
        engine.load(q.tolist(), v.tolist(), [0.0] * engine.states, 0.0, [0.0] * 4, [0.0] * 4, step)
        return engine.accelerate()

    def ahead(q: np.ndarray, v: np.ndarray, time: float) -> np.ndarray:
        out = q.copy()
        lib.mj_integratePos(engine.model, out, v, time)
        return out

    for _ in range(200):  # midpoint rule, then the loops
        q, v = data.qpos.copy(), data.qvel.copy()
        car.refresh()
        energies.append(car.kinetic() + car.potential())
        kinetic.append(car.kinetic())
        middle = v + 0.5 * step * rate(q, v)
        change = rate(ahead(q, v, 0.5 * step), middle)
        data.qpos[:], data.qvel[:] = ahead(q, middle, step), v + step * change
        engine.close(np.empty(engine.model.nv))
    assert np.ptp(kinetic) > 20.0  # J exchanged with springs and weight
    assert np.ptp(energies) < 1e-4 * np.ptp(kinetic)


def test_the_engine_s_own_step_is_fine_enough() -> None:
    kerb = make_manoeuvre("kerb", duration=0.15, **KERB)
    coarse = run(SecondCar.named("second"), kerb, settle=0.25)
    fine = run(SecondCar.named("second"), kerb, settle=0.25, step=0.000125)
    assert np.ptp(coarse.travel[:, 0]) > 0.001
    assert np.max(np.abs(coarse.travel - fine.travel)) < 2e-6
    assert np.max(np.abs(coarse.force - fine.force)) < 2.0


def test_its_sensors_see_its_motion() -> None:
    motion = drive("second-engine", "sinus")
    table = exchange_run(motion, make_rig("hub"), noise=0.0)
    times = table.signals["laser.fl.hub"].t

    def at(values: np.ndarray, latency: float) -> np.ndarray:
        return np.interp(times - latency, motion.t, values)

    hub = table.signals["laser.fl.hub"].values[:, 0]
    np.testing.assert_allclose(np.diff(hub), -np.diff(at(motion.travel[:, 0], 0.008)), atol=1e-6)
    steer = table.signals["camera.fr.steer"].values[:, 0]
    np.testing.assert_allclose(np.diff(steer), np.diff(at(motion.steer[:, 1], 0.025)), atol=1e-6)
    assert np.ptp(motion.travel[:, 0]) > 0.002
    assert np.ptp(motion.steer[:, 1]) > 0.005


def test_an_effect_of_the_first_car_is_refused_by_name() -> None:
    with pytest.raises(UsageError, match=r"anti_roll_bar\.front"):
        run(SecondCar.named("second"), make_manoeuvre("straight", duration=0.1), [Hidden("anti_roll_bar.front", 1e4)])
