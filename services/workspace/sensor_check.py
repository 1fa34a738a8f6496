"""The work behind ``lacet check``: noise, latencies and the bias of noise, as plain data and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.formats.result import plain
from lacet.daq.vehicle import Vehicle
from lacet.identify.properties.whole_vehicle import NAMES, UNITS, whole_vehicle
from lacet.identify.regression.instrumental_variables import Contrast, Instruments
from lacet.identify.regression.latency import Timings
from lacet.identify.signals.noise_level import NoiseLevel
from lacet.services.render.tables import number, table

LEVEL = 0.01
"""Significance of the two tests of bias: an alarm one set of runs in a hundred gives by chance."""

DISTRUST = 1.5
"""A row this many times above its noise floor: the model lacks something, which latencies then follow."""

CLEAR = 3.0
"""Differences of this many of their σ are shown."""


def noise_result(levels: Sequence[NoiseLevel]) -> list[dict[str, Any]]:
    """Measured noise as plain data."""
    return [
        {
            "sensor": n.sensor, "family": n.family, "unit": _unit(n.family), "sigma": n.sigma, "half95": n.half,
            "sheet": n.sheet, "flatness": n.flatness, "verdict": n.verdict, "why": n.why, "columns": n.columns,
            "odd_columns": n.odd_ones,
        }
        for n in levels
    ]  # fmt: skip


def _unit(family: str) -> str:
    return next(c.unit for c in CHANNELS.values() if c.family == family)


_WORDS = {
    "as the sheet": "as the sheet",
    "larger": "larger than the sheet",
    "smaller": "smaller than the sheet",
    "not white": "not white: samples depend on their neighbours, or motion reaches this far up",
    "unknown": "cannot be told",
}


def noise_table(levels: Sequence[NoiseLevel]) -> str:
    """Measured noise by sensor and family."""
    rows: list[list[str]] = []
    for n in levels:
        measured = ["-", "-"] if n.sigma is None else [f"{n.sigma:.3g}", f"± {n.half:.1g}"]
        verdict = f"{_WORDS[n.verdict]}{': ' + n.why if n.why else ''}"
        rows.append([n.sensor, n.family, *measured, f"{n.sheet:.3g}", _unit(n.family), verdict])
    text = _with_verdicts(["sensor", "family", "noise", "95 %", "sheet", "unit", "verdict"], rows, left=2)
    odd = [f"  {name}: {s:.3g}, others of its kind {np.median(list(n.columns.values())):.3g}"
           for n in levels for name, s in n.odd_ones.items()]  # fmt: skip
    return text + ("\nUnlike their kind:\n" + "\n".join(odd) if odd else "")


def latency_result(timings: Timings, trust: tuple[str, float]) -> dict[str, Any]:
    """Latencies as plain data; `trust`: the row farthest above its floor, and how far."""
    return {
        "time_base": timings.base,
        "settled": timings.settled,
        "worst_row": trust[0],
        "worst_ratio": trust[1],
        "trusted": timings.settled and trust[1] <= DISTRUST,
        "sensors": [
            {
                "sensor": s.sensor, "rig": s.rig, "found": s.found, "half95": s.half, "testable": s.testable,
                "agrees": s.agrees if s.testable else None, "why": s.why,
            }
            for s in timings.sensors
        ],
    }  # fmt: skip


def latency_table(timings: Timings) -> str:
    """Latencies by sensor [ms]."""
    base = next(s for s in timings.rig.sensors if s.name == timings.base)
    rows = [[base.name, f"{1e3 * base.latency:.1f}", "", "", "time base"]]
    for s in timings.sensors:
        if not s.testable:
            rows.append([s.sensor, f"{1e3 * s.rig:.1f}", "-", "-", f"not testable with these runs: {s.why}"])
            continue
        digits = max(1, 1 - int(np.floor(np.log10(1e3 * s.half)))) if s.half > 0 else 2
        says = "agrees" if s.agrees else f"differs from the rig by {1e3 * (s.found - s.rig):+.{digits}f} ms"
        rows.append(
            [s.sensor, f"{1e3 * s.rig:.1f}", f"{1e3 * s.found:.{digits}f}", f"± {1e3 * s.half:.{digits}f}", says]
        )
    return _with_verdicts(["sensor", "rig ms", "found ms", "95 %", "verdict"], rows)


def _with_verdicts(head: list[str], rows: list[list[str]], left: int = 1) -> str:
    """A table whose last column is text, to the left."""
    width = max(len(row[-1]) for row in (head, *rows))
    lines = table([*head[:-1], head[-1].ljust(width)], [[*row[:-1], row[-1].ljust(width)] for row in rows], left)
    return "\n".join(line.rstrip() for line in lines.splitlines())


@dataclass(frozen=True)
class Difference:
    """A value by plain least squares, by the fit with the sheet's correction, and with instruments.

    `plain_off` and `fit_off` : how far the first two are from the third, in σ of that difference; `plain_half` and
    `fit_half` half of the 95 % interval of the differences.
    """

    name: str
    unit: str
    plain: float
    fit: float
    instruments: float
    half: float
    plain_half: float
    fit_half: float

    @property
    def plain_z(self) -> float:
        """Plain least squares against the instruments, in σ."""
        return 1.96 * (self.plain - self.instruments) / self.plain_half if self.plain_half > 0.0 else 0.0

    @property
    def fit_z(self) -> float:
        """The corrected fit against the instruments, in σ."""
        return 1.96 * (self.fit - self.instruments) / self.fit_half if self.fit_half > 0.0 else 0.0


def differences(found: Instruments, vehicle: Vehicle) -> list[Difference]:
    """Every estimated parameter, then the whole vehicle's values that the runs determine."""
    iv, of = found.fit, found.of
    least = iv.theta + found.plain.difference

    def half(contrast: Contrast, i: int) -> float:
        return 1.96 * float(np.sqrt(max(0.0, contrast.covariance[i, i])))

    out: list[Difference] = []
    for i, q in enumerate(iv.model.parameters):
        own = 1.96 * float(np.sqrt(max(0.0, iv.covariance[i, i])))
        if own > 0.0:
            halves = half(found.plain, i), half(found.corrected, i)
            out.append(
                Difference(q.name, q.unit, float(least[i]), float(of.theta[i]), float(iv.theta[i]), own, *halves)
            )
    whole = [
        whole_vehicle(one, vehicle)
        for one in (
            replace(iv, theta=least), of, iv, replace(iv, covariance=found.plain.covariance),
            replace(iv, covariance=found.corrected.covariance),
        )
    ]  # fmt: skip
    if all(w is not None for w in whole):
        a, b, c, d, e = (w for w in whole if w is not None)
        for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
            if c.determined[k]:
                values = (a.values[k], b.values[k], c.values[k], c.interval[k], d.interval[k], e.interval[k])
                out.append(Difference(name, unit, *(float(v) for v in values)))
    return out


def bias_result(found: Instruments, vehicle: Vehicle) -> dict[str, Any]:
    """Both tests and every value, as plain data."""

    def test(contrast: Contrast) -> dict[str, Any]:
        return {"statistic": contrast.statistic, "directions": contrast.directions, "p": contrast.p}

    return plain(
        {
            "plain": test(found.plain),
            "corrected": test(found.corrected),
            "without_instruments": found.weak,
            "values": [
                {
                    "name": d.name, "unit": d.unit, "plain": d.plain, "fit": d.fit, "instruments": d.instruments,
                    "half95": d.half, "plain_z": d.plain_z, "fit_z": d.fit_z,
                }
                for d in differences(found, vehicle)
            ],
        }
    )  # fmt: skip


def bias_text(found: Instruments, vehicle: Vehicle, most: int = 12) -> str:
    """Both tests in words, and the values that noise moves."""
    values = differences(found, vehicle)
    lines: list[str] = []
    biased, wrong = found.plain.p < LEVEL, found.corrected.p < LEVEL
    if not biased:
        lines.append(f"Noise in the regressors does not bias plain least squares visibly (p = {found.plain.p:.2g}).")
    else:
        lines.append(f"Noise in the regressors biases plain least squares (p = {found.plain.p:.2g}).")
    if wrong:
        lines.append(
            f"The correction by the sheet's noise does not remove it (p = {found.corrected.p:.2g}): the noise in these "
            "runs is not the sheet's.\nPut the measured noise into the rig file, and look for noise that is not white."
        )
    elif biased:
        lines.append(
            f"The fit, corrected by the sheet's noise, agrees with the instruments (p = {found.corrected.p:.2g})."
        )
    moved = [d for d in values if abs(d.fit_z if wrong else d.plain_z) > CLEAR]
    moved.sort(key=lambda d: -abs(d.fit - d.instruments if wrong else d.plain - d.instruments) / d.half)
    if moved and (biased or wrong):
        rows = [
            [
                d.name, number(d.plain, d.half), number(d.fit, d.half), number(d.instruments, d.half),
                f"± {number(d.half, d.half)}", d.unit, _percent(d.plain, d), _percent(d.fit, d),
            ]
            for d in moved[:most]
        ]  # fmt: skip
        head = ["value", "plain", "corrected", "instruments", "95 %", "unit", "plain off", "corrected off"]
        lines.append(table(head, rows))
        if len(moved) > most:
            lines.append(f"  and {len(moved) - most} more, less in proportion to their intervals (--json has them all)")
    if found.weak:
        lines.append(f"Directions of the parameters that are mostly noise, of which nothing is said: {found.weak}.")
    return "\n".join(lines)


def _percent(value: float, d: Difference) -> str:
    if abs(d.instruments) <= d.half:
        return "-"
    return f"{100.0 * (value - d.instruments) / abs(d.instruments):+.2f} %"


def distrusted(trust: tuple[str, float]) -> str:
    """What to say of latencies when the model lacks something."""
    return (
        f"The model leaves {trust[1]:.1f} times the noise floor in {trust[0]}: something is missing in it, and "
        "latencies follow what is missing. Distrust them until lacet diagnose has found it."
    )
