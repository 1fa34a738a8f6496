"""A plan is right: intervals predicted before a run are those found after it, and the run ranked first is the best."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache

import numpy as np
import pytest

from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.design.run_information import (
    fit_information,
    half_widths,
    predicted,
    residual_excess,
    run_information,
)
from lacet.identify.design.run_ranking import rank
from lacet.identify.effects.catalogue import base_model
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.signals.filters import Filters
from lacet.services.planning.manoeuvre_library import Limits, Plan, library
from lacet.services.planning.nominal_car import known_values, planned_car
from lacet.services.planning.simulated_plans import PlannedRun, SensorSetup, simulated_runs
from lacet.simulate import Manoeuvre, Sheet, exchange_run, find_car, make_manoeuvre, run
from lacet.simulate.vehicle_file import vehicle_text

CAR, RIG = find_car("peugeot-406"), Rig.load("peugeot-406")
VEHICLE = Vehicle.parse(vehicle_text(CAR))  # geometry only: nothing is known before
MODEL = Model.of(base_model(VEHICLE, "contact"))
SECONDS = 12.0


def driven(manoeuvre: Manoeuvre, seed: int) -> PreparedRun:
    """A run as it is measured: other noise, zeros and road than any plan knows of."""
    motion = run(CAR, manoeuvre, [], seed, settle=1.0, step=0.001)
    return PreparedRun.of(exchange_run(motion, RIG, seed, sheet=Sheet()), VEHICLE, RIG)


@cache
def sinus() -> PreparedRun:
    return driven(make_manoeuvre("sinus", duration=SECONDS), 11)


@cache
def present() -> Fit:
    return fit(MODEL, [sinus()])


def plans(*kinds: str) -> list[Plan]:
    """The strongest variant of each manoeuvre."""
    like = planned_car(VEHICLE, known_values(VEHICLE, present(), "contact"))
    return [library(like.car, Limits(), [kind], SECONDS)[-1] for kind in kinds]


def planned(chosen: list[Plan]) -> list[PlannedRun]:
    like = planned_car(VEHICLE, known_values(VEHICLE, present(), "contact"))
    rates = sinus().recording.rates
    made, problems = simulated_runs(
        chosen, like, VEHICLE, SensorSetup(RIG, Filters(), rates), Limits(), None, lambda step: None
    )
    assert problems == []
    return made


def after(plan: Plan, seed: int) -> Fit:
    """The fit once the planned run has been driven."""
    settings = {key: value for key, value in asdict(plan.manoeuvre).items() if key != "road_seed"}
    return fit(MODEL, [sinus(), driven(make_manoeuvre(plan.manoeuvre.name, **settings), seed)])


def compared(guess: Fit, found: Fit, before: Fit) -> dict[str, float]:
    """Predicted ÷ obtained, of the intervals that the run shrinks by a tenth at least."""
    a, b, was = half_widths(guess), half_widths(found), half_widths(before)
    out = {name: float(a[i] / b[i]) for i, name in enumerate(MODEL.names) if b[i] < 0.9 * was[i]}
    assert len(out) > 12
    return out


def within(ratios: dict[str, float], part: float = 0.3) -> float:
    """How many are no farther apart than this part."""
    return float(np.mean([1.0 / (1.0 + part) < r < 1.0 + part for r in ratios.values()]))


def middle(ratios: dict[str, float]) -> float:
    """Geometric mean."""
    return float(np.exp(np.mean(np.log(list(ratios.values())))))


@pytest.mark.slow  # the simulator drives a whole campaign
def test_a_braking_run_shrinks_what_was_predicted():
    chosen = plans("braking")
    (one,) = planned(chosen)
    now = fit_information(present())
    guess = predicted(present(), now + run_information(one.prepared, present(), residual_excess(present())).lasting())
    found = after(chosen[0], 23)
    ratios = compared(guess, found, present())
    assert within(ratios) >= 0.9, ratios
    assert middle(ratios) == pytest.approx(1.0, abs=0.1)
    k = MODEL.names.index("YY6")
    assert half_widths(found)[k] < 0.3 * half_widths(present())[k]
    assert half_widths(guess)[k] == pytest.approx(half_widths(found)[k], rel=0.3)


@pytest.mark.slow  # two minutes
@pytest.mark.parametrize("wanted", [["YY6"], ["ZZ6", "M6", "MX6"], []])
def test_the_run_ranked_first_shrinks_most(wanted: list[str]):
    chosen, told, found = campaign()
    now = fit_information(present())
    ranking = rank(present(), now, list(told), VEHICLE, SECONDS, wanted, 0.0 if wanted else 0.02)
    names = list(ranking.targets)
    k = [MODEL.names.index(name) for name in names]
    goals = np.array([ranking.targets[name] for name in names])
    worth = [
        float(np.mean(np.log(half_widths(present())[k] / np.maximum(half_widths(one)[k], goals)).clip(0)))
        for one in found
    ]
    predicted_order = [one.index for one in ranking.runs]
    first = chosen[predicted_order[0]].manoeuvre.name
    # Best, or no worse than the best by what the two uncertain intervals can differ.
    assert worth[predicted_order[0]] > max(worth) - np.log(1.15), (wanted, first, worth)
    assert np.corrcoef([one.worth for one in ranking.runs], [worth[i] for i in predicted_order])[0, 1] > 0.9
    if wanted == ["YY6"]:
        assert first in ("braking", "liftoff", "kerb", "rough")


@pytest.mark.slow
def test_every_run_of_the_library_shrinks_what_was_predicted():
    chosen, told, found = campaign()
    now = fit_information(present())
    every: dict[str, float] = {}
    for plan, weighted_run, one in zip(chosen, told, found, strict=True):
        ratios = compared(predicted(present(), now + weighted_run.lasting()), one, present())
        # Of a handful of bumps the fit's own estimate of its uncertainty is rough: it is one draw.
        assert within(ratios) >= 0.75, (plan.label, ratios)
        assert middle(ratios) == pytest.approx(1.0, abs=0.2), plan.label
        every |= {f"{plan.label}: {name}": r for name, r in ratios.items()}
    assert within(every) >= 0.9
    assert middle(every) == pytest.approx(1.0, abs=0.1)


@cache
def campaign():
    """Plans of every kind, what each would tell, and the fit once each has been driven."""
    chosen = plans("sinus", "sweep", "liftoff", "braking", "rough", "kerb")
    excess = residual_excess(present())
    told = tuple(run_information(one.prepared, present(), excess) for one in planned(chosen))
    return chosen, told, tuple(after(plan, 31 + i) for i, plan in enumerate(chosen))
