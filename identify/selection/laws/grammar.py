"""Grammar of laws: products of one or two shapes of the measured states, written in the language of one-line effects.

A shape is a state, its size, a power, a gap, a saturation or a memory of it. Constants in which a law is not linear
have a coarse grid, between whose ends they are searched.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from lacet.daq.expressions.written_units import whole_unit
from lacet.identify.effects.language.compiled import OneLine, effect_class
from lacet.identify.effects.language.parser import read_line
from lacet.identify.selection.laws.settings import LAWS

GRIDS: Mapping[str, tuple[str, str, str]] = {
    "gap": ("-30 -20 -10 0 10 20 30 45", "-30 -10 5 20 45", "mm"),
    "band": ("2 5 10 20 35", "2 8 35", "mm"),
    "s0": ("3 8 20 50", "3 12 50", "mm"),
    "v0": ("5 15 50 150 500", "5 50 500", "mm/s"),
    "v1": ("10 40 120 350", "10 60 350", "mm/s"),
    "T": ("5 15 40 120 400", "5 40 400", "ms"),
    # Friction that turns round within less than a millimetre is Coulomb's, within the noise of the travel.
    "length": ("1 2 6 20", "1 3 20", "mm"),
    "pressed": ("5 15 25 40", "5 15 40", "mm"),
}
"""Constant → values tried for a single shape, values in a product of two, and their unit."""
_NAME = re.compile(r"[A-Za-z_]\w*")

_TRAVEL = ("travel", "abs(travel)", "travel**2", "travel*abs(travel)")
_RATE = ("rate", "abs(rate)", "rate*abs(rate)", "rate**3")
_GAPS = ("max(0, travel - gap)", "max(0, -travel - gap)")
_BANDS = ("max(0, abs(travel) - band)", "sign(travel)*max(0, abs(travel) - band)")
_KNEES = ("max(0, rate - v1)", "max(0, -rate - v1)", "sign(rate)*max(0, abs(rate) - v1)")
_FULL_TRAVEL, _FULL_RATE = ("tanh(travel/s0)", "tanh(abs(travel)/s0)"), ("tanh(rate/v0)", "tanh(abs(rate)/v0)")
_PATH = "hysteresis(travel, length)"
_OF_TRAVEL = (*_TRAVEL, *_GAPS, _BANDS[0], *_FULL_TRAVEL, _PATH)
_OF_RATE = (*_RATE, *_KNEES, _FULL_RATE[0])
_TWIST, _TWIST_RATE = "(travel - travel_other)", "(rate - rate_other)"
SUSPENSION = (
    *_TRAVEL[1:], "travel**3", *_RATE[1:], "rate**2", *(gap + power for gap in _GAPS for power in ("", "**2", "**3")),
    *_BANDS, *_FULL_TRAVEL, *_KNEES, *_FULL_RATE, _PATH,
    *(f"{s}*{v}" for s in _OF_TRAVEL for v in _OF_RATE), f"abs(travel)*{_PATH}",
    *(f"lag({x}, T)" for x in ("rate", "rate*abs(rate)", "abs(travel)*rate", "travel*abs(travel)", "tanh(rate/v0)",
                               "max(0, travel - gap)", "ax", "ay")),
    _TWIST, _TWIST_RATE, f"{_TWIST}*abs({_TWIST})", f"{_TWIST}**3", f"tanh({_TWIST}/s0)",
    f"sign({_TWIST})*max(0, abs({_TWIST}) - band)", f"{_TWIST_RATE}*abs({_TWIST_RATE})", f"tanh({_TWIST_RATE}/v0)",
    f"abs({_TWIST})*rate", f"abs({_TWIST})*{_TWIST_RATE}", "travel*travel_other", "travel_other*rate",
    *(f"{by}*{x}" for by in ("load", "speed", "ax", "ay", "abs(ay)", "steer")
      for x in ("travel", "rate", _FULL_RATE[0])),
    f"load*{_PATH}", "accel", "accel*abs(travel)", "fx", "fy", "ax", "ay", "ay**2", "abs(ay)", "steer", "steer**2",
    "speed**2", "yaw_rate*speed", "roll_accel", "pitch_accel",
)  # fmt: skip
"""Laws of a suspension row."""
TYRE = (
    "deflection**2", "deflection**3", "max(0, deflection - pressed)", "max(0, deflection - pressed)**2",
    "deflection_rate", "abs(deflection_rate)", "deflection_rate*abs(deflection_rate)", "tanh(deflection_rate/v0)",
    "deflection*deflection_rate", "deflection**2*deflection_rate", "lag(deflection_rate, T)",
    "hysteresis(deflection, length)", "camber", "camber**2", "abs(camber)", "camber*deflection", "speed*deflection",
    "speed*deflection_rate", "spin**2", "fy", "abs(fy)", "fx", "fy**2", "ay", "ax", "abs(ay)",
)  # fmt: skip
"""Laws of a tyre row."""
SPIN = (
    "spin", "spin**2", "load", "load**2", "load*speed", "load*spin", "abs(fy)", "fy**2", "fx", "abs(fx)",
    "deflection_rate", "lag(load, T)", "lag(fx, T)", "ax", "ay**2",
)  # fmt: skip
"""Laws of a spin row."""
_BODY = ("speed", "vy", "yaw_rate", "ax", "ay", "roll_rate", "pitch_rate")
CHASSIS = (
    *_BODY, "az", "roll_accel", "pitch_accel", "yaw_accel", *(f"{x}*abs({x})" for x in _BODY),
    *(f"abs({x})" for x in _BODY[1:]), *(f"{x}*{y}" for i, x in enumerate(_BODY) for y in _BODY[i:]),
    *(f"lag({x}, T)" for x in _BODY[1:]),
)  # fmt: skip
"""Laws of a row of the whole car."""
_LAWS = {"suspension": SUSPENSION, "tyre": TYRE, "spin": SPIN}
AXLE_ONLY = "_other"
"""What is in the text of a law between the wheels of an axle."""


def constants_of(text: str) -> list[str]:
    """Names of the constants in a law, in the order written."""
    return [name for name in dict.fromkeys(_NAME.findall(text)) if name in GRIDS]


@cache
def pool(kind: str) -> tuple[type[OneLine], ...]:
    """Effect classes of all laws of a kind of row (``suspension``, ``chassis.fx``), of one parameter p each."""
    return tuple(_effect_class(kind, number, text) for number, text in enumerate(_LAWS.get(kind, CHASSIS)))


def _effect_class(kind: str, number: int, text: str) -> type[OneLine]:
    names = constants_of(text)
    tried = 0 if len(names) < 2 and not _is_product(text) else 1
    clauses = "".join(f", {name} = {GRIDS[name][tried]} {GRIDS[name][2]}" for name in names)
    return effect_class(read_line(f"law_{kind.replace('.', '_')}_{number} = {kind}: p * {text}{clauses}"))


def _is_product(text: str) -> bool:
    return any(text.startswith(f"{s}*") for s in (*_OF_TRAVEL, "load", "speed", "steer"))


@dataclass(frozen=True)
class Written:
    """A law as text for `lacet effect`.

    Attributes
    ----------
    text : ``suspension.rear: p * abs(travel)*tanh(rate/v0), v0 = 31.5 mm/s``.
    terms, constants : how many it has.
    """

    text: str
    terms: int
    constants: int

    @classmethod
    def of(cls, terms: Sequence[OneLine]) -> Written:
        """The sum of terms that act at the same place."""
        (row,) = terms[0].line.rows
        where = ".".join(part for part in (row.row, terms[0].where) if part)
        parts: list[str] = []
        clauses: list[str] = []
        taken: list[str] = []
        for number, term in enumerate(terms, start=1):
            law = term.line.rows[0].text.removeprefix("p * ")
            for name, value in term.shape.items():
                own = next(one for one in _names_like(name) if one not in taken)
                taken.append(own)
                law = re.sub(rf"\b{name}\b", own, law)
                clauses.append(f"{own} = {_rounded(value, GRIDS[name][2])}")
            parts.append(f"{'p' if len(terms) == 1 else f'p{number}'} * {law}")
        return cls(f"{where}: {', '.join((' + '.join(parts), *clauses))}", len(terms), len(clauses))


def _names_like(name: str) -> Iterator[str]:
    yield name
    stem = f"{name}_" if name[-1].isdigit() else name
    yield from (f"{stem}{number}" for number in range(2, 100))


def _rounded(value: float, unit: str) -> str:
    factor, _ = whole_unit(unit)
    return f"{float(f'{value / factor:.{LAWS.digits}g}'):.10g} {unit}"
