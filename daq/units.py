"""Units of rig and vehicle files, with their factors to SI and radians, applied on reading."""

from __future__ import annotations

import math

_DEG = math.pi / 180.0

TO_SI: dict[str, tuple[str, float]] = {
    # unit as written: (SI unit, factor)
    "-": ("-", 1.0),
    "1": ("-", 1.0),
    "%": ("-", 0.01),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    "deg": ("rad", _DEG),
    "°": ("rad", _DEG),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "kg": ("kg", 1.0),
    "kg·m": ("kg·m", 1.0),
    "kg·m²": ("kg·m²", 1.0),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "N·m": ("N·m", 1.0),
    "N/m": ("N/m", 1.0),
    "N/mm": ("N/m", 1e3),
    "kN/m": ("N/m", 1e3),
    "N/m²": ("N/m²", 1.0),
    "N/m³": ("N/m³", 1.0),
    "N·s/m": ("N·s/m", 1.0),
    "N·s/m²": ("N·s/m²", 1.0),
    "N·s²/m": ("N·s²/m", 1.0),
    "N·s²/m²": ("N·s²/m²", 1.0),
    "m/s": ("m/s", 1.0),
    "km/h": ("m/s", 1.0 / 3.6),
    "m/s²": ("m/s²", 1.0),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", _DEG),
    "Hz": ("Hz", 1.0),
    "m²": ("m²", 1.0),
    "s²": ("s²", 1.0),
    "rad/m": ("rad/m", 1.0),
    "rad/(N·m)": ("rad/(N·m)", 1.0),
}

_SPELLINGS = str.maketrans({"*": "·", "^": ""})
_POWERS = (("2", "²"), ("3", "³"))


def canonical(unit: str) -> str:
    """The canonical spelling of `unit`: ``kg*m^2``, ``kgm2`` and ``kg·m2`` become ``kg·m²``."""
    text = unit.strip().replace(" ", "").translate(_SPELLINGS)
    for plain, raised in _POWERS:
        text = text.replace(plain, raised)
    if text in TO_SI:
        return text
    spelled = {"kgm": "kg·m", "kgm²": "kg·m²", "Nm": "N·m", "Ns/m": "N·s/m", "N/(m/s)": "N·s/m", "N/m/s": "N·s/m"}
    return spelled.get(text, text)


def to_si(value: float, unit: str) -> tuple[float, str]:
    """A value in SI, and its SI unit. Raises KeyError for an unknown unit."""
    si, factor = TO_SI[canonical(unit)]
    return value * factor, si
