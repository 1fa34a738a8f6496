"""Anti-roll bars."""

from __future__ import annotations

from lacet.identify.car.motion import CornerMotion
from lacet.identify.effects.base import Parameter
from lacet.identify.effects.suspension.across_axle import AcrossAxle
from lacet.identify.multibody.vectors import Array


class AntiRollBar(AcrossAxle):
    """A bar that resists the difference of travel left and right: F = k (s_left − s_right), and its opposite.

    Hub lasers of different scales left and right look like a bar in roll; the tyre rows distinguish them.
    """

    name = "anti_roll_bar"
    looks_like = ("sensor_gain",)
    about = "anti-roll bar: couples left and right travel of an axle"
    signature = "left and right suspension rows follow the difference of travel, with opposite signs"
    shown_by = "steering or one-sided bumps together with heave: roll against heave"
    source = "Venture et al. (2003); paper, table 6 (karf, karr)"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness k, per metre of travel difference."""
        return (self.named("k", "N/m", 0.0, 1e5, "positive"),)

    def state(self, corner: CornerMotion) -> Array:
        """Travel [m]."""
        return corner.travel
