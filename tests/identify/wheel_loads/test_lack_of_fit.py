"""Lack of fit of a study: what neither noise nor parameters nor instruments within their sheet explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import compare
from lacet.identify.wheel_loads.lack_of_fit import known_car
from tests.identify import cars

_, RIG = cars.reference_car()


@pytest.fixture(scope="module")
def knowledge(fitted: Fit) -> Knowledge:
    """What the reference car's runs say of its parameters."""
    return Knowledge.of(fitted)


def lack(fitted: Fit, knowledge: Knowledge, run: PreparedRun) -> dict[str, float]:
    """Row → lack of fit on a run held out."""
    return dict(known_car(fitted, knowledge, [(run, compare(fitted, run, draws=8, knowledge=knowledge))]).lack)


def late(run: PreparedRun, channel: str, tolerances: float) -> PreparedRun:
    """Twelve seconds of a run, all channels of the sensor of one late by so many tolerances of its latency."""
    record = run.recording.at(slice(0, 1500))
    tolerance = record.rig.tolerance(channel, "latency")
    names = [name for name in record.signals.value if record.rig.sensor_of(name) == record.rig.sensor_of(channel)]
    assert tolerance > 0.0
    seconds = tolerances * tolerance
    moved = {
        name: np.stack([np.interp(record.t - seconds, record.t, series) for series in record.signals.value[name]])
        for name in names
    }
    signals = type(record.signals).differentiated({**record.signals.value, **moved}, record.filters.rate)
    return PreparedRun(replace(record, signals=signals))


def test_late_dynamometers_are_no_lack_of_fit(
    fitted: Fit, knowledge: Knowledge, drives: dict[str, PreparedRun]
) -> None:
    """They leave a residual far above the floor, of which hardly anything counts; a force that is missing counts."""
    record, run = drives["sweep"].recording.at(slice(0, 1500)), late(drives["sweep"], "wheel.fl.force", 2.0)
    score = compare(fitted, run, draws=8).scores["chassis.fy"]
    plain = float(np.sqrt(score.rms**2 - score.floor**2))
    assert plain > 0.5 * score.floor
    assert lack(fitted, knowledge, run)["chassis.fy"] < 0.3 * plain

    wrong = replace(fitted, theta=np.where(np.char.find(fitted.model.names, "anti_roll_bar") >= 0, 0.0, fitted.theta))
    missing = lack(wrong, knowledge, PreparedRun(record))
    assert missing["suspension.fl"] > 10.0 * lack(fitted, knowledge, PreparedRun(record))["suspension.fl"] + 50.0


@pytest.mark.parametrize("channel", ["wheel.fl.force", "laser.fl.hub"])
def test_runs_say_how_late_instruments_are_compared_with_each_other(
    fitted: Fit, knowledge: Knowledge, drives: dict[str, PreparedRun], channel: str
) -> None:
    """And not how late they all are: of that the tolerances alone say something."""

    def said(tolerances: float) -> tuple[dict[str, float], np.ndarray, list[str]]:
        run = late(drives["sweep"], channel, tolerances)
        found = known_car(fitted, knowledge, [(run, compare(fitted, run, draws=8, knowledge=knowledge))]).instruments
        assert found is not None
        covariance = np.linalg.inv(found.normal + np.eye(len(found.entries)))
        sensors = [str(RIG.sensor_of(channel).name) for _, channel, _ in found.entries]
        return dict(zip(sensors, covariance @ found.right, strict=True)), covariance, sensors

    (before, *_), (after, covariance, sensors) = said(0.0), said(2.0)
    moved, still = (RIG.sensor_of(one).name for one in (channel, "imu.accel"))
    at = [sensors.index(name) for name in (moved, still)]
    own = covariance[np.ix_(at, at)]
    apart = float(np.sqrt(own[0, 0] + own[1, 1] - 2.0 * own[0, 1]))
    assert apart < 0.5 * np.sqrt(2.0)
    assert (after[moved] - after[still]) - (before[moved] - before[still]) == pytest.approx(2.0, abs=2.0 * apart)
    assert np.sqrt(np.sum(own)) / 2.0 > 0.5
