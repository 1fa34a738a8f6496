"""Units in which engineers read quantities, with their factors from SI."""

from __future__ import annotations

import math

TRAVEL, TRAVEL_RATE = (1e3, "mm"), (1e3, "mm/s")
"""Factor and unit of a suspension's travel, and of its rate."""
_SMALL = {"m": 0.5, "m/s": 1.5}
"""SI unit → largest magnitude up to which a quantity is read in thousandths."""
_DEGREES = {"rad": "°", "rad/s": "°/s", "rad/s²": "°/s²"}


def display_unit(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit for values [`unit`, SI] up to the magnitude `largest`: small lengths in mm, angles in degrees."""
    if unit in _DEGREES:
        return 180.0 / math.pi, _DEGREES[unit]
    if largest < _SMALL.get(unit, 0.0):
        return 1e3, f"m{unit}"
    return 1.0, unit_text(unit)


def unit_text(unit: str) -> str:
    """A unit as shown; an empty string for a plain number."""
    return "" if unit in ("1", "-") else unit
