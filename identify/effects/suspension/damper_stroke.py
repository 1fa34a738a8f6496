"""Dampers that depend on where the piston is."""

from __future__ import annotations

import numpy as np

from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
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


class DamperStrokeSymmetric(SuspensionForce):
    """Damping that grows with travel both ways: F = p |s| ṡ; a by-pass groove about the middle of the stroke."""

    name = "damper_stroke_symmetric"
    about = "damping that grows with travel both ways"
    signature = "suspension row follows the size of the travel times the travel rate"
    shown_by = "rough road with large and small bumps, or while braking and cornering: large rates at different travels"
    source = "Dixon (2007), The Shock Absorber Handbook, chapters 6 and 7 (position-dependent dampers)"
    bend = Bend.TRAVEL

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Growth of damping per unit of travel."""
        return (self.named("p", "N·s/m²", -1e5, 1e5, "positive"),)

    def law(self, travel: Array, rate: Array) -> Array:
        """|s| ṡ."""
        return np.abs(travel) * rate
