"""Pictures of a study: measurement and model by row, and the fall of the error by version."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from lacet.identify.car.rows import Row
from lacet.identify.validation.score import Comparison, pooled_ratio
from lacet.services.render.figures.panels import ERROR, FAULT, HELD, MEASURED, MODEL, Axis, Line, Panel, Panels
from lacet.services.render.identifiability import open_parameters
from lacet.services.render.rows import colour_words

WIDTH = 1180.0
"""Width of a picture as wide as a page's text [px]."""
_COLUMNS = 2
_FEW = 5
"""Versions whose labels have the larger type."""
_LARGE, _SMALL = (9, 80), (7, 84)
"""Size of the labels' type [pt], and characters of it side by side below the picture."""
_BROAD = 900.0
"""Width of a picture on the first page, which is an upright sheet of paper when printed [px]."""


def comparison_charts(part: Comparison, rows: Sequence[Row] | None = None) -> Panels:
    """Measured and modelled rows of a run and their difference, for some rows (default: all)."""
    names = list(rows or part.measured)
    kind = "run used (direct validation)" if part.used else "run held out (cross validation)"
    columns = min(_COLUMNS, len(names))
    return Panels(
        f"{part.name}: {kind}", [_row(part, row) for row in names], columns, (WIDTH / max(columns, 1.2), 200.0)
    )


def side_by_side_charts(left: Comparison, right: Comparison) -> Panels:
    """The rows that both runs have, one below the other: of one run on the left, of the other on the right."""
    rows = [row for row in left.measured if row in right.measured]
    panels = [_row(part, row) for row in rows for part in (left, right)]
    return Panels(f"{left.name} | {right.name}", panels, 2, (WIDTH / 2, 200.0))


def _row(part: Comparison, row: Row) -> Panel:
    t, level = part.t[row], float(np.mean(part.measured[row]))
    score = part.scores[row]
    title = row_title(part, row)
    marks = [
        Line(t, part.measured[row], MEASURED, "measured", width=1.6),
        Line(t, part.modelled[row], MODEL, "model", width=1.1),
        Line(t, part.residual(row) + level, ERROR, "error (about the mean)", width=0.9),
    ]
    return Panel(title, marks, Axis("time [s]"), colour=MEASURED if score.judged else FAULT, tight=True)


def row_title(part: Comparison, row: Row) -> str:
    """Unit, error and verdict of a row of a run, in one or two lines."""
    score = part.scores[row]
    title = f"{row} [{score.unit}]   error {score.rms:.3g}, {score.ratio:.2f} × floor; {colour_words(score)}"
    if score.judged:
        return title
    return f"{title}\ncannot be judged: {open_parameters(score.why).partition(' not ')[0]} left open by the runs used"


def before_after_charts(before: Comparison, after: Comparison, row: Row) -> Panels:
    """A row of one run with the base model and with the present one, below each other on one scale."""
    parts = [before] if before is after else [before, after]
    panels = [_row(part, row) for part in parts]
    ends = [panel.limits()[1] for panel in panels]
    axis = Axis(low=min(low for low, _ in ends), high=max(high for _, high in ends))
    names = ("Base model: ", "Present model: ")
    panels = [replace(panel, title=name + panel.title, y=axis) for name, panel in zip(names, panels, strict=False)]
    return Panels(f"{row} of run {after.name}", panels, 1, (_BROAD, 165.0))


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
            axes.bar_label(bars, fmt="%.2f", fontsize=9, padding=2.5)
    axes.axhline(1.0, color=MEASURED, lw=1.2, ls="--", label="noise floor")
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.8), high * 1.25)
    axes.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    axes.minorticks_off()
    axes.set_ylim(0.7, max(2.0, high * 1.3))
    size, room = _LARGE if len(versions) <= _FEW else _SMALL
    axes.set_xticks(x, [fill(f"{v.number}: {v.note}", max(room // len(versions), 4)) for v in versions], fontsize=size)
    axes.set_ylabel("error ÷ noise floor")
    axes.legend(frameon=False, fontsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure
