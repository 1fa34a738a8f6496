"""Lack of fit of a study: what neither noise nor parameters nor instruments within their sheet explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import compare
from lacet.identify.wheel_loads.lack_of_fit import lack_of_fit
from lacet.identify.wheel_loads.without_dynamometers import LOADS


@pytest.fixture(scope="module")
def knowledge(fitted: Fit) -> Knowledge:
    """What the reference car's runs say of its parameters."""
    return Knowledge.of(fitted)


def lack(fitted: Fit, knowledge: Knowledge, run: PreparedRun) -> dict[str, float]:
    """Row → lack of fit on a run held out."""
    return dict(lack_of_fit(fitted, knowledge, [(run, compare(fitted, run, draws=8, knowledge=knowledge))]))


def test_late_dynamometers_are_no_lack_of_fit(
    fitted: Fit, knowledge: Knowledge, drives: dict[str, PreparedRun]
) -> None:
    """They leave a residual far above the floor, of which hardly anything counts; a force that is missing counts."""
    record = drives["sweep"].recording.at(slice(0, 1500))
    late = 2 * record.rig.tolerance(LOADS[0], "latency")
    assert late > 0.0
    moved = {
        name: np.stack([np.interp(record.t - late, record.t, series) for series in record.signals.value[name]])
        for name in LOADS
    }
    signals = type(record.signals).differentiated({**record.signals.value, **moved}, record.filters.rate)
    run = PreparedRun(replace(record, signals=signals))
    score = compare(fitted, run, draws=8).scores["chassis.fy"]
    plain = float(np.sqrt(score.rms**2 - score.floor**2))
    assert plain > 0.5 * score.floor
    assert lack(fitted, knowledge, run)["chassis.fy"] < 0.3 * plain

    wrong = replace(fitted, theta=np.where(np.char.find(fitted.model.names, "anti_roll_bar") >= 0, 0.0, fitted.theta))
    missing = lack(wrong, knowledge, PreparedRun(record))
    assert missing["suspension.fl"] > 10.0 * lack(fitted, knowledge, PreparedRun(record))["suspension.fl"] + 50.0
