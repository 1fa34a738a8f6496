"""Recursive filters against SciPy's."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from lacet.identify.signals.recursion import recursion


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.floats(-3, 3), min_size=1, max_size=3), st.floats(0.0, 0.999), st.floats(0.0, 3.1), st.integers(3, 400),
    st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_the_series_is_that_of_scipys_filter(b: list[float], radius: float, angle: float, n: int, seed: int) -> None:
    """Of two conjugate poles anywhere within the unit circle, from rest, series by series."""
    a = (1.0, -2.0 * radius * np.cos(angle), radius**2)
    x = np.random.default_rng(seed).standard_normal((2, 3, n))
    expected = lfilter(b, a, x, axis=-1)
    np.testing.assert_allclose(recursion(b, a, x), expected, rtol=0.0, atol=1e-9 * (1.0 + np.max(np.abs(expected))))
