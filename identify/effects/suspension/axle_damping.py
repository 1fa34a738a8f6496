"""Damping across an axle: dampers that both wheels of an axle move."""

from __future__ import annotations

from lacet.identify.car.motion import CornerMotion
from lacet.identify.effects.base import Parameter
from lacet.identify.effects.suspension.across_axle import AcrossAxle
from lacet.identify.multibody.vectors import Array


class AxleDamping(AcrossAxle):
    """Damping of the difference of travel rates left and right: F = c (ṡ_left − ṡ_right), and its opposite.

    A damper compressed by a of its own wheel's travel and b of the other one's is, beside dampers c_d (a + b)², c = −2
    c_d a b: negative for live axles with dampers inboard of the wheels and twist beams. Rubber and the material of a
    bar have a positive c.
    """

    name = "axle_damping"
    about = "damping across an axle: couples left and right travel rates"
    signature = "left and right suspension rows follow the difference of travel rates, with opposite signs"
    shown_by = "rough road, kerbs: both wheels of an axle at different rates"
    source = "Dixon (2007), The Shock Absorber Handbook, chapter 5 (motion ratios of axles); Reimpell et al. (2001)"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Damping c, per difference of travel rates."""
        return (self.named("c", "N·s/m", -5e3, 5e3),)

    def state(self, corner: CornerMotion) -> Array:
        """Travel rate [m/s]."""
        return corner.rate
