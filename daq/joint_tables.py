"""Joints of a wheel's suspension as T(s_own, s_other, rack): bench tables of one corner, and how they are put together.

T(s, s', r) = own(s) + other(s') + rack(r) + product s s' + rack_product s r, each 0 at 0, s the wheel's own travel, s'
that of the other wheel of the axle [m, compression positive], r the rack [m, to the left positive]. The products are
the first mixed terms, which a bench gives that moves both wheels of an axle, and the rack at several travels. What it
measured beside T is the error of mixed terms left away.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.compliance import JOINTS, Compliance, compliance_lines, read_compliance
from lacet.daq.toml_reader import Reader

Array = NDArray[np.float64]

PLACE: dict[str, int] = {name: i for i, name in enumerate(JOINTS)}
"""Places of the joints in a table's columns."""
TOE = PLACE["toe"]
STEERED = np.radians(1.0)
"""Change of toe along the rack's curve above which the rack steers the wheel [rad]: a bench reads to 0.003°."""
PRODUCT: dict[str, str] = {name: "1/m" if unit == "m" else "rad/m²" for name, unit in JOINTS.items()}
"""SI unit of each joint's change per product of both travels, or of travel and rack."""
REACHED: dict[str, float] = {
    "half_track": 0.5, "half_wheelbase": 0.5, "toe": np.radians(60.0), "camber": np.radians(30.0),
    "pitch": np.radians(30.0),
}  # fmt: skip
"""Changes that no wheel reaches [m, rad]: degrees taken as radians, and mm as m, are beyond. Source: a choice."""
CURVES: dict[str, str] = {"own": "travel", "other": "travel", "rack": "rack"}
"""The three curves of a table, and what each is against."""


@dataclass(frozen=True)
class JointCurve:
    """The joints against one variable: `at` (n,) [m], strictly increasing, holding 0; `values` (n, 5), `JOINTS`."""

    at: Array
    values: Array

    @cached_property
    def _spline(self) -> Any:
        # Only here: SciPy is not needed to read a vehicle file.
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.at, self.values, bc_type="natural" if len(self.at) > 2 else "not-a-knot")

    @cached_property
    def _at_zero(self) -> Array:
        return np.asarray(self._spline(0.0), float)

    def value(self, x: Array, derivative: int = 0) -> Array:
        """(…, 5) the joints at `x` [m] less those at 0, or their first or second derivative by x.

        A natural cubic spline through the table; beyond its ends a straight line goes on.
        """
        x = np.asarray(x, float)
        inside = np.clip(x, self.at[0], self.at[-1])
        out = np.asarray(self._spline(inside, derivative), float)
        if derivative == 2:
            return out * (x == inside)[..., None]
        if derivative:
            return out
        out -= self._at_zero
        if np.any(beyond := x != inside):
            out[beyond] += np.asarray(self._spline(inside[beyond], 1), float) * (x - inside)[beyond][..., None]
        return out


@dataclass(frozen=True)
class JointTables:
    """Joint tables of one corner.

    `own`, `other`, `rack` : the curves, None where there is none; `mixed` : largest difference between what a bench
    measured with several variables moved and T, by joint [m, rad]; empty where none was measured; `product`,
    `rack_product` : (5,) of `JOINTS`, in the units of `PRODUCT`; `compliance` : what loads change, None where no bench
    loaded the wheels.
    """

    own: JointCurve
    other: JointCurve | None
    rack: JointCurve | None
    mixed: Mapping[str, float]
    compliance: Compliance | None = None
    product: Array = field(default_factory=lambda: np.zeros(len(JOINTS)))
    rack_product: Array = field(default_factory=lambda: np.zeros(len(JOINTS)))

    @property
    def follows_other(self) -> bool:
        """Whether the wheel moves or turns with the travel of the axle's other wheel."""
        moved = self.other is not None and bool(np.any(np.diff(self.other.values, axis=0)))
        return moved or bool(np.any(self.product))

    @property
    def steered(self) -> bool:
        """Whether the rack steers the wheel."""
        return self.rack is not None and bool(np.ptp(self.rack.values[:, TOE]) > STEERED)

    def at(self, own: Array, other: Array, rack: Array) -> Array:
        """(…, 5) changes of the joints from the design position, in the order of `JOINTS` [m, rad]."""
        own = np.asarray(own)
        out = (
            self.own.value(own) + self.product * (own * other)[..., None] + self.rack_product * (own * rack)[..., None]
        )
        for curve, x in ((self.other, other), (self.rack, rack)):
            if curve is not None:
                out = out + curve.value(x)
        return out


def read_joints(reader: Reader, rows: dict[str, Any], place: str) -> JointTables | None:
    """The ``joints`` of a corner of a vehicle file; faults go to the reader."""
    if not rows:
        return None
    reader.known(rows, (*CURVES, "mixed", "product", "rack_product", "compliance"), place)
    curves = {name: _curve(reader, reader.table(rows, name, place), f"{place}.{name}", name) for name in CURVES}
    own = curves["own"]
    if own is None:
        if "own" not in rows:
            reader.fault(place, "own is missing: the joints against the wheel's own travel")
        return None
    rack = curves["rack"]
    if rack is not None and np.ptp(rack.values[:, TOE]) > STEERED and np.ptp(np.sign(np.diff(rack.values[:, TOE]))):
        reader.fault(f"{place}.rack.toe", "must rise, or fall, all along: the steer of the wheel gives the rack")
        return None
    products = [_numbers(reader, rows, key, PRODUCT, place) for key in ("product", "rack_product")]
    return JointTables(
        own, curves["other"], curves["rack"],
        {name: abs(error) for name, error in _numbers(reader, rows, "mixed", JOINTS, place).items()},
        read_compliance(reader, reader.table(rows, "compliance", place), f"{place}.compliance"),
        *(np.array([product.get(name, 0.0) for name in JOINTS]) for product in products),
    )  # fmt: skip


def _numbers(reader: Reader, rows: dict[str, Any], key: str, units: Mapping[str, str], place: str) -> dict[str, float]:
    """The numbers of a table by joint, those that it has."""
    table = reader.table(rows, key, place)
    reader.known(table, units, f"{place}.{key}")
    found = {name: reader.quantity(table, name, f"{place}.{key}", unit) for name, unit in units.items()}
    return {name: one.value for name, one in found.items() if one is not None}


def _curve(reader: Reader, rows: dict[str, Any], place: str, name: str) -> JointCurve | None:
    if not rows:
        return None
    against = CURVES[name]
    reader.known(rows, (against, *JOINTS), place)
    at = reader.series(rows, against, place, "m")
    if at is None or len(at) < 2 or np.any(np.diff(at) <= 0) or not at[0] <= 0.0 <= at[-1]:
        reader.fault(f"{place}.{against}", "needs at least two values, strictly increasing, from below 0 to above it")
        return None
    columns = [bench_column(reader, rows, key, place, len(at), against) for key in JOINTS]
    return JointCurve(np.asarray(at, float), np.stack(columns, axis=1))


def bench_column(reader: Reader, rows: dict[str, Any], key: str, place: str, n: int, against: str) -> Array:
    """(n,) a joint of a bench table with n values of what it is `against`; 0 without one, or with a fault."""
    values, unit = reader.series(rows, key, place, JOINTS[key]), JOINTS[key]
    if values is not None and len(values) != n:
        reader.fault(f"{place}.{key}", f"has {len(values)} values for {n} of {against}")
        values = None
    found = np.asarray(values if values is not None else np.zeros(n), float)
    if beyond := beyond_reach(found, unit, REACHED[key]):
        reader.fault(f"{place}.{key}", beyond)
    return found


def beyond_reach(values: Array, unit: str, most: float) -> str:
    """What is wrong with values [m, rad] that exceed what a car reaches; empty where they do not."""
    largest = float(np.max(np.abs(values), initial=0.0))
    if largest <= most:
        return ""
    shown = f"{1e3 * largest:.0f} mm" if unit == "m" else f"{np.degrees(largest):.0f}°"
    return f"reaches {shown}, which no car does: another unit is meant"


def joints_text(tables: Mapping[str, JointTables], source: str) -> str:
    """Tables by corner as the part of a vehicle file that holds them: ``[corner.fl.joints.own]`` and so on."""
    quoted = source.replace("\\", "/").replace('"', "'")
    lines: list[str] = []

    def shown(values: Array, unit: str) -> tuple[list[float], str]:
        scaled = 1e3 * values if unit == "m" else np.degrees(values)
        return [round(float(v), 5) + 0.0 for v in scaled], "mm" if unit == "m" else "deg"

    for corner, table in tables.items():
        for name, against in CURVES.items():
            curve: JointCurve | None = getattr(table, name)
            if curve is None:
                continue
            lines += ["", f"[corner.{corner}.joints.{name}]"]
            zero = curve.value(np.zeros(1))[0]
            columns = {against: (curve.at, "m")}
            columns |= {key: (curve.values[:, i] - zero[i], unit) for i, (key, unit) in enumerate(JOINTS.items())}
            for key, (values, unit) in columns.items():
                numbers, written = shown(values, unit)
                lines.append(f'{key} = {{ value = {numbers}, unit = "{written}", source = "{quoted}" }}')
        for name, product in (("product", table.product), ("rack_product", table.rack_product)):
            if not np.any(product):
                continue
            lines += ["", f"[corner.{corner}.joints.{name}]"]
            for (key, unit), factor in zip(PRODUCT.items(), product.tolist(), strict=True):
                lines.append(f'{key} = {{ value = {round(factor, 6) + 0.0}, unit = "{unit}", source = "{quoted}" }}')
        if table.mixed:
            lines += ["", f"[corner.{corner}.joints.mixed]"]
            for key, error in table.mixed.items():
                (number,), written = shown(np.array([error]), JOINTS[key])
                lines.append(f'{key} = {{ value = {number}, unit = "{written}", source = "{quoted}" }}')
        if table.compliance is not None:
            lines += compliance_lines(table.compliance, f"corner.{corner}.joints", quoted)
    return "\n".join(lines) + "\n"
