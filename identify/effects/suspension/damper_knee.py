"""Dampers whose slope changes at a travel rate: both ways alike, or in bump or rebound alone."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class DamperKnee(SuspensionForce):
    """A slope that changes beyond a knee, the same in bump and rebound: F = d sign(ṡ) max(0, |ṡ| − v0).

    On top of the linear damper of slope c: c + d beyond v0, as of a valve that opens at a pressure. A damper that
    saturates (`damper_saturation`) has the same two slopes with a rounded knee. A damper with knees and slopes of its
    own in bump and in rebound is `damper_asymmetry`, `damper_knee_bump` and `damper_knee_rebound` together.
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
    grid_units: ClassVar = {"v0": "m/s"}
    bounds: ClassVar = {"v0": (0.03, 0.5)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Change of slope beyond the knee d, negative for a digressive damper."""
        return (self.named("d", "N·s/m", -1e4, 1e4, "negative"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """sign(ṡ) max(0, |ṡ| − v0)."""
        return np.sign(rate) * np.maximum(0.0, np.abs(rate) - self.shape.get("v0", 0.1))


class _KneeOneWay(SuspensionForce):
    """A slope that changes beyond a knee one way."""

    shown_by = "rough road with large and small travel rates"
    source = "Dixon (2007), The Shock Absorber Handbook, chapters 6 and 7; Reimpell et al. (2001), chapter 5"
    bend = Bend.RATE
    # Steps of a factor of two: the knee is searched between them.
    grids: ClassVar = {"v0": (0.05, 0.1, 0.2)}
    grid_units: ClassVar = {"v0": "m/s"}
    bounds: ClassVar = {"v0": (0.03, 0.5)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Change of slope beyond the knee d, negative where a valve opens."""
        return (self.named("d", "N·s/m", -1e4, 1e4, "negative"),)


class DamperKneeBump(_KneeOneWay):
    """A slope that changes beyond a knee in bump: F = d max(0, ṡ − v0).

    With the linear damper, `damper_asymmetry` and `damper_knee_rebound` it is a damper of four slopes: c + a in bump up
    to its knee and c + a + d beyond, c − a in rebound up to another and c − a + d of its own beyond. With a knee near
    zero it is half of `damper_asymmetry`.
    """

    name = "damper_knee_bump"
    about = "damping that changes beyond a travel rate in bump alone"
    signature = "suspension row has a corner at a travel rate in compression"

    def law(self, travel: Array, rate: Array) -> Array:
        """max(0, ṡ − v0)."""
        return np.maximum(0.0, rate - self.shape.get("v0", 0.1))


class DamperKneeRebound(_KneeOneWay):
    """A slope that changes beyond a knee in rebound: F = −d max(0, −ṡ − v0); see `damper_knee_bump`."""

    name = "damper_knee_rebound"
    about = "damping that changes beyond a travel rate in rebound alone"
    signature = "suspension row has a corner at a travel rate in extension"

    def law(self, travel: Array, rate: Array) -> Array:
        """−max(0, −ṡ − v0)."""
        return -np.maximum(0.0, -rate - self.shape.get("v0", 0.1))
