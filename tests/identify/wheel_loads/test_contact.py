"""The unknown forces and the loads they make: identities, without any run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.errors import NotIdentifiable
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.effects.base import AXLES
from lacet.identify.multibody.vectors import cross, dot
from lacet.identify.wheel_loads.measured_forces import forces_of
from lacet.identify.wheel_loads.outputs import SUMS
from lacet.identify.wheel_loads.run_constants import information, per_wheel_mass
from lacet.identify.wheel_loads.settings import STANDARD
from lacet.identify.wheel_loads.tyre_contact import UNKNOWNS, AxleDifference, TyreContact, with_loads
from lacet.identify.wheel_loads.without_dynamometers import LOADS, placed, rows_of
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
VEHICLE = cars.with_tables(VEHICLE)


def motion_of(seed: int, reference: str = "contact") -> Motion:
    rig = cars.in_reference(RIG, reference, {"wheels": "body"})
    return build_motion(cars.recording(cars.random_signals(seed), VEHICLE, rig))


def contact_of(motion: Motion) -> TyreContact:
    values = np.random.default_rng(5).uniform(1500.0, 4500.0, (len(UNKNOWNS), motion.t.size))
    return TyreContact(motion, VEHICLE.corners, STANDARD, {}).divided(values)


def test_the_forces_of_the_loads_are_the_unknowns() -> None:
    motion = motion_of(1)
    values = np.random.default_rng(2).normal(0.0, 1000.0, (len(UNKNOWNS), motion.t.size))
    loads = contact_of(motion).loads(values)
    np.testing.assert_allclose(forces_of(with_loads(motion, loads)), SUMS @ values, atol=1e-8)


def test_a_load_acts_at_the_contact_with_trail_and_rolling_resistance() -> None:
    motion = motion_of(3)
    contact = contact_of(motion)
    for c in CORNERS:
        axes, load = contact.axes[c], contact.load(c, 300.0, 2000.0, 4000.0)
        about_contact = load.moment - cross(axes.arm, load.force)
        np.testing.assert_allclose(dot(about_contact, axes.z), -STANDARD.trail.mean * 2000.0)
        rolling = -STANDARD.rolling.mean * 4000.0 * axes.radius * np.tanh(motion.corners[c].spin)
        np.testing.assert_allclose(dot(about_contact, axes.y), rolling)
        np.testing.assert_allclose(dot(about_contact, axes.x), 0.0, atol=1e-9)


def test_what_is_assumed_changes_no_force_of_an_axle() -> None:
    motion = motion_of(4)
    values = np.random.default_rng(6).uniform(500.0, 4500.0, (len(UNKNOWNS), motion.t.size))
    contact = contact_of(motion)
    names: set[str] = set()
    for one in contact.assumptions(values, CORNERS):
        names.add(one.name)
        np.testing.assert_allclose(forces_of(with_loads(motion, one.loads)), 0.0, atol=1e-8, err_msg=one.name)
        assert one.sigma > 0.0
        assert np.any(contact.in_rows(one.loads, ROWS) != 0.0), one.name
    assert len(names) == 1 + 5 * len(AXLES) + 5 * len(CORNERS)


def test_a_released_brake_drags_on_its_wheel_and_on_no_chassis_row() -> None:
    """In a suspension row without the half-shaft's torque, which the spin row gave, it stands with the wheel's turning
    per travel, of the axle's other wheel as well.
    """
    vehicle = cars.with_joints(VEHICLE)
    driven = replace(vehicle, corners={c: replace(one, driven=True) for c, one in vehicle.corners.items()})
    motion = build_motion(cars.recording(cars.random_signals(11), driven, RIG))
    contact = TyreContact(motion, driven.corners, STANDARD, {})
    wheel, drag = motion.corners["fl"], np.tanh(motion.corners["fl"].spin)
    brake = next(
        one for one in contact.assumptions(np.ones((8, motion.t.size)), ()) if one.name == "released brake, fl"
    )
    in_rows = dict(zip(motion.rows, contact.in_rows(brake.loads, motion.rows), strict=True))
    assert wheel.other_dphi_ds is not None
    turning = {Row("spin.fl"): -1.0, Row("suspension.fl"): dot(wheel.spin_axis, wheel.dphi_ds)}
    turning[Row("suspension.fr")] = dot(wheel.spin_axis, wheel.other_dphi_ds)
    for row, change in in_rows.items():
        np.testing.assert_allclose(change, turning.get(row, 0.0) * drag, atol=1e-12, err_msg=str(row))
    assert np.all(np.abs(in_rows[Row("suspension.fr")]) > 0.01)
    constant = contact.in_rows(contact.constant(), ROWS)
    np.testing.assert_allclose(constant[ROWS.index(Row("spin.fl"))], -STANDARD.brake_drag.mean * drag)


def test_a_measured_brake_torque_contains_the_drag() -> None:
    signals = cars.random_signals(12)
    measured = {f"brake.{c}.torque": np.full((1, 40), 50.0) for c in CORNERS}
    signals = replace(signals, value={**signals.value, **measured})
    motion = build_motion(cars.recording(signals, VEHICLE, RIG, brakes="on"))
    contact = TyreContact(motion, VEHICLE.corners, STANDARD, {})
    np.testing.assert_allclose(contact.in_rows(contact.constant(), ROWS), 0.0, atol=1e-12)


def test_a_mass_at_a_wheel_is_a_body_in_every_row() -> None:
    """At rest on a level road a kilogram more is its weight, in the suspension row and in those of the chassis."""
    motion = motion_of(7)
    rows = [Row("chassis.fz"), Row("chassis.mx"), Row("suspension.fl"), Row("suspension.fr"), Row("tyre.fl")]
    wheel = motion.corners["fl"]
    found = per_wheel_mass(motion, "fl", rows)
    np.testing.assert_allclose(found[0], wheel.centre_accel[2])
    np.testing.assert_allclose(found[1], cross(wheel.centre, wheel.centre_accel)[0])
    np.testing.assert_allclose(found[2], dot(wheel.centre_accel, wheel.dp_ds))
    assert not np.any(found[3:])
    outboard = per_wheel_mass(replace(motion, reference="hub"), "fl", rows)
    assert not np.any(outboard[:4])
    np.testing.assert_allclose(outboard[4], -dot(wheel.centre_accel, wheel.normal))


def test_the_constants_are_those_of_one_large_least_squares() -> None:
    """Eliminating the unknowns of every instant gives what all equations together give."""
    rng = np.random.default_rng(8)
    n, rows, q = 6, 12, 5
    axles, off = AxleDifference(np.zeros(n), rng.uniform(0.5, 0.9, n)), rng.normal(size=n)
    C, K, rest = rng.normal(size=(n, rows, q)), rng.normal(size=(n, rows, len(UNKNOWNS))), rng.normal(size=(n, rows))
    weight = rng.uniform(0.5, 2.0, (n, rows))
    weight[2, 3] = 0.0
    normal, right = information(C, K, rest, weight, axles, off)
    found = np.linalg.solve(normal + np.eye(q), right)
    lines, sides = [np.eye(q + n * len(UNKNOWNS))[:q]], [np.zeros(q)]
    priors = np.linalg.cholesky(axles.equations()[1]).transpose(0, 2, 1)
    sides_of_prior = np.linalg.solve(priors.transpose(0, 2, 1), axles.equations()[0][..., None])[..., 0] * off[:, None]
    for i in range(n):
        own = np.zeros((rows + len(UNKNOWNS), q + n * len(UNKNOWNS)))
        place = slice(q + i * len(UNKNOWNS), q + (i + 1) * len(UNKNOWNS))
        root = np.sqrt(weight[i])[:, None]
        own[:rows, :q], own[:rows, place], own[rows:, place] = root * C[i], root * K[i], priors[i]
        lines.append(own)
        sides.append(np.concatenate([-root[:, 0] * rest[i], -sides_of_prior[i]]))
    every = np.linalg.lstsq(np.concatenate(lines), np.concatenate(sides), rcond=None)[0]
    np.testing.assert_allclose(found, every[:q], rtol=1e-7)


@pytest.mark.parametrize("along", [2000.0, -8000.0])
def test_driven_wheels_drive_and_all_wheels_brake_by_their_loads(along: float) -> None:
    """Of a car with driven front wheels the assumed difference of the axles is all of a drive, a part of braking."""
    contact = contact_of(motion_of(4))
    vehicle = {c: replace(corner, driven=c[0] == "f") for c, corner in contact.vehicle.items()}
    contact = TyreContact(contact.motion, vehicle, contact.assumed, contact.outboard)
    at = dict.fromkeys(UNKNOWNS, 0.0) | {"z.fl": 4000.0, "z.fr": 4000.0, "z.rl": 1000.0, "z.rr": 1000.0}
    values = np.array(list((at | {"x.front": along, "x.rear": 0.0}).values()))[:, None]
    difference = contact.divided(values * np.ones(contact.motion.t.size)).difference
    np.testing.assert_allclose(difference.mean, along if along > 0.0 else 0.6 * along)
    np.testing.assert_allclose(difference.sigma, 300.0 + 0.3 * abs(along))
    np.testing.assert_allclose(difference.off(values), along - difference.mean)


def test_what_is_lacking_is_named_with_what_to_add() -> None:
    record = cars.recording(cars.random_signals(9, 200), VEHICLE, RIG)
    assert set(rows_of(placed(record, {}), ROWS)) >= {Row("chassis.fz"), Row("suspension.fl")}
    values = {k: v for k, v in record.signals.value.items() if k not in (*LOADS, "camera.rl.steer", "laser.fr.ground")}
    poor = replace(record, signals=replace(record.signals, value=values))
    with pytest.raises(NotIdentifiable, match=r"exact: .* the least to be added: camera\.rl\.steer$"):
        rows_of(placed(poor, {}), ROWS)
    with pytest.raises(NotIdentifiable, match=r"neither suspension\.rr nor tyre\.rr"):
        rows_of(placed(record, {}), [row for row in ROWS if row not in ("suspension.rr", "tyre.rr")])
    with pytest.raises(NotIdentifiable, match=r"not identified chassis\.mz: its runs need dynamometers"):
        rows_of(placed(record, {}), [row for row in ROWS if row != "chassis.mz"])
