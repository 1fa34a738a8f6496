"""The car that is exactly its model, ranked: made once for all tests that need it."""

from __future__ import annotations

from typing import NamedTuple

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
from tests.support.once import once


class Ranked(NamedTuple):
    """The model on a run that lacks nothing, its floor, candidates; and on one of a car with a law of no catalogue."""

    fitted: Fit
    floor: NoiseFloor
    space: ScoreTests
    unlisted: Fit
    hidden: Diagnosis


def made() -> Ranked:
    """All of it: 7 s."""
    fitted = fit_of(driven(exact(), 0))
    floor = floor_of(fitted, DRAWS)
    space = ScoreTests.of(Linearisation.of(fitted, floor), CANDIDATES, 0)
    unlisted = fit_of(driven(exact_with(HIDDEN, SIZE), 1))
    return Ranked(fitted, floor, space, unlisted, diagnose(unlisted, floor, CANDIDATES))


@pytest.fixture(scope="session")
def ranked() -> Ranked:
    """Made once, by whichever process of the run needs it first."""
    return once("exact_ranking", made)


@pytest.fixture(scope="session")
def fitted(ranked: Ranked) -> Fit:
    """The model on a run that lacks nothing."""
    return ranked.fitted


@pytest.fixture(scope="session")
def floor(ranked: Ranked) -> NoiseFloor:
    """The floor of that motion."""
    return ranked.floor


@pytest.fixture(scope="session")
def space(ranked: Ranked) -> ScoreTests:
    """Candidates on it."""
    return ranked.space


@pytest.fixture(scope="session")
def found(space: ScoreTests) -> list[Candidate]:
    """What is said of each before chance is looked at."""
    return [c for c in space.try_all() if c.tested]


@pytest.fixture(scope="session")
def unlisted(ranked: Ranked) -> Fit:
    """The model on a run of a car with a law that is in no catalogue."""
    return ranked.unlisted


@pytest.fixture(scope="session")
def hidden(ranked: Ranked) -> Diagnosis:
    """Its diagnosis."""
    return ranked.hidden
