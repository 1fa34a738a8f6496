"""Shape constants between the values of their grid: a gap that lies between two of them is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Answer, Candidate
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.joint.shape_constants import refined
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.services.render.verdicts import says
from tests.identify.exact_car import KNOWN, driven, exact_with, fit_of

DRAWS, GAP, RATE = 39, 0.0055, 9000.0
HIDDEN = replace(KNOWN["helper_spring.front"], shape={"gap": GAP})
CANDIDATES = [KNOWN[key] for key in ("helper_spring.front", "coulomb.front", "damper_asymmetry.front")]


@pytest.fixture(scope="module")
def fitted() -> Fit:
    """The model on a car with a helper spring that goes solid between two gaps of the catalogue."""
    return fit_of(driven(exact_with(HIDDEN, RATE), 5))


@pytest.fixture(scope="module")
def floor(fitted: Fit) -> NoiseFloor:
    """Its floor."""
    return floor_of(fitted, DRAWS)


@pytest.fixture(scope="module")
def space(fitted: Fit, floor: NoiseFloor) -> ScoreTests:
    """Candidates on it."""
    return ScoreTests.of(Linearisation.of(fitted, floor), CANDIDATES, 0)


@pytest.fixture(scope="module")
def on_grid(space: ScoreTests) -> Candidate:
    """The helper spring with the best gap of its grid."""
    return next(c for c in space.try_all() if c.key == HIDDEN.key)


def test_the_gap_lies_off_the_grid_and_is_found(space: ScoreTests, on_grid: Candidate):
    assert on_grid.shape["gap"] in (0.0, 0.01)
    found = refined(space, on_grid)
    assert found.shape["gap"] == pytest.approx(GAP, abs=0.0007)
    assert found.values[0] == pytest.approx(RATE, abs=max(2.0 * found.interval[0], 0.03 * RATE))
    # What chance was searched over is the grid: these stay.
    assert (found.p, found.gain, found.drop) == (on_grid.p, on_grid.gain, on_grid.drop)


def test_a_gap_on_the_grid_stays(space: ScoreTests, on_grid: Candidate):
    """A value off the grid must be better by more than noise."""
    exactly = fit_of(driven(exact_with(replace(HIDDEN, shape={"gap": 0.01}), RATE), 6))
    own = ScoreTests.of(Linearisation.of(exactly, space.floor), CANDIDATES, 0, space.noise)
    best = next(c for c in own.try_all() if c.key == HIDDEN.key)
    assert best.shape == {"gap": 0.01}
    assert refined(own, best).shape["gap"] == pytest.approx(0.01, abs=0.0007)


class Touched(type(KNOWN["bump_stop.front"])):
    """A bump stop one of whose gaps is passed once, by a hair."""

    name = "touched"


def test_a_gap_passed_by_a_hair_does_not_hide_the_others(fitted: Fit, floor: NoiseFloor):
    """Its column is next to nothing, and the correction for noise in it is no fall."""
    corners = fitted.runs[0].motion.corners
    travel = np.concatenate([corners[c].travel for c in ("fl", "fr")])
    hair = float(np.max(travel)) - 1e-5
    effect = Touched("front")
    effect.grids = {"gap": (0.01, hair)}
    found = next(c for c in ScoreTests.of(Linearisation.of(fitted, floor), [effect], 0).try_all())
    assert found.tested, found.reason
    assert found.shape == {"gap": 0.01}


def test_what_has_no_constants_or_cannot_be_tested_is_left_alone(space: ScoreTests, on_grid: Candidate):
    friction = next(c for c in space.try_all() if c.key == "damper_asymmetry.front")
    assert refined(space, friction) is friction
    shut = replace(on_grid, answer=Answer.NOT_TESTABLE)
    assert refined(space, shut) is shut


def test_the_verdict_names_it_with_its_gap(fitted: Fit, floor: NoiseFloor, space: ScoreTests):
    """What the grid's gap would leave behind is not taken for a second, unlisted cause."""
    found = diagnose(fitted, floor, CANDIDATES, noise=space.noise)
    assert found.verdict == "missing", says(found)
    assert found.best is not None
    assert found.best.key == HIDDEN.key
    assert found.best.shape["gap"] == pytest.approx(GAP, abs=0.0007)
    assert np.isclose(found.best.values[0], RATE, atol=max(2.0 * found.best.interval[0], 0.03 * RATE))
