"""Columns between the values of a shape constant's grid."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.effects.suspension.coulomb import Coulomb
from lacet.identify.effects.suspension.stops import BumpStop
from lacet.identify.selection.columns.interpolation import interpolation_weights, searched_in_ratios

GRID = (0.002, 0.005, 0.01, 0.02, 0.04)


@pytest.mark.parametrize("at", [0.002, 0.0035, 0.007, 0.013, 0.03, 0.04])
def test_a_parabola_in_the_logarithm_is_exact_and_a_line_between_two_values(at: float):
    """Three neighbours carry a parabola of ln v; two carry a line in v."""
    found = interpolation_weights(GRID, at, ratios=True)
    assert sum(weight for _, weight in found) == pytest.approx(1.0)
    parabola = sum(weight * (1.0 + np.log(v) - 0.3 * np.log(v) ** 2) for v, weight in found)
    assert parabola == pytest.approx(1.0 + np.log(at) - 0.3 * np.log(at) ** 2)
    line = interpolation_weights(GRID, at, ratios=False)
    assert len(line) <= 2
    assert sum(weight * v for v, weight in line) == pytest.approx(at)


def test_beyond_the_grid_the_outermost_stands_for_it():
    """A constant may be searched beyond its grid, the noise in its column is not extrapolated."""
    assert interpolation_weights(GRID, 0.001, ratios=True) == [(0.002, 1.0)]
    assert interpolation_weights(GRID, 0.06, ratios=True) == [(0.04, 1.0)]


def test_a_constant_of_positive_and_distant_bounds_is_searched_in_ratios():
    """Friction's speed is, a stop's gap, which may be none, is not."""
    assert searched_in_ratios(Coulomb("front"), "v0")
    assert not searched_in_ratios(BumpStop("front"), "gap")
