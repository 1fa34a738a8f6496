"""A picture of small charts in a grid as values: what is drawn in each, axes, legends, and where all of it stands.

It is written as SVG (`figures.svg`) or drawn as PNG (`figures.png`): one description, whatever the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

MEASURED, MODEL, ERROR, HELD, FAULT, CHANCE = "#222222", "#d1495b", "#2e86ab", "#e09f3e", "#b3261e", "#bbbbbb"
"""Colours of what is measured, modelled, their difference, a second quantity, a fault, and what chance may do."""
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """A line through points; `width` [px], `marks` : diameter of a dot at each point [px]."""

    x: Array
    y: Array
    colour: str
    label: str = ""
    width: float = 1.0
    dashed: bool = False
    marks: float = 0.0


@dataclass(frozen=True)
class Band:
    """The area between two lines."""

    x: Array
    low: Array
    high: Array
    colour: str
    label: str = ""


@dataclass(frozen=True)
class Dots:
    """A cloud of points."""

    x: Array
    y: Array
    colour: str
    label: str = ""


@dataclass(frozen=True)
class Level:
    """A line across the chart, at a value of y, or of x when `upright`."""

    at: float
    colour: str = MEASURED
    label: str = ""
    width: float = 0.6
    dashed: bool = False
    upright: bool = False


class Scale(Enum):
    """Scale of an axis."""

    LINEAR = "linear"
    LOGARITHMIC = "log"


@dataclass(frozen=True)
class Axis:
    """An axis: its label, scale, ends (those of the data where None), and ticks (round numbers where empty)."""

    label: str = ""
    scale: Scale = Scale.LINEAR
    low: float | None = None
    high: float | None = None
    ticks: Sequence[float] = ()


Mark = Line | Band | Dots | Level


@dataclass(frozen=True)
class Panel:
    """One chart; `tight` : the x axis ends with the data; `legend` : a legend of its own below it."""

    title: str
    marks: Sequence[Mark]
    x: Axis = Axis()
    y: Axis = Axis()
    colour: str = MEASURED
    tight: bool = False
    legend: bool = False

    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Both ends of the x axis, and of the y axis."""
        across: list[Array] = []
        along: list[Array] = []
        for mark in self.marks:
            match mark:
                case Line() | Dots():
                    across.append(mark.x)
                    along.append(mark.y)
                case Band():
                    across.append(mark.x)
                    along += [mark.low, mark.high]
                case Level(upright=True):
                    pass
                case Level():
                    along.append(np.array([mark.at]))
        return _ends(self.x, across, 0.0 if self.tight else 0.045), _ends(self.y, along, 0.05)


def _ends(axis: Axis, values: Sequence[Array], margin: float) -> tuple[float, float]:
    logarithmic = axis.scale is Scale.LOGARITHMIC
    every = np.concatenate([np.ravel(part) for part in values] or [np.zeros(0)])
    seen = every[np.isfinite(every) & ((every > 0.0) | (not logarithmic))]
    low, high = (float(seen.min()), float(seen.max())) if seen.size else (1.0, 10.0)
    if logarithmic:
        low, high = np.log10(low), np.log10(high)
    if high - low < 1e-9 * max(abs(low), abs(high), 1e-9):
        half = 0.5 if logarithmic else 0.5 * max(abs(low), 1e-3)
        low, high = low - half, high + half
    low, high = low - margin * (high - low), high + margin * (high - low)
    if logarithmic:
        low, high = 10.0**low, 10.0**high
    return (low if axis.low is None else axis.low), (high if axis.high is None else axis.high)


@dataclass(frozen=True)
class Panels:
    """A picture of charts in a grid.

    Attributes
    ----------
    title : above all of them.
    panels : the charts, line by line.
    columns : charts in a line.
    cell : width and height of a chart with its labels [px].
    legend : whether one legend below stands for all charts; then it is that of the first.
    """

    title: str
    panels: Sequence[Panel]
    columns: int
    cell: tuple[float, float]
    legend: bool = True


@dataclass(frozen=True)
class Box:
    """A rectangle [px] from the upper left corner of the picture."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Entry:
    """A mark in a legend: where its sample begins [px]."""

    mark: Mark
    x: float
    y: float


@dataclass(frozen=True)
class Plan:
    """Where everything in a picture stands [px]: its size, each chart's area of data, the legends' entries."""

    width: float
    height: float
    areas: Sequence[Box]
    entries: Sequence[Entry]


FONT, LETTER = 11.0, 6.4
"""Size of the labels and width of an average letter of theirs [px], in the widest of usual fonts."""
HEAD, LINE, SAMPLE = 24.0, 15.0, 26.0
"""Height of the picture's title and of a line of text, and length of a legend's sample of a line [px]."""
_LEFT, _RIGHT, _BELOW = 52.0, 12.0, 34.0
"""Room for the tick labels, beside the last of them, and below the chart with the label of its axis [px]."""


def plan(picture: Panels) -> Plan:
    """Where everything in a picture stands."""
    width, (across, tall) = picture.columns * picture.cell[0], picture.cell
    areas: list[Box] = []
    entries: list[Entry] = []
    top = HEAD if picture.title else 0.0
    for first in range(0, len(picture.panels), picture.columns):
        line = picture.panels[first : first + picture.columns]
        above = LINE * max(panel.title.count("\n") + 1 for panel in line) + 4.0
        lowest = top + tall
        for k, panel in enumerate(line):
            indent = _LEFT + (LINE if panel.y.label else 0.0)
            areas.append(Box(k * across + indent, top + above, across - indent - _RIGHT, tall - above - _BELOW))
            if panel.legend:
                own = _legend(panel, k * across + indent, top + tall + LINE, across - indent)
                entries += own
                lowest = max([lowest, *(entry.y for entry in own)])
        top = lowest
    if picture.legend and picture.panels:
        shared = _legend(picture.panels[0], _LEFT, top + LINE, width - _LEFT)
        entries += shared
        top = max([top, *(entry.y for entry in shared)])
    return Plan(width, top + 8.0, areas, entries)


def _legend(panel: Panel, x: float, y: float, width: float) -> list[Entry]:
    out: list[Entry] = []
    at = x
    for mark in panel.marks:
        if not mark.label:
            continue
        needed = SAMPLE + 6.0 + LETTER * len(mark.label)
        if at > x and at + needed > x + width:
            at, y = x, y + LINE
        out.append(Entry(mark, at, y))
        at += needed + 18.0
    return out
