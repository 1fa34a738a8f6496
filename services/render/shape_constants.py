"""Shape constants of effects as text, in the unit that people use."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.identify.effects.base import Effect

_IN_THOUSANDTHS = {"m": "mm", "m/s": "mm/s", "s": "ms"}
"""SI unit → the unit in which values below one are written."""


def unit_of(effect: Effect | type[Effect], constant: str) -> str:
    """Unit of a shape constant; ``(SI)`` where the effect does not state it."""
    return effect.grid_units.get(constant, "(SI)")


def constants_text(effect: Effect, shape: Mapping[str, float]) -> list[str]:
    """Each constant with three digits and its unit (``gap 5.55 mm``)."""
    read = {name: readable(effect, name, value) for name, value in shape.items()}
    return [f"{name} {value:.3g} {unit}".rstrip() for name, (value, unit) in read.items()]


def readable(effect: Effect | type[Effect], constant: str, value: float) -> tuple[float, str]:
    """A constant's value [SI] in the unit in which people read it, and that unit."""
    unit = unit_of(effect, constant)
    if unit in _IN_THOUSANDTHS and abs(value) < 1.0:
        return 1e3 * value, _IN_THOUSANDTHS[unit]
    return value, unit
