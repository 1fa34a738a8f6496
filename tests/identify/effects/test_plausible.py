"""What no car has of an effect: a parameter outside its range, a payload that is not on the car."""

from __future__ import annotations

import math

import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.effects.body.payload import Payload
from tests.identify.exact_car import KNOWN

PAYLOAD = Payload("braking")


@pytest.mark.parametrize(("value", "half", "wrong"), [(600.0, 50.0, True), (540.0, 50.0, False), (-60.0, 50.0, True)])
def test_a_parameter_is_implausible_where_its_whole_interval_is_outside_its_range(
    value: float, half: float, wrong: bool
) -> None:
    effect: Effect = KNOWN["coulomb.front"]
    found = effect.implausible([value], [half])
    assert (found is not None) == wrong
    if found:
        assert (found.quantity.name, found.low, found.high) == ("coulomb.front.f", value - half, value + half)


@pytest.mark.parametrize(("values", "half", "axis"), [
    ((75.0, -250.0, 0.0, 30.0), (10.0, 30.0, 5.0, 10.0), ""),  # 3.3 m behind the front axle: luggage
    ((-30.0, 100.0, 0.0, 0.0), (5.0, 10.0, 5.0, 10.0), ""),  # fuel used
    ((75.0, 250.0, 0.0, 0.0), (10.0, 30.0, 5.0, 10.0), "x"),  # in front of the car
    ((8.0, -10.0, 0.0, -56.0), (9.6, 12.0, 4.3, 7.8), "z"),  # metres below the road
    ((0.0, 0.0, 40.0, 0.0), (1.0, 1.0, 2.0, 1.0), "y"),  # a moment without a mass
    ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), ""),
    ((2000.0, 0.0, 0.0, 0.0), (50.0, 10.0, 10.0, 10.0), "m"),
])  # fmt: skip
def test_a_payload_is_on_the_car(values: tuple[float, ...], half: tuple[float, ...], axis: str) -> None:
    """First moments are the mass times a position."""
    found = PAYLOAD.implausible(values, half)
    assert (found.quantity.name if found else "") == (f"payload.braking.{axis}" if axis else "")
    if found and axis != "m":
        assert math.isinf(found.low) != math.isinf(found.high)
        assert found.low > found.quantity.high or found.high < found.quantity.low
