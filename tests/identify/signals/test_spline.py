"""The cubic spline against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.interpolate

from lacet.identify.signals.spline import CubicSpline


@pytest.mark.parametrize("natural", [True, False])
@pytest.mark.parametrize("knots", [2, 3, 4, 5, 400])
@pytest.mark.parametrize("even", [True, False])
def test_values_and_derivatives_are_those_of_scipy(knots: int, natural: bool, even: bool) -> None:
    """To 1e-10 of the largest, between the knots, on them and beyond both ends."""
    rng = np.random.default_rng(knots)
    t = np.arange(1.0, knots + 1.0) if even else np.cumsum(0.5 + rng.random(knots))
    values = rng.standard_normal((3, knots)) + 50.0
    x = np.concatenate([t, rng.uniform(t[0] - 0.4, t[-1] + 0.4, 300)])
    if natural and knots == 2:
        return  # a line, as without
    theirs = scipy.interpolate.CubicSpline(t, values, axis=1, bc_type="natural" if natural else "not-a-knot")
    ours = CubicSpline.of(t, values, natural)
    for order in range(3):
        expected = theirs(x, order)
        tolerance = 1e-10 * np.max(np.abs(theirs(x)))
        np.testing.assert_allclose(ours.at(x, order), expected, rtol=0.0, atol=tolerance)
        np.testing.assert_array_equal(ours.course(x)[order], ours.at(x, order))
        np.testing.assert_array_equal(ours.one(1).at(x, order), ours.at(x, order)[1:2])
