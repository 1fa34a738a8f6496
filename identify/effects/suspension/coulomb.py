"""Dry friction in the suspension."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class Coulomb(SuspensionForce):
    """Coulomb friction with a stick band: F = f tanh(ṡ/v0).

    Friction that turns round over a short stroke instead (`damper_hysteresis`) is the same where strokes are long.
    """

    name = "coulomb"
    about = "dry friction in the dampers and joints"
    signature = "suspension row changes sign with the travel rate, whatever its size"
    shown_by = "smooth driving with small travel rates, slow sinus steering"
    source = "paper, table 6 (fs); Armstrong-Hélouvry et al. (1994), Automatica 30, 1083"
    bend = Bend.RATE
    looks_like = ("damper_hysteresis",)
    # Narrower bands than 2 mm/s look the same: the travel rate is known to some millimetres a second.
    grids: ClassVar = {"v0": (0.002, 0.005, 0.01, 0.02, 0.04)}
    grid_units: ClassVar = {"v0": "m/s"}
    # What saturates beyond 50 mm/s is a damper (`damper_saturation`).
    bounds: ClassVar = {"v0": (0.002, 0.05)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Friction force f [N]."""
        return (self.named("f", "N", 0.0, 500.0, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """tanh(ṡ/v0)."""
        return np.tanh(rate / self.shape.get("v0", 0.01))
