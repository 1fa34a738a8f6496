"""Pictures as PNG: those of charts (`figures.panels`), and figures of matplotlib."""

from __future__ import annotations

import io

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from lacet.services.render.figures.panels import Band, Box, Dots, Level, Line, Mark, Panel, Panels, plan
from lacet.services.render.figures.ticks import ticks_of

DPI = 110
"""Dots of a picture to an inch."""
_POINTS = 0.75
"""Points to a pixel of the plan: it has 96 to an inch."""


def png(figure: Figure) -> bytes:
    """A figure as PNG bytes."""
    out = io.BytesIO()
    figure.savefig(out, dpi=DPI, format="png")
    return out.getvalue()


def charts_png(picture: Panels) -> bytes:
    """A picture of charts as PNG bytes."""
    where = plan(picture)
    width, height = where.width, where.height
    figure = Figure(figsize=(width / 96.0, height / 96.0))
    if picture.title:
        figure.text(4.0 / width, 1.0 - 15.0 / height, picture.title, fontsize=11)
    for panel, area in zip(picture.panels, where.areas, strict=True):
        place = (area.x / width, 1.0 - (area.y + area.height) / height, area.width / width, area.height / height)
        _panel(figure.add_axes(place), panel, area)
    for entry in where.entries:
        y = 1.0 - (entry.y - 4.0) / height
        for artist in _sample(entry.mark, entry.x / width, y, 26.0 / width, 8.0 / height):
            artist.set_transform(figure.transFigure)
            figure.add_artist(artist)
        figure.text((entry.x + 32.0) / width, y, entry.mark.label, fontsize=8, va="center")
    return png(figure)


def _panel(axes: Axes, panel: Panel, area: Box) -> None:
    (x0, x1), (y0, y1) = panel.limits()
    axes.set_xscale(panel.x.scale.value)
    axes.set_yscale(panel.y.scale.value)
    for mark in panel.marks:
        _draw(axes, mark)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    sides = (
        (axes.xaxis, ticks_of(panel.x, x0, x1, max(3, int(area.width / 60)))),
        (axes.yaxis, ticks_of(panel.y, y0, y1, max(3, int(area.height / 27)))),
    )
    for side, ticks in sides:
        side.set_major_locator(FixedLocator([v for v, _ in ticks]))
        side.set_major_formatter(FixedFormatter([label for _, label in ticks]))
        side.set_minor_locator(NullLocator())
    axes.set_title(panel.title, fontsize=9, loc="left", color=panel.colour, pad=4.0)
    axes.set_xlabel(panel.x.label, fontsize=8, labelpad=1.0)
    axes.set_ylabel(panel.y.label, fontsize=8)
    axes.tick_params(labelsize=8, pad=2.5)
    axes.grid(alpha=0.25)


def _draw(axes: Axes, mark: Mark) -> None:
    match mark:
        case Line():
            style = "--" if mark.dashed else "-"
            marker, size = ("o", _POINTS * mark.marks) if mark.marks else ("", 0.0)
            axes.plot(mark.x, mark.y, style, color=mark.colour, lw=mark.width, marker=marker, ms=size)
        case Band():
            axes.fill_between(mark.x, mark.low, mark.high, color=mark.colour, alpha=0.5, lw=0)
        case Dots():
            axes.plot(mark.x, mark.y, ".", color=mark.colour, alpha=0.5, ms=3.5, mew=0)
        case Level():
            across = axes.axvline if mark.upright else axes.axhline
            across(mark.at, color=mark.colour, lw=mark.width, ls="--" if mark.dashed else "-")


def _sample(mark: Mark, x: float, y: float, width: float, height: float) -> list[Line2D | Rectangle]:
    """A mark as it stands in a legend."""
    match mark:
        case Band():
            return [Rectangle((x, y - height / 2), width, height, color=mark.colour, alpha=0.5, lw=0)]
        case Dots():
            return [Line2D([x + width / 2], [y], ls="", marker=".", ms=3.5, mew=0, color=mark.colour)]
        case Line() | Level():
            style = "--" if mark.dashed else "-"
            out: list[Line2D | Rectangle] = [Line2D([x, x + width], [y, y], color=mark.colour, lw=mark.width, ls=style)]
            if isinstance(mark, Line) and mark.marks:
                size = _POINTS * mark.marks
                out.append(Line2D([x + width / 2], [y], ls="", marker="o", ms=size, color=mark.colour))
            return out
