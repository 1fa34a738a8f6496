"""A sensor fault that its first-order column does not tell is taken out of the runs before more is called unlisted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.effects.base import SensorFault
from lacet.identify.progress import silent
from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.regression.wls import FitOptions, extended, fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import Diagnosis, diagnose, screen
from lacet.identify.selection.relinearisation import without_fault
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.noise_floor import floor_of
from lacet.services.render.progress import in_words
from lacet.services.render.verdicts import says
from tests.identify.exact_car import KNOWN, MODEL, driven, exact, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES, DRAWS, HIDDEN, SIZE

HUB, CUBIC = "sensor_gain.hub.fl", "spring_cubic.front"
REMOVED = f"the runs read again with {HUB} removed"


def scaled(record: Recording, by: float) -> Recording:
    """A front hub laser that reads so much too much of its distance."""
    fault = KNOWN[HUB]
    assert isinstance(fault, SensorFault)
    return recording_without_faults(record, [fault], np.array([1.0 / (1.0 + by) - 1.0]))


def diagnosed(record: Recording) -> tuple[Diagnosis, list[str]]:
    """What is said of a drive with noise, and what was told on the way."""
    said: list[str] = []
    fitted = fit_of(driven(record, 1))
    return diagnose(fitted, floor_of(fitted, DRAWS), CANDIDATES, progress=in_words(said.append)), said


def holds(found: Diagnosis, by: float) -> bool:
    """Whether the laser's scale is proposed, with an interval that holds what it reads too much."""
    assert found.best is not None, says(found)
    assert found.best.key == HUB
    return abs(found.best.values[0] - by) <= found.best.interval[0] < 0.3 * by


@pytest.mark.parametrize(
    ("k3", "by"),
    [pytest.param(0.0, 0.09, marks=pytest.mark.slow), pytest.param(1.0e6, 0.03, marks=pytest.mark.slow), (1.0e6, 0.09)],
)
def test_a_scale_is_named_that_first_order_does_not_tell(k3: float, by: float):
    """Alone, and beside a stiffening spring, for which a moved zero is another stiffness."""
    found, said = diagnosed(scaled(exact_with(KNOWN[CUBIC], k3) if k3 else exact(), by))
    assert REMOVED in said
    assert found.verdict == "missing"
    assert holds(found, by)
    assert found.explained > 0.75
    assert found.together[0] == HUB
    assert (CUBIC in found.together) == bool(k3)


@pytest.mark.parametrize("by", [0.03, pytest.param(0.05, marks=pytest.mark.slow)])
def test_a_scale_beside_a_cause_that_is_not_listed_leaves_it_unlisted(by: float):
    """Of what fails it explains less than may stay, once it is taken out."""
    found, said = diagnosed(scaled(exact_with(HIDDEN, (1.0 if by < 0.04 else 0.3) * SIZE), by))
    assert REMOVED in said
    assert found.verdict == "unlisted cause"
    assert found.best is None


def test_a_large_scale_is_named_before_a_small_cause_that_is_not_listed():
    """It takes all but a twentieth; what stays is told once it is in the model."""
    found, said = diagnosed(scaled(exact_with(HIDDEN, 0.3 * SIZE), 0.09))
    assert REMOVED in said
    assert found.verdict == "missing"
    assert holds(found, 0.09)
    assert found.together == (HUB,)


@pytest.mark.parametrize(("size", "by"), [(SIZE, 0.0), (0.0, 0.03)])
def test_runs_are_not_read_again_for_laws_or_where_columns_tell_enough(size: float, by: float):
    """A law that is in no catalogue; and a scale that is named at once."""
    found, said = diagnosed(scaled(exact_with(HIDDEN, size) if size else exact(), by))
    assert not any("removed" in line for line in said)
    assert (found.best is None) == bool(size)


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


def test_latencies_that_were_taken_out_before_stay_known():
    """The sheet's priors pull to the rig's latencies, and not to those the runs were read at."""
    fitted = fit_of(driven(scaled(exact(), 0.09), 1))
    linearisation = Linearisation.of(fitted, floor_of(fitted, 9))
    latencies = dict.fromkeys(linearisation.latency_tolerances, 0.001)
    seen = screen(ScoreTests.of(replace(linearisation, latencies=latencies), CANDIDATES, 0), silent)
    found = without_fault(seen.space, HUB, silent)
    assert found.latencies == latencies
    assert np.any(found.prior_side)
