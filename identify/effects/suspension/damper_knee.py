"""Dampers whose slope changes at a travel rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class DamperKnee(SuspensionForce):
    """A slope that changes beyond a knee, the same in bump and rebound: F = d sign(ṡ) max(0, |ṡ| − v0).

    On top of the linear damper of slope c: c + d beyond v0, as of a valve that opens at a pressure. A damper that
    saturates (`damper_saturation`) has the same two slopes with a rounded knee. Where d is otherwise in bump than in
    rebound, `damper_asymmetry` takes half the difference of the mean slopes.
    """

    name = "damper_knee"
    about = "damping that changes beyond a travel rate (a valve opens)"
    signature = "suspension row has a corner at a travel rate, the same way in bump and rebound"
    shown_by = "rough road with large and small travel rates"
    source = "Dixon (2007), The Shock Absorber Handbook, chapters 6 and 7; Reimpell et al. (2001), chapter 5"
    bend = Bend.RATE
    looks_like = ("damper_saturation",)
    # Valves open from some 50 mm/s on; a knee below cannot be told from friction at 7 mm/s of noise of the travel rate.
    grids: ClassVar = {"v0": (0.05, 0.07, 0.1, 0.15, 0.25)}
    bounds: ClassVar = {"v0": (0.03, 0.5)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Change of slope beyond the knee d, negative for a digressive damper."""
        return (self.named("d", "N·s/m", -1e4, 1e4, "negative"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """sign(ṡ) max(0, |ṡ| − v0)."""
        return np.sign(rate) * np.maximum(0.0, np.abs(rate) - self.shape.get("v0", 0.1))
