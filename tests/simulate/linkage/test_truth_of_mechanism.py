"""Rates, masses and ratios of the second car are those of its energies."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from lacet.simulate.linkage.statics import Loads, Statics
from lacet.simulate.linkage.truth import values_at
from tests.simulate.linkage.second_cars import mechanism, statics

SOME = ("second", "second-live-axle-rigid")
PLACE = np.array([0.03, -0.01, -0.02, 0.025])


def energy_at(name: str, travel: np.ndarray) -> float:
    car = statics(name)
    shape = car.solve(travel)
    car.mechanism.data.qpos[:] = shape.q
    car.mechanism.refresh()
    return car.mechanism.potential()


@pytest.mark.parametrize("name", SOME)
def test_work_at_the_wheel_is_the_change_of_energy(name: str) -> None:
    car = statics(name)
    held, step = car.solve(PLACE).held, 1e-3
    for i in range(4):
        way = step * np.eye(4)[i]
        change = energy_at(name, PLACE + way) - energy_at(name, PLACE - way)
        assert change == pytest.approx(2 * step * held[i], rel=2e-5)


@pytest.mark.parametrize("name", ["second-rigid", "second-live-axle-rigid"])
def test_force_times_displacement_at_the_wheel_is_the_work_of_the_springs(name: str) -> None:
    """Virtual work on the rigid linkage: only springs, bars, rubber in torsion and weight do any."""
    car = statics(name)
    shape = car.solve(PLACE)
    values = values_at(car, shape)
    motion, _ = car.tangent(shape)
    data, model = car.mechanism.data, car.mechanism.model
    data.qpos[:] = shape.q
    car.mechanism.refresh()
    push = car.mechanism.elements.pushes()
    springs = sum(push[s] * ratio for s, ratio in values.motion_ratio.items() if s.startswith("spring"))
    linkage = car.mechanism.car.linkage
    turning = np.zeros(4)

    def joint(name: str) -> int:
        return int(car.mechanism.lib.mj_name2id(model, car.mechanism.lib.mjtObj.mjOBJ_JOINT, name))

    for t in linkage.torsions:
        dofs = [(model.jnt_qposadr[joint(n)], model.jnt_dofadr[joint(n)]) for n in (t.first, t.second) if n]
        angle = data.qpos[dofs[0][0]] - sum(data.qpos[q] for q, _ in dofs[1:])
        turning += t.stiffness * angle * (motion[dofs[0][1]] - sum(motion[dof] for _, dof in dofs[1:]))
    for r in linkage.rubbers:
        q, dof = model.jnt_qposadr[joint(r.joint)], model.jnt_dofadr[joint(r.joint)]
        half = np.arccos(data.qpos[q])
        turning += r.stiffness * 2 * half / np.sin(half) * data.qpos[q + 1 : q + 4] @ motion[dof : dof + 3]
    weight = np.zeros(4)
    for body in range(2, model.nbody):
        along = np.empty((3, model.nv))
        car.mechanism.lib.mj_jacBodyCom(model, data, along, None, body)
        weight += model.body_mass[body] * car.mechanism.car.gravity * (along[2] @ motion)
    np.testing.assert_allclose(springs + turning + weight, shape.held, rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize("name", SOME)
def test_rates_are_those_between_neighbouring_equilibria_and_reciprocal(name: str) -> None:
    car = statics(name)
    values = values_at(car, car.solve(PLACE))
    step = 1e-3
    ends = [[car.solve(PLACE + sign * step * np.eye(4)[i]) for sign in (1.0, -1.0)] for i in range(4)]
    rate = np.array([(a.held - b.held) / (2 * step) for a, b in ends]).T
    np.testing.assert_allclose(values.wheel_rate, rate, rtol=1e-4, atol=3.0)
    np.testing.assert_allclose(values.wheel_rate, values.wheel_rate.T, atol=0.01)
    path = np.array([(a.centres - b.centres)[:, :2] / (2 * step) for a, b in ends]).transpose(1, 0, 2)
    np.testing.assert_allclose(values.path, path, atol=2e-5)
    for i, (a, b) in enumerate(ends):
        turned = np.einsum("nij,nkj->nik", a.attitudes, b.attitudes)
        about = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1) / (2 * step)
        np.testing.assert_allclose(values.turn[:, i], about, atol=1e-3)


@pytest.mark.parametrize("name", ["second", "second-live-axle-rigid"])
def test_unsprung_mass_is_twice_the_kinetic_energy_per_speed_squared(name: str) -> None:
    car = statics(name)
    shape = car.solve(PLACE)
    values = values_at(car, shape)
    motion, _ = car.tangent(shape)
    speed = np.array([0.4, -0.7, 1.1, 0.3])
    model, data = car.mechanism.model, car.mechanism.data
    data.qpos[:], data.qvel[:] = shape.q, motion @ speed
    car.mechanism.refresh()
    M = np.zeros((model.nv, model.nv))
    car.mechanism.lib.mj_fullM(model, data, M)
    twice = data.qvel @ M @ data.qvel
    assert speed @ values.unsprung_mass_locked @ speed == pytest.approx(twice, rel=1e-9)
    assert np.all(np.diag(values.unsprung_mass) < np.diag(values.unsprung_mass_locked))
    car.mechanism.data.qvel[:] = 0.0


@pytest.mark.parametrize("name", ["second", "second-live-axle"])
def test_roll_stiffness_is_the_moment_per_roll_of_the_axle_line(name: str) -> None:
    car = statics(name)
    values = values_at(car, car.solve(np.zeros(4)))
    angle = 1e-3
    for axle, wheels in ((0, slice(0, 2)), (1, slice(2, 4))):
        half = 0.5 * car.mechanism.car.axle(("fl", "rl")[axle]).track
        travel = np.zeros(4)
        travel[wheels] = angle * half, -angle * half
        shapes = [car.solve(sign * travel) for sign in (1.0, -1.0)]
        moment = [half * (shape.held[wheels][0] - shape.held[wheels][1]) for shape in shapes]
        assert (moment[0] - moment[1]) / (2 * angle) == pytest.approx(values.roll_stiffness[axle], rel=1e-4)


def test_inboard_inertia_is_that_of_all_but_rims_and_tyres() -> None:
    car = mechanism("second")
    model, data = car.model, car.data
    outboard = {
        w: car.car.axle(c).outboard_mass for w, c in zip(car.wheels.tolist(), ("fl", "fr", "rl", "rr"), strict=True)
    }
    mass = model.body_mass - [outboard.get(body, 0.0) for body in range(model.nbody)]
    centre = mass @ data.xipos / mass.sum() - [0.0, 0.0, car.car.origin_height]
    assert car.car.inboard.mass == pytest.approx(mass.sum())
    np.testing.assert_allclose(car.car.inboard.com, centre, atol=1e-9)


def test_a_load_at_a_contact_point_does_work_on_the_wheel() -> None:
    """Compliance: the work of a growing lateral force is stored in the rubber."""
    car = statics("second")
    foot = car.mechanism.car.heights[0]

    def loaded(size: float) -> tuple[np.ndarray, np.ndarray, float]:
        force = np.zeros((4, 3))
        force[0, 1] = size
        shape = car.solve(PLACE, loads=Loads(force, np.zeros((4, 3))))
        car.mechanism.data.qpos[:] = shape.q
        car.mechanism.refresh()
        return shape.centres[0], shape.attitudes[0], car.mechanism.potential()

    sizes = np.linspace(0.0, 2000.0, 5)
    places, attitudes, energies = zip(*(loaded(size) for size in sizes), strict=True)
    camber = [(after @ before.T)[2, 1] for before, after in itertools.pairwise(attitudes)]
    way = np.diff([place[1] for place in places]) + foot * np.array(camber)
    work = np.sum(0.5 * (sizes[1:] + sizes[:-1]) * way)
    assert energies[-1] - energies[0] == pytest.approx(work, rel=1e-3)


@pytest.mark.parametrize("name", ["second-rigid", "second-live-axle-rigid"])
def test_a_load_is_held_by_the_same_forces_whatever_was_solved_before(name: str) -> None:
    """Rigid parts do not move under a load: what counts is that the forces are balanced, also with an older matrix."""
    rng = np.random.default_rng(3)
    loads = Loads(rng.normal(0.0, 2000.0, (4, 3)), rng.normal(0.0, 300.0, (4, 3)))
    used, fresh = Statics(mechanism(name)), Statics(mechanism(name))
    used.solve(np.array([0.04, -0.03, 0.03, -0.04]), 0.03)
    held = [of.solve(np.zeros(4), 0.0, loads).held for of in (used, fresh)]
    np.testing.assert_allclose(held[0], held[1], atol=1e-3)
