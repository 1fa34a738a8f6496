"""The car with three effects hidden, searched once for all tests that need it."""

from __future__ import annotations

import pytest

from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.refits import Joint
from lacet.identify.selection.joint.rounds import found_together
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from tests.identify.exact_car import KNOWN, driven, fit_of
from tests.identify.selection.exact_ranking import DRAWS
from tests.identify.selection.joint.three_hidden import HIDDEN, KEYS, STOP, with_all


@pytest.fixture(scope="session")
def fitted() -> Fit:
    """The base model on a run of the car that has these effects."""
    return fit_of(driven(with_all([*HIDDEN, (STOP, 60000.0)]), 3))


@pytest.fixture(scope="session")
def floor(fitted: Fit) -> NoiseFloor:
    """Its floor."""
    return floor_of(fitted, DRAWS)


@pytest.fixture(scope="session")
def space(fitted: Fit, floor: NoiseFloor) -> ScoreTests:
    """Candidates beside it, those hidden among them."""
    return ScoreTests.of(Linearisation.of(fitted, floor), [KNOWN[key] for key in KEYS], 0)


@pytest.fixture(scope="session")
def subset(space: ScoreTests) -> Joint:
    """What a search finds."""
    return found_together(space, 0)
