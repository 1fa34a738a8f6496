"""Predictions taken apart add up again, and what an effect would do is what a true fit with it does."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.run import Run
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.validation.contributions import shares_of
from lacet.identify.validation.one_step_update import CLOSE, preview
from lacet.identify.validation.score import Comparison, compare
from tests.identify import cars
from tests.support.tables import piece

VEHICLE, RIG = cars.reference_car()
KNOWN = catalogue(VEHICLE, "hub")


def drive_of(run: Run) -> PreparedRun:
    """A run of the reference car brought together."""
    return PreparedRun.of(run, VEHICLE, RIG)


@pytest.fixture(scope="module")
def base() -> Fit:
    """The base model on ten seconds of two runs."""
    runs = [drive_of(piece("sine", 5.0, 15.0)), drive_of(piece("rough", 4.0, 14.0))]
    return fit(Model.of(base_model(VEHICLE, "hub")), runs)


@pytest.fixture(scope="module")
def held() -> PreparedRun:
    """A run that is not used."""
    return drive_of(piece("liftoff", 3.0, 13.0))


@pytest.fixture(scope="module")
def compared(base: Fit, held: PreparedRun) -> list[tuple[PreparedRun, Comparison]]:
    """All three runs against it."""
    return [(drive, compare(base, drive, 5)) for drive in (*base.runs, held)]


def rms(x: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(x**2)))


def test_shares_add_up(base: Fit, compared: list[tuple[PreparedRun, Comparison]]):
    for drive, part in compared:
        shares = shares_of(base, drive, part)
        assert set(shares.effects) == set(part.modelled)
        for row, modelled in part.modelled.items():
            total = np.sum([*shares.effects[row].values(), shares.zeros[row]], axis=0)
            largest = max(np.abs(a).max() for a in (*shares.effects[row].values(), shares.zeros[row]))
            assert np.abs(total - modelled).max() < 1e-12 * largest


@pytest.mark.parametrize("key", ["anti_roll_bar.front", "coulomb.rear"])
def test_a_preview_is_a_true_fit(base: Fit, compared: list[tuple[PreparedRun, Comparison]], key: str):
    effect = KNOWN[key]
    found = preview(base, effect)
    true = fit(base.model + effect, base.runs)
    assert found.values == pytest.approx([true.value(q.name) for q in effect.parameters], rel=0.05)
    for drive, part in compared:
        after, then = found.residual(drive, part), compare(true, drive, 5)
        for row in part.modelled:
            off = rms(after[row] - then.residual(row))
            assert off < CLOSE * rms(part.residual(row)) + 0.1 * part.scores[row].floor, (drive.name, row)


def test_what_is_hidden_falls_and_what_is_not_there_does_not(base: Fit, compared: list[tuple[PreparedRun, Comparison]]):
    drive, part = compared[0]
    row = "suspension.fl"
    now = rms(part.residual(row))
    assert rms(preview(base, KNOWN["anti_roll_bar.front"]).residual(drive, part)[row]) < 0.3 * now
    assert rms(preview(base, KNOWN["coulomb.rear"]).residual(drive, part)[row]) > 0.9 * now


def test_a_fault_of_the_instruments_has_a_preview_too(base: Fit, compared: list[tuple[PreparedRun, Comparison]]):
    effect: Effect = next(e for key, e in KNOWN.items() if key.startswith("sensor_gain.") and "hub.fl" in key)
    found = preview(base, effect)
    # Linear in the fault: as much as its column times its size, everything else being fitted anew.
    plain = fit(base.model + effect, base.runs, FitOptions(unbias=False))
    assert found.values == pytest.approx([plain.value(q.name) for q in effect.parameters], rel=0.2, abs=0.003)
    after = found.residual(*compared[0])
    assert all(np.all(np.isfinite(series)) for series in after.values())
