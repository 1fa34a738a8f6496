"""The loop that linearises anew: it converges, keeps its limits, and ends by its rule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.gauss_newton import CHECK_RULE, FAULT_RULE, LinearStep, StepRule

RULE = StepRule(most=20, close=1e-9)


class Cube:
    """Newton's steps to the cube root of 2, and the values they were asked at."""

    def __init__(self, half: float = 0.0, final_from: int = 0):
        self.asked: list[float] = []
        self.half, self.final_from = half, final_from

    def __call__(self, steps_made: int, values: Array) -> LinearStep:
        assert steps_made == len(self.asked)
        self.asked.append(float(values[0]))
        step = (2.0 - values**3) / (3.0 * values**2)
        return LinearStep(step, np.full(1, self.half), final=steps_made >= self.final_from)


def test_it_converges_on_what_is_not_linear():
    cube = Cube()
    found = RULE.relinearised(cube, np.ones(1))
    assert found.values[0] == pytest.approx(2.0 ** (1.0 / 3.0), abs=1e-9)
    assert found.settled
    assert found.made == len(cube.asked) - 1
    assert cube.asked[-1] == found.values[0]


def test_a_plain_array_is_a_step_too():
    found = RULE.relinearised(lambda _, values: 3.0 - values, np.zeros(2))
    np.testing.assert_array_equal(found.values, [3.0, 3.0])
    assert found.made == 1


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_no_step_is_longer_than_the_longest(scale: float):
    """The limit is in its own unit: a phase for latencies, say."""
    cube = Cube()
    found = replace(RULE, most=40, longest=0.05, scale=scale).relinearised(cube, np.ones(1))
    steps = np.abs(np.diff(cube.asked))
    assert np.max(steps) == pytest.approx(0.05 / scale)
    assert found.values[0] == pytest.approx(2.0 ** (1.0 / 3.0), abs=1e-9)


@pytest.mark.parametrize("most", [0, 1, 3])
def test_what_never_settles_ends_after_the_most_steps(most: int):
    asked: list[float] = []

    def further(_: int, values: Array) -> Array:
        asked.append(float(values[0]))
        return np.ones(1)

    found = StepRule(most, close=0.5).relinearised(further, np.zeros(1))
    assert asked == list(range(most + 1))
    assert (found.values[0], found.settled, found.made) == (most, False, most)


def test_values_stay_within_their_bounds():
    found = replace(RULE, most=4).relinearised(
        lambda _, values: 3.0 - values, np.zeros(2), (-np.ones(2), np.array([1, 9]))
    )
    np.testing.assert_array_equal(found.values, [1.0, 3.0])


def test_a_small_step_is_made_or_not():
    for made in (False, True):
        asked: list[float] = []

        def once(_: int, values: Array, asked: list[float] = asked) -> Array:
            asked.append(float(values[0]))
            return np.full(1, 0.1)

        found = StepRule(5, close=0.5, small_step_made=made).relinearised(once, np.zeros(1))
        assert asked == ([0.0, 0.1] if made else [0.0])
        assert found.values[0] == asked[-1]
        assert found.settled


def test_the_first_step_may_have_its_own_tolerance():
    """Small at first, it is not worth a linearisation; once begun, steps go on to the other tolerance."""
    rule = replace(RULE, close=0.02, first_close=0.15)
    assert rule.relinearised(lambda _, values: 0.10 - values, np.zeros(1)).made == 0
    steps = iter((0.2, 0.1, 0.01))
    assert rule.relinearised(lambda *_: np.full(1, next(steps)), np.zeros(1)).made == 2


def test_tolerances_are_the_largest_of_three():
    step = np.full(1, 0.1)
    assert not RULE.is_small(step, np.ones(1), 1.0)
    assert StepRule(1, close=0.11).is_small(step, np.zeros(1))
    assert not StepRule(1, close=0.11, scale=2.0).is_small(step, np.zeros(1))
    assert StepRule(1, close_of_interval=0.5).is_small(step, np.zeros(1), 0.21)
    assert StepRule(1, close_of_value=0.5).is_small(step, np.full(1, -0.21))
    assert not StepRule(1, close_of_value=0.5).is_small(np.full(2, 0.1), np.array([0.21, 0.19]))


def test_coarse_equations_are_no_end():
    """A small step of equations that are not the last ones is made, and the next ones are asked."""
    assert RULE.relinearised(Cube(half=1.0), np.full(1, 2.0 ** (1.0 / 3.0))).made == 0
    assert RULE.relinearised(Cube(final_from=2), np.full(1, 2.0 ** (1.0 / 3.0))).made == 2


def test_the_named_rules_limit_what_they_say():
    """A latency's step by 15 ms; a fault's only by the fault's bounds."""
    far = np.array([1.0, -1.0])
    np.testing.assert_array_equal(CHECK_RULE.limited(far), [0.015, -0.015])
    np.testing.assert_array_equal(FAULT_RULE.limited(far), far)
    assert FAULT_RULE.is_small(0.0009 * far, far)
    assert not FAULT_RULE.is_small(0.0 * far, 0.0 * far)
