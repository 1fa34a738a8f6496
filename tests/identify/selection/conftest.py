"""The car that is exactly its model, ranked: made once for all tests that need it."""

from __future__ import annotations

import pytest

from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from tests.identify.exact_car import driven, exact, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES, DRAWS, HIDDEN, SIZE


@pytest.fixture(scope="session")
def fitted() -> Fit:
    """The model on a run that lacks nothing."""
    return fit_of(driven(exact(), 0))


@pytest.fixture(scope="session")
def floor(fitted: Fit) -> NoiseFloor:
    """The floor of that motion."""
    return floor_of(fitted, DRAWS)


@pytest.fixture(scope="session")
def space(fitted: Fit, floor: NoiseFloor) -> ScoreTests:
    """Candidates on it."""
    return ScoreTests.of(Linearisation.of(fitted, floor), CANDIDATES, 0)


@pytest.fixture(scope="session")
def found(space: ScoreTests) -> list[Candidate]:
    """What is said of each before chance is looked at."""
    return [c for c in space.try_all() if c.tested]


@pytest.fixture(scope="session")
def unlisted() -> Fit:
    """The model on a run of a car with a law that is in no catalogue."""
    return fit_of(driven(exact_with(HIDDEN, SIZE), 1))


@pytest.fixture(scope="session")
def hidden(unlisted: Fit, floor: NoiseFloor) -> Diagnosis:
    """Its diagnosis."""
    return diagnose(unlisted, floor, CANDIDATES)
