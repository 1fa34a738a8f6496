"""One scale error that all lasers of a kind have in common: its channels, its entries of the sheet, and its finding."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.identify.effects.sensors.sensor_gain import SensorGain
from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.validation.noise_floor import floor_of
from tests.identify import cars
from tests.identify.exact_car import KNOWN, RIG, VEHICLE, driven, exact, fit_of

GAINS = [one for one in KNOWN.values() if isinstance(one, SensorGain)]
TRIED = [*GAINS, *(KNOWN[key] for key in ("anti_roll_bar.front", "tyre_progression.front", "coulomb.front"))]


@pytest.mark.parametrize("what", ["hub", "ground"])
def test_a_common_scale_is_that_of_each_laser(what: str) -> None:
    """Channel by channel it changes and corrects what the single ones do, and stands for all their tolerances."""
    common, single = SensorGain(what), [SensorGain(f"{what}.{c}") for c in CORNERS]
    assert common in GAINS
    record = cars.recording(cars.random_signals(1), VEHICLE, RIG)
    assert common.channels() == tuple(f"laser.{c}.{what}" for c in CORNERS)
    changes = common.changes(record)
    for one, channel in zip(single, common.channels(), strict=True):
        assert one.channels() == (channel,)
        np.testing.assert_array_equal(changes[channel], one.perturb(channel, record))
        np.testing.assert_array_equal(common.correct(channel, record, 0.03), one.correct(channel, record, 0.03))
        np.testing.assert_allclose(
            1.03 * common.correct(channel, record, 0.03), record.signals.value[channel], rtol=1e-14
        )
    assert common.sheet_entries == frozenset[tuple[str, str]]().union(*(one.sheet_entries for one in single))
    assert common.sheet_bound(RIG) == max(one.sheet_bound(RIG) for one in single) > 0.0
    assert [p.name for p in common.parameters] == [f"sensor_gain.{what}.g"]


@pytest.mark.parametrize(
    ("key", "by"), [("sensor_gain.hub", 0.02), ("sensor_gain.ground", 0.01), ("sensor_gain.hub.fl", 0.02)]
)
def test_one_scale_or_all_is_told_apart(key: str, by: float) -> None:
    """Of a car whose lasers read too much: all of a kind, or one, is proposed as it was, with its size."""
    fault = KNOWN[key]
    assert isinstance(fault, SensorGain)
    fitted = fit_of(driven(recording_without_faults(exact(), [fault], np.array([1.0 / (1.0 + by) - 1.0])), 1))
    found = diagnose(fitted, floor_of(fitted, 39), TRIED)
    assert found.verdict == "missing"
    assert found.best is not None
    assert found.best.key == key
    assert found.best.values[0] == pytest.approx(by, rel=0.2)
