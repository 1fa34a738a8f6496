"""Units as users, instruments and files write them, with their factors to SI and radians.

The common ones are in a table; every other spelling is read by the library pint, which is loaded when it is needed.
``g`` is standard gravity and never the gram, ``C`` the degree Celsius, ``1/min`` a speed of rotation.
"""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

from lacet.daq.dimension import NUMBER, Dimension

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
    "m/N": ("m/N", 1.0),
    "µm/N": ("m/N", 1e-6),
    "mm/kN": ("m/N", 1e-6),
    "rad/N": ("rad/N", 1.0),
    "µrad/N": ("rad/N", 1e-6),
    "deg/kN": ("rad/N", 1e-3 * _DEG),
}

_SPELLINGS = str.maketrans({"*": "·", "^": ""})
_POWERS = (("2", "²"), ("3", "³"))
_WORDS = {
    "g": "standard_gravity", "G": "standard_gravity", "Nm": "newton*meter", "kNm": "kilonewton*meter",
    "daNm": "decanewton*meter", "mNm": "millinewton*meter", "NM": "newton*meter", "KN": "kilonewton",
    "kp": "kilogram_force",
    "rev": "revolution", "revs": "revolution", "U": "revolution", "Umdr": "revolution", "tr": "revolution",
    "kmh": "kilometer/hour", "kph": "kilometer/hour", "kmph": "kilometer/hour", "KPH": "kilometer/hour",
    "MPH": "mile/hour", "Grad": "degree", "grad": "degree", "degs": "degree", "º": "degree", "°": "degree",
    "C": "degC", "°C": "degC", "F": "degF", "°F": "degF", "kgs": "kilogram", "lbs": "pound", "ohms": "ohm",
    "RPM": "rpm", "Rpm": "rpm", "%": "percent", "sec": "second", "Sec": "second", "msec": "millisecond",
}  # fmt: skip
"""Words whose usual meaning on instruments differs from pint's, or that pint does not know."""
_ROTATION = {"1/min", "min^-1", "min-1", "/min", "min⁻¹", "U/min", "tr/min"}
_LONGEST = 40
"""Longest unit [characters]."""
_STRANGE = re.compile(r"\d{3}|\d\s*\*\*|\d[eE]|\*\*\s*[(\w]*[A-Za-z_]|[_'\"{}=,;:@!&|<>\\]")
"""What no unit has: numbers above 99, powers of numbers (they could be of any size), letters as powers."""
_DIMENSIONS = {"[mass]": 0, "[length]": 1, "[time]": 2, "[current]": 3, "[temperature]": 4}


class UnitFault(ValueError):
    """A text that is no unit; the message names it and the nearest one."""


@dataclass(frozen=True)
class Unit:
    """A unit: a value in it is ``factor * value + offset`` in SI.

    Attributes
    ----------
    text : as written.
    si : its SI unit in the project's spelling; angles in rad.
    factor, offset : to SI; only temperatures have an offset.
    dimension : physical dimension.
    angle : whether it is one of an angle or its rate: tells ``rad/s`` from ``Hz`` and ``rad`` from a ratio.
    """

    text: str
    si: str
    factor: float
    offset: float
    dimension: Dimension
    angle: bool

    def fits(self, wanted: str) -> bool:
        """Whether values in this unit are a quantity whose SI unit is `wanted`."""
        other = read_unit(wanted)
        return self.dimension == other.dimension and (self.angle == other.angle or not _turning(self, other))


def _turning(one: Unit, other: Unit) -> bool:
    """Whether the difference between an angle and a number matters: not in N·m/rad."""
    return one.dimension in (NUMBER, Dimension.of(time=-1), Dimension.of(time=-2)) or other.si.startswith("rad")


def canonical(unit: str) -> str:
    """The canonical spelling of `unit`: ``kg*m^2``, ``kg*m**2``, ``kgm2`` and ``kg·m2`` become ``kg·m²``."""
    text = unit.strip().replace(" ", "").replace("**", "^").translate(_SPELLINGS)
    for plain, raised in _POWERS:
        text = text.replace(plain, raised)
    if text in TO_SI:
        return text
    spelled = {"kgm": "kg·m", "kgm²": "kg·m²", "Nm": "N·m", "Ns/m": "N·s/m", "N/(m/s)": "N·s/m", "N/m/s": "N·s/m"}
    return spelled.get(text, text)


def to_si(value: float, unit: str) -> tuple[float, str]:
    """A value in SI, and its SI unit. Raises UnitFault for an unknown unit."""
    text = canonical(unit)
    if text in TO_SI:  # without dimensions, and so without pint
        si, factor = TO_SI[text]
        return value * factor, si
    found = read_unit(unit)
    return value * found.factor + found.offset, found.si


@lru_cache(maxsize=1024)
def read_unit(text: str) -> Unit:
    """The unit that a text denotes, in any usual spelling. Raises UnitFault, with the nearest known one."""
    short = canonical(text)
    if short in TO_SI:
        si, factor = TO_SI[short]
        return Unit(text, si, factor, 0.0, _dimension_of(si), si.startswith("rad"))
    return _by_pint(text)


def is_unit(text: str) -> bool:
    """Whether a text is a unit."""
    try:
        read_unit(text)
    except UnitFault:
        return False
    return True


@lru_cache(maxsize=64)
def _dimension_of(si: str) -> Dimension:
    """Dimension of an SI unit of the table, from its factors."""
    out = NUMBER
    below = False
    for name, power, slash in re.findall(r"([A-Za-z]+)([²³]?)|(/)", si):
        if slash:
            below = True
            continue
        one = _BASE[name] ** ({"²": 2, "³": 3}.get(power, 1))
        out = out / one if below else out * one
    return out


_BASE = {
    "m": Dimension.of(length=1), "s": Dimension.of(time=1), "kg": Dimension.of(mass=1), "N": Dimension.of(1, 1, -2),
    "rad": NUMBER, "Hz": Dimension.of(time=-1),
}  # fmt: skip


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint  # here, for it takes half a second to load and most runs need none of it

    return pint.UnitRegistry(cache_folder=None, on_redefinition="ignore")


def _by_pint(text: str) -> Unit:
    written = text.strip().strip("[]").strip()
    if written in ("", ".") or len(written) > _LONGEST or _STRANGE.search(written.replace("^", "**")):
        raise UnitFault(f"unit {written[:_LONGEST]!r} is not known")
    registry = _registry()
    for candidate in dict.fromkeys((written, written.lower())):
        try:
            with _quiet():
                unit = registry.parse_units(_pint_text(candidate))
                zero, one = (registry.Quantity(x, unit).to_base_units() for x in (0.0, 1.0))
            powers = [Fraction(0)] * 5
            for name, power in one.dimensionality.items():
                powers[_DIMENSIONS[name]] = Fraction(power).limit_denominator(12)
        except Exception:  # pint and the tokenizer under it raise exceptions of many kinds
            continue
        dimension = Dimension(*powers)
        angle = "radian" in str(one.units)
        rate = {NUMBER: "rad", Dimension.of(time=-1): "rad/s", Dimension.of(time=-2): "rad/s²"}
        si = rate[dimension] if angle and dimension in rate else dimension.inertial_unit
        offset = float(zero.magnitude)
        factor = float(one.magnitude) - offset if offset else float(one.magnitude)
        return Unit(text, si, factor, offset, dimension, angle)
    close = difflib.get_close_matches(written, [*TO_SI, *_WORDS, "bar", "kPa", "rpm", "psi", "V", "mV", "daN"], n=1)
    hint = f"; did you mean '{close[0]}'?" if close else ""
    raise UnitFault(f"unit {text!r} is not known{hint}")


class _quiet:
    """Silence of pint's logger about what it cannot read."""

    def __enter__(self) -> None:
        import logging

        self._logger = logging.getLogger("pint")
        self._level = self._logger.level
        self._logger.setLevel(logging.CRITICAL)

    def __exit__(self, *_: object) -> None:
        self._logger.setLevel(self._level)


def _pint_text(written: str) -> str:
    """A unit in the spelling of pint."""
    if written.replace(" ", "") in _ROTATION:
        return "revolution/minute"
    text = written.replace("·", "*").replace("×", "*").replace("⋅", "*").replace("−", "-").replace("^", "**")
    text = re.sub(r"(?<=[A-Za-z])[.\-](?=[A-Za-z])", "*", text)  # N.m and N-m
    text = re.sub(r"°\s*([CF])\b", r"deg\1", text)
    text = re.sub(r"([A-Za-zµ°])(-?\d)", r"\1**\2", text)  # m/s2
    return re.sub(r"[A-Za-zµμΩ%°º]+", lambda word: f"({_WORDS[word[0]]})" if word[0] in _WORDS else word[0], text)
