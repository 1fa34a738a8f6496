"""Values beside their 95 % intervals: two significant digits of the half-width, the value to the same place."""

from __future__ import annotations

import math

import pytest

from lacet.services.render.intervals import half_width, to_interval, with_interval
from lacet.services.render.tables import size


@pytest.mark.parametrize(
    ("value", "half", "written"),
    [
        (51234.0, 2184.0, "51200 ± 2200"),
        (0.01234, 0.00454, "0.0123 ± 0.0045"),
        (-40.0, 6.0, "-40.0 ± 6.0"),
        (26773.2, 99.6, "26770 ± 100"),
        (9.996, 0.0996, "10.00 ± 0.10"),
        (-0.4, 120.0, "0 ± 120"),
        (1.6e6, 3.04e5, "1600000 ± 300000"),
    ],
)
def test_the_second_digit_of_the_half_width_is_the_last_of_both(value: float, half: float, written: str) -> None:
    assert with_interval(value, half) == written


def test_without_an_interval_a_value_has_five_digits() -> None:
    assert [to_interval(1668.4914, half) for half in (None, 0.0, math.inf)] == ["1668.5"] * 3
    assert half_width(math.inf) == "inf"


def test_a_sign_is_written_where_it_is_asked_for() -> None:
    assert (with_interval(128.4, 3.3, "+"), with_interval(-128.4, 3.3, "+")) == ("+128.4 ± 3.3", "-128.4 ± 3.3")


def test_a_size_is_never_rounded_to_tens() -> None:
    assert [size(value) for value in (2184.4, 99.6, 12.34, 1.234, 0.01234, 0.0)] == [
        "2184", "100", "12", "1.2", "0.012", "0",
    ]  # fmt: skip
