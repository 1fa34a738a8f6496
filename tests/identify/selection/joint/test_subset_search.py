"""Several effects at once on the car that is exactly its model: those hidden are found, and no other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.rivals import rivals
from lacet.identify.selection.joint.shape_constants import refined, with_best_constants
from lacet.identify.selection.joint.subset_search import Subset, found_together
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from tests.identify import cars
from tests.identify.exact_car import KNOWN, MODEL, driven, exact, fit_of, theta
from tests.identify.selection.exact_ranking import DRAWS

KEYS = (
    "anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.front", "coulomb.rear", "bump_stop.front", "bump_stop.rear",
    "spring_cubic.front", "spring_cubic.rear", "damper_asymmetry.front", "damper_knee.front", "damper_knee.rear",
    "tyre_damping.rear", "sensor_gain.hub.fl",
)  # fmt: skip
STOP = replace(KNOWN["bump_stop.rear"], shape={"gap": 0.0065, "n": 1.6})
HIDDEN = [(KNOWN["anti_roll_bar.front"], 6000.0), (KNOWN["damper_asymmetry.front"], -300.0)]
LAWS = [effect for effect, _ in HIDDEN]


def with_all(hidden: Sequence[tuple[Effect, float]]) -> Recording:
    """The exact drive of a car that is the model and these effects, with their sizes."""
    laws, sizes = zip(*hidden, strict=True)
    return cars.fulfil(exact(), (*MODEL.effects, *laws), np.append(theta(), sizes))


@pytest.fixture(scope="module")
def fitted() -> Fit:
    return fit_of(driven(with_all([*HIDDEN, (STOP, 60000.0)]), 3))


@pytest.fixture(scope="module")
def floor(fitted: Fit) -> NoiseFloor:
    return floor_of(fitted, DRAWS)


@pytest.fixture(scope="module")
def space(fitted: Fit, floor: NoiseFloor) -> ScoreTests:
    return ScoreTests.of(Linearisation.of(fitted, floor), [KNOWN[key] for key in KEYS], 0)


@pytest.fixture(scope="module")
def subset(space: ScoreTests) -> Subset:
    return found_together(space, 0)


def test_all_that_are_hidden_are_found_and_no_other(subset: Subset):
    assert {one.effect.key for one in subset.settled} == {*(effect.key for effect in LAWS), STOP.key}
    assert not subset.effects


def test_sizes_of_the_fit_with_all_are_the_true_ones(subset: Subset):
    fitted = subset.space.fitted
    sigma = np.sqrt(np.diag(fitted.covariance + fitted.covariance_sheet))
    for effect, size in HIDDEN:
        i = fitted.model.names.index(effect.parameters[0].name)
        assert abs(fitted.theta[i] - size) <= max(3.0 * sigma[i], 0.02 * abs(size))


def test_constants_between_two_values_of_their_grids_are_found(subset: Subset):
    (stop,) = (one.effect for one in subset.settled if one.effect.key == STOP.key)
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.0015)
    assert stop.shape["n"] == pytest.approx(STOP.shape["n"], abs=0.15)


def test_constants_searched_together_explain_more_than_one_after_the_other(space: ScoreTests):
    chosen = [*LAWS, replace(KNOWN[STOP.key], shape={"gap": 0.02, "n": 1.0})]
    *_, stop = with_best_constants(space, chosen)
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)


def test_where_nothing_is_missing_nothing_is_found():
    plain = fit_of(driven(exact(), 0))
    nothing = ScoreTests.of(Linearisation.of(plain, floor_of(plain, DRAWS)), [KNOWN[key] for key in KEYS], 0)
    found = found_together(nothing, 0)
    assert not found.settled
    assert not found.effects
    assert found.space is nothing


def test_a_rival_that_explains_more_takes_the_place(space: ScoreTests):
    """A cubic spring in the place of a stop explains less, and the stop in its place more."""
    cubic = KNOWN["spring_cubic.rear"]
    free = space.given([*LAWS, cubic]).releasing([cubic.key])
    tried = free.try_all()
    (own,) = (c for c in tried if c.key == cubic.key)
    best, *_ = rivals(free, own, tried)
    assert best.effect.key == STOP.key
    assert best.margin < 0.0
    stop = refined(free, next(c for c in tried if c.key == STOP.key))
    assert all(rival.margin > 0.0 for rival in rivals(free, stop, tried))


def test_selected_effects_are_nuisance_and_released_ones_candidates(space: ScoreTests):
    bar = KNOWN["anti_roll_bar.front"]
    beside = space.given([bar])
    assert bar.key not in beside.best_tests
    again = beside.releasing([bar.key])
    # The same priors, but for their stiffening: the same test as alone.
    assert again.best_tests[bar.key].values == pytest.approx(space.best_tests[bar.key].values, rel=0.02)
