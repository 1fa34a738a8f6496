"""Geometry table of a robot whose lengths and angles are expressions with symbols."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from lacet.daq.expressions.expression import Expression

LENGTHS = ("b", "d", "r")
ANGLES = ("gamma", "alpha", "theta")
GEOMETRY = ("gamma", "b", "alpha", "d", "theta", "r")
_KEYS = ("j", "ant", "sigma", *GEOMETRY, "absent")
FIXED = 2
"""σ of a frame fixed in its antecedent."""


@dataclass(frozen=True)
class Row:
    """One frame of the table: its number, its antecedent's, σ, and the constant parts of the six lengths and angles."""

    j: int
    ant: int
    sigma: int
    entries: Mapping[str, Expression]


@dataclass(frozen=True)
class SymbolicTable:
    """The rows of a tree of frames, each after its antecedent.

    Attributes
    ----------
    rows : rows of the tree.
    variables : names of joint positions that occur in the entries; their value in a table is 0.
    """

    rows: tuple[Row, ...]
    variables: frozenset[str] = field(default_factory=frozenset[str])

    @classmethod
    def read(cls, rows: Iterable[Mapping[str, Any]]) -> SymbolicTable:
        """The table of rows with ``j ant sigma gamma b alpha d theta r``; entries are numbers or expressions.

        Raises ValueError with every fault.
        """
        faults: list[str] = []
        out: list[Row] = []

        def fault(place: int, text: str) -> None:
            faults.append(f"row {place}: {text}")

        for place, given in enumerate(rows, start=1):
            try:
                row = dict(given)
            except (TypeError, ValueError):
                raise ValueError(f"row {place}: a mapping such as {{'j': {place}}} expected, found {given!r}") from None
            for key in row:
                if meant := _misspelt(str(key)):
                    fault(place, f"there is no key '{key}'; did you mean '{meant}'?")
            here = partial(fault, place)
            numbers = {key: _whole(row.get(key, default), key, here) for key, default in _WHOLE(place)}
            entries = {key: _entry(row.get(key, 0.0), key, here) for key in GEOMETRY}
            out.append(Row(numbers["j"], numbers["ant"], numbers["sigma"], entries))
        for place, row in enumerate(out, start=1):
            if row.j != place or not 0 <= row.ant < place or row.sigma not in (0, 1, FIXED):
                fault(
                    place,
                    "joints are numbered 1, 2, … in order, each after its antecedent, with sigma 0 (revolute), "
                    f"1 (prismatic) or 2 (fixed); found j={row.j}, ant={row.ant}, sigma={row.sigma}",
                )
        if faults:
            raise ValueError("\n".join(faults))
        return cls(tuple(out))

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """Symbols that need a value, in the order of the rows."""
        found = (s for row in self.rows for key in GEOMETRY for s in sorted(row.entries[key].symbols))
        return tuple(dict.fromkeys(s for s in found if s not in self.variables))

    @cached_property
    def angle_symbols(self) -> frozenset[str]:
        """Symbols that are angles, or occur in a function."""
        entries = [(key, row.entries[key]) for row in self.rows for key in GEOMETRY]
        found = {s for key, e in entries if key in ANGLES for s in e.symbols}
        return frozenset(found | {s for _, e in entries for a in e.angles for s in a.symbols})

    def missing(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """Symbols without a value."""
        return tuple(s for s in self.symbols if s not in values)

    def numbers(self, values: Mapping[str, float]) -> list[dict[str, float]]:
        """The six lengths [m] and angles [rad] of every row. Raises ValueError with every entry that has no value."""
        given = {**values, **dict.fromkeys(self.variables, 0.0)}
        faults: list[str] = []
        out: list[dict[str, float]] = []
        for row in self.rows:
            numbers: dict[str, float] = {}
            for key in GEOMETRY:
                try:
                    numbers[key] = row.entries[key].value(given)
                except ValueError as error:
                    faults.append(f"joint {row.j}, {key}: {error}")
            out.append(numbers)
        if faults:
            raise ValueError("\n".join(faults))
        return out

    def any_values(self, rng: np.random.Generator) -> dict[str, float]:
        """Random values of the symbols, lengths and angles of order one, so that no relation holds by coincidence."""
        return {s: rng.uniform(0.3, 1.2) if s in self.angle_symbols else rng.uniform(0.5, 1.5) for s in self.symbols}

    def path(self, j: int) -> tuple[int, ...]:
        """Numbers of the rows from `j` to the ground, `j` first."""
        out: list[int] = []
        while j:
            out.append(j)
            j = self.rows[j - 1].ant
        return tuple(out)


def refuse_missing(missing: Sequence[str], given: Iterable[str]) -> None:
    """Raise ValueError that names the symbols of a table without a value (`missing`), if there are any."""
    if not missing:
        return
    known = list(given)
    near = [(s, difflib.get_close_matches(s, known, n=1)) for s in missing]
    example = ", ".join(f"'{s}': …" for s in missing[:3])
    raise ValueError(
        f"this needs numbers, and these symbols of the table have none: {', '.join(missing)}. "
        f"Give values={{{example}}} when the chain is made, or chain.with_values(…)."
        + "".join(f" '{match[0]}' was given: is '{s}' meant?" for s, match in near if match)
    )


def _WHOLE(place: int) -> tuple[tuple[str, int], ...]:
    return (("j", place), ("ant", 0), ("sigma", 0))


def _misspelt(key: str) -> str:
    """The known key that an unknown key nearly spells; empty for known keys and for users' own columns."""
    if key in _KEYS:
        return ""
    long = [k for k in _KEYS if len(k) > 2]
    exact = [k for k in _KEYS if k == key.strip().casefold()]
    return next(iter(exact or difflib.get_close_matches(key.casefold(), long, n=1, cutoff=0.65)), "")


def _whole(value: Any, key: str, fault: Callable[[str], None]) -> int:
    try:
        number = float(value)
        if number == int(number):
            return int(number)
    except (TypeError, ValueError, OverflowError):
        pass
    fault(f"{key} must be a whole number, found {value!r}")
    return -1


def _entry(value: Any, key: str, fault: Callable[[str], None]) -> Expression:
    try:
        if isinstance(value, str):
            return Expression.parse(value)
        number = float(value)
        if np.isfinite(number):
            return Expression.of(number)
        fault(f"{key} is {number}")
    except TypeError:
        fault(f"{key} must be a number or an expression, found {value!r}")
    except ValueError as error:
        fault(f"{key}: {error}")
    return Expression.of(0.0)
