"""A scale common to all that is known without wheel loads: no tolerance of it explains what the model lacks."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import FitOptions, fit
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.columns.common_scale import scales_all, without_common_scale
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import floor_of
from tests.identify.regression.test_no_wheel_loads import BARS, RIG, with_mass, without_loads

HEAVE, ROLL = Row("body.heave"), Row("body.roll")


def test_what_is_in_proportion_to_the_known_side_is_nothing_and_the_rest_stays() -> None:
    """Of one factor in all rows; a column of one row has its part of that factor taken out of the others, too."""
    rng = np.random.default_rng(1)
    known = {HEAVE: rng.standard_normal(50), ROLL: 3.0 * rng.standard_normal(40)}
    sigma = {HEAVE: 0.5, ROLL: 2.0}
    other = rng.standard_normal(50)
    columns = {
        HEAVE: ([4, 5, 6], np.stack([0.01 * known[HEAVE], other, known[HEAVE]])),
        ROLL: ([4], 0.01 * known[ROLL][None]),
    }
    found = without_common_scale(columns, [4, 6], known, sigma)
    np.testing.assert_allclose(found[HEAVE][1][0], 0.0, atol=1e-15)
    np.testing.assert_allclose(found[ROLL][1][0], 0.0, atol=1e-15)
    np.testing.assert_array_equal(found[HEAVE][1][1], other)
    assert found[ROLL][0] == [4, 6]
    across = sum(found[row][1][found[row][0].index(6)] @ known[row] / sigma[row] ** 2 for row in known)
    assert abs(across) < 1e-12 * sum(side @ side / sigma[row] ** 2 for row, side in known.items())
    np.testing.assert_array_equal(columns[HEAVE][1][2], known[HEAVE])  # what was given stays as it is


def test_given_masses_and_rates_and_the_gain_of_the_specific_force_are_such_scales() -> None:
    assert scales_all("assumed", "sprung_mass")
    assert scales_all("assumed", "spring_rate.front")
    assert scales_all("gain", "imu.accel")
    assert not scales_all("assumed", "unsprung_mass.front")
    assert not scales_all("gain", "laser.fl.hub")
    assert not scales_all("latency", "imu.accel")


@cache
def bar_and_gain(tolerance: float) -> tuple[Candidate, Candidate]:
    """The rear bar, and a gain of the specific force, tested without wheel loads in a model without bars.

    `tolerance` : of the sprung mass [kg].
    """
    text = with_mass().text.replace("tolerance = 15,", f"tolerance = {tolerance:g},", 1)
    vehicle = Vehicle.parse(text)
    runs = [PreparedRun.of(without_loads(name, 5.0, 20.0), vehicle, RIG) for name in ("sine", "rough")]
    plain = fit(Model.of(base_model(vehicle, "contact")), runs, FitOptions(draws=2))
    candidates = [catalogue(vehicle, "contact")[key] for key in (BARS[1], "sensor_gain.accel.z")]
    bar, gain = ScoreTests.of(Linearisation.of(plain, floor_of(plain, 20)), candidates, 0).try_all()
    return bar, gain


def test_how_well_the_mass_is_known_changes_neither_a_test_nor_what_a_law_explains() -> None:
    """The model lacks both bars by many noise floors: a smaller mass would leave less in newtons, not of the car.

    What remains of a tolerance beside the common scale are the unsprung masses, which it leaves as they are.
    """
    (well, _), (badly, _) = bar_and_gain(5.0), bar_and_gain(500.0)
    assert badly.drop == pytest.approx(well.drop, rel=0.1)
    assert badly.gain == pytest.approx(well.gain, rel=0.1)
    assert badly.values == pytest.approx(well.values, rel=0.1)


def test_a_gain_of_the_specific_force_explains_nothing_of_a_missing_law() -> None:
    """With half the specific force the model would leave half of it; as a gain it is not that which is missing."""
    bar, gain = bar_and_gain(5.0)
    assert gain.drop < 0.2 * bar.drop
