"""Dampers whose force does not grow in proportion to the rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class DamperDigressive(SuspensionForce):
    """A quadratic part: F = c2 ṡ|ṡ|, negative for a digressive damper, positive for a progressive one (an orifice)."""

    name = "damper_digressive"
    about = "damping that falls (or grows) with the travel rate"
    signature = "suspension row bends with the travel rate, the same way in bump and rebound"
    shown_by = "rough road with large and small travel rates"
    source = "Dixon (2007), The Shock Absorber Handbook, chapters 6 and 7"
    bend = Bend.RATE

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Quadratic damping c2."""
        return (self.named("c2", "N·s²/m²", -1e4, 1e4, "negative"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """ṡ|ṡ|."""
        return rate * np.abs(rate)


class DamperSaturation(SuspensionForce):
    """A valve that blows off: F = c ṡ / √(1 + (ṡ/v0)²), of slope c at rest and no more than c v0.

    With the linear damper it has two slopes and a rounded knee between them, as `damper_knee` has a sharp one.
    """

    name = "damper_saturation"
    about = "damping that saturates above a travel rate (blow-off valve)"
    signature = "suspension row is steep at small travel rates and flat at large ones"
    shown_by = "rough road with large and small travel rates"
    source = "Dixon (2007), The Shock Absorber Handbook, chapters 6 and 7; Heißing and Ersoy (2011), Chassis Handbook"
    bend = Bend.RATE
    looks_like = ("damper_knee",)
    # Valves open from some 50 mm/s on; what saturates below is friction (`coulomb`).
    grids: ClassVar = {"v0": (0.05, 0.1, 0.2, 0.4)}
    grid_units: ClassVar = {"v0": "m/s"}
    bounds: ClassVar = {"v0": (0.05, 0.8)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Damping at rest c, on top of the linear one."""
        return (self.named("c", "N·s/m", 0.0, 2e4, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """ṡ / √(1 + (ṡ/v0)²)."""
        return rate / np.sqrt(1.0 + (rate / self.shape.get("v0", 0.1)) ** 2)
