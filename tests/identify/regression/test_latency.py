"""Latencies from ordinary runs: a wrong rig file is put right, and what no run tells is said so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.errors import UsageError
from lacet.daq.formats.open_run import open_run
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.effects.sensors.sensor_latency import SensorLatency
from lacet.identify.regression.latency import TESTABLE, Timings, estimate_latencies, shifted_rig, time_base
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.services.render.sensor_report import not_testable
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
KNOWN = catalogue(VEHICLE, "hub")
BASE = Model.of(effect for effect in KNOWN.values() if effect.base)
BARS = BASE + KNOWN["anti_roll_bar.front"] + KNOWN["anti_roll_bar.rear"]
TRUE = {sensor.name: sensor.latency for sensor in RIG.sensors}


def errors(timings: Timings) -> dict[str, float]:
    """Latency found − true, of what is testable [s]."""
    return {one.sensor: one.found - TRUE[one.sensor] for one in timings.sensors if one.testable}


@pytest.fixture(scope="module")
def rough() -> Timings:
    """Ten seconds of rough road, with a rig file that is wrong by up to 20 ms."""
    wrong = shifted_rig(RIG, {"imu": 0.020, "lasers": -0.010})
    return estimate_latencies(BARS, [cars.piece("rough", 4.0, 14.0)], VEHICLE, wrong)


def test_a_wrong_rig_is_put_right_to_a_millisecond(rough: Timings) -> None:
    """Inertial unit and lasers against the wheel loads."""
    assert rough.base == "wheels"
    assert rough.settled
    found = errors(rough)
    assert set(found) == {"imu", "lasers"}
    for name, error in found.items():
        assert abs(error) < 0.001, (name, error)
    for one in rough.sensors:
        if one.testable:
            assert one.half < 0.001
            assert not one.agrees
            assert abs(one.found - TRUE[one.sensor]) < 2.0 * one.half
    latencies = {sensor.name: sensor.latency for sensor in rough.rig.sensors}
    assert latencies["lasers"] == pytest.approx(TRUE["lasers"], abs=0.001)


def test_what_the_run_does_not_tell_is_said(rough: Timings) -> None:
    """Straight ahead nothing is seen of the cameras; no row depends on the speed sensor. Both stay as they were."""
    by_name = {one.sensor: one for one in rough.sensors}
    assert not by_name["cameras"].testable
    assert by_name["cameras"].half > TESTABLE
    assert not_testable(by_name["cameras"]).startswith("± ")
    assert not_testable(by_name["correvit"]) == "no row of the model depends on it"
    latencies = {sensor.name: sensor.latency for sensor in rough.rig.sensors}
    for name in ("wheels", "cameras", "correvit"):
        assert latencies[name] == TRUE[name], name


def test_reading_again_is_what_the_fault_takes_out() -> None:
    """The fault of a rig's row, corrected, is the run read with another latency: all channels, those alone."""
    run = cars.piece("sine", 4.0, 12.0)
    lasers = next(sensor for sensor in RIG.sensors if sensor.name == "lasers")
    fault = SensorLatency.of_sensor(lasers)
    assert fault.channels() == lasers.channels
    drive = PreparedRun.of(run, VEHICLE, RIG)
    late = PreparedRun.of(run, VEHICLE, shifted_rig(RIG, {"lasers": 0.010}))
    rate = drive.recording.filters.rate
    lag = round((late.recording.t[0] - drive.recording.t[0]) * rate)
    n = late.recording.t.size
    for channel, value in drive.recording.signals.value.items():
        other = late.recording.signals.value[channel][:, 100:-100]
        moved = fault.correct(channel, drive.recording, 0.010) if channel in fault.channels() else value
        np.testing.assert_allclose(
            other, moved[:, lag : lag + n][:, 100:-100], atol=1e-5 * np.ptp(value) + 1e-9, err_msg=channel
        )


def test_the_time_base_is_the_loads_sensor_or_the_one_named() -> None:
    """Loads first; a wrong name is answered with the right ones."""
    run = cars.piece("sine", 4.0, 10.0)
    assert time_base(RIG, [run]) == "wheels"
    bare = replace(run, signals={n: s for n, s in run.signals.items() if not n.startswith("wheel.")})
    assert time_base(RIG, [bare]) == "imu"
    with pytest.raises(UsageError, match="did you mean 'lasers'"):
        estimate_latencies(BARS, [run], VEHICLE, RIG, base="laser")


@pytest.mark.slow
def test_thirty_milliseconds_off_in_every_sensor() -> None:
    """From far away, with steering and a rough road, to 0.5 ms; the other time base tells the same."""
    runs = [open_run(cars.CAR / f"{name}.parquet") for name in ("sine", "rough")]
    wrong = shifted_rig(RIG, {"imu": 0.030, "lasers": -0.020, "cameras": 0.030})
    found = estimate_latencies(BARS, runs, VEHICLE, wrong)
    assert found.settled
    for name, error in errors(found).items():
        assert abs(error) < 0.0005, (name, error)
    assert {"imu", "lasers"} <= set(errors(found))
    other = estimate_latencies(BARS, runs, VEHICLE, shifted_rig(RIG, {"wheels": 0.010}), base="imu")
    assert abs(errors(other)["wheels"]) < 0.0005
    assert abs(errors(other)["lasers"]) < 0.0005
