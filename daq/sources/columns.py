"""Tables of other systems: units in the columns' names, and which column is the time."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lacet.daq.sources.source import Array
from lacet.daq.units import is_unit, read_unit

_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]]{1,24})[\])]\s*$")
_IN = re.compile(r"^(?P<name>.*\S)\s+(?:in|en)\s+(?P<unit>\S{1,12})$")
_TIME = re.compile(
    r"^(t|time|times|timestamp|time_?stamp|zeit|zeitstempel|temps|tiempo|tempo|tid|sec|secs|second|seconds|elapsed|"
    r"elapsed_?time|log_?time|abs_?time|rel_?time|date_?time|clock|uhrzeit|index_?time|epoch)"
    r"(?:[ _.]?(?P<unit>s|sec|ms|us|µs|ns))?$",
    re.IGNORECASE,
)
_EPOCHS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3), (1e8, 1.0))
"""Least number that is a time since 1970 in a unit: in ns, µs, ms, s; all of them after 1973."""
SINCE_1970 = _EPOCHS[-1][1] * _EPOCHS[-1][0]
"""Time from which one counts from 1970 [s]."""
_WHOLE_STEP = 2.0
"""Smallest whole step of times without a unit that are taken for milliseconds."""


@dataclass(frozen=True)
class TimeColumn:
    """A column of times: its `name`, the `factor` to seconds, and whether it counts from the Unix epoch."""

    name: str
    factor: float
    epoch: bool
    note: str = ""


def with_unit(text: str) -> tuple[str, str]:
    """Name and unit of a column: ``Speed [km/h]``, ``Speed (km/h)``, ``Speed in km/h``; the unit empty for none."""
    written = text.strip().strip('"').strip()
    for pattern in (_BRACKETS, _IN):
        found = pattern.match(written)
        if found and found["name"] and (is_unit(found["unit"]) or found["unit"].strip() in ("", "-")):
            return found["name"].strip(), found["unit"].strip()
    return written, ""


def is_time_name(name: str) -> bool:
    """Whether a column's name, in several languages, is that of a time."""
    return _TIME.match(name.strip()) is not None


def find_time(
    heads: Mapping[str, Array], units: Mapping[str, str], asked: str = "", asked_unit: str = ""
) -> TimeColumn | None:
    """The time column among the first values of all columns; None where there is none.

    By name first, otherwise the first whose values increase all the time. Raises ValueError in words where the one
    asked for is no time.
    """
    names = [asked] if asked else [name for name in heads if is_time_name(name)]
    if not asked:
        names += [name for name in heads if name not in names]
    for name in names:
        values = heads[name][np.isfinite(heads[name])]
        rising = values.size > 1 and float(np.mean(np.diff(values) > 0.0)) > 0.9
        if not rising or (not asked and not is_time_name(name) and not np.all(np.diff(values) > 0.0)):
            if asked:
                raise ValueError(f"'{asked}' is no time: its values do not increase")
            continue
        return _scaled(name, values, asked_unit or units.get(name, ""))
    return None


def _scaled(name: str, values: Array, unit: str) -> TimeColumn:
    first, step = float(values[0]), float(np.median(np.diff(values)))
    said = _TIME.match(name.strip())
    unit = unit or (said["unit"] if said and said["unit"] else "")
    if unit and is_unit(unit) and read_unit(unit).si == "s":
        factor = read_unit(unit).factor
        return TimeColumn(name, factor, first * factor > SINCE_1970)
    for least, factor in _EPOCHS:
        if first > least:
            return TimeColumn(name, factor, True, f"'{name}' counts from 1970, in units of {factor:g} s")
    if step >= _WHOLE_STEP and np.array_equal(values, np.round(values)):
        note = f"'{name}' has no unit and whole steps of {step:g}: taken as ms (say time_unit in the map if not)"
        return TimeColumn(name, 1e-3, False, note)
    return TimeColumn(name, 1.0, False)


def units_row(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are units: more than half of those that are not empty, and at least two or all."""
    written = [cell.strip().strip('"').strip("[]() ") for cell in cells]
    filled = [cell for cell in written if cell]
    known = [cell for cell in filled if cell == "-" or is_unit(cell)]
    return bool(filled) and len(known) > 0.5 * len(filled)
