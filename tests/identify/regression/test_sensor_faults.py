"""Faults of the instruments: taken out again to second order, and what an instrument that is really off would read."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.rig import DEFAULT_TOLERANCE
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.road import laser_mount
from lacet.identify.effects.base import SensorFault
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.signals.reconstruct import Recording, Signals
from tests.identify import cars
from tests.identify.cars import RATE

VEHICLE, RIG = cars.reference_car()
VEHICLE_T = cars.with_tables(VEHICLE)
FAULTS = {key: e for key, e in catalogue(VEHICLE_T, "hub").items() if isinstance(e, SensorFault)}


def smooth_recording() -> Recording:
    """A drive with steady derivatives, sensors mounted askew: their axes are not the body's."""
    curves = cars.drive_curves(np.random.default_rng(3), (0.15, 2.0))
    curves |= {name: cars.MultiSine(np.random.default_rng(4), 3, 500.0, (100.0, 50.0, 3000.0)) for name in cars.LOADS}
    curves |= {"correvit.speed": cars.MultiSine(np.random.default_rng(6), 2, 2.0, (22.0, 1.0), (0.15, 2.0))}
    t = np.arange(round(3.2 * RATE)) / RATE
    signals = Signals.differentiated({name: curve.at(t) for name, curve in curves.items()}, RATE)
    sensors = tuple(
        replace(s, orientation=(0.03, -0.05, 1.4)) if s.axes == "sensor" and "imu.accel" in s.channels else s
        for s in RIG.sensors
    )
    return cars.recording(signals, VEHICLE, replace(RIG, sensors=sensors))


RECORD = smooth_recording()


@pytest.mark.parametrize("key", FAULTS)
def test_a_fault_is_taken_out_again(key: str) -> None:
    """`correct` undoes `perturb` to second order: half the fault leaves a quarter of the error."""
    fault, record = FAULTS[key], RECORD
    values, rate = record.signals.value, record.filters.rate
    there = [channel for channel in fault.channels() if channel in values]
    assert there
    assert len(fault.parameters) == 1, "a fault has one parameter"
    assert DEFAULT_TOLERANCE.keys() & {fault.tolerance, *(_sheet(channel, fault.tolerance) for channel in there)}
    (parameter,) = fault.parameters
    assert RIG.tolerance(there[0], fault.tolerance) <= parameter.largest
    inner, errors = slice(50, -50), []
    big = min(0.005, 0.2 * parameter.largest)
    for p in (big, 0.5 * big):
        faulty = {channel: values[channel] + p * fault.perturb(channel, record) for channel in there}
        wrong = record.with_signals(record.signals.changed(faulty, rate))
        off = [np.max(np.abs(fault.correct(c, wrong, p) - values[c])[:, inner]) for c in there]
        moved = [np.max(np.abs(faulty[c] - values[c])[:, inner]) for c in there]
        assert max(moved) > 0
        errors.append(max(o / (m + 1e-12) for o, m in zip(off, moved, strict=True) if m > 0))
    # Relative to the fault: first order in p, or nothing at all but what differences leave of smooth signals.
    assert errors[1] < max(0.6 * errors[0], 1e-6), errors
    assert errors[0] < 0.7


def _sheet(channel: str, what: str) -> str:
    family = CHANNELS[channel].family
    return f"{family.partition('.')[0] if what in ('misalignment', 'position') else family}.{what}"


def test_units_of_faults_are_the_sensor_sheets() -> None:
    """A tolerance is the prior of a fault's parameter: both have one unit."""
    units = {"gain": "-", "crosstalk": "-", "latency": "s", "misalignment": "rad", "position": "m"}
    for key, fault in FAULTS.items():
        (parameter,) = fault.parameters
        drift = f"{CHANNELS[fault.channels()[0]].unit}/min"
        assert parameter.unit == (drift if fault.tolerance == "drift" else units[fault.tolerance]), key


def test_drift_goes_on_from_piece_to_piece() -> None:
    """A piece of a long run has the drift of its place in the run."""
    fault = FAULTS["sensor_drift.wheel.fl.force.z"]
    whole = fault.perturb("wheel.fl.force", replace(RECORD, t=RECORD.t + 3.0, start=3.0))
    assert whole[2, 0] == 0.0
    assert whole[2, -1] == pytest.approx(RECORD.t[-1] / 60.0)
    assert not np.any(whole[:2])
    piece = replace(RECORD, t=RECORD.t + 3.0, start=3.0).at(slice(300, 500))
    np.testing.assert_array_equal(fault.perturb("wheel.fl.force", piece), whole[:, 300:500])
    assert COLUMNS[fault.where][0].name == "wheel.fl.force"


def test_a_turned_inertial_unit_is_a_rig_with_another_orientation() -> None:
    """`correct` gives what the rig file with the unit's true orientation gives; so does it for a position."""
    from scipy.spatial.transform import Rotation

    sensor = RECORD.rig.sensor_of("imu.accel")
    assert sensor is not None
    turn = Rotation.from_euler("z", 0.02) * Rotation.from_euler("xyz", sensor.orientation)
    truly = replace(sensor, orientation=tuple(turn.as_euler("xyz")))
    fault = FAULTS["sensor_misalignment.imu.yaw"]
    _same_body(fault, 0.02, truly)
    place = np.add(sensor.position[""], (0.0, 0.03, 0.0))
    _same_body(FAULTS["sensor_position.imu.y"], 0.03, replace(sensor, position={"": tuple(place)}))


def _same_body(fault: SensorFault, p: float, truly: Any) -> None:
    mended = {c: fault.correct(c, RECORD, p) for c in fault.channels()}
    by_fault = build_motion(RECORD.with_signals(RECORD.signals.changed(mended, RECORD.filters.rate)))
    rig = replace(RECORD.rig, sensors=tuple(truly if s.name == truly.name else s for s in RECORD.rig.sensors))
    by_rig = build_motion(replace(RECORD, rig=rig))
    np.testing.assert_allclose(by_fault.body.accel, by_rig.body.accel, atol=1e-9)
    np.testing.assert_allclose(by_fault.body.omega, by_rig.body.omega, atol=1e-12)
    assert by_fault.attitude is not None
    assert by_rig.attitude is not None
    np.testing.assert_allclose(by_fault.attitude, by_rig.attitude, atol=1e-9)


@pytest.mark.parametrize("where", ["pitch", "roll"])
def test_a_tilted_laser_reads_along_its_beam(where: str) -> None:
    """The reading of a beam that is turned, from the plane of the road, against the law of first order."""
    fault, p = FAULTS[f"laser_tilt.{where}"], 1e-4
    straight, tilted = _above_a_road(where, p)
    for channel, value in straight.items():
        found = value + p * fault.perturb(channel, _recorded(straight))
        np.testing.assert_allclose(found, tilted[channel], atol=1e-3 * np.max(np.abs(tilted[channel] - value)) + 1e-12)


@pytest.mark.parametrize("p", [-0.15, 0.15])
@pytest.mark.parametrize("where", ["pitch", "roll"])
def test_a_laser_tilted_by_8_degrees_is_turned_back(where: str, p: float) -> None:
    """The first order leaves 1 % of the height. The road's slope, read by the tilted lasers, is off by 2 %."""
    fault = FAULTS[f"laser_tilt.{where}"]
    straight, tilted = _above_a_road(where, p)
    for channel, value in straight.items():
        np.testing.assert_allclose(fault.correct(channel, _recorded(tilted), p), value, rtol=1e-3)


def _above_a_road(where: str, p: float) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Ground lasers above a sloping plane 0.3 m below the car, looking straight down and turned by p."""
    beam = np.array([-np.sin(p), 0.0, -np.cos(p)]) if where == "pitch" else np.array([0.0, np.sin(p), -np.cos(p)])
    rng = np.random.default_rng(0)
    slope, n = rng.normal(0.0, 0.05, 2), 5
    straight: dict[str, np.ndarray] = {}
    tilted: dict[str, np.ndarray] = {}
    for c, corner in VEHICLE.corners.items():
        road = np.array([-slope[0], -slope[1], 1.0])  # normal of z = slope·(x, y) − 0.3
        height = road @ laser_mount(RIG, corner) + 0.3
        straight[f"laser.{c}.ground"] = np.full((1, n), height)
        tilted[f"laser.{c}.ground"] = np.full((1, n), -height / (road @ beam))
    return straight, tilted


def _recorded(values: dict[str, np.ndarray]) -> Recording:
    return cars.recording(Signals.differentiated(values, RATE), VEHICLE, RIG)
