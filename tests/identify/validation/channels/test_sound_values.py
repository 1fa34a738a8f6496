"""Values that look like no measurement and are one: they are not flagged."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.run import Signal
from lacet.identify.validation.channels.recorded_values import MOVES
from lacet.identify.validation.channels.unusable_values import _is_range_end, _moves_on, _quiet_span, _sentinel_values

RNG = np.random.default_rng(2)
T = np.arange(5000) / 250.0
"""Twenty seconds at 250 Hz."""
NOISE = RNG.standard_normal(T.size)
MOVING = 50.0 * np.sin(2.0 * np.pi * 1.3 * T) + NOISE


def with_values(value: float, at: slice | list[int], series: np.ndarray = MOVING) -> np.ndarray:
    """A series that has a value at some samples."""
    out = series.copy()
    out[at] = value
    return out


@pytest.mark.parametrize(("series", "found"), [
    (with_values(-9999.0, [100, 900, 2000]), [-9999.0]),
    (with_values(-9999.0, [100]), []),
    (with_values(-9999.0, slice(4000, None)), []),
    (with_values(-9999.0, slice(2000, 2400)), [-9999.0]),
    (with_values(-60.0, [100, 900, 2000]), []),
], ids=["three", "one spike", "up to the end", "in between", "near"])  # fmt: skip
def test_a_sentinel_repeats_far_away_and_not_up_to_an_end(series: np.ndarray, found: list[float]):
    assert _sentinel_values(series) == found


def test_a_column_that_jumps_between_levels_has_no_sentinel():
    """A switched load: 0 and 100, and for some samples exactly 300."""
    levels = np.where(np.sin(T) > 0.0, 100.0, 0.0) + 0.01 * NOISE
    assert _sentinel_values(with_values(300.0, [10, 2000, 4000], levels)) == []


def range_end(series: np.ndarray) -> bool:
    """Whether the highest value of a series is the end of a range."""
    signal = Signal(T, series[:, None], np.zeros(T.size, np.uint8))
    return _is_range_end(signal, np.arange(T.size), series, series == np.max(series))


def test_a_clipped_column_is_at_the_end_of_its_range():
    assert range_end(np.minimum(MOVING, 35.0))


def test_a_column_that_is_clipped_most_of_the_time_at_both_ends_is_at_that_of_its_range():
    assert range_end(np.clip(MOVING, -15.0, 15.0))


def test_the_crests_of_a_coarse_column_are_no_end_of_a_range():
    """Whole numbers of a slow sine with half a step of noise: equal neighbours are frequent at its crests."""
    coarse = np.round(4.0 * np.sin(2.0 * np.pi * 0.5 * T) + 0.3 * NOISE)
    assert not range_end(coarse)
    assert not range_end(np.round(40.0 * np.sin(2.0 * np.pi * 0.5 * T)))


def test_one_stretch_at_the_highest_value_is_no_end_of_a_range():
    """It stands still there once, which is another fault."""
    assert not range_end(with_values(70.0, slice(2000, 2200)))


def half(second: np.ndarray, first: np.ndarray = MOVING) -> np.ndarray:
    """The first series until 10 s, the second from then on."""
    return np.where(T < 10.0, first, second)


@pytest.mark.parametrize(("series", "dead"), [
    (half(NOISE), True),
    (half(NOISE + 8.0 * (T - 10.0)), False),
    (np.where((T > 10.0) & (T < 11.5), NOISE, MOVING), False),
    (half(NOISE, 0.1 * MOVING + NOISE), False),
    (half(0.7 * NOISE + np.sin(2.0 * T)), False),
], ids=["noise alone", "slow motion", "a second and a half", "little motion before", "motion like noise"])  # fmt: skip
def test_noise_alone_is_seconds_long_after_much_more(series: np.ndarray, dead: bool):
    span = _quiet_span(T, series, 1.0)
    assert (span is not None) == dead
    if span is not None:
        assert T[span[0]] == pytest.approx(10.0, abs=0.1)
        assert span[1] == T.size - 1


@pytest.mark.parametrize(("part", "moves"), [(1.0, True), (0.3, False)])
def test_the_other_corners_drive_on_as_before(part: float, moves: bool):
    """Where they rest as well, the car does."""
    series = half(part * MOVING)
    signal = Signal(T, series[:, None], np.zeros(T.size, np.uint8))
    assert _moves_on(signal, 0, 10.0, 20.0, 1.0) == moves
    assert float(np.std(0.3 * MOVING)) > MOVES
