"""Pictures of the failure analysis: residual map, phases, states, spectra, restoring-force surfaces."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import log10

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from lacet.identify.car.manoeuvre_phases import PHASES, Phases
from lacet.identify.car.rows import Row
from lacet.identify.validation.explainable_residual import ExplainableResidual
from lacet.identify.validation.residual_map import Against, InPhase, residual_map
from lacet.identify.validation.restoring_force import LEAST_SAMPLES, Surface
from lacet.identify.validation.score import Comparison
from lacet.identify.validation.spectra import RowSpectrum
from lacet.services.render.figures.panels import (
    CHANCE,
    ERROR,
    FAULT,
    HELD,
    MEASURED,
    MODEL,
    Axis,
    Band,
    Dots,
    Level,
    Line,
    Panel,
    Panels,
    Scale,
)
from lacet.services.render.figures.study_plots import WIDTH
from lacet.services.render.units import TRAVEL, TRAVEL_RATE, display_unit

COLOURS = dict(
    zip(
        PHASES,
        (
            "#8c8c8c", "#e4e4e4", "#4c9f70", "#c1443c", "#e09f3e", "#2e86ab", "#8ecae6",
            "#2a6f4e", "#7f1d1d", "#a36a12", "#8e6bbf", "#6b4a2f",
        ),
        strict=True,
    )
)  # fmt: skip
"""Colour of each manoeuvre phase, the same in every figure."""
_BROKEN = re.compile(r"(?<=cornering) |(?<=,) | (?=in a bend)")
"""Places in the name of a phase at which a line may break."""
MOST = 5.0
"""Smallest upper end of the colour scale, error ÷ floor."""
LEAST, UTMOST = 0.5, 50.0
"""Lower end of the colour scale, and largest upper end, error ÷ floor."""


def map_figure(parts: Sequence[Comparison], phases: Sequence[Phases]) -> Figure:
    """Residual map: row × time in units of the noise floor, one panel a run, its phases as a strip above."""
    maps = [residual_map(part) for part in parts]
    rows = list(dict.fromkeys(row for one in maps for row in one.rows))
    lengths = [float(one.edges[-1] - one.edges[0]) for one in maps]
    present = [name for name in PHASES if any(name in split.present for split in phases)]
    legend_lines = -(-len(present) // 6)
    size = max(8.0, 2.4 * len(parts) + 2.0), 1.5 + 0.25 * legend_lines + 0.22 * len(rows)
    figure = Figure(figsize=size, layout="constrained")
    heights = [1.0, max(4.0, float(len(rows)))]
    grid = figure.subplots(2, len(parts), squeeze=False, sharex="col", width_ratios=lengths, height_ratios=heights)
    norm = _norm(*(one.ratio for one in maps))
    image = None
    for k, (one, split) in enumerate(zip(maps, phases, strict=True)):
        strip, axes = grid[0, k], grid[1, k]
        for interval in split.intervals:
            strip.axvspan(interval.start, interval.stop, color=COLOURS[interval.phase], lw=0)
        strip.set_yticks([])
        strip.tick_params(bottom=False, labelbottom=False)
        strip.set_title(f"{one.name}{'' if parts[k].used else ' (held out)'}", fontsize=9, loc="left")
        field = np.full((len(rows), one.edges.size - 1), np.nan)
        for row, line in zip(one.rows, one.ratio, strict=True):
            field[rows.index(row)] = line
        image = axes.pcolormesh(one.edges, np.arange(len(rows) + 1), field, cmap="magma_r", norm=norm, rasterized=True)
        axes.set_facecolor("#dddddd")
        axes.set_ylim(len(rows), 0)
        axes.set_yticks(np.arange(len(rows)) + 0.5, rows if k == 0 else [""] * len(rows), fontsize=8)
        axes.set_xlim(one.edges[0], one.edges[-1])
        axes.set_xlabel("time [s]", fontsize=8)
        axes.tick_params(labelsize=8)
    if image is not None:
        _bar(figure.colorbar(image, ax=grid[1, :], label="error ÷ floor", extend="both"), norm)
    handles = [Patch(color=COLOURS[name], label=name) for name in present]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(6, len(present)), frameon=False, fontsize=8)
    return figure


def phase_figure(in_phase: Mapping[str, Mapping[Row, InPhase]]) -> Figure:
    """Residual ÷ floor by row and phase, with numbers."""
    rows = list(dict.fromkeys(row for own in in_phase.values() for row in own))
    field = np.array([[own[row].ratio if row in own else np.nan for own in in_phase.values()] for row in rows])
    figure = Figure(figsize=(2.6 + 0.95 * len(in_phase), 1.4 + 0.23 * len(rows)), layout="constrained")
    axes = figure.subplots()
    norm = _norm(field)
    image = axes.imshow(field, aspect="auto", cmap="magma_r", norm=norm)
    for i, line in enumerate(field):
        for j, value in enumerate(line):
            if np.isfinite(value):
                colour = "white" if float(norm(value)) > 0.5 else MEASURED
                axes.text(j, i, f"{value:.1f}", ha="center", va="center", fontsize=8, color=colour)
    names = [
        f"{_BROKEN.sub(chr(10), name)}\n{max(x.seconds for x in own.values()):.0f} s" for name, own in in_phase.items()
    ]
    axes.set_xticks(np.arange(len(names)), names, fontsize=8)
    axes.set_yticks(np.arange(len(rows)), rows, fontsize=8)
    axes.tick_params(length=0)
    _bar(figure.colorbar(image, ax=axes, label="error ÷ floor", extend="both"), norm)
    return figure


def against_charts(against: Mapping[str, Against]) -> Panels:
    """Residual of a row against states: samples, conditional mean, 95 % band."""
    panels: list[Panel] = []
    for name, one in against.items():
        scale, unit = display_unit(one.mean.unit, float(np.max(np.abs(one.mean.centre))))
        x = scale * one.mean.centre
        marks = [
            Dots(scale * one.values, one.residual, ERROR, "samples"),
            Band(x, one.mean.low, one.mean.high, HELD, "95 % of the mean"),
            Line(x, one.mean.mean, MODEL, "mean", width=1.3, marks=4.0),
            Level(0.0),
        ]
        panels.append(Panel("", marks, Axis(f"{name} [{unit}]"), Axis(f"error [{one.row_unit}]")))
    first = next(iter(against.values()))
    put_back = any(one.put_back for one in against.values())
    also = ", what the model's own springs, dampers and masses absorbed put back" if put_back else ""
    columns = min(3, len(against))
    return Panels(f"{first.row} against its states{also}", panels, columns, (WIDTH / 3.0, 250.0))


def surface_figure(surfaces: Mapping[str, Surface], what: str = "residual") -> Figure:
    """Mean residual, or the whole suspension `force`, over travel × rate at each corner."""
    figure = Figure(figsize=(9.4, 0.6 + 3.1 * (-(-len(surfaces) // 2))), layout="constrained")
    grid = list(figure.subplots(-(-len(surfaces) // 2), 2, squeeze=False).flat)
    fields = {corner: s.residual if what == "residual" else s.force for corner, s in surfaces.items()}
    values = np.concatenate([f[np.isfinite(f)] for f in fields.values()] or [np.zeros(1)])
    high = float(np.max(np.abs(values), initial=1e-9))
    low = -high if what == "residual" else float(np.min(values, initial=high))
    image = None
    for axes, (corner, one) in zip(grid, surfaces.items(), strict=False):
        cmap = "RdBu_r" if what == "residual" else "viridis"
        travel, rate = TRAVEL[0] * one.travel, TRAVEL_RATE[0] * one.rate
        image = axes.pcolormesh(travel, rate, fields[corner], cmap=cmap, vmin=low, vmax=high, rasterized=True)
        axes.set_facecolor("#eeeeee")
        single = (one.count >= LEAST_SAMPLES) & (one.blocks < 2)
        x, y = (0.5 * (edges[:-1] + edges[1:]) for edges in (travel, rate))
        jj, ii = np.nonzero(single)
        axes.plot(x[ii], y[jj], "x", ms=4, mew=0.7, color=MEASURED)
        scatter = f": scatter about it {one.scatter:.3g} N" if what == "residual" else ""
        axes.set_title(f"{corner}{scatter}", fontsize=9, loc="left")
        axes.set_xlabel(f"travel [{TRAVEL[1]}], compression positive", fontsize=8)
        axes.set_ylabel(f"rate [{TRAVEL_RATE[1]}]", fontsize=8)
        axes.tick_params(labelsize=8)
    for axes in grid[len(surfaces) :]:
        axes.set_axis_off()
    if image is not None:
        label = "mean error of the suspension row [N]" if what == "residual" else "force of the suspension [N]"
        figure.colorbar(image, ax=grid, label=label)
    note = f"grey: fewer than {LEAST_SAMPLES} samples; ×: from a single stretch of 2 s"
    title = "What the model misses" if what == "residual" else "Restoring force"
    figure.suptitle(f"{title} over travel and rate ({note})", x=0.01, ha="left", fontsize=10)
    return figure


def spectrum_charts(spectrum: RowSpectrum) -> Panels:
    """A row's residual spectrum against its floor's, and the coherence with the states that explain most of it."""
    f = spectrum.frequency
    x = Axis("frequency [Hz]", low=0.0, high=float(f[-1]))
    power = [
        Band(f, spectrum.floor, spectrum.high, CHANCE, "noise, up to 95 %"),
        Line(f, spectrum.floor, MEASURED, "noise floor", width=1.1, dashed=True),
        Line(f, spectrum.residual, ERROR, "residual", width=1.4, marks=3.5),
    ]
    order = list(spectrum.explained)[:4]
    coherent = [
        Line(f, spectrum.coherence[name], colour, name, width=1.4)
        for name, colour in zip(order, (MODEL, ERROR, HELD, "#4c9f70"), strict=False)
    ]
    chance = Level(spectrum.level, label="chance, any state, 5 %", width=1.0, dashed=True)
    title = f"squared coherence with states ({spectrum.segments:.0f} segments)"
    panels = [
        Panel(f"{spectrum.row}: spectrum", power, x, Axis(f"({spectrum.unit})²/Hz", Scale.LOGARITHMIC), legend=True),
        Panel(title, [*coherent, chance], x, Axis(low=0.0, high=1.02), legend=True),
    ]
    return Panels("", panels, 2, (WIDTH / 2.0, 280.0), legend=False)


def explainable_figure(explainable: Mapping[Row, ExplainableResidual]) -> Figure:
    """Composition of each row's residual: noise, dependence on states, on their history, the rest."""
    rows = list(explainable)
    figure = Figure(figsize=(9.4, 1.1 + 0.25 * len(rows)), layout="constrained")
    axes = figure.subplots()
    y = np.arange(len(rows))
    total = np.array([explainable[r].rms / explainable[r].floor for r in rows])
    present = np.array([max(0.0, explainable[r].part) if explainable[r].something else 0.0 for r in rows])
    history = np.array([max(0.0, explainable[r].history) if explainable[r].depends_on_history else 0.0 for r in rows])
    rest = 1.0 - present - history
    start = np.zeros(len(rows))
    for share, colour, label in (
        (rest, "#b5b5b5", "not predictable"),
        (present, MODEL, "follows the states"),
        (history, HELD, "follows their history"),
    ):
        axes.barh(y, share * total, left=start, color=colour, label=label, height=0.72)
        start = start + share * total
    axes.axvline(1.0, color=MEASURED, lw=1.2, ls="--", label="noise floor")
    for k, row in enumerate(rows):
        one = explainable[row]
        found = one.something or one.depends_on_history
        text = f" {max(one.part_rms, one.history_rms):.3g} {one.unit} left to find" if found else ""
        axes.text(float(total[k]), k, text, va="center", fontsize=8, color=FAULT)
    axes.set_yticks(y, rows, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.3 * float(total.max(initial=1.0)))
    if float(total.max(initial=1.0)) > 8.0:
        _root_scale(axes, float(total.max()))
    axes.set_xlabel("error ÷ floor; colours share the bar as they share the squares", fontsize=8)
    axes.tick_params(labelsize=8)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure


def _norm(*fields: NDArray[np.float64]) -> LogNorm:
    """Logarithmic colour scale of error ÷ floor, common to all fields."""
    high = max((float(np.nanmax(field)) for field in fields if np.isfinite(field).any()), default=1.0)
    return LogNorm(LEAST, float(np.clip(high, MOST, UTMOST)))


def _bar(bar: Colorbar, norm: LogNorm) -> None:
    ticks = [x for x in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if x <= float(norm.vmax or UTMOST)]
    bar.set_ticks(ticks, labels=[f"{x:g}" for x in ticks])
    bar.ax.minorticks_off()


def _root_scale(axes: Axes, high: float) -> None:
    """Square-root scale of an axis, so that rows at the floor remain visible beside one far above it."""
    axes.set_xscale("function", functions=(lambda x: np.sqrt(np.maximum(x, 0.0)), np.square))
    decades = 10.0 ** np.arange(int(log10(high)) + 1)
    ticks = [0.0, 1.0, *(float(x) for x in np.outer(decades, (2.0, 5.0, 10.0)).ravel() if x <= high)]
    axes.set_xticks(ticks, [f"{x:g}" for x in ticks])
