"""Faults of the inertial unit and the speed sensor, from how these agree, whatever forces act on the car."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from lacet.daq.rig import Rig, Sensor
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import SensorFault
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY
from lacet.identify.multibody.vectors import Array, cross, turn
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.validation.channels.speed_agreement import AgreeingSize, SpeedAgreement, disagreement
from tests.identify.exact_car import driven, exact
from tests.support.tables import CAR, piece, without

RIG, VEHICLE = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")
KNOWN = catalogue(VEHICLE, "hub")
SIGNIFICANCE = 0.01


def drive(name: str, faulty: dict[str, float] | None = None, *gone: str) -> PreparedRun:
    """Ten seconds and more of the reference car, with faults of these sizes."""
    run = PreparedRun.of(without(piece(name, 2.0, 22.0), *gone), VEHICLE, RIG)
    faults = [fault for key in faulty or {} if (fault := KNOWN[key].as_fault)]
    taken = np.array([-size for size in (faulty or {}).values()])
    return PreparedRun(recording_without_faults(run.recording, faults, taken)) if faulty else run


def agreement(faulty: dict[str, float] | None = None) -> SpeedAgreement:
    found = SpeedAgreement.of([drive(name, faulty) for name in ("sine", "rough", "liftoff")])
    assert found is not None
    return found


def test_sound_instruments_agree_within_their_noise_and_the_sheet() -> None:
    found = agreement()
    assert not found.beyond_sheet(SIGNIFICANCE)
    assert 0.1 < found.products[-1, -1] / found.count < 1.5
    for fault, bound in zip(found.faults, found.bounds, strict=True):
        one = found.sizes([fault.key])[fault.key]
        assert len(found.faults) * one.chance(tolerance=float(bound)) > SIGNIFICANCE, fault.key


@pytest.mark.parametrize(
    ("key", "size"),
    [
        ("sensor_misalignment.imu.pitch", 0.07),
        ("sensor_misalignment.imu.yaw", 0.08),
        ("sensor_position.imu.x", 0.4),
        ("sensor_gain.accel.y", -0.05),
        ("sensor_gain.rate.z", 0.05),
        ("sensor_latency.imu", 0.02),
    ],
)
def test_a_fault_is_found_with_its_size(key: str, size: float) -> None:
    found = agreement({key: size})
    assert found.beyond_sheet(SIGNIFICANCE)[0].key == key
    one = found.sizes([key])[key]
    assert abs(one.value - size) < 3.0 * one.sigma + 0.02 * abs(size)
    assert one.sigma < 0.25 * abs(size)
    assert one.chance(size) > 1e-3
    assert one.chance() < 1e-4


def test_two_faults_are_found_together() -> None:
    hidden = {"sensor_misalignment.imu.pitch": 0.07, "sensor_gain.accel.y": -0.06}
    found = agreement(hidden)
    assert {fault.key for fault in found.beyond_sheet(SIGNIFICANCE)} == set(hidden)
    for key, one in found.sizes(list(hidden)).items():
        assert abs(one.value - hidden[key]) < 3.0 * one.sigma + 0.02 * abs(hidden[key]), key


def test_wheel_loads_do_not_enter() -> None:
    run = drive("sine")
    signals = run.recording.signals
    loads = {name: 2.0 * value for name, value in signals.value.items() if name.startswith("wheel.")}
    other = run.recording.with_signals(replace(signals, value={**signals.value, **loads}))
    assert np.array_equal(disagreement(run.recording), disagreement(other))


@pytest.mark.parametrize("gone", ["imu.attitude", "correvit.speed", "imu.accel"])
def test_without_one_of_the_channels_there_is_nothing_to_compare(gone: str) -> None:
    assert SpeedAgreement.of([drive("sine", None, gone)]) is None


def test_instruments_that_do_not_measure_the_same_motion_are_not_compared() -> None:
    assert SpeedAgreement.of([driven(exact(), 1)]) is None


def test_runs_without_them_are_left_out() -> None:
    whole, one = drive("sine"), SpeedAgreement.of([drive("sine"), drive("rough", None, "correvit.speed")])
    alone = SpeedAgreement.of([whole])
    assert one is not None
    assert alone is not None
    assert np.array_equal(one.products, alone.products)


def test_what_is_not_usable_does_not_count() -> None:
    run = drive("sine")
    recording = run.recording
    value, usable = dict(recording.signals.value), dict(recording.usable)
    bad = (recording.t > recording.t[0] + 8.0) & (recording.t < recording.t[0] + 8.5)
    value["correvit.speed"] = np.where(bad, 0.0, value["correvit.speed"])
    usable["correvit.speed"] = usable["correvit.speed"] & ~np.convolve(bad, np.ones(2 * 94 + 1), "same").astype(bool)
    spoilt = replace(recording, usable=usable).with_signals(recording.signals.changed(value, recording.filters.rate))
    found = SpeedAgreement.of([PreparedRun(spoilt)])
    assert found is not None
    assert not found.beyond_sheet(SIGNIFICANCE)


def test_a_long_run_in_pieces_says_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """But for the noise that is drawn: the same for both here."""
    run, module = drive("sine", {"sensor_position.imu.x": 0.4}), "lacet.identify.validation.channels.speed_agreement"
    monkeypatch.setattr(
        f"{module}._noise_squares", lambda piece, before, kept: np.full(2, 0.01 * np.count_nonzero(kept))
    )
    whole = SpeedAgreement.of([run])
    monkeypatch.setattr(f"{module}.PIECE", 5.0)
    parts = SpeedAgreement.of([run])
    assert whole is not None
    assert parts is not None
    assert parts.count == whole.count
    scale = np.sqrt(np.diag(whole.products)) + 1e-12
    assert np.allclose(parts.products / np.outer(scale, scale), whole.products / np.outer(scale, scale), atol=1e-6)


def test_a_run_without_a_usable_sample_is_left_out() -> None:
    recording = drive("sine").recording
    nothing = {name: np.zeros(recording.t.size, bool) for name in recording.signals.value}
    assert SpeedAgreement.of([PreparedRun(replace(recording, usable=nothing))]) is None


@pytest.mark.parametrize("axes", ["sensor", "heading"])
def test_a_body_that_is_pitched_and_rolls_at_constant_speed_agrees(axes: str) -> None:
    """Exactly: its velocity along the road has a part along its own z, which turns with the roll."""
    sensors = tuple(replace(one, axes=axes) if one.name == "correvit" else one for one in RIG.sensors)
    recording = replace(drive("sine").recording, rig=replace(RIG, sensors=sensors))
    pitch, t = 0.05, recording.t - recording.t[0]
    roll, rate, accel = (0.05 * f for f in (np.sin(4.0 * t), 4.0 * np.cos(4.0 * t), -16.0 * np.sin(4.0 * t)))
    zero, one = np.zeros_like(t), np.ones_like(t)

    def in_body(x: Array) -> Array:
        return turn(0, -roll, turn(1, np.full_like(t, -pitch), x))

    omega, omega_dot = np.stack([rate, zero, zero]), np.stack([accel, zero, zero])
    unit, speed = (np.array(_sensor(name).position[""])[:, None] * one for name in ("imu.accel", "correvit.speed"))
    velocity = in_body(np.stack([20.0 * one, zero, zero])) + cross(omega, speed)
    if axes == "heading":
        velocity = turn(1, np.full_like(t, pitch), turn(0, roll, velocity))
    force = in_body(np.stack([zero, zero, STANDARD_GRAVITY * one]))
    value = {
        "imu.rate": omega,
        "imu.accel": force + cross(omega_dot, unit) + cross(omega, cross(omega, unit)),
        "imu.attitude": np.stack([roll, pitch * one, zero]),
        "correvit.speed": velocity[:2],
    }
    assert {_sensor(name).orientation for name in value} == {(0.0, 0.0, 0.0)}
    found = disagreement(recording, recording.signals.changed(value, recording.filters.rate))
    assert np.max(np.abs(found[:, 8:-8])) < 2e-3


def _sensor(channel: str) -> Sensor:
    sensor = RIG.sensor_of(channel)
    assert sensor is not None
    return sensor


def test_without_noise_in_the_sheet_there_is_no_weight(monkeypatch: pytest.MonkeyPatch) -> None:
    run = drive("sine")
    monkeypatch.setattr(Rig, "noise", lambda rig, channel: 0.0)
    assert SpeedAgreement.of([run]) is None


def test_a_size_is_no_better_known_than_what_remains_allows() -> None:
    """Within noise and tolerance it is chance; four times the noise's squares make it half as well known."""
    fault = KNOWN["sensor_gain.accel.x"].as_fault
    assert fault is not None
    prior = fault.parameters[0].prior ** -2.0
    for remains in (0.25, 1.0, 4.0):
        square = 100.0 * remains + 30.0**2 / (1.0e4 + prior)
        one = SpeedAgreement((fault,), np.zeros(1), np.array([[1.0e4, 30.0], [30.0, square]]), 100)
        size = one.sizes([fault.key])[fault.key]
        assert size.sigma == pytest.approx(max(1.0, remains) ** 0.5 * (1.0e4 + prior) ** -0.5)
    assert AgreeingSize(0.3, 0.1).chance() == pytest.approx(2.0 * norm.sf(3.0))
    assert AgreeingSize(0.3, 0.06).chance(0.1, 0.08) == pytest.approx(2.0 * norm.sf(2.0))


def test_every_fault_is_of_these_instruments() -> None:
    found = agreement()
    assert {fault.key for fault in found.faults} >= {"sensor_gain.speed", "sensor_latency.correvit"}
    for fault in found.faults:
        assert isinstance(fault, SensorFault)
        assert {name.partition(".")[0] for name in fault.channels()} <= {"imu", "correvit"}
    assert found.sizes(["sensor_gain.hub.fl"]) == {}
