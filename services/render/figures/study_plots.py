"""Figures of a study, drawn with matplotlib without a display."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lacet.identify.car.rows import Row
from lacet.identify.validation.score import Comparison, pooled_ratio
from lacet.services.render.identifiability import open_parameters
from lacet.services.render.rows import colour_words

matplotlib.use("Agg")

MEASURED, MODEL, ERROR, HELD, FAULT = "#222222", "#d1495b", "#2e86ab", "#e09f3e", "#b3261e"
_COLUMNS = 2


def comparison_figure(part: Comparison, rows: Sequence[Row] | None = None) -> Figure:
    """Measured and modelled rows of a run and their difference, for some rows (default: all)."""
    names = list(rows or part.measured)
    lines = -(-len(names) // _COLUMNS)
    width = 6.0 * min(_COLUMNS, len(names)) if len(names) > 1 else 9.2
    figure = Figure(figsize=(width, 0.6 + 2.1 * lines), layout="constrained")
    grid = figure.subplots(lines, min(_COLUMNS, len(names)), squeeze=False)
    for axes, row in zip(grid.flat, names, strict=False):
        _row(axes, part, row)
    for axes in list(grid.flat)[len(names) :]:
        axes.set_axis_off()
    handles, labels = grid.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False)
    kind = "run used (direct validation)" if part.used else "run held out (cross validation)"
    figure.suptitle(f"{part.name}: {kind}", x=0.01, ha="left", fontsize=11)
    return figure


def _row(axes: Axes, part: Comparison, row: Row) -> None:
    t, level = part.t[row], float(np.mean(part.measured[row]))
    axes.plot(t, part.measured[row], color=MEASURED, lw=1.4, label="measured")
    axes.plot(t, part.modelled[row], color=MODEL, lw=0.9, label="model")
    axes.plot(t, part.residual(row) + level, color=ERROR, lw=0.7, label="error (about the mean)")
    score = part.scores[row]
    title = f"{row} [{score.unit}]   error {score.rms:.3g}, {score.ratio:.2f} × floor; {colour_words(score)}"
    if not score.judged:
        title += f"\ncannot be judged: {open_parameters(score.why).partition(' not ')[0]} left open by the runs used"
    axes.set_title(title, fontsize=9, loc="left", color=MEASURED if score.judged else FAULT)
    axes.tick_params(labelsize=8)
    axes.set_xlabel("time [s]", fontsize=8)
    axes.grid(alpha=0.25)
    axes.margins(x=0)


def fall_figure(versions: Sequence[Any]) -> Figure:
    """Error ÷ floor by version, on the runs used and held out, with the floor as a line."""
    figure = Figure(figsize=(7.5, 3.4), layout="constrained")
    axes = figure.subplots()
    x = np.arange(len(versions))
    width = 0.38
    for offset, kind, colour, label in ((-0.5, "used", ERROR, "runs used"), (0.5, "held", HELD, "runs held out")):
        values = [pooled_ratio(v.result["rows"][kind]) for v in versions]
        if np.all(np.isfinite(values)):
            bars = axes.bar(x + offset * width, values, width, color=colour, label=label)
            axes.bar_label(bars, fmt="%.2f", fontsize=9)
    axes.axhline(1.0, color=MEASURED, lw=1.2, ls="--", label="noise floor")
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.8), high * 1.25)
    axes.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    axes.minorticks_off()
    axes.set_ylim(0.7, max(2.0, high * 1.3))
    axes.set_xticks(x, [f"{v.number}: {v.note}" for v in versions], fontsize=9)
    axes.set_ylabel("error ÷ noise floor")
    axes.legend(frameon=False, fontsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure


def png(figure: Figure) -> bytes:
    """A figure as PNG bytes."""
    out = io.BytesIO()
    figure.savefig(out, dpi=110, format="png")
    return out.getvalue()
