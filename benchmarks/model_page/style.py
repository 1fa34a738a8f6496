"""What the pictures of the model have in common: colours, arrows, and SVG files that are the same each time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

LINE = "#30363d"
BODY = "#1f5fa8"
FORCE = "#c0392b"
MOTION = "#1b7f3b"
NOTE = "#6a737d"
SETTINGS: dict[str, Any] = {"svg.fonttype": "none", "svg.hashsalt": "lacet", "font.family": "DejaVu Sans"}
"""Text stays text, so that a search finds it and a test reads it."""


def canvas(width: float, height: float) -> tuple[Figure, Axes]:
    """A white sheet [inches] with one pair of axes without frame."""
    figure = Figure(figsize=(width, height), facecolor="white")
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_axis_off()
    return figure, axes


def arrow(
    axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str, text: str = "", **place: Any
) -> None:
    """An arrow with its name at the head; `place` is for the text."""
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    )
    if text:
        dx, dy = place.pop("offset", (0.0, 0.0))
        axes.text(end[0] + dx, end[1] + dy, text, color=colour, fontsize=9, **{"ha": "center", "va": "center", **place})


def save(figure: Figure, file: Path) -> None:
    """The figure as SVG, without date."""
    with mpl.rc_context(SETTINGS):
        figure.savefig(file, format="svg", metadata={"Date": None})
