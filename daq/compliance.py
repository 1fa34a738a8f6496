"""Compliance of a wheel's suspension: shift, toe, camber and pitch of the wheel by loads on it and on the other wheel.

Slopes at the design position, in proportion to the loads. A load has the signs of the wheel that it is on: forwards,
outwards, towards toe-in; so that both sides have the same numbers. Travel is held: it is the wheel centre's height.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.toml_reader import Reader

Array = NDArray[np.float64]

JOINTS: dict[str, str] = {"half_track": "m", "half_wheelbase": "m", "toe": "rad", "camber": "rad", "pitch": "rad"}
"""Joints of a wheel with their SI units; signs as in the vehicle file's ``kinematics`` (docs/vehicle.md)."""
LOADS: dict[str, str] = {"longitudinal": "N", "traction": "N", "lateral": "N", "aligning": "N·m"}
"""Loads with their SI units. ``longitudinal`` acts on the contact point of a wheel that its brake holds, ``traction``
at the centre of a wheel that is free to turn; both forwards. ``lateral``: on the contact point, outwards. ``aligning``:
about z, towards toe-in."""
PLACES = ("own", "other")
"""Wheels that are loaded: this one, and the axle's other one."""


@dataclass(frozen=True)
class Compliance:
    """Compliance of one corner: `own`, `other` hold load → (5,) change of `JOINTS` per unit of load [SI].

    Loads that no bench put on the wheel are absent.
    """

    own: Mapping[str, Array]
    other: Mapping[str, Array]

    def change(self, own: Mapping[str, Array], other: Mapping[str, Array]) -> Array:
        """(5, N) changes of the joints under loads, by name (N,), on the wheel and on the axle's other one."""
        parts = [
            slopes[load][:, None] * series
            for slopes, loads in ((self.own, own), (self.other, other))
            for load, series in loads.items()
            if load in slopes
        ]
        return np.sum(parts, axis=0) if parts else np.zeros((len(JOINTS), 1))


def unit_of(joint: str, load: str) -> str:
    """SI unit of a joint's change per load."""
    if LOADS[load] == "N":
        return f"{JOINTS[joint]}/N"
    return "1/N" if JOINTS[joint] == "m" else "rad/(N·m)"


def read_compliance(reader: Reader, rows: dict[str, Any], place: str) -> Compliance | None:
    """``compliance`` in the joints of a corner of a vehicle file; faults go to the reader."""
    if not rows:
        return None
    reader.known(rows, PLACES, place)
    found: list[dict[str, Array]] = []
    for wheel in PLACES:
        loads = reader.table(rows, wheel, place)
        reader.known(loads, LOADS, f"{place}.{wheel}")
        slopes: dict[str, Array] = {}
        for load in [name for name in LOADS if name in loads]:
            where = f"{place}.{wheel}.{load}"
            values = reader.table(loads, load, f"{place}.{wheel}")
            reader.known(values, JOINTS, where)
            each = (reader.quantity(values, joint, where, unit_of(joint, load)) for joint in JOINTS)
            slopes[load] = np.array([0.0 if one is None else one.value for one in each])
        found.append(slopes)
    return Compliance(*found)


def compliance_lines(compliance: Compliance, place: str, source: str) -> list[str]:
    """Lines of a vehicle file that hold the compliance of a corner, at ``corner.fl.joints`` [mm, deg per kN, kN·m]."""
    lines: list[str] = []
    for wheel in PLACES:
        for load, slopes in getattr(compliance, wheel).items():
            lines += ["", f"[{place}.compliance.{wheel}.{load}]"]
            per = "kN" if LOADS[load] == "N" else "(kN·m)"
            for joint, slope in zip(JOINTS, slopes, strict=True):
                number, unit = (1e6 * slope, "mm") if JOINTS[joint] == "m" else (1e3 * np.degrees(slope), "deg")
                shown = round(float(number), 5) + 0.0
                lines.append(f'{joint} = {{ value = {shown}, unit = "{unit}/{per}", source = "{source}" }}')
    return lines
