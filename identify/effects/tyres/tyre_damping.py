"""Vertical damping of the tyres."""

from __future__ import annotations

from lacet.identify.car.motion import CornerMotion, GroundLaserOffset, Motion
from lacet.identify.car.road import ABOVE
from lacet.identify.effects.base import Parameter, TyreForce
from lacet.identify.multibody.vectors import Array


class TyreDamping(TyreForce):
    """Vertical damping of the tyre: c δ̇.

    Lasers that are late by τ measure δ − τ δ̇, and a tyre of stiffness kt then seems to have a damper c = kt τ: the same
    column.
    """

    name = "tyre_damping"
    looks_like = ("sensor_latency",)
    about = "vertical damping of the tyres"
    signature = "tyre row follows the rate of deflection; a late ground laser looks the same"
    shown_by = "rough road"
    source = "Pacejka (2012), Tire and Vehicle Dynamics; Reimpell et al. (2001), The Automotive Chassis, chapter 2"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Damping c."""
        return (self.named("c", "N·s/m", 0.0, 2e3, "positive"),)

    def lacks(self, motion: Motion) -> tuple[str | GroundLaserOffset, ...]:
        """The road under the tyres, where a laser sees it by Δx / v too early: that is a damper kt Δx / v."""
        beside = (GroundLaserOffset(motion.ahead),) if abs(motion.ahead) > ABOVE else ()
        return (*super().lacks(motion), *beside)

    def law(self, corner: CornerMotion) -> Array:
        """δ̇."""
        return corner.deflection_rate
