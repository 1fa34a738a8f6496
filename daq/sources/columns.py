"""Tables of other systems: units in the columns' names, and which column is the time."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.sources.source import Array
from lacet.daq.units import is_unit, read_unit

_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(［（](?P<unit>[^\[\]［］]{1,24})[\])］）]\s*$")
_IN = re.compile(r"^(?P<name>.*\S)\s+(?:in|en)\s+(?P<unit>\S{1,12})$")
_TIME = re.compile(
    r"^(t|time|times|time[ _-]?stamp|zeit|zeitstempel|temps|tiempo|tempo|tid|sec|secs|second|seconds|elapsed|epoch|"
    r"(elapsed|log|abs|rel|date|index|utc|gps|local|system)[ _/-]?time|time[ _-]?of[ _-]?day|clock|uhrzeit|utc|"
    r"(経過|計測)?(時間|時刻)|タイム(スタンプ)?)"
    r"(?:[ _.]?(?P<unit>s|sec|ms|us|µs|ns))?$",
    re.IGNORECASE,
)
_EPOCHS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3), (1e8, 1.0))
"""Least number that is a time since 1970 in a unit: in ns, µs, ms, s; all of them after 1973."""
SINCE_1970 = _EPOCHS[-1][1] * _EPOCHS[-1][0]
"""Time from which one counts from 1970 [s]."""
_WHOLE_STEP = 2.0
"""Smallest whole step of times without a unit that are taken for milliseconds, or a smaller unit."""
_WHOLE = (("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9))
_LONGEST_STEP = 1.0
"""Longest step of a log of a car [s]: a unit that makes it longer is not the one of its times."""
_RISING = 0.9
"""Part of the steps of a time that increase, at least."""


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

    By name, or where no name is that of a time, the first whose values increase all the time. Raises ValueError in
    words where the one asked for, or the one with the name of a time, is none.
    """
    possible = [name for name in heads if asked_unit or may_be_time(units.get(name, ""))]
    named = [asked] if asked else [name for name in possible if is_time_name(name)]
    known = {name: heads[name][np.isfinite(heads[name])] for name in {*named, *possible}}
    for name in named:
        if known[name].size > 1 and float(np.mean(np.diff(known[name]) > 0.0)) > _RISING:
            return _scaled(name, known[name], asked_unit or units.get(name, ""))
    if named:
        raise ValueError("; ".join(_no_time(name, known[name]) for name in named))
    for name in possible:
        if known[name].size > 1 and np.all(np.diff(known[name]) > 0.0):
            found = _scaled(name, known[name], asked_unit or units.get(name, ""))
            note = f"no column has the name of a time: '{name}', which increases all the time, is taken for it"
            return replace(found, note=f"{note}. {found.note}" if found.note else note)
    return None


def may_be_time(unit: str) -> bool:
    """Whether values in a unit can be times: there is none, or it is none known, or one of time."""
    return not unit or not is_unit(unit) or read_unit(unit).si in ("s", "-")


def _no_time(name: str, values: Array) -> str:
    """Why a column is no time, and what to do."""
    if values.size < 2:
        return f"'{name}' has no values"
    steps = np.diff(values)
    if np.all(steps >= 0.0) and np.any(steps > 0.0):
        lines = values.size / (1 + np.count_nonzero(steps))
        why = f"'{name}' has the same value in {lines:.0f} lines each, so that samples cannot be told apart by it"
    else:
        why = f"'{name}' is no time: its values do not increase"
    return f'{why}. Say which column is, or the rate, in the map: [read] time = "NAME", or rate = 100'


def _scaled(name: str, values: Array, unit: str) -> TimeColumn:
    first, step = float(values[0]), float(np.median(np.diff(values)))
    said = _TIME.match(name.strip())
    unit = unit or (said["unit"] if said and said["unit"] else "")
    if unit and is_unit(unit) and read_unit(unit).si == "s":
        factor = read_unit(unit).factor
        return TimeColumn(name, factor, first * factor > SINCE_1970)
    for least, factor in _EPOCHS:
        if first > least and step * factor <= _LONGEST_STEP:
            return TimeColumn(name, factor, True, f"'{name}' counts from 1970, in units of {factor:g} s")
    if step >= _WHOLE_STEP and np.array_equal(values, np.round(values)):
        short, factor = next((one for one in _WHOLE if step * one[1] <= _LONGEST_STEP), _WHOLE[0])
        note = f"'{name}' has no unit and whole steps of {step:g}: taken as {short} (say time_unit in the map if not)"
        return TimeColumn(name, factor, False, note)
    return TimeColumn(name, 1.0, False)


def units_row(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are units: more than half of those that are not empty, and at least two or all."""
    written = [cell.strip().strip('"').strip("[]() ") for cell in cells]
    filled = [cell for cell in written if cell]
    known = [cell for cell in filled if cell == "-" or is_unit(cell)]
    return bool(filled) and len(known) > 0.5 * len(filled)
