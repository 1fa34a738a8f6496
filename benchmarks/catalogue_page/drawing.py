"""One small picture of a signature: the residual over time, and against the state that tells."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from benchmarks.catalogue_page.residuals import Signature
from lacet.identify.validation.residual_map import conditional_mean

LINE, POINTS, MEAN, BAND, AXIS = "#2e86ab", "#5fa3c7", "#b3261e", "#d9d9d9", "#444444"
SIZE = 6.6, 2.2
DOTS = 110
SHADES = 6
"""Of each ink on each ground."""
BLOCK = 2.0
"""Length of a block of correlated residuals [s]."""
LEAST = 5.0
"""The axis reaches at least so many floors."""
SMALL = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "m²/s": ("cm²/s", 1e4), "rad": ("mrad", 1e3), "N": ("kN", 1e-3)}


def draw(one: Signature, loop: bool, path: Path) -> None:
    """Write the picture as a PNG of few colours; `loop`: a path against the state, not points and their mean."""
    figure = Figure(figsize=SIZE, dpi=DOTS, layout="constrained")
    time, state = figure.subplots(1, 2, sharey=True, width_ratios=(1.35, 1.0))
    for axes in (time, state):
        axes.axhspan(-2.0, 2.0, color=BAND, lw=0)
        axes.axhline(0.0, color="white", lw=0.6)
        axes.tick_params(labelsize=8, colors=AXIS, length=3)
        axes.spines[["top", "right"]].set_visible(False)
    time.plot(one.t, one.residual, color=LINE, lw=0.9)
    time.set_xlim(one.t[0], one.t[-1])
    low, high = np.quantile(one.residual, (0.001, 0.999))
    room = 0.08 * max(high - low, abs(high), abs(low))
    time.set_ylim(min(low - room, -LEAST), max(high + room, LEAST))
    time.set_ylabel("residual ÷ noise floor", fontsize=8)
    time.set_xlabel("time [s]", fontsize=8)
    time.set_title(f"{one.row}, floor {one.floor:.2g} {one.row_unit}", fontsize=8, loc="left", color=AXIS)
    _against(state, one, loop)
    file = io.BytesIO()
    FigureCanvasAgg(figure).print_png(file)
    picture = Image.open(file).convert("RGB").quantize(palette=_palette(), dither=Image.Dither.NONE)
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.save(path, optimize=True)


def _palette() -> Image.Image:
    """Every ink on white and on the band, with half-tones for their edges: chosen, so that no ink is lost."""
    colours: list[tuple[int, ...]] = []
    for ground in ("#ffffff", BAND):
        for ink in (LINE, POINTS, MEAN, AXIS, "#000000", BAND):
            pair = np.array([to_rgb(ground), to_rgb(ink)])
            mixed = np.linspace(0.0, 1.0, SHADES)[:, None] * (pair[1] - pair[0]) + pair[0]
            colours += [tuple(round(255.0 * v) for v in colour) for colour in mixed]
    flat = [v for colour in dict.fromkeys(colours) for v in colour]
    out = Image.new("P", (1, 1))
    out.putpalette(flat)
    return out


def _against(axes: Axes, one: Signature, loop: bool) -> None:
    unit, factor = one.unit, 1.0
    largest = float(np.max(np.abs(one.against)))
    if largest < 1.0 or one.unit == "N":
        unit, factor = SMALL.get(one.unit, (one.unit, 1.0))
    x = one.against * factor
    if loop:
        axes.plot(x, one.residual, color=LINE, lw=0.9)
    else:
        axes.plot(x, one.residual, ".", color=POINTS, ms=3.5, mew=0)
        blocks = np.floor((one.t - one.t[0]) / BLOCK).astype(np.intp)
        mean = conditional_mean(x, one.residual, blocks, bins=14)
        axes.plot(mean.centre, mean.mean, color=MEAN, lw=1.6)
        axes.set_title("mean in red", fontsize=8, loc="right", color=MEAN)
    low, high = np.quantile(x, (0.002, 0.998))
    if high > low:
        axes.set_xlim(low, high)
    axes.set_xlabel(f"{one.state} [{unit}]", fontsize=8)
