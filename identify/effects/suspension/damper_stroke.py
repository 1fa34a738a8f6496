"""Dampers that depend on where the piston is."""

from __future__ import annotations

from lacet.identify.effects.base import Parameter, SuspensionForce
from lacet.identify.multibody.vectors import Array


class DamperStroke(SuspensionForce):
    """Damping that grows with compression: F = p s ṡ; by-pass grooves, lever arms that change, hydraulic stops."""

    name = "damper_stroke"
    about = "damping that depends on the stroke"
    signature = "suspension row follows travel times travel rate"
    shown_by = "rough road while braking, cornering or loaded: large rates at different travels"
    source = "Dixon (2007), The Shock Absorber Handbook, chapters 6 and 7 (position-dependent dampers)"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Change of damping per unit of travel."""
        return (self.named("p", "N·s/m²", -5e4, 5e4),)

    def law(self, travel: Array, rate: Array) -> Array:
        """s ṡ."""
        return travel * rate
