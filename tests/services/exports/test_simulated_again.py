"""An exported car, simulated by MuJoCo alone, is identified again with the numbers that were exported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.formats.open_run import open_run
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.validation.parameter_estimates import Estimate, estimates
from lacet.services.exports.car import ExportedCar, exported_car
from lacet.services.exports.mjcf import mjcf_text
from lacet.services.exports.urdf import urdf_text
from tests.identify import cars
from tests.support.mujoco_drive import drive, with_sensors, without_latency

VEHICLE, RIG = cars.reference_car()
EXACT = without_latency(RIG)
DRIVE = {"seconds": 9.0, "steer": 0.004, "push": 2500.0, "bumps": 0.006}


def model_of(car: Fit | None = None) -> Model:
    """The base model with both bars."""
    known = catalogue(VEHICLE, RIG.wheel_reference)
    bars = [known[f"anti_roll_bar.{axle}"] for axle in ("front", "rear")]
    return Model.of([*base_model(VEHICLE, RIG.wheel_reference), *bars])


@pytest.fixture(scope="module")
def fitted() -> Fit:
    """The reference car, identified from real measurements (of another simulator)."""
    drives = [PreparedRun.of(open_run(cars.CAR / f"{name}.parquet"), VEHICLE, RIG) for name in ("sine", "rough")]
    return fit(model_of(), drives)


@pytest.fixture(scope="module")
def car(fitted: Fit) -> ExportedCar:
    """The car to export."""
    return exported_car(fitted)


@pytest.fixture(scope="module")
def mjcf(car: ExportedCar, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its MJCF."""
    file = tmp_path_factory.mktemp("mjcf") / "car.xml"
    file.write_text(mjcf_text(car, "reference car"), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def urdf(car: ExportedCar, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its URDF."""
    file = tmp_path_factory.mktemp("urdf") / "car.urdf"
    file.write_text(urdf_text(car, "reference car"), encoding="utf-8")
    return file


def found_again(fitted: Fit, run: Any) -> dict[str, tuple[float, Estimate]]:
    """Parameters that both runs determine: name → value exported, estimate from the simulated run."""
    before = {e.name: e for e in estimates(fitted)}
    again = estimates(fit(model_of(), [PreparedRun.of(run, VEHICLE, EXACT)]))
    both = {e.name: (before[e.name].value, e) for e in again if e.identifiable and before[e.name].identifiable}
    for name in ("XX6", "YY6", "ZZ6", "MX6", "M6", "spring.fl.k", "damper.rr.c", "anti_roll_bar.rear.k"):
        assert name in both
    assert sum(name.startswith("tyre_stiffness") for name in both) == 4
    return both


def assert_same(both: dict[str, tuple[float, Estimate]]) -> None:
    """95 % intervals: nine in ten hold the value exported, and none is off by twice its own."""
    off = {name: abs(e.value - value) / e.half for name, (value, e) in both.items()}
    assert max(off.values()) < 2.0, max(off, key=lambda name: off[name])
    assert sum(x > 1.0 for x in off.values()) <= 0.1 * len(off), {n: round(x, 2) for n, x in off.items() if x > 1.0}


def test_mjcf_is_identified_again(fitted: Fit, mjcf: Path) -> None:
    """Springs, dampers, bars and tyres are those of the file: the test gives no force but those along the road."""
    model = with_sensors(mujoco.MjSpec.from_file(str(mjcf)), EXACT, "rim")
    tyre = [model.actuator(f"tyre_{c}").id for c in CORNERS]
    steer = [model.actuator(f"steer_{c}").id for c in ("fl", "fr")]
    # The assumed steering is stiffer than steps of 1 ms can follow.
    model.actuator_gainprm[steer, 0] = 5e4
    model.actuator_biasprm[steer, 1:3] = -5e4, -200.0
    level, slope = model.actuator_biasprm[tyre, 0].copy(), model.actuator_biasprm[tyre, 1].copy()

    def tyres(model: Any, data: Any, inputs: np.ndarray) -> np.ndarray:
        data.ctrl[steer] = inputs[0]
        model.actuator_biasprm[tyre, 0] = level - slope * inputs[1]  # a road higher by so much
        mujoco.mj_fwdActuation(model, data)
        return data.actuator_force[tyre].copy()

    assert_same(found_again(fitted, drive(model, VEHICLE, EXACT, tyres, "again", 3, **DRIVE)))


def test_urdf_is_identified_again(fitted: Fit, car: ExportedCar, urdf: Path) -> None:
    """Tree, inertias and damping are those of the file; springs, bars, tyres and steering are forces of the test."""
    spec = mujoco.MjSpec.from_file(str(urdf))
    spec.body("chassis").add_freejoint()
    spec.body("chassis").pos = [0.0, 0.0, car.height]
    spec.compiler.fusestatic = False
    model = with_sensors(spec, EXACT, "rim")
    slide = [int(model.joint(f"slide_{c}").dofadr[0]) for c in CORNERS]
    steer = [int(model.joint(f"steer_{c}").dofadr[0]) for c in ("fl", "fr")]
    body = [model.body(f"rim_{c}").id for c in CORNERS]
    bars = {(CORNERS.index(left), CORNERS.index(right)): k for left, right, k in car.bars}

    def tyres(model: Any, data: Any, inputs: np.ndarray) -> np.ndarray:
        data.qfrc_applied[:] = 0.0
        s = data.qpos[np.array(slide) + 1]
        law = np.array([c.stiffness * x + c.offset for c, x in zip(car.corners, s, strict=True)])
        for (left, right), k in bars.items():
            law[left] += k * (s[left] - s[right])
            law[right] -= k * (s[left] - s[right])
        data.qfrc_applied[slide] = -law
        for dof in steer:
            data.qfrc_applied[dof] = 5e4 * (inputs[0] - data.qpos[dof + 1]) - 200.0 * data.qvel[dof]
        load = np.zeros(4)
        for i, c in enumerate(car.corners):
            height = data.xpos[body[i], 2] - inputs[1]
            load[i] = max(0.0, c.tyre_stiffness * (c.radius - height / np.sqrt(1.0 - c.attitude[2, 1] ** 2)))
            arm = data.xpos[body[i]] - data.xipos[body[i]]
            data.xfrc_applied[body[i], 2] += load[i]
            data.xfrc_applied[body[i], 3:] += np.cross(arm, [0.0, 0.0, load[i]])
        return load

    assert_same(found_again(fitted, drive(model, VEHICLE, EXACT, tyres, "again", 3, **DRIVE)))


def test_urdf_and_mjcf_are_the_same_bodies(mjcf: Path, urdf: Path) -> None:
    """By a third library: total mass, centre of mass and, at design height, the inertia of the whole."""
    flyer = pinocchio.JointModelFreeFlyer()
    tree = pinocchio.buildModelFromUrdf(str(urdf), flyer)
    data = tree.createData()
    pinocchio.ccrba(tree, data, pinocchio.neutral(tree), np.zeros(tree.nv))
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, state, M)
    np.testing.assert_allclose(data.Ig.mass, np.sum(model.body_mass), rtol=1e-9)
    com = data.com[0] + [0.0, 0.0, float(state.qpos[2])]
    np.testing.assert_allclose(com, state.subtree_com[model.body("chassis").id], atol=1e-9)
    pinocchio.crba(tree, data, pinocchio.neutral(tree))
    np.testing.assert_allclose(np.triu(data.M[:6, :6]), np.triu(M[:6, :6]), rtol=1e-8, atol=1e-6)


def test_an_exported_car_stands_at_its_design_height(mjcf: Path, car: ExportedCar) -> None:
    """Weight, springs and tyres balance where they were measured: within 10 mm after three seconds."""
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 6000)
    assert abs(data.qpos[2] - car.height) < 0.01
    assert np.max(np.abs(data.qvel)) < 0.01
