"""Tyres that grow stiffer under load."""

from __future__ import annotations

from lacet.identify.car.motion import CornerMotion
from lacet.identify.effects.base import Parameter, TyreForce
from lacet.identify.multibody.vectors import Array


class TyreProgression(TyreForce):
    """Stiffness that grows with deflection: k2 δ²."""

    name = "tyre_progression"
    about = "progressive vertical tyre stiffness"
    signature = "tyre row bends upwards with deflection"
    shown_by = "spiral, strong roll, rough road"
    source = "Pacejka (2012), Tire and Vehicle Dynamics; Reimpell et al. (2001), The Automotive Chassis, chapter 2"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Quadratic stiffness k2."""
        return (self.named("k2", "N/m²", -3e6, 3e6, "positive"),)

    def law(self, corner: CornerMotion) -> Array:
        """δ²."""
        return corner.deflection**2
