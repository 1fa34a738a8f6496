"""Units behind numbers inside an expression: ``20 mm``, ``2 m/s``, ``40 mm/V``."""

from __future__ import annotations

import math
import re

from lacet.daq.dimension import (
    CURRENT,
    FORCE,
    LENGTH,
    MASS,
    NUMBER,
    PRESSURE,
    RAISED,
    TEMPERATURE,
    TIME,
    VOLTAGE,
    Dimension,
)
from lacet.daq.units import UnitFault, is_unit, read_unit

_FACTOR = re.compile(r"(?P<name>[A-Za-zµ°%]+)(?:(?P<raised>[²³⁴])|\^?(?P<plain>[234])(?![0-9.]))?")

UNITS: dict[str, tuple[float, Dimension]] = {
    "m": (1.0, LENGTH), "mm": (1e-3, LENGTH), "cm": (1e-2, LENGTH), "km": (1e3, LENGTH),
    "s": (1.0, TIME), "ms": (1e-3, TIME), "h": (3600.0, TIME), "Hz": (1.0, TIME**-1),
    "kg": (1.0, MASS), "N": (1.0, FORCE), "kN": (1e3, FORCE), "Nm": (1.0, FORCE * LENGTH),
    "rad": (1.0, NUMBER), "mrad": (1e-3, NUMBER), "deg": (math.pi / 180.0, NUMBER), "°": (math.pi / 180.0, NUMBER),
    "%": (1e-2, NUMBER), "daN": (10.0, FORCE), "V": (1.0, VOLTAGE), "mV": (1e-3, VOLTAGE), "mA": (1e-3, CURRENT),
    "bar": (1e5, PRESSURE), "kPa": (1e3, PRESSURE), "Pa": (1.0, PRESSURE), "K": (1.0, TEMPERATURE),
}  # fmt: skip
"""Units that may stand anywhere in the unit of a number: factor to SI, dimension. Any other unit that `daq.units` knows
may be the first; behind a slash it could be a name: ``2 m/t``."""


def unit_at(text: str) -> tuple[float, Dimension, int]:
    """The longest unit at the beginning of `text`, ``m/s`` or ``N·s²/m``: factor to SI, dimension, its length.

    ``m/speed`` begins with ``m`` only. Raises ValueError with the word that is no unit.
    """
    factor, dimension, end, sign = 1.0, NUMBER, 0, 1
    while True:
        found = _FACTOR.match(text, end if end == 0 else end + 1)
        follows = text[found.end() : found.end() + 1] if found else ""
        known = None
        if found is not None and not follows.isalnum() and follows != "_":
            known = UNITS.get(found["name"]) or (None if end else _further(found["name"]))
        if found is None or known is None:
            if end:
                return factor, dimension, end
            word = re.match(r"\w*", text)
            raise ValueError((word and word[0]) or text[:1])
        power = sign * (RAISED.index(found["raised"]) if found["raised"] else int(found["plain"] or 1))
        factor, dimension, end = factor * known[0] ** power, dimension * known[1] ** power, found.end()
        if text[end : end + 1] not in ("·", "/") or not text[end : end + 1]:
            return factor, dimension, end
        sign = -1 if text[end] == "/" else 1


def _further(word: str) -> tuple[float, Dimension] | None:
    """A unit that is not in `UNITS`, without an offset (degrees Celsius cannot be multiplied)."""
    if not is_unit(word):
        return None
    found = read_unit(word)
    return None if found.offset else (found.factor, found.dimension)


def whole_unit(text: str) -> tuple[float, Dimension]:
    """Factor to SI and dimension of a unit (``N s/m``, ``N*s/m``, ``-``). Raises ValueError where the text is none."""
    written = re.sub(r"\s*[*·]\s*|(?<=[A-Za-z²³])\s+(?=[A-Za-z])", "·", text.strip())
    written = re.sub(r"/\(([^()]*)\)", lambda below: "/" + below[1].replace("·", "/"), written)
    if written in ("", "-", "1"):
        return 1.0, NUMBER
    if written.startswith("1/"):
        written = f"rad{written[1:]}"
    try:
        factor, dimension, end = unit_at(written)
    except ValueError:
        factor, dimension, end = 1.0, NUMBER, -1
    if end == len(written):
        return factor, dimension
    try:
        known = read_unit(text)
    except UnitFault:
        raise ValueError(text.strip()) from None
    if known.offset:
        raise ValueError(text.strip())
    return known.factor, known.dimension
