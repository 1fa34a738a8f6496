"""Runs on other tyres: said with their stiffness, and only where that explains what fails."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.run import Run
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.validation.score import FAILS, compare
from lacet.identify.validation.tyre_differences import EXPLAINS, tyre_difference
from lacet.services.render.tyre_differences import difference_result, difference_text
from tests.identify import cars

CAR, RIG = cars.reference_car()
BARS = ("anti_roll_bar.front", "anti_roll_bar.rear")


def on_tyres(run: Run, softer: float) -> Run:
    """A run as of a car whose tyres are softer by a factor: deflected as much more."""
    corners = PreparedRun.of(run, CAR, RIG).motion.corners
    t = PreparedRun.of(run, CAR, RIG).motion.t
    values = {}
    for c in CORNERS:
        signal = run.signals[f"laser.{c}.ground"]
        more = (softer - 1.0) * np.interp(signal.t, t, corners[c].deflection)
        values[f"laser.{c}.ground"] = signal.values - more[:, None]
    return run.with_values(values)


@cache
def fitted(softer: float, effects: tuple[str, ...] = BARS) -> Fit:
    """Three runs, the last of them on other tyres."""
    runs = [cars.piece(name, 3.0, 18.0) for name in ("sine", "liftoff", "rough")]
    runs[2] = on_tyres(runs[2], softer)
    known = catalogue(CAR, "contact")
    model = Model.of([*base_model(CAR, RIG.wheel_reference), *(known[key] for key in effects)])
    return fit(model, [PreparedRun.of(run, CAR, RIG) for run in runs], FitOptions(draws=2))


def found(one: Fit):
    return tyre_difference(one, [compare(one, run) for run in one.runs])


def test_other_tyres_in_one_run_are_told_with_their_stiffness() -> None:
    difference = found(fitted(1.25))
    assert difference is not None
    assert difference.explained > EXPLAINS
    for values in difference.values.values():
        assert values["rough"] == pytest.approx(values["sine"] / 1.25, rel=0.15)
    text = difference_text({"tyre_difference": difference_result(difference)})
    assert text.startswith("the tyres are not the same in all runs: with stiffnesses of each run's own")
    assert "in rough N/mm). Other tyres or pressures in some of them? Fit these apart" in text


def test_nothing_is_said_of_runs_of_one_car_nor_of_one_run() -> None:
    assert found(fitted(1.0)) is None
    assert difference_text({"tyre_difference": difference_result(None)}) == ""
    assert difference_text({}) == "", "of a study that was made before"


def test_a_missing_effect_and_a_few_percent_of_pressure_are_no_other_tyres() -> None:
    assert found(fitted(1.0, ())) is None
    assert found(fitted(1.25, ())) is None  # most is the missing bars'
    little = fitted(1.08)
    assert max(score.ratio for run in little.runs for score in compare(little, run).scores.values()) > FAILS
    assert found(little) is None
