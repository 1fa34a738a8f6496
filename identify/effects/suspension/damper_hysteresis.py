"""Friction that turns round over a stroke: bushes, joints, leaf springs."""

from __future__ import annotations

from typing import ClassVar

from lacet.identify.effects.base import Parameter
from lacet.identify.effects.memory import dahl
from lacet.identify.effects.suspension.with_memory import SuspensionForceOnPath
from lacet.identify.multibody.vectors import Array


class DamperHysteresis(SuspensionForceOnPath):
    """Dahl's friction: F = f z, dz/ds = (1 − z sign ṡ) / length, so that z goes from −1 to 1 over some lengths.

    It depends on the path, not on time: between reversals z = ±1 + (z0 ∓ 1) exp(−|Δs| / length), exact for a travel
    that is monotone between samples. A run (or a piece of a long one) begins at z = 0, which is forgotten after a few
    lengths. Coulomb friction is the same where strokes are long.
    """

    name = "damper_hysteresis"
    about = "friction with memory: turns round over a stroke (bushes, joints, leaf springs)"
    signature = "suspension row is a loop against travel, as wide at slow as at fast travel"
    shown_by = "slow sinus steering, smooth driving: many reversals of a small travel"
    source = "Dahl (1976), AIAA Journal 14, 1675; Fancher et al. (1980), SAE 800905"
    looks_like = ("coulomb",)
    # Shorter strokes than a few tenths of a millimetre of laser noise cannot be followed.
    grids: ClassVar = {"length": (0.001, 0.003, 0.01)}
    grid_units: ClassVar = {"length": "m"}
    bounds: ClassVar = {"length": (0.001, 0.03)}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Friction force f."""
        return (self.named("f", "N", 0.0, 1500.0, "positive"),)

    def path(self, travel: Array) -> Array:
        """State z of the friction, from −1 to 1."""
        return dahl(travel, self.shape.get("length", 0.003))
