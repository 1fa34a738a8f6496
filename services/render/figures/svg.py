"""Pictures as SVG text for the body of an HTML page: small, sharp at any size, with text that can be found.

Series denser than the columns of pixels are drawn as the extremes of each. Places are whole tenths of a pixel, as steps
from the one before; the style sheet is once in the page (`STYLE`).
"""

from __future__ import annotations

import html
import io
import math
import re
from collections.abc import Callable

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lacet.services.render.figures.envelope import envelope_places, thinned
from lacet.services.render.figures.panels import (
    FONT,
    LINE,
    SAMPLE,
    Array,
    Axis,
    Band,
    Box,
    Dots,
    Entry,
    Level,
    Line,
    Mark,
    Panel,
    Panels,
    Scale,
    plan,
)
from lacet.services.render.figures.ticks import ticks_of

STYLE = f"""
figure svg {{ display: block; width: 100%; height: auto; background: white; stroke-linejoin: round; }}
figure > svg:not(.charts) {{ max-height: 80vh; }}
figure svg text {{ font-family: "DejaVu Sans", Verdana, sans-serif; }}
svg.charts text {{ font: {FONT:g}px system-ui, sans-serif; fill: #222; }}
svg.charts .h {{ font-size: {FONT + 3:g}px; }} svg.charts .t {{ font-size: {FONT + 1:g}px; }}
svg.charts .e {{ text-anchor: end; }} svg.charts .m {{ text-anchor: middle; }}
svg.charts path {{ fill: none; stroke-linejoin: round; }} svg.charts .g {{ stroke: #0002; stroke-width: 8; }}
svg.charts .f {{ stroke: #222; stroke-width: .8; }} svg.charts .r {{ stroke-linecap: round; }}
"""
"""Style sheet of all pictures of a page."""
RASTER = 150
"""Resolution of maps within a figure [dots per inch]."""
_NUMBER = re.compile(r"(?<![\w#.])-?\d+\.\d{2,}(?![\w.])")
"""Numbers with more decimals than a picture shows."""
_BETWEEN = re.compile(r">\s*\n\s*<")
_UNNEEDED = re.compile(
    r'<defs><style.*?</style></defs>| id="[\w.]+_\d+"| transform="rotate\(-0 [^"]*"|font-family: [^;"]*;? ?| (?=/>)'
)
"""What matplotlib writes and the page has once (the font), or needs nowhere (names of groups)."""
UNIT = 10.0
"""Units of the charts' areas in a pixel: what places are rounded to."""
DOT = 2.4
"""Diameter of a dot in a cloud [px]; dots within half of it of each other are drawn once."""
MOST_DOTS = 400
"""Dots of a cloud above which neighbours are drawn once: what a chart of some 300 × 200 px still shows as a cloud."""


def svg(picture: Panels) -> str:
    """A picture as an SVG element."""
    where = plan(picture)
    out = [
        f'<svg class="charts" role="img" viewBox="0 0 {where.width:.0f} {where.height:.0f}" '
        f'style="max-width:{where.width:.0f}px"><title>{html.escape(picture.title)}</title>'
    ]
    if picture.title:
        out.append(f'<text class="h" x="4" y="15">{html.escape(picture.title)}</text>')
    for panel, area in zip(picture.panels, where.areas, strict=True):
        out += _panel(panel, area)
    out += [_entry(entry) for entry in where.entries]
    return "".join([*out, "</svg>"])


def figure_svg(figure: Figure) -> str:
    """A figure of matplotlib as an SVG element, its text as text."""
    out = io.StringIO()
    # Equal parts of two figures may have the same name, others not: names are digests of the parts.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "lacet", "path.simplify": True}):
        figure.savefig(out, format="svg", dpi=RASTER, metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    text = out.getvalue()
    text = _NUMBER.sub(lambda found: f"{float(found[0]):.1f}".removesuffix(".0"), text[text.index("<svg") :])
    return _UNNEEDED.sub("", _BETWEEN.sub("><", text))


def _panel(panel: Panel, area: Box) -> list[str]:
    (x0, x1), (y0, y1) = panel.limits()
    wide, tall = round(UNIT * area.width), round(UNIT * area.height)
    across, up = _scale(panel.x, x0, x1, wide), _scale(panel.y, y0, y1, tall)

    def down(values: Array) -> Array:
        return tall - up(values)

    columns = ticks_of(panel.x, x0, x1, max(3, int(area.width / 60)))
    lines = ticks_of(panel.y, y0, y1, max(3, int(area.height / 27)))
    grid = "".join(f"M{v:.0f} 0V{tall}" for v in across(np.array([v for v, _ in columns])))
    grid += "".join(f"M0 {v:.0f}H{wide}" for v in down(np.array([v for v, _ in lines])))
    drawn = "".join(_mark(mark, across, down, (wide, tall)) for mark in panel.marks)
    start, top, bottom = area.x, area.y, area.y + area.height
    out = [
        f'<svg x="{start:g}" y="{top:g}" width="{area.width:g}" height="{area.height:g}" viewBox="0 0 {wide} {tall}">'
        f'<path class="g" d="{grid}"/>{drawn}</svg><path class="f" d="M{start:g} {top:g}h{area.width:g}v{area.height:g}'
        f'h{-area.width:g}z"/>'
    ]
    for number, line in enumerate(panel.title.split("\n")):
        y = top - 5.0 - LINE * (panel.title.count("\n") - number)
        out.append(_text(start, y, line, "t", panel.colour))
    out += [_text(start + float(across(np.array([v]))[0]) / UNIT, bottom + 13, label, "m") for v, label in columns]
    out += [_text(start - 5, top + float(down(np.array([v]))[0]) / UNIT + 4, label, "e") for v, label in lines]
    out.append(_text(start + area.width / 2, bottom + 27, panel.x.label, "m"))
    if panel.y.label:
        x, y = start - 50, top + area.height / 2
        turned = f'transform="rotate(-90 {x:g} {y:g})"'
        out.append(f'<text class="m" x="{x:g}" y="{y:g}" {turned}>{html.escape(panel.y.label)}</text>')
    return out


def _text(x: float, y: float, text: str, kind: str, colour: str = "") -> str:
    style = f' style="fill:{colour}"' if colour else ""
    spaced = html.escape(text).replace("  ", "\u00a0 ")
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}"{style}>{spaced}</text>' if text else ""


def _scale(axis: Axis, low: float, high: float, length: float) -> Callable[[Array], Array]:
    """Places of values along an axis of a length."""
    if axis.scale is Scale.LINEAR:
        return lambda values: (np.asarray(values, float) - low) * (length / (high - low))
    bottom, span = math.log10(low), math.log10(high / low)
    # Zero has no place on a logarithmic axis: it is far below.
    return lambda values: (np.log10(np.maximum(values, 1e-30 * low)) - bottom) * (length / span)


def _mark(mark: Mark, across: Callable[[Array], Array], down: Callable[[Array], Array], size: tuple[int, int]) -> str:
    wide, tall = size
    match mark:
        case Line():
            x, y = across(mark.x), _within(down(mark.y), tall)
            ascending = mark.x.size > 1 and bool(np.all(np.diff(mark.x) > 0.0))
            kept = envelope_places(x, y, round(wide / UNIT)) if ascending else np.arange(x.size)
            out = f'<path d="{_path(x[kept], y[kept])}" style="{_stroke(mark.colour, mark.width, mark.dashed)}"/>'
            return out + (_dots(x, y, mark.colour, mark.marks, 1.0) if mark.marks else "")
        case Band():
            x = np.concatenate([mark.x, mark.x[::-1]])
            y = np.concatenate([mark.high, mark.low[::-1]])
            area = _path(across(x), _within(down(y), tall))
            return f'<path d="{area}z" style="fill:{mark.colour};fill-opacity:.5"/>'
        case Dots():
            x, y = across(mark.x), _within(down(mark.y), tall)
            kept = thinned(x, y, 0.5 * UNIT * DOT, MOST_DOTS)
            return _dots(x[kept], y[kept], mark.colour, DOT, 0.6)
        case Level(upright=True):
            place = float(across(np.array([mark.at]))[0])
            return f'<path d="M{place:.0f} 0v{tall}" style="{_stroke(mark.colour, mark.width, mark.dashed)}"/>'
        case Level():
            place = float(down(np.array([mark.at]))[0])
            return f'<path d="M0 {place:.0f}h{wide}" style="{_stroke(mark.colour, mark.width, mark.dashed)}"/>'


def _within(places: Array, tall: int) -> Array:
    """Places at most one height outside of the area: what cannot be seen needs no digits."""
    return np.clip(places, -tall, 2.0 * tall)


def _stroke(colour: str, width: float, dashed: bool) -> str:
    dash = f";stroke-dasharray:{5 * UNIT:g} {3 * UNIT:g}" if dashed else ""
    return f"stroke:{colour};stroke-width:{UNIT * width:g}{dash}"


def _path(x: Array, y: Array) -> str:
    """A path through points, with a gap where one is not finite."""
    good = np.isfinite(x) & np.isfinite(y)
    edges = np.flatnonzero(np.diff(good.astype(np.int8), prepend=0, append=0))
    return "".join(_stretch(x[a:b], y[a:b]) for a, b in zip(edges[::2], edges[1::2], strict=True))


def _stretch(x: Array, y: Array) -> str:
    places = np.round(np.stack([x, y], axis=1)).astype(np.intp)
    return f"M{places[0, 0]} {places[0, 1]}" + _steps("l", np.diff(places, axis=0))


def _steps(letter: str, steps: NDArray[np.intp]) -> str:
    """Steps of a path; a minus sign parts two numbers as well as a blank."""
    moving = steps[np.any(steps != 0, axis=1)]
    if not moving.size:
        return f"{letter}0 0" if letter == "l" else ""
    return letter + " ".join(map(str, moving.ravel().tolist())).replace(" -", "-")


def _dots(x: Array, y: Array, colour: str, diameter: float, opacity: float) -> str:
    good = np.isfinite(x) & np.isfinite(y)
    places = np.round(np.stack([x[good], y[good]], axis=1)).astype(np.intp)
    if not places.size:
        return ""
    first, steps = places[0], np.diff(places, axis=0).tolist()
    path = f"M{first[0]} {first[1]}h0" + "".join(f"m{dx}{dy}h0" if dy < 0 else f"m{dx} {dy}h0" for dx, dy in steps)
    return f'<path class="r" d="{path}" style="{_stroke(colour, diameter, False)};stroke-opacity:{opacity:g}"/>'


def _entry(entry: Entry) -> str:
    """A sample of a mark and its label."""
    mark, x, y = entry.mark, entry.x, entry.y - 4.0
    label = _text(x + SAMPLE + 6.0, entry.y, mark.label, "")
    match mark:
        case Band():
            sample = (
                f'<path d="M{x:g} {y - 4:g}h{SAMPLE:g}v8h{-SAMPLE:g}z" style="fill:{mark.colour};fill-opacity:.5"/>'
            )
        case Dots():
            middle = x + SAMPLE / 2
            sample = f'<path class="r" d="M{middle:g} {y:g}h0" style="stroke:{mark.colour};stroke-width:{DOT:g}"/>'
        case Line() | Level():
            dash = ";stroke-dasharray:5 3" if mark.dashed else ""
            style = f"stroke:{mark.colour};stroke-width:{mark.width:g}{dash}"
            sample = f'<path d="M{x:g} {y:g}h{SAMPLE:g}" style="{style}"/>'
            if isinstance(mark, Line) and mark.marks:
                dot = f"stroke:{mark.colour};stroke-width:{mark.marks:g}"
                sample += f'<path class="r" d="M{x + SAMPLE / 2:g} {y:g}h0" style="{dot}"/>'
    return sample + label
