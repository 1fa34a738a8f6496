"""Check of the sensors against the rig file, as plain data: noise, latencies, a position, and bias from noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lacet.daq.formats.result import plain
from lacet.daq.vehicle import Vehicle
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.properties.whole_vehicle import NAMES, UNITS, whole_vehicle
from lacet.identify.regression.instrumental_variables import Contrast, Instruments
from lacet.identify.regression.latency import Timings
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.noise_level import NoiseLevel
from lacet.identify.validation.channels.speed_agreement import SpeedAgreement
from lacet.identify.validation.channels.unit_position import AxisPosition
from lacet.services.render.sensor_report import not_testable, unit_of, unmeasured

DISTRUST = 1.5
"""Residual ÷ noise floor of a row from which latencies are not trusted: the model lacks something that biases them."""


def noise_result(levels: Sequence[NoiseLevel]) -> list[dict[str, Any]]:
    """Measured noise as plain data."""
    return [
        {
            "sensor": n.sensor, "family": n.family, "unit": unit_of(n.family), "sigma": n.sigma, "half95": n.half,
            "sheet": n.sheet, "flatness": n.flatness, "verdict": n.verdict.value, "why": unmeasured(n),
            "columns": n.columns, "odd_columns": n.odd_ones,
        }
        for n in levels
    ]  # fmt: skip


def latency_result(timings: Timings, trust: tuple[str, float]) -> dict[str, Any]:
    """Latencies as plain data; `trust` : the row farthest above its floor, and its ratio."""
    return {
        "time_base": timings.base,
        "settled": timings.settled,
        "worst_row": trust[0],
        "worst_ratio": trust[1],
        "trusted": timings.settled and trust[1] <= DISTRUST,
        "sensors": [
            {
                "sensor": s.sensor, "rig": s.rig, "found": s.found, "half95": s.half, "testable": s.testable,
                "agrees": s.agrees if s.testable else None, "why": not_testable(s),
            }
            for s in timings.sensors
        ],
    }  # fmt: skip


def position_result(found: Sequence[AxisPosition]) -> list[dict[str, Any]]:
    """Position of the inertial unit by axis as plain data."""
    return [
        {
            "axis": one.axis, "rig": one.rig, "found": one.found, "half95": one.half, "tolerance": one.tolerance,
            "testable": one.testable, "agrees": one.agrees if one.testable else None,
        }
        for one in found
    ]  # fmt: skip


def agreement_result(found: SpeedAgreement | None) -> list[dict[str, Any]] | None:
    """Faults of inertial unit and speed sensor that these show by themselves, as plain data; None if not compared."""
    if found is None:
        return None
    faults = found.beyond_sheet(SELECTION.significance)
    sizes, bounds = found.sizes([fault.key for fault in faults]), dict(zip(found.keys, found.bounds, strict=True))
    return [
        {
            "effect": fault.key, "value": sizes[fault.key].value, "half95": TWO_SIDED_95 * sizes[fault.key].sigma,
            "unit": fault.parameters[0].unit, "tolerance": float(bounds[fault.key]),
        }
        for fault in faults
    ]  # fmt: skip


@dataclass(frozen=True)
class Difference:
    """One value by plain least squares, by the bias-corrected fit, and by instrumental variables.

    `plain_half` and `fit_half` : half of the 95 % intervals of the first two's differences from the third.
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
        """Plain least squares minus instrumental variables, in σ of the difference."""
        return TWO_SIDED_95 * (self.plain - self.instruments) / self.plain_half if self.plain_half > 0.0 else 0.0

    @property
    def fit_z(self) -> float:
        """The corrected fit minus instrumental variables, in σ of the difference."""
        return TWO_SIDED_95 * (self.fit - self.instruments) / self.fit_half if self.fit_half > 0.0 else 0.0


def differences(found: Instruments, vehicle: Vehicle) -> list[Difference]:
    """The difference of every estimated parameter, then of the whole vehicle's values that the runs determine."""
    iv, of = found.fit, found.of
    least = iv.theta + found.plain.difference

    def half(contrast: Contrast, i: int) -> float:
        return TWO_SIDED_95 * float(np.sqrt(max(0.0, contrast.covariance[i, i])))

    out: list[Difference] = []
    for i, q in enumerate(iv.model.parameters):
        own = TWO_SIDED_95 * float(np.sqrt(max(0.0, iv.covariance[i, i])))
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
    """Both tests of bias and every value as plain data."""

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
