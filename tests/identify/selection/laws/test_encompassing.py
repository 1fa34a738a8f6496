"""Laws found, compared with laws of no catalogue in their place: stand-ins fall, what is there stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.subset_search import inexactness_of
from lacet.identify.selection.laws import encompassing
from lacet.identify.selection.laws.encompassing import (
    _better,
    encompasses,
    kinds_of,
)
from lacet.identify.selection.laws.formulas import laws_at
from lacet.identify.selection.laws.replacement import Replacement
from lacet.identify.selection.laws.search import without_noise
from lacet.identify.selection.rest import AddedLaw, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor
from tests.identify.exact_car import KNOWN, VEHICLE, driven, exact_with, fit_of

STAND_IN = KNOWN["damper_stroke_symmetric.front"]
UNLISTED = one_line_effects("hidden = suspension.front: p * tanh(abs(travel)/s0)*rate, s0 = 10 mm", VEHICLE, "hub")[0]


def beyond_chance(fall: float, null: Array) -> bool:
    """Without other candidates."""
    return bool(fall > np.max(null))


def with_law(fitted: Fit, law: Effect, floor: NoiseFloor) -> tuple[ScoreTests, AddedLaw]:
    """The model of a fit with a law, fitted again, and the law in it."""
    both = fitted.with_effects([law])
    space = without_noise(ScoreTests.of(Linearisation.of(both, floor), [], 0))
    (found,) = added_laws(space)
    return space, found


@pytest.fixture(scope="module")
def lacks_unlisted() -> Fit:
    """The model on a run of a car with damping that grows with the travel and saturates."""
    return fit_of(driven(exact_with(UNLISTED, 700.0), 1))


def test_a_listed_law_does_not_stand_for_another_that_is_not_listed(lacks_unlisted: Fit, floor: NoiseFloor):
    space, law = with_law(lacks_unlisted, STAND_IN, floor)
    assert beyond_chance(law.force, law.null)
    assert not encompasses(space, law, "front", beyond_chance)


def test_a_law_that_only_describes_is_as_inexact_as_one_elsewhere(lacks_unlisted: Fit, floor: NoiseFloor):
    _, law = with_law(lacks_unlisted, STAND_IN, floor)
    exact, describes = (inexactness_of("another", law.rows, [replace(law, describes=one)]) for one in (False, True))
    assert exact == pytest.approx(SELECTION.law_inexactness**2 * law.force)
    assert describes == pytest.approx(SELECTION.selected_inexactness**2 * law.force)


def test_an_effect_that_looks_like_a_law_may_explain_a_part_of_the_laws_whole_force(
    lacks_unlisted: Fit, floor: NoiseFloor
):
    """What nothing else explains of a law grows less as the effect joins it, and is no measure of how exact it is."""
    _, law = with_law(lacks_unlisted, STAND_IN, floor)
    alike = replace(law, looks_like=("another",), force=0.1 * law.force)
    rows = sorted(law.rows)[:1]
    whole = SELECTION.law_inexactness**2 * sum(law.row_force.values())
    assert inexactness_of("another", law.rows, [alike]) == pytest.approx(whole)
    assert inexactness_of("a third", law.rows, [alike]) == pytest.approx(SELECTION.law_inexactness**2 * alike.force)
    one = SELECTION.selected_inexactness**2 * max(alike.force, law.row_force[rows[0]])
    assert inexactness_of("another", rows, [alike]) == pytest.approx(one)


@pytest.mark.parametrize(("key", "size"), [("damper_stroke_symmetric.front", 3e5), ("coulomb.front", 60.0)])
def test_a_listed_law_that_is_there_stands(key: str, size: float, floor: NoiseFloor):
    """Whatever a thousand laws of no catalogue explain in its place by chance."""
    hidden = KNOWN[key]
    space, law = with_law(fit_of(driven(exact_with(hidden, size), 2)), hidden, floor)
    assert encompasses(space, law, "front", beyond_chance)


def test_more_than_the_truth_explains_must_be_beyond_chance(floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch):
    """Without any other bar: where the law is there, no law of the grammar is better in its place."""
    monkeypatch.setattr(encompassing, "SELECTION", replace(SELECTION, least_refinement_fall=-np.inf))
    hidden = KNOWN["coulomb.front"]
    space, law = with_law(fit_of(driven(exact_with(hidden, 60.0), 2)), hidden, floor)
    assert _better(space, law, [], laws_at(space, "suspension", "front"), silent) is None


def test_the_same_law_in_other_words_is_no_rival(floor: NoiseFloor):
    """The grammar has most laws of the catalogue, too."""
    hidden = KNOWN["spring_cubic.front"]
    space, law = with_law(fit_of(driven(exact_with(hidden, 3e6), 2)), hidden, floor)
    laws = {one.line.rows[0].text: one for one in laws_at(space, "suspension", "front")}
    place = Replacement.of(space, [law], [laws["p * travel**3"], laws["p * rate**3"]])
    assert place.others.tolist() == [2]


def test_equations_of_a_law_are_those_without_it(lacks_unlisted: Fit, floor: NoiseFloor):
    """Normal matrix and right side of the law and others in its place, against elimination of all else one by one."""
    space, law = with_law(lacks_unlisted, STAND_IN, floor)
    others = laws_at(space, "suspension", "front")[::60]
    place = Replacement.of(space, [law], others).given(np.array([1]))
    known, trials = space.beside(others)
    model, width = known.sums.layout.model, known.sums.layout.width
    own, right = np.eye(width), known.sums.layout.right  # columns of the model's own parameters in place of turned ones
    own[:model, :model] = np.linalg.inv(known.sums.turn)
    total = known.total.copy()
    total[np.ix_(known.nuisance, known.nuisance)] += known.prior
    total[known.nuisance, right] += known.prior_side
    total[right, known.nuisance] += known.prior_side
    total = own.T @ total @ own
    # The residual is that of a fit with the law, whose force it lacks.
    (at,) = law.places
    total[:, right] += total[:, at] * space.fitted.theta[space.fitted.place][at]
    beside = trials[0].place.start
    wanted = [at, *(trial.place.start for trial in trials[1:])]
    gone = [i for i in (*known.nuisance.tolist(), beside) if i != at]
    scale = np.sqrt(np.diag(total)[gone])
    gain = np.linalg.solve(total[np.ix_(gone, gone)] / np.outer(scale, scale), total[gone] / scale[:, None])
    left = total - (total[:, gone] / scale) @ gain
    unit = np.sqrt(np.maximum(np.diag(total)[wanted], 1.0))  # some never act on this run
    np.testing.assert_allclose(place.normal / np.outer(unit, unit), left[np.ix_(wanted, wanted)] / np.outer(unit, unit),
                               atol=1e-9)  # fmt: skip
    np.testing.assert_allclose(place.right / unit, left[wanted, right] / unit, atol=1e-6)
    margins, _ = place.margins()
    falls = place.right[place.others] ** 2 / np.diag(place.normal)[place.others]
    np.testing.assert_allclose(margins, falls - place.fall)


def test_rows_of_several_wheels_have_no_laws_of_the_grammar():
    rows = [Row.parse(text) for text in ("corner.fl", "body.roll", "suspension.fr", "suspension.fl", "chassis.fx")]
    assert kinds_of(rows, "front") == [("chassis.fx", ""), ("suspension", "front")]
