"""Joint tables of rigid linkages: slopes and work of wheel loads in lacet's suspension rows are the mechanism's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.joint_tables import JointCurve, JointTables
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import Row
from lacet.simulate.linkage.bench import SIDE, toe_camber_spin
from lacet.simulate.linkage.statics import Loads, Statics
from lacet.simulate.linkage.truth import values_at
from lacet.simulate.vehicle_file import vehicle_text
from tests.identify import cars
from tests.simulate.linkage.second_cars import RIGID, drive, statics

FLOOR = np.array([7.7, 7.7, 9.3, 9.3])
"""Noise floors of the suspension rows on the second car [N]: docs/benchmarks/second-car.md."""
NEAR = np.linspace(-4e-3, 4e-3, 33)
"""Travels and racks of the tables [m]: so near the design position and so dense that slopes there are exact. What the
ends of a natural spline do falls to a quarter from knot to knot: four of half a millimetre left 2e-8."""


def tables_of(of: Statics) -> dict[str, JointTables]:
    """Joint tables of each corner, one variable moved at a time."""
    design = of.mechanism.design_attitudes
    zero, centres = toe_camber_spin(design, design), of.mechanism.car.wheel_centres

    def readings(travel: np.ndarray, rack: float = 0.0) -> np.ndarray:
        shape = of.solve(travel, rack)
        moved, angles = shape.centres - centres, toe_camber_spin(shape.attitudes, design) - zero
        return np.column_stack([SIDE * moved[:, 1], moved[:, 0], angles])

    left, right = np.array([1.0, 0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0, 1.0])
    by_left, by_right = (np.array([readings(s * side) for s in NEAR]) for side in (left, right))
    by_rack = np.array([readings(np.zeros(4), r) for r in NEAR])
    out = {}
    for i, c in enumerate(CORNERS):
        own, other = (by_left, by_right) if c[1] == "l" else (by_right, by_left)
        curves = [JointCurve(NEAR, values[:, i]) for values in (own, other, by_rack)]
        out[c] = JointTables(*curves, {})
    return out


def at_design(name: str) -> Motion:
    """The car standing at its design position, as lacet makes it of its instruments and joint tables."""
    of = statics(name)
    vehicle = Vehicle.parse(vehicle_text(of.mechanism.car), f"{name}.toml")
    # The bench locks the wheels to their carriers: no half-shaft is eliminated.
    corners = {c: replace(vehicle.corners[c], joints=tables, driven=False) for c, tables in tables_of(of).items()}
    vehicle = replace(vehicle, corners=corners)
    signals = cars.random_signals(1, 1)
    rig = Rig.load("peugeot-406")
    value = dict(signals.value)
    flat = build_motion(cars.recording(signals, vehicle, rig))
    for c, corner in corners.items():
        value[f"laser.{c}.hub"] = value[f"laser.{c}.hub"] + flat.corners[c].travel
        value[f"camera.{c}.steer"] = np.array([[-corner.side * corner.static_toe]])
        value[f"camera.{c}.camber"] = np.array([[-corner.side * corner.static_camber]])
    return build_motion(cars.recording(replace(signals, value=value), vehicle, rig))


@pytest.mark.parametrize("name", RIGID)
def test_slopes_by_both_travels_are_the_mechanism_s(name: str) -> None:
    """∂p/∂s and ∂φ/∂s of each wheel by its own and by the other wheel's travel."""
    motion, of = at_design(name), statics(name)
    values = values_at(of, of.solve(np.zeros(4)))
    for i, c in enumerate(CORNERS):
        corner = motion.corners[c]
        assert corner.other_dp_ds is not None
        assert corner.other_dphi_ds is not None
        for j, dp, dphi in ((i, corner.dp_ds, corner.dphi_ds), (i ^ 1, corner.other_dp_ds, corner.other_dphi_ds)):
            np.testing.assert_allclose(dp[:, 0], [*values.path[i, j], float(i == j)], atol=1e-10)
            np.testing.assert_allclose(dphi[:, 0], values.turn[i, j], atol=1e-10)


@pytest.mark.parametrize("name", RIGID)
def test_loads_of_both_wheels_do_the_work_that_holds_the_travels(name: str) -> None:
    """What a load at the wheels adds to the forces that hold the travels is the left side of the suspension rows."""
    motion, of = at_design(name), statics(name)
    rng = np.random.default_rng(4)
    force, moment = rng.normal(0, 2000, (4, 3)), rng.normal(0, 300, (4, 3))
    held = of.solve(np.zeros(4), loads=Loads(force, moment)).held - of.solve(np.zeros(4)).held
    corners = {}
    for i, c in enumerate(CORNERS):
        lever = np.array([0.0, 0.0, -of.mechanism.car.heights[i]])
        about = moment[i] + np.cross(lever, force[i])
        corners[c] = replace(motion.corners[c], force=force[i][:, None], moment=about[:, None])
    loaded = replace(motion, corners=corners)
    found = np.array([loaded.measured(Row.parse(f"suspension.{c}"))[0] for c in CORNERS])
    np.testing.assert_allclose(found, -held, atol=1e-6)
    # Without what the other wheel adds it is another force, where an axle couples its wheels.
    alone = {c: replace(k, other_dp_ds=None) for c, k in corners.items()}
    cut = np.array([replace(motion, corners=alone).measured(Row.parse(f"suspension.{c}"))[0] for c in CORNERS])
    assert np.max(np.abs(cut + held)[2:]) > 20.0


@pytest.mark.parametrize("name", RIGID)
def test_with_the_bench_s_tables_work_along_a_drive_is_the_mechanism_s_to_a_tenth_of_a_noise_floor(name: str) -> None:
    """Loads, travels and steering of a sinus; the tables are those of bump, roll and steer, as a bench gives them."""
    run, of = drive(name, "sinus", duration=1.6, amplitude=0.03), statics(name)
    at = np.linspace(0, len(run.t) - 1, 16).astype(int)
    force, moment, travel = run.force[at], run.moment[at], run.travel[at]
    rack, design = run.q[at, of.mechanism.rack_q], of.mechanism.design_attitudes
    assert np.all(np.ptp(travel, axis=0) > 0.03)
    work, angles = np.zeros((len(at), 4)), np.zeros((len(at), 4, 2))
    for k in range(len(at)):
        shape = of.solve(travel[k], rack[k])
        values = values_at(of, shape)
        place = np.concatenate([values.path, np.eye(4)[..., None]], axis=2)
        work[k] = np.einsum("jx,jix->i", force[k], place) + np.einsum("jx,jix->i", moment[k], values.turn)
        angles[k] = -SIDE[:, None] * toe_camber_spin(shape.attitudes, design)[:, :2]
    vehicle = Vehicle.parse(vehicle_text(of.mechanism.car), f"{name}.toml")
    vehicle = replace(vehicle, corners={c: replace(k, driven=False) for c, k in vehicle.corners.items()})
    motion = standing(vehicle, angles, force, moment, travel)

    def off(motion: Motion) -> np.ndarray:
        found = np.stack([motion.measured(Row.parse(f"suspension.{c}")) for c in CORNERS], axis=1)
        return np.sqrt(np.mean((found - work) ** 2, axis=0)) / FLOOR

    assert np.all(off(motion) < 0.1)
    # Of the wheel's own travel alone it is more than a floor, where an axle couples its wheels.
    alone = {c: replace(k, other_dp_ds=None) for c, k in motion.corners.items()}
    assert np.all(off(replace(motion, corners=alone))[2:] > 1.0)


@pytest.mark.parametrize("name", ["second", "second-live-axle"])
def test_on_rubber_places_under_load_and_its_work_are_the_mechanism_s(name: str) -> None:
    """Wheel centres to 0.02 mm and pitch to 0.01°, 1 mm and 0.2° off without the compliance; the work of the loads to
    1 N of some hundred, whatever the rubber gives."""
    of = statics(name)
    rng = np.random.default_rng(7)
    vehicle = Vehicle.parse(vehicle_text(of.mechanism.car), f"{name}.toml")
    corners = {
        c: replace(k, joints=replace(tables, compliance=k.joints.compliance), driven=False)
        for (c, k), tables in zip(vehicle.corners.items(), tables_of(of).values(), strict=True)
        if k.joints is not None
    }
    heights = of.mechanism.car.heights
    force, aligning = rng.normal(0, 700, (4, 3)) * [1.0, 1.0, 0.0], rng.normal(0, 25, 4)
    moment = np.column_stack([np.zeros((4, 2)), aligning])
    # At the wheel centres: of a longitudinal force the contact's moment is left to the half-shaft.
    loads = Loads(force, moment + np.column_stack([np.zeros(4), heights * force[:, 0], np.zeros(4)]))
    still, moved = of.solve(np.zeros(4)), of.solve(np.zeros(4), loads=loads)
    about = moment + np.column_stack([heights * force[:, 1], np.zeros((4, 2))])
    design = of.mechanism.design_attitudes
    zero, angles = (toe_camber_spin(shape.attitudes, design) for shape in (still, moved))
    found, bare = (
        standing(replace(vehicle, corners=one), -SIDE[:, None] * angles[:, :2], force, about)
        for one in (corners, {c: replace(k, joints=replace(k.joints, compliance=None)) for c, k in corners.items()})  # type: ignore[arg-type]
    )
    off = []
    for i, c in enumerate(CORNERS):
        shift, pitch = moved.centres[i] - still.centres[i], angles[i, 2] - zero[i, 2]
        start = np.asarray(vehicle.corners[c].position)
        np.testing.assert_allclose(found.corners[c].centre[:, 0] - start, shift, atol=2e-5)
        np.testing.assert_allclose(found.corners[c].pitch, pitch, atol=np.radians(0.01))
        off.append(np.max(np.abs(bare.corners[c].centre[:, 0] - start - shift)))
    assert max(off) > 3e-4
    work = np.array([found.measured(Row.parse(f"suspension.{c}"))[0] for c in CORNERS])
    np.testing.assert_allclose(work, still.held - moved.held, atol=1.0)
    assert np.max(np.abs(work)) > 30.0


def test_braked_carriers_pitch_as_the_mechanism_s_though_no_channel_shows_the_brakes() -> None:
    """To 0.15° of 1.2°: the rear wheels, which are not driven, show them. Declared off, most of it is lost in front."""
    run, design = drive("second", "braking", duration=1.6), statics("second").mechanism.design_attitudes
    at = np.flatnonzero(run.t >= 1.4)[::20]
    assert np.min(run.brake[at]) > 100.0
    vehicle = Vehicle.parse(vehicle_text(run.car), "second.toml")
    angles = np.array([toe_camber_spin(now, design) for now in run.attitudes[at]])
    spin = angles[:, :, 2] - toe_camber_spin(design, design)[:, 2]
    loads = -SIDE[:, None] * angles[:, :, :2], run.force[at], run.moment[at], run.travel[at]
    found, off = (standing(vehicle, *loads, brakes=brakes) for brakes in ("unknown", "off"))
    for i, c in enumerate(CORNERS):
        np.testing.assert_allclose(found.corners[c].pitch, spin[:, i], atol=np.radians(0.15))
    assert np.all(np.abs(off.corners["fl"].pitch - spin[:, 0]) > np.radians(0.5))


def standing(
    vehicle: Vehicle, angles: np.ndarray, force: np.ndarray, moment: np.ndarray, travel: np.ndarray | None = None,
    brakes: str = "off",
) -> Motion:  # fmt: skip
    """A car at rest with these steer and camber angles (N, 4, 2) and loads (N, 4, 3) in body axes.

    `travel` (N, 4) of its wheels, or its design height; of one position without the first dimension. `brakes` : as
    the run declares them.
    """
    angles, force, moment = (x if x.ndim == 3 else x[None] for x in (angles, force, moment))
    signals = cars.random_signals(1, len(force))
    rig = Rig.load("peugeot-406")
    body = {s.name: "body" for s in rig.sensors if any("force" in channel for channel in s.channels)}
    rig = cars.in_reference(rig, rig.wheel_reference, body)
    value = dict(signals.value)
    flat = build_motion(cars.recording(signals, vehicle, rig))
    for i, c in enumerate(CORNERS):
        down = 0.0 if travel is None else travel[:, i]
        value[f"laser.{c}.hub"] = value[f"laser.{c}.hub"] + flat.corners[c].travel - down
        value[f"camera.{c}.steer"], value[f"camera.{c}.camber"] = angles[None, :, i, 0], angles[None, :, i, 1]
        value[f"wheel.{c}.force"], value[f"wheel.{c}.moment"] = force[:, i].T, moment[:, i].T
    value.pop("brake.pressure", None)
    return build_motion(cars.recording(replace(signals, value=value), vehicle, rig, brakes=brakes))
