"""Search for laws: what is hidden is found, named where the catalogue has it, and told with simpler and longer laws."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.effects.language.compiled import OneLine, one_line_effects
from lacet.identify.effects.language.parser import read_line
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.laws import formulas
from lacet.identify.selection.laws.formulas import Formula, propose
from lacet.identify.selection.laws.grammar import pool
from lacet.identify.selection.laws.held_out import squares_in_held_blocks
from lacet.identify.selection.laws.names import catalogue_names, key_of
from lacet.identify.selection.laws.search import Found, chosen, distinct, simplest
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor
from tests.identify.exact_car import VEHICLE, driven, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES
from tests.identify.selection.held import runs_of


def found_for(law: str, size: float, floor: NoiseFloor) -> tuple[ScoreTests, list[Formula]]:
    """Score tests, and formulae for a car with this law at its front suspensions."""
    hidden = one_line_effects(f"hidden = suspension.front: p * {law}", VEHICLE, "hub")[0]
    space = ScoreTests.of(Linearisation.of(fit_of(driven(exact_with(hidden, size), 1)), floor), CANDIDATES, 0)
    return space, propose(space, space.residual_beside([]).above)


def test_a_law_with_memory_is_found_at_its_place(floor: NoiseFloor) -> None:
    """Damping by |travel| on a soft mount: no catalogue has it. What is written is a line that can be read."""
    _, formulas = found_for("lag(abs(travel)*rate, T), T = 30 ms", 60000.0, floor)
    first = formulas[0]
    assert first.text.startswith("suspension.front: p")
    assert "lag(abs(travel)*rate, T)" in first.text
    assert first.law.explained > 0.9
    assert first.law.listed == ()
    assert first.law in first.front
    assert [law.explained for law in first.front] == sorted(law.explained for law in first.front)
    assert read_line(first.text).rows[0].named == "suspension.front"


def test_a_law_that_makes_the_error_larger_where_it_was_not_fitted_describes_nothing(
    floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that remain of a front are the ones that explain at least what a candidate must."""
    whole = formulas._explained

    def worse(scores: ScoreTests) -> dict[str, float]:
        found = whole(scores)
        most = max(found.values())
        return {key: value if value == most else -0.64 for key, value in found.items()}

    monkeypatch.setattr(formulas, "_explained", worse)
    _, (first, *_) = found_for("abs(travel)*rate", 60000.0, floor)
    assert first.front == (first.law,)
    monkeypatch.setattr(formulas, "_explained", lambda scores: dict.fromkeys(whole(scores), -0.64))
    assert found_for("abs(travel)*rate", 60000.0, floor)[1] == []


def test_a_law_of_the_catalogue_has_its_name(space: ScoreTests) -> None:
    """By its columns on these runs: constants need not be those of the grid, and others are not named."""
    laws = {law.line.rows[0].text: law for law in pool("suspension")}
    bar = laws["p * (travel - travel_other)"]("front")
    friction = laws["p * tanh(rate/v0)"]("front", {"v0": 0.014})
    turning = laws["p * hysteresis(travel, length)"]("front", {"length": 0.005})
    mounted = laws["p * lag(rate, T)"]("front", {"T": 0.03})
    other = laws["p * abs(travel)*abs(rate)"]("front")
    names = catalogue_names(space, [bar, friction, turning, mounted, other])
    assert names[key_of(bar)] == ("anti_roll_bar.front",)
    assert names[key_of(friction)] == ("coulomb.front",)
    assert names[key_of(turning)] == ("damper_hysteresis.front",)
    assert names[key_of(mounted)] == ("damper_mount.front",)
    assert names[key_of(other)] == ()


def test_squares_in_held_blocks_are_those_of_fits_without_them(space: ScoreTests) -> None:
    """Against ordinary least squares with priors on the samples outside each fold, one trial beside model and sheet."""
    trial = space.layout.trials[0]
    squares = squares_in_held_blocks(space.regression, [trial])
    known, right, w = space.regression, space.layout.right, space.layout.width
    wanted: dict[Row, np.ndarray] = {}
    for fold in range(SELECTION.folds):
        _, gain, reduced = known.outside[fold]
        at = trial.place
        noise = (1.0 - 1.0 / SELECTION.folds) * known.noise[at, at]
        value = np.linalg.solve(reduced[at, at] + noise, reduced[at, right])
        for run in runs_of(space.sums):
            for with_law in (0, 1):
                coefficients = np.zeros((w, 1))
                coefficients[right] = 1.0
                coefficients[at, 0] = -with_law * value
                coefficients[known.nuisance] = -gain @ coefficients
                for block, series in run.series(coefficients):
                    inside = (run.first + block.number) % SELECTION.folds == fold
                    here = wanted.setdefault(block.row, np.zeros(2))
                    here[with_law] += float(np.sum(series[inside, 0] ** 2))
    assert squares.keys() == wanted.keys()
    for row, both in wanted.items():
        np.testing.assert_allclose(squares[row], both, rtol=1e-9)


def _law(number: int, terms: int, *falls: float) -> Found:
    laws = [plain_law(number + k) for k in range(terms)]
    return Found(tuple(laws), np.array(falls), 0.01)


def plain_law(number: int) -> OneLine:
    """A law without constants."""
    plain = [law for law in pool("suspension") if not law.grids]
    return plain[number]("front")


def test_the_front_is_the_best_of_each_size_that_explains_more_than_smaller_ones() -> None:
    poor, good = _law(0, 1, 5.0, 5.0), _law(1, 1, 40.0, 40.0)
    hardly, more = _law(2, 2, 40.0, 40.5), _law(3, 3, 48.0, 48.0)
    assert simplest([more, hardly, poor, good]) == [good, more]
    assert distinct([good, _law(1, 1, 30.0, 30.0), poor], 2) == [good, poor]


@pytest.mark.parametrize(("longer", "best"), [((45.0, 35.0), 0), ((41.0, 41.5), 1)])
def test_the_simplest_within_a_standard_error_of_the_best_is_chosen(longer: tuple[float, float], best: int) -> None:
    """More in each fold is believed, more in one and less in another is not."""
    front = [_law(0, 1, 38.0, 38.0), _law(1, 2, *longer)]
    assert chosen(front) is front[best]
