"""The answer to each candidate, in two plain sentences with numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lacet.identify.car.rows import row_unit
from lacet.identify.effects.base import Effect, Parameter, SensorFault
from lacet.identify.selection.candidate import Candidate

SIGNIFICANCE = 0.05
"""Family-wise error of a proposal."""
LEAST_GAIN = 0.01
"""A proposal must take away at least this part of the weighted residual of the rows it acts on, or of one of them."""


def judged(c: Candidate, effect: Effect, draws: int) -> Candidate:
    """A tested candidate as ``missing`` or ``not needed``, with the reason."""
    wrong = implausible(c, effect.parameters)
    takes = (
        f"Added to the model it takes {c.gain_rms:.3g} {unit_of(c)} RMS off {_listed(c.rows)} "
        f"({100 * c.gain:.3g} % of what they leave) in parts of the runs it was not fitted to."
        if c.gain > 0.0
        else f"Added to the model it takes nothing off {_listed(c.rows)} in parts of the runs it was not fitted to."
    )
    found = f"Its size would be {sizes(c, effect.parameters)}"
    fault = isinstance(effect, SensorFault)
    alone = "noise and the sheet's tolerances" if fault else "noise alone"
    chance = (
        f"{alone} never did as well in {draws} simulated runs (p = {c.p:.2g})"
        if c.p <= 1.0 / (draws + 1) + 1e-12
        else f"{alone} {'do' if fault else 'does'} as well with p = {c.p:.2g}"
    )
    if c.p > SIGNIFICANCE:
        why = f"{takes} Not needed: {chance}, more than {SIGNIFICANCE:g}."
    elif c.gain <= 0.0 or max(c.gain, c.most) < LEAST_GAIN:
        why = f"{takes} Not needed: less than {100 * LEAST_GAIN:g} % of any row, though {chance}."
    elif wrong:
        why = f"{takes} Not needed: {wrong}, which no car has; something else looks like it ({chance})."
    else:
        return replace(c, answer="missing", why=f"{takes} {found}; {chance}.")
    return replace(c, answer="not needed", why=why)


def stands_out(c: Candidate, effect: Effect) -> bool:
    """Whether chance does not do as well and its size is plausible, however little it takes away."""
    return c.p <= SIGNIFICANCE and c.gain > 0.0 and not implausible(c, effect.parameters)


def implausible(c: Candidate, parameters: Sequence[Parameter]) -> str:
    """Which of its parameters would lie outside what is plausible on any car, by more than its interval; or nothing."""
    for q, value, half in zip(parameters, c.values, c.interval, strict=True):
        if value + half < q.low or value - half > q.high:
            return (
                f"{_last(q)} would be {value:.3g} ± {_two_digits(half)} {q.unit} (plausible: {q.low:g} to {q.high:g})"
            )
    return ""


def sizes(c: Candidate, parameters: Sequence[Parameter]) -> str:
    """Its parameters with 95 % intervals, and its shape constants."""
    parts = [
        f"{_last(q)} = {_rounded(value, half)} ± {_two_digits(half)} {q.unit}"
        for q, value, half in zip(parameters, c.values, c.interval, strict=True)
    ]
    unusual = [
        _last(q)
        for q, value, half in zip(parameters, c.values, c.interval, strict=True)
        if (q.expect == "positive" and value + half < 0.0) or (q.expect == "negative" and value - half > 0.0)
    ]
    out = ", ".join([*parts, *(f"{name} {value:.3g} (SI)" for name, value in c.shape.items())])
    return f"{out} (the sign of {', '.join(unusual)} is not the usual one)" if unusual else out


def unit_of(c: Candidate) -> str:
    """Unit of a candidate's `gain_rms`."""
    return row_unit(c.rows[0]) if c.rows else "N"


def _listed(rows: Sequence[str], most: int = 4) -> str:
    shown = ", ".join(rows[:most])
    return shown if len(rows) <= most else f"{shown} and {len(rows) - most} more rows"


def _last(q: Parameter) -> str:
    return q.name.rsplit(".", 1)[-1]


def _two_digits(half: float) -> str:
    """An interval with two digits, without a power of ten up to a million."""
    return f"{float(f'{half:.2g}'):g}"


def _rounded(value: float, half: float) -> str:
    """To the second digit of its interval."""
    if not half > 0.0 or not np.isfinite(half):
        return f"{value:.3g}"
    return f"{value:.{max(0, 1 - int(np.floor(np.log10(half))))}f}"
