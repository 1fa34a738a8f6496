"""True values of the second car by lacet's names: what its mechanism amounts to at the design position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.services.reproduction.published_tables import SPIN_ROWS

AXLES = {"front": (0, 1), "rear": (2, 3)}
"""Places of the wheels of each axle in the mechanism's matrices."""


def second_car_values(truth: Mapping[str, Any]) -> dict[str, float]:
    """Values by lacet's names, SI and body axes, from a run of a second car's truth file.

    A spring and a damper are the rates in heave, both wheels of the axle together, as the bar and the damping across
    the axle have what is between the wheels. An offset is the static load less the weight of the reflected mass.
    """
    car, design = truth["car"], truth["design"]
    total = car["total"]
    values = {"mass": total["mass"], **dict(zip(("cog.x", "cog.y", "cog.z"), total["com"], strict=True))}
    values |= {f"I{a}{b}": total["tensor"][i][j] for i, a in enumerate("xyz") for j, b in enumerate("xyz")}
    rate, mass, damping = np.array(design["wheel_rate"]), np.array(design["unsprung_mass"]), _damping(truth)
    for axle, (left, right) in AXLES.items():
        values[f"anti_roll_bar.{axle}.k"] = -float(rate[left, right] + rate[right, left]) / 2.0
        for i, j in ((left, right), (right, left)):
            corner, own = CORNERS[i], car[axle]
            spin = next(name for name, row in SPIN_ROWS.items() if row == f"spin.{corner}")
            values |= {
                f"spring.{corner}.k": float(rate[i, i] + rate[i, j]),
                f"damper.{corner}.c": float(damping[i, i] + damping[i, j]),
                f"offset.{corner}.f0": car["static_loads"][corner] - car["gravity"] * float(mass[i, i] + mass[i, j]),
                f"tyre_stiffness.{corner}.kt": own["tyre_stiffness"],
                spin: own["inboard_spin"] + own["outboard_spin"],
            }
    return values


def _damping(truth: Mapping[str, Any]) -> np.ndarray:
    """(4, 4) ∂Q/∂ṡ of the dampers [N·s/m] at the design position, their mounts not giving."""
    out = np.zeros((4, 4))
    for damper in truth["car"]["linkage"]["dampers"]:
        ratio = np.array(truth["design"]["motion_ratio"][damper["name"]])
        out += damper["damping"] * np.outer(ratio, ratio)
    return out
