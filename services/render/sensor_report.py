"""Check of the sensors against the rig file in tables and sentences: noise, latencies, bias from noise."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from lacet.daq.channels import CHANNELS
from lacet.identify.regression.latency import SensorTiming, Timings
from lacet.identify.signals.noise_level import NoiseLevel
from lacet.identify.validation.channels.unit_position import AxisPosition
from lacet.services.render.intervals import half_width, to_interval
from lacet.services.render.tables import table

LEVEL = 0.01
"""Significance level of the two tests of bias: one set of runs in a hundred is rejected by chance."""

CLEAR = 3.0
"""Size of the differences shown, in their own σ."""

_WORDS = {
    "as the sheet": "as the sheet",
    "larger": "larger than the sheet",
    "smaller": "smaller than the sheet",
    "not white": "not white: samples depend on their neighbours, or motion reaches this far up",
    "unknown": "cannot be judged",
}


def unit_of(family: str) -> str:
    """SI unit of a family of channels."""
    return next(channel.unit for channel in CHANNELS.values() if channel.family == family)


def noise_table(levels: Sequence[Mapping[str, Any]]) -> str:
    """Measured noise by sensor and family, from the check's result."""
    rows: list[list[str]] = []
    for n in levels:
        sigma, half = n["sigma"], n["half95"]
        measured = ["-", "-"] if sigma is None else [to_interval(sigma, half), f"± {half_width(half)}"]
        verdict = f"{_WORDS[n['verdict']]}{': ' + n['why'] if n['why'] else ''}"
        rows.append([n["sensor"], n["family"], *measured, f"{n['sheet']:.3g}", n["unit"], verdict])
    text = _with_verdicts(["sensor", "family", "noise", "95 %", "sheet", "unit", "verdict"], rows, text_columns=2)
    odd = [f"  {name}: {s:.3g}, others of its kind {statistics.median(n['columns'].values()):.3g}"
           for n in levels for name, s in n["odd_columns"].items()]  # fmt: skip
    return text + ("\nUnlike their kind:\n" + "\n".join(odd) if odd else "")


def sheet_noise(levels: Sequence[NoiseLevel]) -> list[str]:
    """What measured noise says against the sensor sheet, one sentence a family of channels."""
    lines: list[str] = []
    for level in (level for level in levels if level.corrects):
        says = "too large" if level.used < level.sheet else "too small"
        lines.append(
            f"noise of {level.family} ({level.sensor}): your sheet is {says} here. It states {level.sheet:.3g}, "
            f"measured {level.sigma:.3g} {unit_of(level.family)} in the quietest run. Floor and weights "
            "use what was measured, tolerances stay. Only white noise is measured: coloured noise in the fit's band is "
            "not seen"
        )
    return lines


def not_testable(timing: SensorTiming) -> str:
    """Why the runs do not determine a sensor's latency; an empty string where they do."""
    if timing.testable:
        return ""
    return "no row of the model depends on it" if math.isinf(timing.half) else f"± {half_width(1e3 * timing.half)} ms"


def unmeasured(level: NoiseLevel) -> str:
    """Why a sensor's noise cannot be measured; an empty string where it is."""
    if level.sigma is not None:
        return ""
    if level.slow is None:
        return "too few usable samples"
    return f"sampled at {level.slow:.0f} Hz, too slowly to tell noise from motion"


def latency_table(timings: Timings) -> str:
    """Latencies by sensor [ms]."""
    base = next(s for s in timings.rig.sensors if s.name == timings.base)
    rows = [[base.name, f"{1e3 * base.latency:.1f}", "", "", "time base"]]
    for s in timings.sensors:
        if not s.testable:
            rows.append([s.sensor, f"{1e3 * s.rig:.1f}", "-", "-", f"not testable with these runs: {not_testable(s)}"])
            continue
        found, half = 1e3 * s.found, 1e3 * s.half
        off = to_interval(found - 1e3 * s.rig, half, "+")
        says = "agrees" if s.agrees else f"differs from the rig by {off} ms"
        rows.append([s.sensor, f"{1e3 * s.rig:.1f}", to_interval(found, half), f"± {half_width(half)}", says])
    return _with_verdicts(["sensor", "rig ms", "found ms", "95 %", "verdict"], rows)


def position_table(found: Sequence[AxisPosition]) -> str:
    """Position of the inertial unit by body axis [mm]."""
    rows: list[list[str]] = []
    for one in found:
        if not one.testable:
            why = f"not testable with these runs: ± {half_width(1e3 * one.half)} mm"
            rows.append([one.axis, f"{1e3 * one.rig:.0f}", "-", "-", why])
            continue
        off = f"{1e3 * (one.found - one.rig):+.0f} mm"
        says = "agrees" if one.agrees else f"differs from the rig by {off}: inertias and heights are off with it"
        at, half = 1e3 * one.found, 1e3 * one.half
        rows.append([one.axis, f"{1e3 * one.rig:.0f}", to_interval(at, half), f"± {half_width(half)}", says])
    return _with_verdicts(["axis", "rig mm", "found mm", "95 %", "verdict"], rows)


_EITHER = (
    "A place of the unit is one beside the speed sensor: where the car's equations find the unit where the rig says, "
    "the speed sensor is elsewhere, as far the other way."
)


def agreement_text(found: Sequence[Mapping[str, Any]] | None) -> str:
    """Faults that inertial unit and speed sensor show by themselves, from the check's result."""
    if found is None:
        return (
            "not compared: no run has imu.accel, imu.rate, imu.attitude and correvit.speed as measured, or they do not "
            "measure the same motion"
        )
    if not found:
        return "agree within the sheet"
    rows = [
        [
            one["effect"], f"{to_interval(one['value'], one['half95'], '+')} {one['unit']}".rstrip(" -"),
            f"± {half_width(one['half95'])}", f"beyond the sheet's ± {one['tolerance']:g}",
        ]
        for one in found
    ]  # fmt: skip
    said = _with_verdicts(["fault", "found", "95 %", "verdict"], rows)
    return f"{said}\n{_EITHER}" if any(one["effect"].startswith("sensor_position.imu") for one in found) else said


def _with_verdicts(head: list[str], rows: list[list[str]], text_columns: int = 1) -> str:
    """A table whose last column is text, left-aligned."""
    width = max(len(row[-1]) for row in (head, *rows))
    lines = table(
        [*head[:-1], head[-1].ljust(width)], [[*row[:-1], row[-1].ljust(width)] for row in rows], text_columns
    )
    return "\n".join(line.rstrip() for line in lines.splitlines())


def bias_text(found: Mapping[str, Any], most: int = 12) -> str:
    """Both tests in words, and the values that noise biases, from the check's result."""
    values = found["values"]
    lines: list[str] = []
    p_plain, p_corrected = found["plain"]["p"], found["corrected"]["p"]
    biased, wrong = p_plain < LEVEL, p_corrected < LEVEL
    if not biased:
        lines.append(f"Noise in the regressors does not bias plain least squares visibly (p = {p_plain:.2g}).")
    else:
        lines.append(f"Noise in the regressors biases plain least squares (p = {p_plain:.2g}).")
    if wrong:
        lines.append(
            f"The correction by the sheet's noise does not remove it (p = {p_corrected:.2g}): the noise in these "
            "runs is not the sheet's.\nPut the measured noise into the rig file, and look for noise that is not white."
        )
    elif biased:
        lines.append(f"The fit, corrected by the sheet's noise, agrees with the instruments (p = {p_corrected:.2g}).")
    moved = [d for d in values if abs(d["fit_z"] if wrong else d["plain_z"]) > CLEAR]
    moved.sort(key=lambda d: -abs((d["fit"] if wrong else d["plain"]) - d["instruments"]) / d["half95"])
    if moved and (biased or wrong):
        rows = [
            [
                d["name"], *(to_interval(d[key], d["half95"]) for key in ("plain", "fit", "instruments")),
                f"± {half_width(d['half95'])}", d["unit"], _percent(d["plain"], d), _percent(d["fit"], d),
            ]
            for d in moved[:most]
        ]  # fmt: skip
        head = ["value", "plain", "corrected", "instruments", "95 %", "unit", "plain off", "corrected off"]
        lines.append(table(head, rows))
        if len(moved) > most:
            lines.append(f"  and {len(moved) - most} more, less in proportion to their intervals (--json has them all)")
    if weak := found["without_instruments"]:
        lines.append(f"Directions of the parameters that are mostly noise, of which nothing is said: {weak}.")
    return "\n".join(lines)


def _percent(value: float, d: Mapping[str, Any]) -> str:
    true = d["instruments"]
    return "-" if abs(true) <= d["half95"] else f"{100.0 * (value - true) / abs(true):+.2f} %"


def distrusted(trust: tuple[str, float]) -> str:
    """Warning about latencies where the model lacks something."""
    return (
        f"The model leaves {trust[1]:.1f} times the noise floor in {trust[0]}: something is missing in it, and "
        "latencies follow what is missing. Distrust them until lacet diagnose has found it."
    )
