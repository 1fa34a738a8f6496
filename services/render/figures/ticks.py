"""Round numbers on an axis, and how they are written."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import LogLocator, MaxNLocator

from lacet.services.render.figures.panels import Axis, Scale

_NARROW = 2.0
"""Decades up to which a logarithmic axis also has ticks at 2 and 5."""


def ticks_of(axis: Axis, low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Values on an axis from `low` to `high`, about `most` of them, each with its label."""
    if axis.ticks:
        found = np.asarray(axis.ticks, float)
        return [(v, f"{v:g}") for v in found[(found >= low) & (found <= high)].tolist()]
    if axis.scale is Scale.LOGARITHMIC:
        wide = math.log10(high / low)
        subs = (1.0,) if wide > _NARROW else (1.0, 2.0, 5.0)
        found = np.asarray(LogLocator(subs=subs, numticks=most + 1).tick_values(low, high), float)
        return [(v, _short(v)) for v in found[(found >= low) & (found <= high)].tolist()]
    found = np.asarray(MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high), float)
    slack = 1e-6 * (high - low)
    found = found[(found >= low - slack) & (found <= high + slack)]
    return list(zip(found.tolist(), _written(found.tolist()), strict=True))


def _written(values: Sequence[float]) -> list[str]:
    """Numbers with the decimals that their distance needs."""
    if len(values) < 2:
        return [_short(v) for v in values]
    step, largest = values[1] - values[0], max(map(abs, values))
    if largest >= 1e6 or largest < 1e-3:
        digits = next((d for d in range(9) if all(abs(float(f"{v:.{d}e}") - v) < 1e-6 * step for v in values)), 9)
        return ["0" if abs(v) < 1e-6 * step else _minus(f"{v:.{digits}e}") for v in values]
    decimals = next((d for d in range(9) if abs(round(step, d) - step) < 1e-6 * step), 9)
    return [_minus(f"{v if abs(v) > 1e-6 * step else 0.0:.{decimals}f}") for v in values]


def _short(value: float) -> str:
    return _minus(f"{value:g}" if 1e-3 <= abs(value) < 1e5 else f"{value:.0e}")


def _minus(text: str) -> str:
    """A number in letters, with a minus sign and without the zeros and signs that an exponent does not need."""
    head, e, power = text.partition("e")
    out = f"{head}e{int(power)}" if e else head
    return out.replace("-", "−")
