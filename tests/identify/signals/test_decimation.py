"""Decimation by sums of exponentials against the filter at every sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.identify.signals.decimation import comb, decimated
from lacet.identify.signals.filters import Filters, zero_phase


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from([(6.0, 250.0), (2.0, 250.0), (6.0, 1000.0), (20.0, 100.0), (110.0, 250.0)]), st.integers(5, 8),
    st.integers(30, 4000), st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_decimated_series_are_those_of_the_filter_at_every_sample(
    low_pass: tuple[float, float], order: int, n: int, seed: int
) -> None:
    """To 1e-12 of the largest value, up to both ends, of series that wander far from zero."""
    filters = Filters(fit_cutoff=low_pass[0], rate=low_pass[1], pre_cutoff=None, order=order)
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.standard_normal((2, 3, n)), axis=-1) + 100.0 * rng.standard_normal((2, 3, 1))
    places = comb(n, filters)
    expected = zero_phase(x, *low_pass, order)[..., places]
    found = decimated(x, filters)
    assert found.shape == (2, 3, len(places))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.max(np.abs(x)))


@pytest.mark.parametrize("n", [9, 10, 200, 5000])
def test_one_series_comes_out_as_among_many(n: int) -> None:
    """And the series given are not changed, and those of zeros are not computed."""
    filters = Filters()
    x = np.random.default_rng(3).standard_normal((40, n))
    before = x.copy()
    many = decimated(x, filters)
    np.testing.assert_array_equal(x, before)
    x[::3] = 0.0
    some = decimated(x, filters)
    assert not np.any(some[::3])
    np.testing.assert_allclose(some[1::3], many[1::3], rtol=0.0, atol=1e-14)
    for one, row in zip(before, many, strict=True):
        np.testing.assert_allclose(decimated(one, filters), row, rtol=0.0, atol=1e-14)


def test_a_series_without_a_kept_instant_or_of_none_gives_none() -> None:
    filters = Filters()
    assert decimated(np.ones((3, filters.step // 2)), filters).shape == (3, 0)
    assert decimated(np.zeros((0, 500)), filters).shape == (0, len(comb(500, filters)))


def test_the_comb_is_every_step_from_half_a_step_on() -> None:
    filters = Filters()
    step = filters.step
    assert list(comb(3 * step, filters)) == [step // 2, step // 2 + step, step // 2 + 2 * step]
