"""Noise in the columns drawn for one fit and used for others to the same runs: what would be drawn for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.regressor_noise import RegressorNoise
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from tests.identify.exact_car import KNOWN, driven, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES, DRAWS

GRIDS = KNOWN["coulomb.front"].grids
LOW, HIGH = sorted(GRIDS["v0"])[1:3]


def friction(v0: float) -> Effect:
    """A friction with this velocity [m/s]."""
    return replace(KNOWN["coulomb.front"], shape={"v0": v0})


def beside(fitted: Fit, space: ScoreTests) -> ScoreTests:
    """Score tests of the other candidates beside a fit, with the noise drawn for the first."""
    others = [effect for effect in CANDIDATES if effect.key not in fitted.model]
    return ScoreTests.of(Linearisation.of(fitted, space.floor), others, 0, drawn=[space.drawn])


def off(tests: ScoreTests) -> float:
    """Largest difference from noise drawn for the tests' own fit ÷ the largest noise, in units of the columns."""
    fitted = tests.linearisation.runs.refittable
    assert fitted is not None
    own = RegressorNoise.of(fitted, tests.layout, tests.floor.sigma)
    assert tests.noise.labels == own.labels
    size = np.sqrt(np.diag(tests.sums.total))
    size = np.where(size > 0.0, size, np.inf)
    known, drawn = (
        np.array([noise.products(tests.sums, {row: 1.0}, noise.sigma) / np.outer(size, size) for row in noise.sigma])
        for noise in (tests.noise, own)
    )
    return float(np.max(np.abs(known - drawn)) / np.max(np.abs(drawn)))


@pytest.mark.parametrize("effect", [friction(LOW), KNOWN["anti_roll_bar.front"]])
def test_with_an_effect_of_the_grid_it_is_the_same(fitted: Fit, space: ScoreTests, effect: Effect) -> None:
    """But for what columns of zeros and sheet change by with the parameters. Each candidate's fall is the same."""
    tests = beside(fitted.with_effect(effect), space)
    assert tests.drawn is space.drawn
    assert off(tests) < 1e-2
    anew = ScoreTests.of(tests.linearisation, tests.columns.effects, 0)
    assert anew.drawn is not space.drawn
    for key, one in anew.best_tests.items():
        assert tests.best_tests[key].drop == pytest.approx(one.drop, rel=1e-2, abs=1e-2), key


def test_beside_an_effect_that_changes_all_parameters_it_is_the_same() -> None:
    """Columns of zeros and tolerances are those of another car: a bar that the first fit has in springs and offsets."""
    bar = KNOWN["anti_roll_bar.front"]
    without = fit_of(driven(exact_with(bar, 30e3), 0))
    first = ScoreTests.of(Linearisation.of(without, floor_of(without, DRAWS)), CANDIDATES, 0)
    tests = beside(without.with_effect(bar), first)
    assert tests.drawn is first.drawn
    k = [fitted.theta[fitted.model.names.index("spring.fl.k")] for fitted in (without, tests.fitted)]
    assert k[0] > 1.1 * k[1]
    anew = ScoreTests.of(tests.linearisation, tests.columns.effects, 0)
    for key, one in anew.best_tests.items():
        assert tests.best_tests[key].drop == pytest.approx(one.drop, rel=2e-2, abs=5e-2), key


def test_between_values_of_a_grid_it_is_interpolated(fitted: Fit, space: ScoreTests) -> None:
    """The residual's column, too, is without what the effect explains: no load that the model carries is in it."""
    tests = beside(fitted.with_effect(friction(float(np.sqrt(LOW * HIGH)))), space)
    assert tests.drawn is space.drawn
    assert off(tests) < 5e-2


def test_without_the_effect_again_it_is_as_drawn_first(fitted: Fit, space: ScoreTests) -> None:
    """There and back, to the last digits."""
    again = beside(fitted.with_effect(friction(LOW)).without_effects(["coulomb.front"]), space)
    assert again.drawn is space.drawn
    assert off(again) < 1e-6


@pytest.mark.parametrize("what", ["beyond the grid", "another run", "another row"])
def test_what_was_not_drawn_is_drawn(fitted: Fit, floor: NoiseFloor, space: ScoreTests, what: str) -> None:
    """Constants beyond their grid, other runs, rows without noise so far."""
    drawn = space.drawn
    if what == "beyond the grid":
        tests = beside(fitted.with_effect(friction(0.5 * min(GRIDS["v0"]))), space)
    elif what == "another run":
        again = replace(fitted, runs=(PreparedRun(fitted.runs[0].recording),))
        tests = ScoreTests.of(Linearisation.of(again, floor), CANDIDATES[:2], 0, drawn=[drawn])
    else:
        less = {row: sigma for row, sigma in drawn.noise.sigma.items() if row.kind != "tyre"}
        drawn = replace(drawn, noise=replace(drawn.noise, sigma=less))
        tests = ScoreTests.of(Linearisation.of(fitted, floor), CANDIDATES[:2], 0, drawn=[drawn])
    assert tests.drawn is not drawn
    assert off(tests) == 0.0
