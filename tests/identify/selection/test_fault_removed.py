"""A sensor fault that its first-order column does not tell is taken out of the runs by the fit with it."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.effects.base import SensorFault
from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.regression.wls import FitOptions, extended, fit
from lacet.identify.selection.diagnose import Diagnosis, diagnose
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.noise_floor import floor_of
from lacet.services.render.verdicts import says
from tests.identify.exact_car import KNOWN, MODEL, driven, exact, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES, DRAWS, HIDDEN, SIZE

HUB, CUBIC = "sensor_gain.hub.fl", "spring_cubic.front"


def scaled(record: Recording, by: float) -> Recording:
    """A front hub laser that reads so much too much of its distance."""
    fault = KNOWN[HUB]
    assert isinstance(fault, SensorFault)
    return recording_without_faults(record, [fault], np.array([1.0 / (1.0 + by) - 1.0]))


def diagnosed(record: Recording) -> Diagnosis:
    """What is said of a drive with noise."""
    fitted = fit_of(driven(record, 1))
    return diagnose(fitted, floor_of(fitted, DRAWS), CANDIDATES)


def holds(found: Diagnosis, by: float) -> bool:
    """Whether the laser's scale is proposed, with an interval that holds what it reads too much."""
    (scale,) = (c for c in found.found if c.key == HUB)
    return abs(scale.values[0] - by) <= scale.interval[0] < 0.3 * by


@pytest.mark.parametrize(
    ("k3", "by"),
    [pytest.param(0.0, 0.09, marks=pytest.mark.slow), pytest.param(1.0e6, 0.03, marks=pytest.mark.slow), (1.0e6, 0.09)],
)
def test_a_scale_is_named_that_first_order_does_not_tell(k3: float, by: float):
    """Alone, and beside a stiffening spring, for which a moved zero is another stiffness."""
    found = diagnosed(scaled(exact_with(KNOWN[CUBIC], k3) if k3 else exact(), by))
    assert {c.key for c in found.found} == ({HUB, CUBIC} if k3 else {HUB}), says(found)
    assert holds(found, by)
    assert not found.unlisted


@pytest.mark.parametrize("by", [0.03, pytest.param(0.05, marks=pytest.mark.slow)])
def test_a_scale_beside_a_cause_that_is_not_listed_leaves_it_unlisted(by: float):
    """What is not listed is told beside it."""
    found = diagnosed(scaled(exact_with(HIDDEN, (1.0 if by < 0.04 else 0.3) * SIZE), by))
    assert found.unlisted, says(found)
    assert set(found.unlisted_rows) & {"suspension.fl", "suspension.fr"}


def test_the_fit_beside_the_fault_is_as_the_one_before():
    """Without zeros or the bias of noise taken out where that was so, and with seconds that count less."""
    drive = driven(scaled(exact(), 0.05), 1)
    plain = fit(MODEL, [drive], FitOptions(zeros=False, unbias=False))
    beside = extended(plain, [KNOWN[HUB]])
    assert not beside.assembly.zeros
    assert not beside.options.zeros
    assert not np.any(beside.correction)
    assert not beside.assembly.weights
    assert KNOWN[HUB] in beside.model.effects
    robust = extended(fit(MODEL, [drive], FitOptions(robust=True, draws=2)), [KNOWN[HUB]])
    assert robust.assembly.weights
    assert robust.options.robust
    assert robust.assembly.zeros
    assert np.any(robust.correction)
