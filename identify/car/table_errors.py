"""Errors of bench tables: what is assumed of each corner's table beyond it, and the change of the joints by that.

An error of a slope is a constant e: the joint is T + e x, x the wheel's own travel, that of the axle's other wheel, or
the rack's. It has a part of the wheel's own and one that both wheels of the axle have in common. It enters all rows as
the table itself does, so that its derivative is a column of the sensor sheet: −F·∂p − M·∂φ of the suspension rows, the
shift of the load's place in the chassis rows, the wheel's height above the road in the tyre row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import AXLE_OF, Assumption
from lacet.daq.compliance import JOINTS
from lacet.daq.table_tolerances import AXLE, COMPLIANCE, CURVES, table_key
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Signals


@dataclass(frozen=True)
class SlopeErrors:
    """Errors of a corner's slopes (5, N), joints in the order and signs of its tables [m/m, rad/m].

    `own`, `other` : by the wheel's own travel and by that of the axle's other wheel; `rack` : by the rack's.
    """

    own: Array
    other: Array
    rack: Array


def table_assumptions(vehicle: Vehicle) -> tuple[Assumption, ...]:
    """What is assumed beyond the bench tables of each corner: where it has a table, or the vehicle file gives it.

    What both wheels of an axle have in common is there once.
    """
    out: dict[str, Assumption] = {}
    for c, corner in vehicle.corners.items():
        for key, measured in _measured(corner).items():
            for one in (vehicle.assumption(key, c), vehicle.assumption(f"{key}{AXLE}", c)):
                if (measured or one.given) and (one.tolerance or one.value):
                    out[one.name] = one
    return tuple(out.values())


def _measured(corner: Corner) -> dict[str, bool]:
    """Key of each error → whether the corner has the curve that may be off."""
    joints = corner.joints
    of_curve = {
        "": corner.table is not None or joints is not None,
        "_other": joints is not None and joints.follows_other,
        "_rack": joints is not None and joints.steered,
    }
    out = {table_key(joint, curve): of_curve[curve] for curve in CURVES for joint in JOINTS}
    return out | {COMPLIANCE: joints is not None and joints.compliance is not None}


def _parts(key: str, corner: Corner, assumed: Mapping[str, Array]) -> list[Array]:
    """(1, N) the error of this corner and that of its axle, those that are assumed."""
    names = f"{key}.{corner.name}", f"{key}{AXLE}.{AXLE_OF[corner.name]}"
    return [assumed[name] for name in names if name in assumed]


def corners_of(name: str) -> tuple[str, ...]:
    """Names of the errors of single corners whose sum an error of an axle is; none of one of a corner."""
    key, _, place = name.rpartition(".")
    return tuple(f"{key.removesuffix(AXLE)}.{c}" for c, axle in AXLE_OF.items() if axle == place)


def slope_errors(corner: Corner, signals: Signals) -> SlopeErrors | None:
    """Errors of the slopes of a corner's tables; None without any."""
    found = {curve: [_parts(table_key(joint, curve), corner, signals.assumed) for joint in JOINTS] for curve in CURVES}
    known = next((part for each in found.values() for parts in each for part in parts), None)
    if known is None:
        return None
    zero = np.zeros_like(known)
    return SlopeErrors(*(np.concatenate([sum(parts, zero) for parts in each]) for each in found.values()))


def compliance_factor(corner: Corner, signals: Signals) -> Array | float:
    """(N,) the compliance ÷ that of the corner's table."""
    parts = _parts(COMPLIANCE, corner, signals.assumed)
    if f"{COMPLIANCE}.{corner.name}" not in signals.assumed:
        parts.append(np.ones((1, 1)))
    return np.sum(parts, axis=0)[0]
