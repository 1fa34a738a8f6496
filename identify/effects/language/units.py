"""Physical dimensions, powers of mass, length and time, and units as users write them; angles are plain numbers."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction

_RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹"
_FACTOR = re.compile(r"(?P<name>[A-Za-zµ°%]+)(?:(?P<raised>[²³⁴])|\^?(?P<plain>[234])(?![0-9.]))?")


@dataclass(frozen=True)
class Dimension:
    """A physical dimension: powers of mass, length and time."""

    mass: Fraction = Fraction(0)
    length: Fraction = Fraction(0)
    time: Fraction = Fraction(0)

    @classmethod
    def of(cls, mass: int = 0, length: int = 0, time: int = 0) -> Dimension:
        """The dimension with these whole powers."""
        return cls(Fraction(mass), Fraction(length), Fraction(time))

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(self.mass + other.mass, self.length + other.length, self.time + other.time)

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other**-1

    def __pow__(self, power: Fraction | int) -> Dimension:
        return Dimension(self.mass * power, self.length * power, self.time * power)

    @property
    def plain(self) -> bool:
        """Whether it is that of a plain number (or an angle)."""
        return self == Dimension()

    @property
    def unit(self) -> str:
        """The SI unit, in newtons rather than kilograms where mass is in it: ``N·s²/m²``; ``-`` for a plain number."""
        if self.plain:
            return "-"
        powers = {"N": self.mass, "m": self.length - self.mass, "s": self.time + 2 * self.mass}
        above = [_raised(name, power) for name, power in powers.items() if power > 0]
        below = [_raised(name, -power) for name, power in powers.items() if power < 0]
        over = "·".join(above) or "1"
        return over if not below else f"{over}/({'·'.join(below)})" if len(below) > 1 else f"{over}/{below[0]}"

    @property
    def inertial_unit(self) -> str:
        """SI unit, in kilograms for a mass, a first moment or an inertia, which multiply an acceleration."""
        masses = {Dimension.of(1, power): unit for power, unit in enumerate(("kg", "kg·m", "kg·m²"))}
        return masses.get(self, self.unit)


NUMBER, LENGTH, TIME, MASS = Dimension(), Dimension.of(length=1), Dimension.of(time=1), Dimension.of(mass=1)
FORCE = Dimension.of(1, 1, -2)

UNITS: dict[str, tuple[float, Dimension]] = {
    "m": (1.0, LENGTH), "mm": (1e-3, LENGTH), "cm": (1e-2, LENGTH), "km": (1e3, LENGTH),
    "s": (1.0, TIME), "ms": (1e-3, TIME), "h": (3600.0, TIME), "Hz": (1.0, TIME**-1),
    "kg": (1.0, MASS), "N": (1.0, FORCE), "kN": (1e3, FORCE), "Nm": (1.0, FORCE * LENGTH),
    "rad": (1.0, NUMBER), "mrad": (1e-3, NUMBER), "deg": (math.pi / 180.0, NUMBER), "°": (math.pi / 180.0, NUMBER),
    "%": (1e-2, NUMBER),
}  # fmt: skip
"""Units that a line may use: factor to SI, dimension."""


def read_unit(text: str) -> tuple[float, Dimension, int]:
    """The longest unit at the beginning of `text`, ``m/s`` or ``N·s²/m``: factor to SI, dimension, its length.

    ``m/speed`` begins with ``m`` only. Raises ValueError with the word that is no unit.
    """
    factor, dimension, end, sign = 1.0, NUMBER, 0, 1
    while True:
        found = _FACTOR.match(text, end if end == 0 else end + 1)
        follows = text[found.end() : found.end() + 1] if found else ""
        bad = found is None or found["name"] not in UNITS or follows.isalnum() or follows == "_"
        if bad and end:
            return factor, dimension, end
        if bad or found is None:
            raise ValueError(re.match(r"\w*", text)[0] or text[:1])  # type: ignore[index]
        power = sign * (_RAISED.index(found["raised"]) if found["raised"] else int(found["plain"] or 1))
        size, kind = UNITS[found["name"]]
        factor, dimension, end = factor * size**power, dimension * kind**power, found.end()
        if text[end : end + 1] not in ("·", "/") or not text[end : end + 1]:
            return factor, dimension, end
        sign = -1 if text[end] == "/" else 1


def whole_unit(text: str) -> tuple[float, Dimension]:
    """Factor to SI and dimension of a unit (``N s/m``, ``N*s/m``, ``-``). Raises ValueError where the text is none."""
    written = re.sub(r"\s*[*·]\s*|(?<=[A-Za-z²³])\s+(?=[A-Za-z])", "·", text.strip())
    written = re.sub(r"/\(([^()]*)\)", lambda below: "/" + below[1].replace("·", "/"), written)
    if written in ("", "-", "1"):
        return 1.0, NUMBER
    if written.startswith("1/"):
        written = f"rad{written[1:]}"
    factor, dimension, end = read_unit(written)
    if end != len(written):
        raise ValueError(text.strip())
    return factor, dimension


def _raised(name: str, power: Fraction) -> str:
    if power == 1:
        return name
    if power.denominator == 1 and power < 10:
        return name + _RAISED[power.numerator]
    return f"{name}^{power}" if power.denominator == 1 else f"{name}^({power})"
