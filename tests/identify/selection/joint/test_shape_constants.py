"""Shape constants of effects searched together."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint import shape_constants
from lacet.identify.selection.joint.shape_constants import constants_by_runs, with_best_constants
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from tests.identify.exact_car import KNOWN, driven, fit_of
from tests.identify.selection.exact_ranking import DRAWS
from tests.identify.selection.joint.three_hidden import HIDDEN, KEYS, LAWS, STOP, with_all


def test_constants_searched_together_explain_more_than_one_after_the_other(space: ScoreTests):
    chosen = [*LAWS, replace(KNOWN[STOP.key], shape={"gap": 0.02, "n": 1.0})]
    *_, stop = with_best_constants(space, chosen)
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)


def test_a_law_is_the_simplest_of_its_kind_unless_another_explains_more():
    """Noise alone would bend a linear stop: its exponent cannot be less than 1."""
    linear = replace(STOP, shape={**STOP.shape, "n": 1.0})
    fitted = fit_of(driven(with_all([*HIDDEN, (linear, 60000.0)]), 3))
    space = ScoreTests.of(Linearisation.of(fitted, floor_of(fitted, DRAWS)), [KNOWN[key] for key in KEYS], 0)
    begun = [*LAWS, replace(linear, shape={"gap": 0.02, "n": 2.0})]
    *others, stop = with_best_constants(space, begun)
    assert others == LAWS
    assert stop.shape == {"gap": pytest.approx(linear.shape["gap"], abs=0.0005), "n": 1.0}


@pytest.mark.parametrize(
    ("falls", "chosen"),
    [
        ((100.0, 103.0, 111.0), 0),  # none beats it by 4 for each further constant
        ((100.0, 107.0, 112.5), 1),  # common ones beat the simplest, own ones these by less than 8
        ((100.0, 105.0, 114.0), 2),
        ((9900.0, 9910.0, 9920.0), 0),  # of a law of 10,000 weighted squares 25 are inexact
    ],
)
def test_a_law_has_the_fewest_constants_that_are_good_enough(
    space: ScoreTests, monkeypatch: pytest.MonkeyPatch, falls: tuple[float, ...], chosen: int
):
    """Simplest, common and own constants of a stop at both axles, beside an effect that has none."""
    stops = [KNOWN["bump_stop.front"], KNOWN["bump_stop.rear"]]
    shapes = [({"gap": 0.01, "n": n}, {"gap": gap, "n": other}) for n, gap, other in
              ((1.0, 0.01, 1.0), (1.2, 0.01, 1.2), (1.2, 0.02, 1.3))]  # fmt: skip
    answers = [[*(replace(e, shape=own) for e, own in zip(stops, both, strict=True)), LAWS[0]] for both in shapes]
    found = {None: 0.0, **dict(enumerate(falls))}
    monkeypatch.setattr(shape_constants._Falls, "of", lambda *_: shape_constants._Falls(None, [], None))
    monkeypatch.setattr(shape_constants._Falls, "of_choice", lambda self, at: found[at[0]])
    assert [shape_constants.constants_found(answer) for answer in answers] == [1, 2, 4]
    assert shape_constants._fewest_constants(space, answers, [[0, 1], [2]]) == answers[chosen]


def test_an_effect_that_is_added_without_a_ranking_gets_the_constants_of_the_runs(fitted: Fit, floor: NoiseFloor):
    *bars, stop = constants_by_runs(fitted, floor, [*LAWS, KNOWN[STOP.key]])
    assert bars == LAWS
    assert stop.shape["gap"] == pytest.approx(STOP.shape["gap"], abs=0.002)
    assert stop.shape["n"] == pytest.approx(STOP.shape["n"], abs=0.2)
