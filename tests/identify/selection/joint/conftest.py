"""The car with three effects hidden, searched once for all tests that need it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import pytest

from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.refits import Joint, beside_of
from lacet.identify.selection.joint.rounds import found_together
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from tests.identify.exact_car import KNOWN, driven, fit_of
from tests.identify.selection.exact_ranking import DRAWS
from tests.identify.selection.joint.three_hidden import HIDDEN, KEYS, STOP, WithFault, with_all
from tests.support.once import once


class Searched(NamedTuple):
    """The base model on a run of the car, its floor, candidates beside it, and what a search finds."""

    fitted: Fit
    floor: NoiseFloor
    space: ScoreTests
    subset: Joint


def made() -> Searched:
    """All of it: 6 s."""
    fitted = fit_of(driven(with_all([*HIDDEN, (STOP, 60000.0)]), 3))
    floor = floor_of(fitted, DRAWS)
    space = ScoreTests.of(Linearisation.of(fitted, floor), [KNOWN[key] for key in KEYS], 0)
    return Searched(fitted, floor, space, found_together(space, 0))


@pytest.fixture(scope="session")
def searched() -> Searched:
    """Made once, by whichever process of the run needs it first."""
    return once("three_hidden", made)


@pytest.fixture(scope="session")
def fitted(searched: Searched) -> Fit:
    """The base model on a run of the car that has these effects."""
    return searched.fitted


@pytest.fixture(scope="session")
def floor(searched: Searched) -> NoiseFloor:
    """Its floor."""
    return searched.floor


@pytest.fixture(scope="session")
def space(searched: Searched) -> ScoreTests:
    """Candidates beside it, those hidden among them."""
    return searched.space


@pytest.fixture(scope="session")
def subset(searched: Searched) -> Joint:
    """What a search finds."""
    return searched.subset


@pytest.fixture(scope="session")
def with_fault(subset: Joint) -> WithFault:
    """A fit with a sensor fault beside what was found, and that as effects found; others are tested beside them."""

    @cache
    def made(key: str, *others: str) -> tuple[Fit, Joint]:
        base, fault = subset.base, KNOWN[key]
        assert base is not None
        fitted = base.with_effects([*subset.added, fault])
        beside = Linearisation.of(fitted, subset.space.floor.redrawn(fitted))
        tests = ScoreTests.of(beside, [KNOWN[other] for other in others], 0)
        return fitted, beside_of(replace(subset, added=(*subset.added, fault), effects=(*subset.effects, fault)), tests)

    return made
