"""Laws found in whose place one of no catalogue is a better answer: they are told from laws that are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.progress import silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Answer, Reason
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.joint.refits import Joint, beside_of
from lacet.identify.selection.laws import unlisted_rivals
from lacet.identify.selection.laws.encompassing import beyond_chance_of
from lacet.identify.selection.laws.formulas import laws_at
from lacet.identify.selection.laws.replacement import Best, Replacement, Winner, family_wise
from lacet.identify.selection.laws.search import without_noise
from lacet.identify.selection.laws.unlisted_rivals import (
    _is_better,
    _is_better_without_noise,
    with_unlisted_rivals,
)
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor
from tests.identify.exact_car import KNOWN, VEHICLE, driven, exact_with_laws, fit_of

GROOVE = one_line_effects("hidden = suspension.front: p * tanh(abs(travel)/s0)*rate, s0 = 10 mm", VEHICLE, "hub")[0]
OF_LOAD = one_line_effects("hidden = suspension.front: p * load*tanh(rate/v0), v0 = 15 mm/s", VEHICLE, "hub")[0]
STROKE, BAR = KNOWN["damper_stroke_symmetric.front"], KNOWN["anti_roll_bar.front"]
FRICTION = replace(KNOWN["coulomb.front"], shape={"v0": 0.005})
CANDIDATES = [STROKE, BAR, FRICTION, KNOWN["damper_stroke.front"], KNOWN["spring_cubic.front"]]


def car_with(*hidden: tuple[Effect, float], seed: int = 1) -> Fit:
    """The model on a run of a car with these effects."""
    return fit_of(driven(exact_with_laws(hidden), seed))


def found_as(fitted: Fit, laws: Sequence[Effect], floor: NoiseFloor) -> Joint:
    """These laws found in a model."""
    first = ScoreTests.of(Linearisation.of(fitted, floor), CANDIDATES, 0)
    others = [effect for effect in CANDIDATES if effect not in laws]
    space = ScoreTests.of(Linearisation.of(fitted.with_effects(laws), floor), others, 0)
    return beside_of(Joint(first, (), space, (), tuple(laws), (), base=fitted, added=tuple(laws)), space)


@pytest.fixture(scope="module")
def groove_and_bar() -> Fit:
    """A car with dampers with a by-pass groove, which no catalogue has, and an anti-roll bar."""
    return car_with((GROOVE, 700.0), (BAR, 6000.0))


def test_a_law_that_another_of_no_catalogue_is_better_than_is_told_from_one_that_is_there(
    groove_and_bar: Fit, floor: NoiseFloor
):
    joint = found_as(groove_and_bar, [STROKE, BAR], floor)
    assert all(law.force > np.max(law.null) for law in joint.laws)
    assert with_unlisted_rivals(joint) == {STROKE.key}
    of_the_study = replace(joint, effects=(BAR,))  # what the user has added is not judged
    assert not with_unlisted_rivals(of_the_study)


def test_of_two_laws_that_do_the_work_of_one_neither_stays(floor: NoiseFloor):
    """The rival's constant lies between two values of its grid: on these the two explain more together."""
    pair = [FRICTION, KNOWN["damper_stroke.front"]]
    joint = found_as(car_with((OF_LOAD, 0.02)), pair, floor)
    assert all(law.force > np.max(law.null) for law in joint.laws)
    assert with_unlisted_rivals(joint) == {law.key for law in pair}


@pytest.mark.parametrize("laws", [[(STROKE, 3e5)], [(FRICTION, 60.0), (BAR, 6000.0)]])
def test_laws_that_are_there_stay(laws: list[tuple[Effect, float]], floor: NoiseFloor):
    """Whatever six hundred laws of no catalogue explain in their place."""
    joint = found_as(car_with(*laws, seed=2), [law for law, _ in laws], floor)
    assert not with_unlisted_rivals(joint)


def test_a_rival_must_explain_more_with_the_noise_in_the_columns_taken_off(groove_and_bar: Fit, floor: NoiseFloor):
    """A law that has much of it may explain less than a rival with little where it is not taken off."""
    stroke = found_as(car_with((STROKE, 3e5), seed=2), [STROKE], floor)
    assert not _is_better_without_noise(stroke, STROKE.key, GROOVE, 0, silent)
    assert _is_better_without_noise(found_as(groove_and_bar, [STROKE, BAR], floor), STROKE.key, GROOVE, 0, silent)


def test_a_law_of_the_catalogue_takes_no_name_away(floor: NoiseFloor):
    """Friction for which quadratic damping was found, say: a rival that the search has."""
    joint = found_as(car_with((FRICTION, 60.0)), [STROKE], floor)
    assert not with_unlisted_rivals(joint)
    without = replace(joint, first=replace_candidates(joint.first, [STROKE, BAR]))
    assert with_unlisted_rivals(without) == {STROKE.key}


def replace_candidates(space: ScoreTests, candidates: Sequence[Effect]) -> ScoreTests:
    """Score tests of other candidates beside the same model."""
    return ScoreTests.of(space.linearisation, candidates, 0)


def test_no_more_than_laws_may_be_inexact_takes_a_name_away(
    groove_and_bar: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(unlisted_rivals, "SELECTION", replace(SELECTION, selected_inexactness=1.0))
    assert not with_unlisted_rivals(found_as(groove_and_bar, [STROKE, BAR], floor))


def test_the_best_of_a_pool_is_that_of_its_parts(groove_and_bar: Fit, floor: NoiseFloor):
    """Its margin is what it explains in place of the law, less what this does."""
    joint = found_as(groove_and_bar, [STROKE, BAR], floor)
    space, pool = without_noise(joint.space), laws_at(joint.space, "suspension", "front")[::20]
    laws = [law for law in joint.laws if law.key == STROKE.key]
    whole = Best(space.draws).over(Replacement.of(space, laws, pool), pool)
    parts = Best(space.draws)
    for batch in (pool[:10], pool[10:]):
        parts = parts.over(Replacement.of(space, laws, batch), batch)
    one, same = whole.winner, parts.winner
    assert one is not None
    assert same is not None
    assert one.law is same.law
    assert one.margin == pytest.approx(same.margin)
    np.testing.assert_allclose(parts.drawn, whole.drawn)
    assert whole.p == (1 + np.count_nonzero(whole.drawn >= one.margin)) / (1 + space.draws)
    assert one.place.force_at(np.array([one.place.k])) - one.place.fall == pytest.approx(one.margin)


def test_a_law_stays_that_explains_more_than_chance_beside_the_better_one(floor: NoiseFloor):
    """Both are there; the one that is not listed is sought where something remains."""
    joint = found_as(car_with((GROOVE, 1500.0), (BAR, 1500.0)), [BAR], floor)
    assert not with_unlisted_rivals(joint)


def test_a_better_law_is_better_by_more_than_chance(
    groove_and_bar: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    joint = found_as(groove_and_bar, [STROKE, BAR], floor)
    space, stands = without_noise(joint.space), beyond_chance_of(joint.space)
    (law,) = (law for law in joint.laws if law.key == STROKE.key)
    pool = laws_at(joint.space, "suspension", "front")
    best = Best(space.draws).over(Replacement.of(space, [law], pool), pool)
    one = best.winner
    assert one is not None
    assert _is_better(one, stands)
    assert not _is_better(one, lambda fall, null: True)
    assert family_wise([best]) == [best.p] == [1 / (1 + space.draws)]
    by_chance = replace(best, drawn=best.drawn + one.margin - np.min(best.drawn))
    monkeypatch.setattr(unlisted_rivals, "family_wise", lambda many: [by_chance.p for _ in many])
    assert not with_unlisted_rivals(joint)


def test_the_more_laws_are_found_the_larger_a_margin_is_by_chance():
    """Of laws that are the truth, one in a hundred has a margin beyond chance, and not one of each six."""
    rng, draws, alone, together = np.random.default_rng(3), 199, 0, 0
    for _ in range(400):
        # Each law's margins have a size of their own; the last run is the measured one.
        runs = [rng.gumbel(-5.0 * k, 1.0 + k, draws + 1) for k in range(6)]
        best = [Best(draws, Winner(GROOVE, None, float(one[-1])), one[:-1]) for one in runs]  # type: ignore[arg-type]
        level = SELECTION.level(draws)
        alone += any(one.p <= level for one in best)
        together += any(p <= level for p in family_wise(best))
    assert alone / 400 == pytest.approx(1 - 0.99**6, abs=0.02)
    assert together / 400 <= 0.02
    # A margin beyond all of its own is one, however large those of another law are.
    large = Best(draws, Winner(GROOVE, None, 0.0), rng.normal(0.0, 1e3, draws))  # type: ignore[arg-type]
    small = Best(draws, Winner(GROOVE, None, 9.0), rng.normal(0.0, 1.0, draws))  # type: ignore[arg-type]
    assert family_wise([large, small])[1] == 1.0 / (1 + draws)
    assert family_wise([Best(draws), Best(draws)]) == [1.0, 1.0]
    assert family_wise([best[0], Best(draws)])[1] == 1.0


@pytest.mark.parametrize("size", [300.0, 500.0])
def test_a_diagnosis_declares_the_cause_unlisted(size: float, floor: NoiseFloor):
    """Nothing remains beside the listed law, and of the smaller one less than chance leaves in a row without it."""
    diagnosis = diagnose(car_with((GROOVE, size)), floor, CANDIDATES)
    assert (diagnosis.unlisted, diagnosis.found) == (True, ())
    assert diagnosis.unlisted_rows
    assert diagnosis.formulas
    (stroke,) = (c for c in diagnosis.candidates if c.key == STROKE.key)
    assert (stroke.answer, stroke.reason) == (Answer.UNDECIDED, Reason.PART_OF_REST)
