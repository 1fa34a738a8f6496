"""Figures of a validation: measurement, model and error by kind of row, residual spectra, autocorrelation, dampers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lacet.identify.car.rows import Row
from lacet.identify.properties.derived import DamperCurve
from lacet.identify.validation.score import Comparison
from lacet.identify.validation.whiteness import Colour
from lacet.services.render.figures.study_plots import ERROR, FAULT, HELD, MEASURED, MODEL, comparison_figure, png
from lacet.services.render.rows import colour_words

_KINDS = ("chassis", "suspension", "tyre", "spin")


def comparison_pictures(part: Comparison) -> dict[str, bytes]:
    """Pictures of a run: one for each kind of row (figures 4 to 10 of the paper), two of its whiteness; what → PNG."""
    figures = {kind: comparison_figure(part, rows) for kind, rows in kinds(part).items()}
    if part.whiteness:
        figures |= {"spectrum": spectrum_figure(part), "autocorrelation": acf_figure(part)}
    return {what: png(figure) for what, figure in figures.items()}


def damper_picture(curves: Mapping[str, DamperCurve]) -> bytes | None:
    """The damper curves of all corners as PNG; None when no suspension row was measured."""
    return png(damper_figure(curves)) if curves else None


def kinds(part: Comparison) -> dict[str, list[Row]]:
    """The rows of a run by kind."""
    found = {kind: [row for row in part.measured if row.kind == kind] for kind in _KINDS}
    return {kind: rows for kind, rows in found.items() if rows}


def spectrum_figure(part: Comparison) -> Figure:
    """Power density of each row's residual against that of its noise floor."""
    figure, grid = _grid(list(part.whiteness), f"{part.name}: residual spectrum against the noise floor's")
    for axes, (row, white) in zip(grid, part.whiteness.items(), strict=False):
        axes.fill_between(
            white.frequency, white.floor, white.high, color="#bbbbbb", alpha=0.6, lw=0, label="within chance"
        )
        axes.plot(white.frequency, white.floor, color=MEASURED, lw=1.1, ls="--", label="noise floor")
        axes.plot(white.frequency, white.spectrum, color=ERROR, lw=1.4, marker="o", ms=2.5, label="residual")
        axes.set_xscale("log")
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        axes.set_ylim(low, max(high, 20 * low))
        _label(axes, part, row, "frequency [Hz]", f"({part.scores[row].unit})²/Hz")
        axes.set_xticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
        axes.minorticks_off()
    _legend(figure, grid[0])
    return figure


def acf_figure(part: Comparison) -> Figure:
    """Autocorrelation of each row's residual, with the 95 % band of the simulated floor's."""
    figure, grid = _grid(list(part.whiteness), f"{part.name}: residual autocorrelation")
    for axes, (row, white) in zip(grid, part.whiteness.items(), strict=False):
        axes.fill_between(
            white.lag, white.acf_low, white.acf_high, color="#bbbbbb", alpha=0.6, lw=0, label="noise, 95 %"
        )
        axes.plot(white.lag, white.acf, color=ERROR, lw=1.3, label="residual")
        axes.axhline(0.0, color=MEASURED, lw=0.6)
        axes.set_ylim(-0.6, 1.05)
        _label(axes, part, row, "lag [s]", "")
    _legend(figure, grid[0])
    return figure


def damper_figure(curves: Mapping[str, DamperCurve]) -> Figure:
    """Damper force against travel rate at each corner, with its 95 % band, over the rates covered."""
    figure = Figure(figsize=(9.2, 6.2), layout="constrained")
    grid = list(figure.subplots(2, 2, squeeze=False, sharex=True, sharey=True).flat)
    for axes, (corner, curve) in zip(grid, curves.items(), strict=False):
        axes.fill_between(
            1e3 * curve.rate,
            curve.force - curve.half,
            curve.force + curve.half,
            color=HELD,
            alpha=0.5,
            lw=0,
            label="95 %",
        )
        axes.plot(1e3 * curve.rate, curve.force, color=MODEL, lw=1.5, label="damper force")
        axes.axhline(0.0, color=MEASURED, lw=0.6)
        axes.axvline(0.0, color=MEASURED, lw=0.6)
        band = f"± {float(curve.half.max()):.2g} N at most"
        axes.set_title(f"{corner}, at {1e3 * curve.travel:+.0f} mm of travel; {band}", fontsize=9, loc="left")
        axes.grid(alpha=0.25)
        axes.tick_params(labelsize=8, labelbottom=True, labelleft=True)
        axes.set_xlabel("travel rate [mm/s], compression positive", fontsize=8)
        axes.set_ylabel("force [N]", fontsize=8)
    for axes in grid[len(curves) :]:
        axes.set_axis_off()
    _legend(figure, grid[0])
    figure.suptitle("Damper force at the wheel, over the rates seen", x=0.01, ha="left")
    return figure


def _grid(rows: Sequence[Row], title: str, columns: int = 4) -> tuple[Figure, list[Axes]]:
    across = min(columns, len(rows))
    lines = -(-len(rows) // across)
    figure = Figure(figsize=(max(6.5, 3.3 * across), 0.7 + 2.1 * lines), layout="constrained")
    grid = list(figure.subplots(lines, across, squeeze=False).flat)
    for axes in grid[len(rows) :]:
        axes.set_axis_off()
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure, grid


def _label(axes: Axes, part: Comparison, row: Row, x: str, y: str) -> None:
    score = part.scores[row]
    plain = score.colour is Colour.LIKE_NOISE
    axes.set_title(f"{row}: {colour_words(score)}", fontsize=9, loc="left", color=MEASURED if plain else FAULT)
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25)


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
