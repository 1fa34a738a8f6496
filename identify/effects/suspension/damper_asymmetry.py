"""Dampers that are stiffer one way."""

from __future__ import annotations

import numpy as np

from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class DamperAsymmetry(SuspensionForce):
    """Different damping in bump and rebound: F = a |ṡ|; c_bump = c + a, c_rebound = c − a."""

    name = "damper_asymmetry"
    about = "damping different in bump and rebound"
    signature = "suspension row follows the size of the travel rate; the car sinks or rises on a rough road"
    shown_by = "rough road"
    source = "Dixon (2007), The Shock Absorber Handbook, chapter 7"
    bend = Bend.RATE

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Half the difference of bump and rebound damping; rebound is usually the stiffer."""
        return (self.named("a", "N·s/m", -4e3, 4e3, "negative"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """|ṡ|."""
        return np.abs(rate)
