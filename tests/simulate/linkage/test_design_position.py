"""The second car's design position is an equilibrium, rigid loops close, and stiff rubber becomes the rigid linkage."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.truth import values_at
from tests.simulate.linkage.second_cars import ALL, RIGID, Stiffened, mechanism, shaken, statics

MIRROR = np.diag([1.0, -1.0, 1.0])
OTHER = [1, 0, 3, 2]


@pytest.mark.parametrize("name", ALL)
def test_the_design_position_is_an_equilibrium_on_a_flat_road(name: str) -> None:
    car = mechanism(name)
    force = car.force() + car.static_wheel_force()
    if car.loops.count:
        J = car.loops.jacobian()
        force = force + J.T @ np.linalg.lstsq(J.T, -force, rcond=None)[0]
    # Static toe moves the contact points by some µm, which the sizes' static loads do not know: 0.13 N·m of pitch.
    assert np.max(np.abs(force[:6])) < 0.2
    assert np.max(np.abs(np.delete(force, [*range(6), car.rack_dof]))) < 1e-5


@pytest.mark.parametrize("name", ALL)
def test_parts_and_chassis_make_up_the_whole_car(name: str) -> None:
    car = mechanism(name)
    model, data, total = car.model, car.data, car.car.total
    centre = model.body_mass @ data.xipos / model.body_mass.sum() - [0.0, 0.0, car.car.origin_height]
    tensor = np.zeros((3, 3))
    for body in range(1, model.nbody):
        R, r = data.ximat[body].reshape(3, 3), data.xipos[body] - [0.0, 0.0, car.car.origin_height] - centre
        tensor += R @ np.diag(model.body_inertia[body]) @ R.T + model.body_mass[body] * (
            r @ r * np.eye(3) - np.outer(r, r)
        )
    assert model.body_mass.sum() == pytest.approx(total.mass, abs=1e-9)
    np.testing.assert_allclose(centre, total.com, atol=1e-9)
    np.testing.assert_allclose(tensor, total.tensor, atol=1e-6)


@pytest.mark.parametrize("name", RIGID)
def test_rigid_loops_close_to_rounding(name: str) -> None:
    car = shaken(name)
    ends = {site: car.data.site_xpos[car.lib.mj_name2id(car.model, car.lib.mjtObj.mjOBJ_SITE, site)] for rod in
            car.car.linkage.rods for site in (f"{rod.name}.a", f"{rod.name}.b")}  # fmt: skip
    for rod in car.car.linkage.rods:
        length = np.linalg.norm(np.subtract(rod.b.at, rod.a.at))
        assert np.linalg.norm(ends[f"{rod.name}.b"] - ends[f"{rod.name}.a"]) == pytest.approx(length, abs=1e-11)
    assert np.max(np.abs(car.loops.jacobian() @ car.data.qvel)) < 1e-9


@pytest.mark.parametrize("name", RIGID)
def test_jacobian_and_drift_of_the_loops_are_their_derivatives(name: str) -> None:
    car = shaken(name)
    q, v, step = car.data.qpos.copy(), car.data.qvel.copy(), 1e-5
    J, drift = car.loops.jacobian(), car.loops.drift()
    values = {}
    for sign in (-1.0, 1.0):
        car.data.qpos[:] = q
        car.lib.mj_integratePos(car.model, car.data.qpos, v, sign * step)
        car.refresh()
        values[sign] = car.loops.value(), car.loops.jacobian() @ v
    np.testing.assert_allclose((values[1.0][0] - values[-1.0][0]) / (2 * step), J @ v, atol=1e-6)
    np.testing.assert_allclose((values[1.0][1] - values[-1.0][1]) / (2 * step), drift, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("name", ["second", "second-live-axle"])
def test_stiff_rubber_is_the_rigid_linkage(name: str) -> None:
    of = [statics(name), statics(name, Stiffened), statics(f"{name}-rigid")]
    soft, stiff, rigid = (values_at(s, s.solve(np.zeros(4))) for s in of)
    for key in ("wheel_rate", "unsprung_mass", "path", "turn"):
        expected = getattr(rigid, key)
        far, near = (np.max(np.abs(getattr(values, key) - expected)) for values in (soft, stiff))
        assert near < 0.02 * far
    travel = np.array([0.04, -0.02, -0.03, 0.05])
    a, b = (s.solve(travel, 0.02) for s in of[1:])
    np.testing.assert_allclose(a.centres, b.centres, atol=2e-5)
    np.testing.assert_allclose(a.attitudes, b.attitudes, atol=2e-4)


def test_left_mirrors_right() -> None:
    both = statics("second")
    travel = np.array([0.05, -0.03, 0.02, -0.04])
    one, other = both.solve(travel, 0.02), both.solve(travel[OTHER], -0.02)
    np.testing.assert_allclose(other.centres[OTHER] @ MIRROR, one.centres, atol=1e-9)
    np.testing.assert_allclose(MIRROR @ other.attitudes[OTHER] @ MIRROR, one.attitudes, atol=1e-9)


def test_the_rack_steers_by_its_ratio() -> None:
    car = statics("second-rigid")
    values = values_at(car, car.solve(np.zeros(4)))
    ends = [car.solve(np.zeros(4), sign * 1e-4) for sign in (1.0, -1.0)]
    steer = [np.mean(np.arctan2(-shape.attitudes[:2, 0, 1], shape.attitudes[:2, 1, 1])) for shape in ends]
    assert (steer[0] - steer[1]) * values.rack_per_steer == pytest.approx(2e-4, rel=1e-5)
    assert isinstance(car.mechanism.car, SecondCar)
