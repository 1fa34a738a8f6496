"""The independent reference car: what the identification finds against what the car is made of.

`truth.json` is read by tests only, to score. Wheels are hub loads: rim and tyre are outboard.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lacet.identify.car.rows import SUSPENSION_ROWS
from lacet.identify.properties.whole_vehicle import NAMES, whole_vehicle
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.validation.score import compare
from tests.identify import cars

VEHICLE, _ = cars.reference_car()
AXLE_OF = {"f": "front", "r": "rear"}


def found(fitted: Fit, family: str) -> dict[str, float]:
    """Values of a family's parameters by place."""
    return {
        effect.where: fitted.value(effect.parameters[0].name)
        for effect in fitted.model.effects
        if effect.name == family
    }


def test_springs_dampers_bars_and_tyres(fitted: Fit, truth: dict[str, Any]) -> None:
    """Springs 0.5 %, dampers 1 %, bars 0.8 %, tyres 0.5 %."""
    for corner in VEHICLE.corners:
        suspension = truth["suspension"][AXLE_OF[corner[0]]]
        assert found(fitted, "spring")[corner] == pytest.approx(suspension["k_N_m"], rel=0.005), corner
        assert found(fitted, "damper")[corner] == pytest.approx(suspension["c_Ns_m"], rel=0.01), corner
        tyre = truth["tyre_vertical_stiffness_N_m"]
        assert found(fitted, "tyre_stiffness")[corner] == pytest.approx(tyre, rel=0.005), corner
        load = truth["static_suspension_load_N"][corner]
        assert found(fitted, "offset")[corner] == pytest.approx(load, rel=0.01), corner
        outboard = truth["wheel_rim_and_tyre"]["mass"]
        assert found(fitted, "outboard_mass")[corner] == pytest.approx(outboard, abs=1.5), corner
    for axle, bar in truth["anti_roll_bar_N_per_m_of_travel_difference"].items():
        assert found(fitted, "anti_roll_bar")[axle] == pytest.approx(bar, rel=0.008), axle


def test_masses(fitted: Fit, truth: dict[str, Any]) -> None:
    """Inboard mass 0.05 %; unsprung masses (arm, upright and hub of a corner) within 1.5 kg."""
    masses = {
        e.where: fitted.value(next(p.name for p in e.parameters if p.name.startswith("M") and p.name[1:].isdigit()))
        for e in fitted.model.effects
        if e.name == "body"
    }
    assert sum(masses.values()) == pytest.approx(truth["inboard_at_design"]["mass_kg"], rel=0.0005)
    for corner in VEHICLE.corners:
        arm = truth["arm"][AXLE_OF[corner[0]]]["mass"]
        upright = truth["front_upright"]["mass"] if corner[0] == "f" else 0.0
        assert masses[f"axle.{corner}"] + masses[f"wheel.{corner}"] == pytest.approx(
            arm + upright + truth["hub"]["mass"], abs=1.5
        ), corner


def test_whole_vehicle(fitted: Fit, truth: dict[str, Any]) -> None:
    """Mass, centre of gravity within 2 mm, inertia about it within 1 %, and the truth inside the intervals."""
    whole = whole_vehicle(fitted, VEHICLE)
    assert whole is not None
    design = truth["inboard_at_design"]
    I = np.array(design["inertia_about_cog_kg_m2"])
    wanted = np.array([design["mass_kg"], *design["cog_m"], I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
    got = dict(zip(NAMES, whole.values - wanted, strict=True))
    assert whole.values[0] == pytest.approx(wanted[0], rel=0.0005)
    for k, name in enumerate(NAMES):
        if name.startswith("cog"):
            assert abs(got[name]) < 0.002, (name, got[name])
        elif name in ("Ixx", "Iyy", "Izz"):
            assert abs(got[name]) < 0.01 * wanted[k], (name, got[name])
        elif name.startswith("I"):  # products are small: 1 % of the tensor
            assert abs(got[name]) < 0.01 * I[2, 2], (name, got[name])
    assert all(whole.determined)
    inside = np.abs(whole.values - wanted) <= whole.interval
    assert np.count_nonzero(inside) >= 8, np.stack([whole.values, wanted, whole.interval])


def test_intervals_of_main_parameters_hold_the_truth(fitted: Fit, truth: dict[str, Any]) -> None:
    """Of 18 intervals at 95 %, at most 3 miss (99 % of campaigns), and none is so wide that it says nothing."""
    pairs: list[tuple[str, float]] = []
    for corner in VEHICLE.corners:
        suspension = truth["suspension"][AXLE_OF[corner[0]]]
        pairs += [(f"spring.{corner}.k", suspension["k_N_m"]), (f"damper.{corner}.c", suspension["c_Ns_m"])]
        pairs += [(f"tyre_stiffness.{corner}.kt", truth["tyre_vertical_stiffness_N_m"])]
        pairs += [(f"offset.{corner}.f0", truth["static_suspension_load_N"][corner])]
    pairs += [
        (f"anti_roll_bar.{axle}.k", bar) for axle, bar in truth["anti_roll_bar_N_per_m_of_travel_difference"].items()
    ]
    missed = []
    for name, wanted in pairs:
        spread = 1.96 * np.sqrt(fitted.covariance[(k := fitted.model.names.index(name)), k])
        assert spread < 0.02 * wanted, name
        if abs(fitted.value(name) - wanted) > spread:
            missed.append((name, fitted.value(name), wanted, spread))
    assert len(missed) <= 3, missed


def test_zeros_stay_within_the_sheet(fitted: Fit) -> None:
    """No sensor zero is moved by more than four of the sheet's σ to make the fit look well."""
    for names, priors, values in fitted.zeros:
        off = np.abs(values) / priors
        assert np.max(off) < 4.0, names[int(np.argmax(off))]


def test_runs_used_are_at_the_noise_floor(fitted: Fit, drives: dict[str, PreparedRun]) -> None:
    """Direct validation: every row of every run within 15 % of what the sensors' noise leaves."""
    for name, drive in drives.items():
        comparison = compare(fitted, drive, draws=6)
        for row, score in comparison.scores.items():
            assert 0.8 < score.ratio < 1.15, (name, row, score)
            np.testing.assert_allclose(comparison.residual(row), comparison.measured[row] - comparison.modelled[row])


def test_a_run_held_out_is_predicted(drives: dict[str, PreparedRun], models: dict[str, Model]) -> None:
    """Cross validation with the rough road held out, the hardest: no other run has its frequencies."""
    others = [drive for name, drive in drives.items() if name != "rough"]
    scores = compare(fit(models["bars"], others), drives["rough"], draws=6).scores
    ratios = {row: score.ratio for row, score in scores.items()}
    assert max(ratios.values()) <= 1.3, ratios


@pytest.mark.slow
@pytest.mark.parametrize("held", ["sine", "sweep", "liftoff"])
def test_each_run_held_out_is_predicted(held: str, drives: dict[str, PreparedRun], models: dict[str, Model]) -> None:
    """Cross validation, each of the other runs held out: at the noise floor, within the floor's own scatter."""
    others = [drive for name, drive in drives.items() if name != held]
    scores = compare(fit(models["bars"], others), drives[held], draws=20).scores
    assert {row: round(s.ratio, 2) for row, s in scores.items() if s.ratio > 1.1} == {}


def test_without_bars_the_suspension_rows_fail(drives: dict[str, PreparedRun], models: dict[str, Model]) -> None:
    """The base model is wrong for this car, and the rows say so: suspensions stand above the floor, drag does not."""
    base = fit(models["base"], [drives["sine"], drives["rough"]], FitOptions(unbias=False))
    scores = compare(base, drives["sine"], draws=4).scores
    assert min(scores[row].ratio for row in SUSPENSION_ROWS) > 1.5
    assert scores["chassis.fx"].ratio < 1.2
