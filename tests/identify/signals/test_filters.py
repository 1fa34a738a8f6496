"""Filters: cut-offs of the two passes, phase, derivatives, resampling, decimation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfiltfilt, sosfreqz

from lacet.identify.signals.filters import (
    Filters,
    bring_to_grid,
    decimate,
    derivative,
    poles,
    two_pass_gain,
    zero_phase,
)
from tests.identify import exact_car

RATE = 250.0


def _one_pass(cutoff: float, rate: float, order: int) -> float:
    """Cut-off of one pass [Hz] with which two are at −3 dB at `cutoff`, on the warped axis."""
    return rate / np.pi * np.arctan(np.tan(np.pi * cutoff / rate) * (np.sqrt(2.0) - 1.0) ** (-0.5 / order))


@given(st.floats(0.5, 60.0), st.sampled_from([100.0, 250.0, 500.0, 1000.0]), st.integers(5, 8))
def test_gain_and_poles_are_those_of_scipys_butterworth_at_minus_3_db(cutoff: float, rate: float, order: int) -> None:
    """|H|² of one pass, which is |H| of both, is 1/√2 at the cut-off asked for, and SciPy's everywhere."""
    if cutoff > 0.45 * rate:
        return
    once = _one_pass(cutoff, rate, order)
    frequency = np.array([0.0, 0.3 * cutoff, cutoff, 0.48 * rate])
    expected = np.abs(sosfreqz(butter(order, once, fs=rate, output="sos"), worN=frequency, fs=rate)[1]) ** 2
    found = two_pass_gain(frequency, cutoff, rate, order)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found[[0, 2]], [1.0, np.sqrt(0.5)], rtol=1e-12)
    theirs = np.poly(butter(order, once, fs=rate, output="zpk")[1])
    np.testing.assert_allclose(np.poly(poles(cutoff, rate, order)), theirs, atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(st.floats(2.0, 40.0), st.integers(5, 8), st.integers(1500, 3000), st.integers(0, 2**32 - 1))
def test_the_filter_is_scipys_forward_and_backward_away_from_the_ends(
    cutoff: float, order: int, n: int, seed: int
) -> None:
    """SciPy continues a series by a part of its own and then by a constant: that is forgotten inside."""
    x = np.cumsum(np.random.default_rng(seed).standard_normal((2, n)), axis=-1)
    expected = sosfiltfilt(butter(order, _one_pass(cutoff, RATE, order), fs=RATE, output="sos"), x, padlen=n // 2)
    inner = slice(int(700 * 2.0 / cutoff), -int(700 * 2.0 / cutoff))
    np.testing.assert_allclose(zero_phase(x, cutoff, RATE, order)[:, inner], expected[:, inner], atol=1e-6)


@settings(deadline=None, max_examples=40)
@given(st.floats(0.5, 5.5), st.floats(0, 6.2), st.integers(5, 8))
def test_no_phase_and_the_amplitude_of_the_transfer_function(frequency: float, phase: float, order: int) -> None:
    """A sine comes out as the same sine, smaller by |H|² of one pass, far from the ends."""
    t = np.arange(5000) / RATE
    out = zero_phase(np.sin(2 * np.pi * frequency * t + phase), 6.0, RATE, order)
    gain = two_pass_gain(np.array([frequency]), 6.0, RATE, order)
    inner = slice(1000, 4000)
    expected = gain * np.sin(2 * np.pi * frequency * t + phase)
    np.testing.assert_allclose(out[inner], expected[inner], atol=1e-6)


def test_a_filter_works_row_by_row_and_keeps_a_straight_line() -> None:
    """Stacked series are filtered alike; a line passes unchanged up to its ends."""
    t = np.arange(2000) / RATE
    x = np.stack([3.0 + 2.0 * t, np.sin(t), np.cos(5 * t)])
    out = zero_phase(x, 6.0, RATE, 6)
    np.testing.assert_allclose(out[0], x[0], rtol=1e-12)
    for one, row in zip(x, out, strict=True):
        np.testing.assert_allclose(zero_phase(one, 6.0, RATE, 6), row, atol=1e-12)


@pytest.mark.parametrize("n", [3000, 4001, 1500, 130])
@pytest.mark.parametrize(("cutoff", "order"), [(20.0, 6), (6.0, 5)])
def test_a_series_of_any_length_is_continued_turned_about_both_ends(n: int, cutoff: float, order: int) -> None:
    """Also where n − 1 is prime, and the series is made longer before it is filtered: against Fourier's sum of it."""
    x = np.cumsum(np.random.default_rng(n).standard_normal((2, n)), axis=1) + 50.0
    line = x[:, :1] + (x[:, -1:] - x[:, :1]) * np.linspace(0.0, 1.0, n)
    odd = np.concatenate([x - line, -(x - line)[:, -2:0:-1]], axis=1)
    gain = two_pass_gain(np.fft.rfftfreq(odd.shape[1], 1.0 / RATE), cutoff, RATE, order)
    expected = line + np.fft.irfft(np.fft.rfft(odd) * gain, odd.shape[1])[:, :n]
    found = zero_phase(x, cutoff, RATE, order)
    assert found.flags.c_contiguous
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.max(np.abs(x)))


@pytest.mark.parametrize(("frequency", "error"), [(1.0, 1e-9), (6.0, 2e-6), (20.0, 5e-4)])
def test_derivative_is_accurate_up_to_the_prefilter(frequency: float, error: float) -> None:
    """Relative error of the amplitude; and no phase shift at all."""
    t = np.arange(1001) / RATE
    w = 2 * np.pi * frequency
    inner = slice(4, -4)
    found = derivative(np.sin(w * t), RATE)[inner]
    np.testing.assert_allclose(found, w * np.cos(w * t)[inner], atol=error * w)
    assert abs(np.dot(found, np.sin(w * t)[inner]) / np.dot(found, found)) < 1e-6


@settings(deadline=None)
@given(st.lists(st.floats(-5, 5), min_size=1, max_size=9), st.integers(9, 60))
def test_derivative_is_exact_for_polynomials_of_eighth_degree(coefficients: list[float], n: int) -> None:
    """Away from the four samples at each end."""
    t = np.linspace(-1, 1, n)
    p = np.polynomial.Polynomial(coefficients)
    found = derivative(np.stack([p(t), -p(t)]), (n - 1) / 2.0)
    inner = slice(4, n - 4)
    np.testing.assert_allclose(found[0, inner], p.deriv()(t)[inner], atol=1e-8 * (1 + np.sum(np.abs(coefficients)) * n))
    np.testing.assert_array_equal(found[1], -found[0])


def test_derivative_of_a_short_series_has_its_shape() -> None:
    """Fewer than nine samples fall back to the three-point rule."""
    np.testing.assert_allclose(derivative(np.array([0.0, 1.0, 2.0, 3.0]), 10.0), 10.0)


def test_decimation_is_just_above_twice_the_cutoff_and_filters_first() -> None:
    """Samples kept are those of the filtered series; the kept rate holds the fit's band."""
    for cutoff in (3.0, 6.0, 7.0):
        filters = Filters(fit_cutoff=cutoff, pre_cutoff=25.0)
        kept_rate = filters.rate / filters.step
        assert 2 * cutoff < kept_rate < 2.8 * cutoff
    filters = Filters()
    x = np.random.default_rng(0).normal(size=(2, 3, 2000))
    keep = np.arange(5, 2000, filters.step)
    np.testing.assert_array_equal(decimate(x, filters, keep), zero_phase(x, 6.0, filters.rate, 6)[..., keep])


@pytest.mark.parametrize(
    ("settings_", "message"),
    [
        ({"order": 4}, "5 to 8"),
        ({"order": 9}, "5 to 8"),
        ({"pre_cutoff": 10.0}, "at least 3 times"),
        ({"fit_cutoff": 6.0, "rate": 12.0, "pre_cutoff": None}, "needs a rate above"),
    ],
)
def test_settings_that_bias_are_refused(settings_: dict, message: str) -> None:
    """Orders outside 5 to 8, a pre-filter near the fit's, a rate too low."""
    with pytest.raises(ValueError, match=message):
        Filters(**settings_)


@settings(deadline=None, max_examples=25)
@given(st.floats(0.0, 0.35), st.integers(0, 2**32 - 1), st.sampled_from([100.0, 200.0, 500.0]))
def test_jittered_stamps_come_to_the_grid(jitter: float, seed: int, rate: float) -> None:
    """Stamps off by up to a third of a step: the curve is found again at the grid's own instants."""
    rng = np.random.default_rng(seed)
    n = int(8 * rate)
    t = (np.arange(n) + rng.uniform(-jitter, jitter, n)) / rate

    def curve(x: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(2 * np.pi * 1.3 * x), 5 + np.cos(2 * np.pi * 0.4 * x)], axis=1)

    grid = np.arange(2.0, 6.0, 1 / RATE)
    found = bring_to_grid(t, curve(t), grid, None, 6)
    assert found.shape == (2, grid.size)
    np.testing.assert_allclose(found, curve(grid).T, atol=2e-4 * (100.0 / rate))
    filtered = bring_to_grid(t, curve(t), grid, 20.0, 6)
    np.testing.assert_allclose(filtered, curve(grid).T, atol=5e-4)


def test_a_grid_on_the_samples_takes_the_samples() -> None:
    """Nothing is interpolated where nothing has to be."""
    t = 3.0 + np.arange(500) / RATE
    values = np.random.default_rng(1).normal(size=(500, 2))
    np.testing.assert_array_equal(bring_to_grid(t, values, t[10:400], None, 6), values[10:400].T)


def test_prefilter_takes_out_what_would_alias() -> None:
    """40 Hz on a 500 Hz channel is gone at 20 Hz cut-off: order 6, two passes, an octave: 72 dB and more."""
    t = np.arange(4000) / 500.0
    out = bring_to_grid(t, np.sin(2 * np.pi * 40 * t)[:, None], np.arange(2.0, 6.0, 1 / RATE), 20.0, 6)
    assert np.max(np.abs(out)) < 10 ** (-60 / 20)


def test_many_series_go_through_the_filter_as_each_would_alone() -> None:
    """More than one batch, none, empty ones, and a row that the drive lacks."""
    rng = np.random.default_rng(5)
    drive = exact_car.driven(exact_car.exact(), 1)
    n = drive.recording.t.size
    many = [
        {"suspension.fl": rng.standard_normal((3, n)), "tyre.rr": np.zeros((2, n))},
        {},
        {"suspension.fl": rng.standard_normal(n), "nowhere": np.ones(n)},
        *({"chassis.fz": rng.standard_normal((40, n))} for _ in range(3)),
    ]
    found = drive.decimated_each(iter(many))
    assert [set(rows) for rows in found] == [
        {"suspension.fl", "tyre.rr"},
        set(),
        {"suspension.fl"},
        *[{"chassis.fz"}] * 3,
    ]
    for rows, got in zip(many, found, strict=True):
        for row, series in got.items():
            expected = decimate(rows[row], drive.recording.filters, drive.index[row])
            np.testing.assert_allclose(series, expected, rtol=0.0, atol=1e-12)
    assert drive.decimated_each([]) == []
