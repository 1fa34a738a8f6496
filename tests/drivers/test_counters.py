"""Counters and clocks followed across any split."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lacet.drivers.framework.counters import CounterState, follow_counter, steady_counters, unwrap_clock


@given(
    steps=st.lists(st.tuples(st.integers(0, 14), st.booleans()), min_size=1, max_size=40),
    bits=st.sampled_from([4, 8, 16, 32]),
    first=st.integers(0, 2**32 - 1),
    cut=st.integers(0, 40),
)
def test_losses_are_found_where_they_are(steps, bits, first, cut):
    """Lose `steps[i][0]` samples before sample i; samples without trust take part in the count of steps."""
    lost = np.array([step for step, _ in steps])
    trusted = np.array([trust for _, trust in steps])
    # A loss right before an untrusted sample is only seen at the next trusted one; keep these apart here.
    lost[~trusted] = 0
    lost[0] = 0
    runs = np.diff(np.flatnonzero(trusted), prepend=-1)
    if (runs + lost[trusted]).max(initial=0) > 14:
        lost[:] = 0
        trusted[:] = True
    counter = (first + np.cumsum(lost + 1)) % (1 << bits)
    jumps, state = follow_counter(counter, trusted, bits, CounterState())
    expected = np.where(np.cumsum(trusted) == 1, 0, lost)
    expected[~trusted] = 0
    np.testing.assert_array_equal(jumps.lost, expected)
    assert not jumps.back.any()
    a, between = follow_counter(counter[:cut], trusted[:cut], bits, CounterState())
    b, end = follow_counter(counter[cut:], trusted[cut:], bits, between)
    np.testing.assert_array_equal(np.concatenate((a.lost, b.lost)), jumps.lost)
    assert end == state


def test_unused_bad_samples_do_not_count_twice():
    counter = np.array([3, 99, 99, 8])
    jumps, _ = follow_counter(counter, np.array([True, False, False, True]), 8, CounterState())
    assert jumps.lost.tolist() == [0, 0, 0, 2]
    # More untrusted samples than steps of the counter: strangers, not losses.
    jumps, _ = follow_counter(np.array([3, 9, 9, 4]), np.array([True, False, False, True]), 8, CounterState())
    assert jumps.lost.tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize("bits", [16, 32])
def test_a_wide_counter_that_goes_back_is_a_restart(bits):
    jumps, _ = follow_counter(np.array([5000, 0, 1]), np.ones(3, bool), bits, CounterState())
    assert jumps.lost.tolist() == [0, 0, 0]
    assert jumps.gap.tolist() == [False, True, False]


@given(
    steps=st.lists(st.integers(1, 2**31 - 1), min_size=1, max_size=30),
    first=st.integers(0, 2**32 - 1),
    bad=st.lists(st.integers(0, 29), max_size=5),
    cut=st.integers(0, 30),
)
def test_a_clock_is_unwrapped_across_any_split(steps, first, bad, cut):
    bad = [i for i in bad if i < len(steps)]
    trusted = np.ones(len(steps), bool)
    trusted[bad] = False
    # Untrusted readings stand still, so that the trusted ones stay within half the range of each other.
    true_us = first + np.cumsum(np.where(trusted, steps, 0))
    clock = np.where(trusted, true_us % 2**32, 12345)
    device, back, last = unwrap_clock(clock, trusted, None)
    assert not back.any()
    at = np.flatnonzero(trusted)
    np.testing.assert_array_equal(np.diff(device[at]), np.diff(true_us[at]) * 1000)
    a, _, middle = unwrap_clock(clock[:cut], trusted[:cut], None)
    b, _, end = unwrap_clock(clock[cut:], trusted[cut:], middle)
    np.testing.assert_array_equal(np.concatenate((a, b)), device)
    assert end == last


@given(
    lengths=st.lists(st.integers(1, 6), min_size=1, max_size=4),
    states=st.lists(st.builds(CounterState, st.none() | st.integers(0, 15), st.sampled_from([0, 0, 0, 1])), min_size=4),
    bits=st.sampled_from([4, 8, 16]),
    spoilt=st.none() | st.integers(0, 20),
)
def test_several_steady_counters_at_once_are_as_one_by_one(lengths, states, bits, spoilt):
    """Counters that go on, or begin anywhere; one of their values may be wrong."""
    ends = np.cumsum(lengths)
    spans = [(u, slice(int(end - n), int(end))) for u, (n, end) in enumerate(zip(lengths, ends, strict=True))]
    firsts = [7 if states[u].last is None else states[u].last + 1 for u, _ in spans]
    values = [(first + np.arange(n)) % (1 << bits) for first, n in zip(firsts, lengths, strict=True)]
    counter = np.concatenate(values).astype(np.int64)
    if spoilt is not None and spoilt < len(counter):
        counter[spoilt] = (counter[spoilt] + 3) % (1 << bits)
    found = steady_counters(counter, spans, bits, states)
    trusted = np.ones(len(counter), bool)
    slow = {u: follow_counter(counter[span], trusted[span], bits, states[u]) for u, span in spans}
    if found is None:
        lost = any(jumps.gap.any() for jumps, _ in slow.values())
        assert lost or any(states[u].between for u, _ in spans)
    else:
        assert not any(jumps.gap.any() for jumps, _ in slow.values())
        assert found == {u: state for u, (_, state) in slow.items()}
