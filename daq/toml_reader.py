"""Reader of TOML files that reports every fault at once, with place, cause and remedy."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from lacet.daq.errors import FileFault, nearest
from lacet.daq.units import UnitFault, read_unit


@dataclass(frozen=True)
class Quantity:
    """A number with its origin: `value` in the SI `unit`, and the `source` it comes from."""

    value: float
    unit: str
    source: str


class Reader:
    """A reader of one TOML file that collects its faults while the tables are read.

    Parameters
    ----------
    text : the file's text.
    name : the file's name, for messages.
    error : the error class to raise.
    expected : the value the file's ``format`` key must have.
    """

    def __init__(self, text: str, name: str, error: type[FileFault], expected: str):
        self.name, self.error, self.faults = name, error, list[str]()
        try:
            self.root: dict[str, Any] = tomllib.loads(text)
        except tomllib.TOMLDecodeError as cause:
            raise error(name, [f"not valid TOML: {cause}"]) from None
        if self.root.get("format") != expected:
            self.fault("format", f'must be "{expected}", found {self.root.get("format")!r}')

    @classmethod
    def of(cls, root: Mapping[str, Any], name: str, error: type[FileFault]) -> Reader:
        """A reader of tables that are parsed already, a part of another file."""
        out = cls.__new__(cls)
        out.name, out.error, out.faults, out.root = name, error, [], dict(root)
        return out

    def fault(self, place: str, message: str) -> None:
        """Add one fault."""
        self.faults.append(f"{place}: {message}" if place else message)

    def finish(self) -> None:
        """Raise the file's error when there were faults."""
        if self.faults:
            raise self.error(self.name, self.faults)

    def table(self, holder: dict[str, Any], key: str, place: str, required: bool = False) -> dict[str, Any]:
        """A sub-table, empty when absent."""
        value = holder.get(key)
        if value is None:
            if required:
                self.fault(place, f"[{key}] is missing")
            return {}
        if not isinstance(value, dict):
            self.fault(f"{place}.{key}".lstrip("."), "must be a table")
            return {}
        return value

    def known(self, holder: dict[str, Any], allowed: Iterable[str], place: str) -> None:
        """Add a fault for every key that is not allowed, with the nearest one that is."""
        allowed = tuple(allowed)
        for key in holder:
            if key not in allowed:
                self.fault(f"{place}.{key}".lstrip("."), f"unknown key{nearest(key, allowed)}")

    def text(self, holder: dict[str, Any], key: str, place: str, default: str | None = None) -> str:
        """A string; a fault when absent and without default."""
        value = holder.get(key, default)
        if not isinstance(value, str):
            self.fault(f"{place}.{key}".lstrip("."), "must be a text" if key in holder else "is missing")
            return ""
        return value

    def choice(self, holder: dict[str, Any], key: str, place: str, allowed: Iterable[str], default: str) -> str:
        """One of a few words."""
        value = holder.get(key, default)
        allowed = tuple(allowed)
        if value not in allowed:
            self.fault(
                f"{place}.{key}".lstrip("."),
                f"must be one of {', '.join(allowed)}, found {value!r}{nearest(str(value), allowed)}",
            )
            return default
        return value

    def number(self, holder: dict[str, Any], key: str, place: str, default: float, low: float = -math.inf) -> float:
        """A plain SI number, at least `low`."""
        value = holder.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < low:
            self.fault(f"{place}.{key}".lstrip("."), f"must be a finite number{self._least(low)}, found {value!r}")
            return default
        return float(value)

    def vector(self, value: Any, place: str, n: int = 3) -> tuple[float, ...]:
        """`n` plain SI numbers."""
        if (
            not isinstance(value, list)
            or len(value) != n
            or not all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in value)
        ):
            self.fault(place, f"must be {n} numbers, found {value!r}")
            return (0.0,) * n
        return tuple(float(v) for v in value)

    def quantity(self, holder: dict[str, Any], key: str, place: str, unit: str) -> Quantity | None:
        """``{ value, unit, source }`` in a unit of the dimension of SI `unit`; None when the key is absent."""
        value = holder.get(key)
        if value is None:
            return None
        where = f"{place}.{key}".lstrip(".")
        scaled = self._pedigree(value, where, unit)
        if scaled is None:
            return None
        number, factor, source = scaled
        if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
            self.fault(where, f"value must be a finite number, found {number!r}")
            return None
        return Quantity(float(number) * factor, unit, source)

    def series(self, holder: dict[str, Any], key: str, place: str, unit: str) -> tuple[float, ...] | None:
        """``{ value = [...], unit, source }``: a list of numbers, None when the key is absent."""
        value = holder.get(key)
        if value is None:
            return None
        where = f"{place}.{key}".lstrip(".")
        scaled = self._pedigree(value, where, unit)
        if scaled is None:
            return None
        numbers, factor, _ = scaled
        if not isinstance(numbers, list) or not numbers:
            self.fault(where, "value must be a list of numbers")
            return None
        return tuple(v * factor for v in self.vector(numbers, where, len(numbers)))

    def _pedigree(self, value: Any, where: str, unit: str) -> tuple[Any, float, str] | None:
        form = f'write {{ value = …, unit = "{unit}", source = "where it comes from" }}'
        if not isinstance(value, dict) or "value" not in value:
            self.fault(where, f"a number needs unit and source: {form}")
            return None
        self.known(value, ("value", "unit", "source", "note"), where)
        source = value.get("source")
        if not isinstance(source, str) or not source.strip():
            self.fault(where, f"source is missing: {form}")
            source = ""
        written = value.get("unit")
        if not isinstance(written, str):
            self.fault(where, f"unit {written!r} is not known; {form}")
            return None
        try:
            found = read_unit(written)
        except UnitFault as cause:
            self.fault(where, f"{cause}; {form}")
            return None
        if not found.fits(unit):
            self.fault(where, f"unit {written!r} is not one of a quantity in {unit}")
            return None
        if found.offset:
            self.fault(where, f"unit {written!r} has an offset: give the value in {found.si}")
            return None
        return value["value"], found.factor, source

    @staticmethod
    def _least(low: float) -> str:
        return "" if low == -math.inf else f" of at least {low:g}"


def dotted(table: Mapping[str, Any], known: Container[str], before: str = "") -> dict[str, Any]:
    """A table of tables with dotted keys: ``wheel.fl.force.x`` without quotes is nested in TOML.

    A table that has ``from``, or whose key is `known`, is an entry.
    """
    out: dict[str, Any] = {}
    for key, entry in table.items():
        full = f"{before}{key}"
        if isinstance(entry, dict) and "from" not in entry and full not in known:
            out |= dotted(entry, known, f"{full}.")
        else:
            out[full] = entry
    return out
