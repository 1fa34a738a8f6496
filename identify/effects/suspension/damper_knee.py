"""Dampers whose slope changes at a travel rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lacet.identify.effects.base import Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class DamperKnee(SuspensionForce):
    """A slope that changes beyond a knee, in bump and in rebound: F = d_b max(0, ṡ − v0) − d_r max(0, −ṡ − v0).

    On top of the linear damper of slope c: c + d_b above v0 in bump, c + d_r below −v0 in rebound, as of a valve that
    opens at a pressure. A damper that only saturates (`damper_saturation`) has the same two slopes with a rounded knee;
    unequal changes at a small v0 are nearly a |ṡ| (`damper_asymmetry`).
    """

    name = "damper_knee"
    about = "damping that changes beyond a travel rate, in bump and rebound apart (a valve opens)"
    signature = "suspension row has a corner at a travel rate in bump, in rebound, or both"
    shown_by = "rough road with large and small travel rates"
    source = "Dixon (2007), The Shock Absorber Handbook, chapters 6 and 7; Reimpell et al. (2001), chapter 5"
    looks_like = ("damper_saturation", "damper_asymmetry")
    grids: ClassVar = {"v0": (0.03, 0.06, 0.12, 0.25)}
    bounds: ClassVar = {"v0": (0.01, 0.5)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Change of slope beyond the knee in bump and in rebound, negative for a digressive damper."""
        return (
            self.named("bump", "N·s/m", -1e4, 1e4, "negative"),
            self.named("rebound", "N·s/m", -1e4, 1e4, "negative"),
        )

    def law(self, travel: Array, rate: Array) -> Array:
        """(2, N) max(0, ṡ − v0), −max(0, −ṡ − v0)."""
        v0 = self.shape.get("v0", 0.06)
        return np.stack([np.maximum(0.0, rate - v0), -np.maximum(0.0, -rate - v0)])
