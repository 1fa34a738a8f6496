"""Lookup tables of a channel map: a text table of two or more columns with units, interpolated linearly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lacet.daq.errors import RunError
from lacet.daq.sources.source import Array
from lacet.daq.units import Unit, UnitFault, read_unit


@dataclass(frozen=True)
class Lookup:
    """A table from one quantity to another, both in SI; without value outside its range.

    `x` (n,) strictly increasing in `x_unit`'s SI, `y` (n,) in `y_unit`'s.
    """

    name: str
    x: Array
    y: Array
    x_unit: Unit
    y_unit: Unit

    def of(self, values: Array) -> Array:
        """(N,) table values, NaN outside."""
        return np.interp(values, self.x, self.y, left=np.nan, right=np.nan)


def read_lookup(path: Path, column: str, content: bytes | None = None) -> Lookup:
    """The table in a file: its first column against `column`, or against the only other one.

    `content` is the file's where it is kept elsewhere, in a run's log. Raises RunError with the file, the line or
    column, and what to do.
    """
    from lacet.daq.sources.csv_table import read_cells  # loads the library of the format

    names, units, rows, first = read_cells(path, content)
    if len(names) < 2:
        raise RunError(path, [f"a lookup table has two columns with units, as in 'SWA [deg], {column} [deg]'"])
    if len(names) > 2 and column not in names:
        raise RunError(path, [f"no column is {column}; it has {', '.join(names[1:])}: name the one that is meant so"])
    which = names.index(column) if column in names[1:] else 1
    found: list[Unit] = []
    for at in (0, which):
        if not units[at]:
            raise RunError(path, [f"column '{names[at]}' has no unit: write '{names[at]} [deg]', or a row of units"])
        try:
            found.append(read_unit(units[at]))
        except UnitFault as cause:
            raise RunError(path, [f"column '{names[at]}': {cause}"]) from None
    x, y = (rows[:, at] * unit.factor + unit.offset for at, unit in zip((0, which), found, strict=True))
    keep = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(keep) < 2:
        raise RunError(path, ["fewer than two lines of numbers"])
    x, y = x[keep], y[keep]
    if x[0] > x[-1]:
        x, y = x[::-1], y[::-1]
    back = np.flatnonzero(np.diff(x) <= 0.0)
    if back.size:
        raise RunError(path, [f"line {first + 1 + int(back[0])}: '{names[0]}' must increase from line to line"])
    return Lookup(path.name, x, y, found[0], found[1])
