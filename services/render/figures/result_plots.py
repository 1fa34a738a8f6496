"""Figures of results of the library: a ranking, how the error fell, parameters with their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lacet.identify.selection.candidate import Answer, Candidate
from lacet.identify.validation.parameter_estimates import Estimate
from lacet.services.render.figures.panels import CHANCE, ERROR, FAULT, HELD, MEASURED, MODEL
from lacet.services.render.intervals import to_interval

LINE = 0.26
"""Height of a line of a figure [in]."""


def ranking_figure(candidates: Sequence[Candidate], most: int) -> Figure:
    """Gain in cross-validation of the best candidates, those missing in a colour of their own."""
    shown = sorted((c for c in candidates if np.isfinite(c.gain)), key=lambda c: -c.gain)[:most]
    figure, axes = _lines([c.key for c in shown])
    colours = [MODEL if c.answer is Answer.MISSING else CHANCE for c in shown]
    bars = axes.barh(np.arange(len(shown)), [100.0 * c.gain for c in shown], color=colours)
    axes.bar_label(bars, [f" {c.answer.value}, p = {c.p:.2g}" for c in shown], fontsize=8)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlim(0.0, 1.35 * max([100.0 * c.gain for c in shown], default=100.0))
    axes.set_xlabel("fall of the squared error in cross-validation [%]", fontsize=9)
    return figure


def waterfall_figure(steps: Mapping[str, float]) -> Figure:
    """Error ÷ noise floor step by step: what each takes off, and what remains; the last bar is the whole remainder."""
    names, ratios = list(steps), np.array(list(steps.values()))
    figure = Figure(figsize=(2.2 + 1.5 * len(names), 3.4), layout="constrained")
    axes = figure.subplots()
    axes.bar(0, ratios[0], color=ERROR, width=0.6)
    for k in range(1, len(names)):
        low, high = sorted(ratios[k - 1 : k + 1])
        falls = ratios[k] <= ratios[k - 1]
        axes.bar(k, high - low, bottom=low, color=HELD if falls else FAULT, width=0.6)
        axes.plot([k - 0.7, k + 0.3], [ratios[k - 1]] * 2, color=MEASURED, lw=0.7)
    for k, ratio in enumerate(ratios):
        below = k > 0 and ratio <= ratios[k - 1]
        place = {"xytext": (0, -12 if below else 3), "textcoords": "offset points"}
        axes.annotate(f"{ratio:.2f}", (k, ratio), ha="center", fontsize=9, **place)
    axes.bar(len(names), ratios[-1], color=ERROR, width=0.6)
    axes.axhline(1.0, color=MEASURED, lw=1.2, ls="--", label="noise floor")
    axes.set_xticks(range(len(names) + 1), [*names, "remains"], fontsize=9)
    axes.set_ylim(0.0, 1.12 * float(np.max(ratios)))
    axes.set_ylabel("error ÷ noise floor", fontsize=9)
    axes.legend(frameon=False, fontsize=9)
    _open(axes)
    return figure


def forest_figure(parameters: Sequence[Estimate], known: Mapping[str, float]) -> Figure:
    """Each parameter's 95 % interval relative to its value, by noise (thick) and with the sensor sheet (thin).

    `known` : values known otherwise by name (SI), as crosses.
    """
    figure, axes = _lines([f"{one.name} = {to_interval(one.value, one.half)} {one.unit}" for one in parameters])
    for k, one in enumerate(parameters):
        scale = 100.0 / abs(one.value)
        for half, width in ((one.half_sheet, 1.0), (one.half, 3.5)):
            axes.plot([-half * scale, half * scale], [k, k], color=ERROR, lw=width, solid_capstyle="butt")
        if one.name in known:
            axes.plot((known[one.name] - one.value) * scale, k, "x", color=MODEL, ms=7, mew=1.8)
    axes.plot(np.zeros(len(parameters)), np.arange(len(parameters)), ".", color=MEASURED, ms=4)
    axes.axvline(0.0, color=CHANCE, lw=0.8, zorder=0)
    axes.set_xlabel("95 % interval [% of the value]" + "; × known otherwise" * bool(known), fontsize=9)
    return figure


def _lines(labels: Sequence[str]) -> tuple[Figure, Axes]:
    """A figure of one line a label, the first on top."""
    figure = Figure(figsize=(8.0, 1.1 + LINE * len(labels)), layout="constrained")
    axes = figure.subplots()
    axes.set_yticks(range(len(labels)), labels, fontsize=9)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    _open(axes)
    return figure, axes


def _open(axes: Axes) -> None:
    """Without the lines above and on the right."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
