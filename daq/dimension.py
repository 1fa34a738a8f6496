"""Physical dimensions: powers of mass, length, time, electric current and temperature; angles are plain numbers."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹"


@dataclass(frozen=True)
class Dimension:
    """A physical dimension: powers of mass, length, time, electric current and temperature."""

    mass: Fraction = Fraction(0)
    length: Fraction = Fraction(0)
    time: Fraction = Fraction(0)
    current: Fraction = Fraction(0)
    temperature: Fraction = Fraction(0)

    @classmethod
    def of(cls, mass: int = 0, length: int = 0, time: int = 0, current: int = 0, temperature: int = 0) -> Dimension:
        """The dimension with these whole powers."""
        return cls(*map(Fraction, (mass, length, time, current, temperature)))

    @property
    def powers(self) -> tuple[Fraction, ...]:
        """The five powers, in the order of the attributes."""
        return (self.mass, self.length, self.time, self.current, self.temperature)

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(*(a + b for a, b in zip(self.powers, other.powers, strict=True)))

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other**-1

    def __pow__(self, power: Fraction | int) -> Dimension:
        return Dimension(*(one * power for one in self.powers))

    @property
    def plain(self) -> bool:
        """Whether it is that of a plain number (or an angle)."""
        return self == Dimension()

    @property
    def unit(self) -> str:
        """The SI unit, in newtons rather than kilograms where mass is in it: ``N·s²/m²``; ``-`` for a plain number."""
        if self.plain:
            return "-"
        if self in _NAMED:
            return _NAMED[self]
        by_volts = self * VOLTAGE**self.current
        if self.current and not by_volts.mass:  # a sensor's gain: m/V
            powers = {"m": by_volts.length, "s": by_volts.time, "K": by_volts.temperature, "V": -self.current}
            return _joined(powers)
        powers = {
            "N": self.mass, "m": self.length - self.mass, "s": self.time + 2 * self.mass, "A": self.current,
            "K": self.temperature,
        }  # fmt: skip
        return _joined(powers)

    @property
    def inertial_unit(self) -> str:
        """SI unit, in kilograms for a mass, a first moment or an inertia, which multiply an acceleration."""
        masses = {Dimension.of(1, power): unit for power, unit in enumerate(("kg", "kg·m", "kg·m²"))}
        return masses.get(self, self.unit)


NUMBER, LENGTH, TIME, MASS = Dimension(), Dimension.of(length=1), Dimension.of(time=1), Dimension.of(mass=1)
CURRENT, TEMPERATURE = Dimension.of(current=1), Dimension.of(temperature=1)
FORCE = Dimension.of(1, 1, -2)
PRESSURE, VOLTAGE = Dimension.of(1, -1, -2), Dimension.of(1, 2, -3, -1)
_NAMED = {VOLTAGE: "V", CURRENT: "A"}


def _joined(powers: dict[str, Fraction]) -> str:
    above = [_raised(name, power) for name, power in powers.items() if power > 0]
    below = [_raised(name, -power) for name, power in powers.items() if power < 0]
    over = "·".join(above) or "1"
    return over if not below else f"{over}/({'·'.join(below)})" if len(below) > 1 else f"{over}/{below[0]}"


def _raised(name: str, power: Fraction) -> str:
    if power == 1:
        return name
    if power.denominator == 1 and power < 10:
        return name + RAISED[power.numerator]
    return f"{name}^{power}" if power.denominator == 1 else f"{name}^({power})"
