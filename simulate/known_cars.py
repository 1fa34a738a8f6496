"""Every simulated car by name, whatever its wheels hang on."""

from __future__ import annotations

from lacet.daq.errors import UsageError, nearest
from lacet.simulate.cars import CARS, Car
from lacet.simulate.linkage.cars import SECOND_CARS, SecondCar

KNOWN_CARS = (*CARS, *SECOND_CARS)
"""Their names."""


def known_car(name: str) -> Car | SecondCar:
    """A simulated car by name. Raises UsageError naming the known ones."""
    if name in SECOND_CARS:
        return SecondCar.named(name)
    if name not in CARS:
        raise UsageError(
            f"no simulated car is called '{name}'{nearest(name, KNOWN_CARS) or '.'} Known: {', '.join(KNOWN_CARS)}"
        )
    return CARS[name]()
