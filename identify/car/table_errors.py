"""Errors of bench tables: what is assumed of each corner's table beyond it, and the change of the joints by that.

An error of a slope is a constant e: the joint is T(s) + e s, s the wheel's own travel. It enters all rows as the table
itself does, so that its derivative is a column of the sensor sheet: −F·∂p − M·∂φ of the suspension row, the shift of
the load's place in the chassis rows, the wheel's height above the road in the tyre row.
"""

from __future__ import annotations

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.compliance import JOINTS
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Signals

SLOPES = tuple(f"table_{joint}" for joint in JOINTS)
"""Keys of the errors of a table's slopes (`daq.assumptions.ASSUMABLE`), in the order of its joints."""
COMPLIANCE = "table_compliance"


def table_assumptions(vehicle: Vehicle) -> tuple[Assumption, ...]:
    """What is assumed beyond the bench tables of each corner: where it has a table, or the vehicle file gives it."""
    out: list[Assumption] = []
    for c, corner in vehicle.corners.items():
        measured = corner.table is not None or corner.joints is not None
        keys = dict.fromkeys(SLOPES, measured)
        keys[COMPLIANCE] = corner.joints is not None and corner.joints.compliance is not None
        found = {key: vehicle.assumption(key, c) for key in keys}
        out += [one for key, one in found.items() if (keys[key] or one.given) and (one.tolerance or one.value)]
    return tuple(out)


def slope_errors(corner: Corner, signals: Signals) -> Array | None:
    """(5, N) errors of the slopes by the wheel's own travel, in the signs of the tables; None without any."""
    found = [signals.assumed.get(f"{key}.{corner.name}") for key in SLOPES]
    known = next((one for one in found if one is not None), None)
    if known is None:
        return None
    return np.concatenate([np.zeros_like(known) if one is None else one for one in found])


def compliance_factor(corner: Corner, signals: Signals) -> Array | float:
    """(N,) the compliance ÷ that of the corner's table."""
    found = signals.assumed.get(f"{COMPLIANCE}.{corner.name}")
    return 1.0 if found is None else found[0]
