"""Pictures of a validation: measurement, model and error by kind of row, residual spectra, autocorrelation, dampers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.properties.derived import DamperCurve
from lacet.identify.validation.score import Comparison
from lacet.identify.validation.whiteness import Colour
from lacet.services.render.figures.panels import (
    CHANCE,
    ERROR,
    FAULT,
    HELD,
    MEASURED,
    MODEL,
    Axis,
    Band,
    Level,
    Line,
    Mark,
    Panel,
    Panels,
    Scale,
)
from lacet.services.render.figures.png import charts_png
from lacet.services.render.figures.study_plots import WIDTH, comparison_charts
from lacet.services.render.intervals import half_width
from lacet.services.render.rows import colour_words

_KINDS = ("chassis", "suspension", "tyre", "spin", "body", "corner")
_FREQUENCIES = (0.2, 0.5, 1.0, 2.0, 5.0)


def comparison_pictures(part: Comparison) -> dict[str, bytes]:
    """Pictures of a run: one for each kind of row (figures 4 to 10 of the paper), two of its whiteness; what → PNG."""
    figures = {kind: comparison_charts(part, rows) for kind, rows in kinds(part).items()}
    if part.whiteness:
        figures |= {"spectrum": spectrum_charts(part), "autocorrelation": acf_charts(part)}
    return {what: charts_png(figure) for what, figure in figures.items()}


def damper_picture(curves: Mapping[str, DamperCurve]) -> bytes | None:
    """The damper curves of all corners as PNG; None when no suspension row was measured."""
    return charts_png(damper_charts(curves)) if curves else None


def kinds(part: Comparison) -> dict[str, list[Row]]:
    """The rows of a run by kind."""
    found = {kind: [row for row in part.measured if row.kind == kind] for kind in _KINDS}
    return {kind: rows for kind, rows in found.items() if rows}


def spectrum_charts(part: Comparison) -> Panels:
    """Power density of each row's residual against that of its noise floor."""
    panels: list[Panel] = []
    for row, white in part.whiteness.items():
        seen = np.concatenate([white.floor, white.high, white.spectrum])
        low = float(np.min(seen[seen > 0.0], initial=np.inf, where=np.isfinite(seen[seen > 0.0])))
        least = 20.0 * low if np.isfinite(low) and float(np.nanmax(seen)) < 20.0 * low else None
        marks = [
            Band(white.frequency, white.floor, white.high, CHANCE, "within chance"),
            Line(white.frequency, white.floor, MEASURED, "noise floor", width=1.1, dashed=True),
            Line(white.frequency, white.spectrum, ERROR, "residual", width=1.4, marks=3.5),
        ]
        x = Axis("frequency [Hz]", Scale.LOGARITHMIC, ticks=_FREQUENCIES)
        y = Axis(f"({part.scores[row].unit})²/Hz", Scale.LOGARITHMIC, high=least)
        panels.append(_panel(part, row, marks, x, y))
    return _small(f"{part.name}: residual spectrum against the noise floor's", panels)


def acf_charts(part: Comparison) -> Panels:
    """Autocorrelation of each row's residual, with the 95 % band of the simulated floor's."""
    panels = [
        _panel(
            part, row,
            [
                Band(white.lag, white.acf_low, white.acf_high, CHANCE, "noise, 95 %"),
                Line(white.lag, white.acf, ERROR, "residual", width=1.3),
                Level(0.0),
            ],
            Axis("lag [s]"), Axis(low=-0.6, high=1.05),
        )
        for row, white in part.whiteness.items()
    ]  # fmt: skip
    return _small(f"{part.name}: residual autocorrelation", panels)


def damper_charts(curves: Mapping[str, DamperCurve]) -> Panels:
    """Damper force against travel rate at each corner, with its 95 % band, over the rates covered."""
    rates = [1e3 * curve.rate for curve in curves.values()]
    ends = [curve.force + sign * curve.half for curve in curves.values() for sign in (-1.0, 1.0)]
    (x0, x1), (y0, y1) = ((float(np.min(np.concatenate(a))), float(np.max(np.concatenate(a)))) for a in (rates, ends))
    x = Axis("travel rate [mm/s], compression positive", low=x0 - 0.05 * (x1 - x0), high=x1 + 0.05 * (x1 - x0))
    y = Axis("force [N]", low=y0 - 0.05 * (y1 - y0), high=y1 + 0.05 * (y1 - y0))
    panels: list[Panel] = []
    for (corner, curve), rate in zip(curves.items(), rates, strict=True):
        marks = [
            Band(rate, curve.force - curve.half, curve.force + curve.half, HELD, "95 %"),
            Line(rate, curve.force, MODEL, "damper force", width=1.5),
            Level(0.0),
            Level(0.0, upright=True),
        ]
        band = f"± {half_width(float(curve.half.max()))} N at most"
        panels.append(Panel(f"{corner}, at {1e3 * curve.travel:+.0f} mm of travel; {band}", marks, x, y))
    return Panels("Damper force at the wheel, over the rates seen", panels, 2, (440.0, 300.0))


def _small(title: str, panels: Sequence[Panel]) -> Panels:
    columns = min(4, len(panels))
    return Panels(title, panels, columns, (max(WIDTH / 4.0, 620.0 / columns), 190.0))


def _panel(part: Comparison, row: Row, marks: Sequence[Mark], x: Axis, y: Axis) -> Panel:
    score = part.scores[row]
    plain = score.colour is Colour.LIKE_NOISE
    return Panel(f"{row}: {colour_words(score)}", marks, x, y, MEASURED if plain else FAULT)
