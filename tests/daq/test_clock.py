"""The clock fit against clocks that are known because they are made here."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lacet.daq.clock import MAX_DRIFT, fit_clock

T0 = 1_700_000_000 * 10**9
MS = 1_000_000


def instants(seconds: float, rate: float, drift: float, start_device: int = 7 * 10**9):
    """True instants on the arrival clock and the device's stamps of them [ns]."""
    true = T0 + np.rint(np.arange(int(seconds * rate)) / rate * 1e9 * (1 + drift)).astype(np.int64)
    device = start_device + np.rint((true - T0) / (1 + drift)).astype(np.int64)
    return true, device


def latency_timer(true: np.ndarray, rng: np.random.Generator, period_ns: int = 16 * MS) -> np.ndarray:
    """Arrivals through a serial adapter that hands over what it has every 16 ms, at least 0.5 ms late."""
    phase = int(rng.integers(period_ns))
    ready = true + 500_000 + rng.integers(0, 100_000, len(true))
    return -(-(ready - phase) // period_ns) * period_ns + phase


@pytest.mark.parametrize("drift", [-200e-6, -20e-6, 0.0, 35e-6, 200e-6])
def test_latency_timer_of_16_ms(drift: float):
    """The measured case of the docs: 4.7 ms jitter and 9 ms bias by arrival, microseconds and 0.5 ms by envelope."""
    rng = np.random.default_rng(4)
    true, device = instants(120, 200, drift)
    device = device + rng.integers(-4000, 4000, len(device))  # the device stamps to 4 µs
    arrival = latency_timer(true, rng)
    by_arrival = arrival - true
    assert by_arrival.std() > 4 * MS
    assert by_arrival.mean() > 8 * MS
    fit = fit_clock(arrival, device)
    error = fit.apply(device) - true
    assert error.std() < 30_000
    # 5 ms samples meet a 16 ms timer on a grid of 1 ms; clocks that do not drift at all may stay between its lines.
    assert 0.4 * MS < error.mean() < (1.6 if drift == 0 else 1.0) * MS
    assert abs(fit.drift - drift) < 1e-6
    assert len(fit.jumps) == 0
    assert fit.delay_std_ns == pytest.approx(by_arrival.std(), rel=0.1)
    slope, cut = np.polyfit((device - device[0]) / 1e9, (arrival - device - (arrival[0] - device[0])) / 1e9, 1)
    squares = device + (arrival[0] - device[0]) + ((slope * (device - device[0])) + cut * 1e9) - true
    assert squares.mean() > 8 * MS  # what a least-squares line would leave


@given(
    st.integers(0, 2**32 - 1),
    st.floats(-200e-6, 200e-6),
    st.sampled_from(["exponential", "uniform", "none"]),
    st.integers(2, 3000),
)
@settings(max_examples=60, deadline=None)
def test_the_line_is_below_every_arrival_and_touches(seed: int, drift: float, kind: str, n: int):
    rng = np.random.default_rng(seed)
    true, device = instants((n + 0.5) / 200, 200, drift)
    delay = {
        "exponential": rng.exponential(3 * MS, n),
        "uniform": rng.uniform(0, 16 * MS, n),
        "none": np.zeros(n),
    }[kind]
    arrival = true + np.rint(np.minimum(delay, 60 * MS)).astype(np.int64)
    fit = fit_clock(arrival, device)
    above = arrival - fit.apply(device)
    assert above.min() >= -1
    assert above.min() <= 1
    assert abs(fit.drift) <= MAX_DRIFT
    if abs(fit.drift) < MAX_DRIFT:  # optimal: no line below all points is nearer on average; try tilts about the mean
        x = (device - device.mean()).astype(float)
        lag = (arrival - device - (arrival[0] - device[0])).astype(float)
        best = np.min(lag - fit.drift * x)
        for tilt in (-1e-4, -1e-6, 1e-6, 1e-4):
            assert np.min(lag - (fit.drift + tilt) * x) <= best + 1e-2


@given(st.integers(0, 2**32 - 1), st.integers(-(10**12), 10**12), st.integers(-(10**15), 10**15))
@settings(max_examples=25, deadline=None)
def test_origins_do_not_matter(seed: int, arrival_shift: int, device_shift: int):
    rng = np.random.default_rng(seed)
    true, device = instants(20, 100, 50e-6)
    arrival = latency_timer(true, rng)
    one = fit_clock(arrival, device)
    two = fit_clock(arrival + arrival_shift, device + device_shift)
    np.testing.assert_allclose(one.apply(device) + arrival_shift, two.apply(device + device_shift), atol=1, rtol=0)
    assert one.drift == pytest.approx(two.drift, abs=1e-12)


@given(
    st.integers(0, 2**32 - 1),
    st.integers(-(10**11), 10**11).filter(lambda jump: abs(jump) > 300 * MS),
    st.floats(-200e-6, 200e-6),
)
@settings(max_examples=30, deadline=None)
@example(seed=315, jump=300000001, drift=-5.712481033714044e-05)
def test_a_jump_or_reset_parts_two_clocks(seed: int, jump: int, drift: float):
    rng = np.random.default_rng(seed)
    true, device = instants(60, 200, drift)
    at = int(rng.integers(3000, 9000))
    device = device + jump * (np.arange(len(device)) >= at)
    arrival = latency_timer(true, rng)
    fit = fit_clock(arrival, device)
    assert fit.jumps.tolist() == [at]
    # A group of samples arrives at one instant, so the neighbours of the jump can be taken for the other side's.
    near = np.abs(np.arange(len(true)) - at) < 5
    error = fit.apply(device, arrival) - true
    # Either side is a clock of its own, with its own small bias.
    for side in (np.arange(len(true)) < at, np.arange(len(true)) >= at):
        assert error[side & ~near].std() < 0.5 * MS
        assert -MS < error[side & ~near].mean() < 1.5 * MS
    with pytest.raises(ValueError, match="arrivals"):
        fit.apply(device)


def test_drifts_of_less_than_a_step_of_the_timer_in_a_stretch():
    """What a line on one tread of the staircase gets wrong most: a step of 1 ms comes once in 15 to 60 s."""
    rng = np.random.default_rng(11)
    for drift in np.linspace(-66e-6, 66e-6, 60):
        true, device = instants(60, 200, drift)
        at = int(rng.integers(3000, 9000))
        device = device + 5 * 10**9 * (np.arange(len(device)) >= at)
        arrival = latency_timer(true, rng)
        error = fit_clock(arrival, device).apply(device, arrival) - true
        for side in (error[: at - 5], error[at + 5 :]):
            assert side.std() < 0.35 * MS
            assert 0.0 < side.mean() < 1.6 * MS


def test_a_parted_clock_without_delays_is_exact():
    true, device = instants(60, 200, 35e-6)
    device = device - 3 * 10**9 * (np.arange(len(device)) >= 9000)
    fit = fit_clock(true, device)
    assert fit.drift == pytest.approx(35e-6, abs=1e-10)
    assert np.abs(fit.apply(device, true) - true).max() <= 4  # device stamps are whole nanoseconds


def test_a_stall_and_a_late_frame_are_no_jumps():
    rng = np.random.default_rng(2)
    true, device = instants(60, 200, 20e-6)
    arrival = latency_timer(true, rng)
    stall = (true > true[4000]) & (true < true[4000] + 2500 * MS)
    arrival[stall] = true[4000] + 2500 * MS  # nothing for 2.5 s, then all at once
    arrival[8000] += 400 * MS
    fit = fit_clock(arrival, device)
    assert len(fit.jumps) == 0
    assert len(fit.outliers) == 0
    assert abs((fit.apply(device) - true).mean()) < MS


def test_a_wrong_device_stamp_is_an_outlier():
    rng = np.random.default_rng(2)
    true, device = instants(60, 200, 20e-6)
    arrival = latency_timer(true, rng)
    wrong = device.copy()
    wrong[5000] += 10**10
    fit = fit_clock(arrival, wrong)
    assert fit.outliers.tolist() == [5000]
    assert len(fit.jumps) == 0
    assert abs((fit.apply(device) - true).mean()) < MS


def test_drift_that_is_not_constant_shows():
    true, device = instants(120, 200, 0.0)
    bent = device + np.rint(((true - T0) / 60e9 - 1) ** 2 * 5 * MS).astype(np.int64)
    rng = np.random.default_rng(0)
    assert fit_clock(latency_timer(true, rng), device).misfit_ns < MS
    assert fit_clock(latency_timer(true, rng), bent).misfit_ns > 2 * MS


def test_one_sample_and_none():
    fit = fit_clock(np.array([T0]), np.array([5]))
    assert fit.apply(np.array([5, 6])).tolist() == [T0, T0 + 1]
    with pytest.raises(ValueError, match="0 arrivals"):
        fit_clock(np.array([], np.int64), np.array([], np.int64))
