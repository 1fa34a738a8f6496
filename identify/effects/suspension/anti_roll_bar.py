"""Anti-roll bars."""

from __future__ import annotations

from typing import Self

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array


class AntiRollBar(PhysicalEffect):
    """A bar that resists the difference of travel left and right: F = k (s_left − s_right), and its opposite.

    Hub lasers of other scales left and right look like other springs, and in roll like a bar; the tyre rows, in which
    they take part in the deflection, tell them apart.
    """

    name = "anti_roll_bar"
    rows = ("suspension",)
    looks_like = ("sensor_gain",)
    about = "anti-roll bar: couples left and right travel of an axle"
    signature = "left and right suspension rows follow the difference of travel, with opposite signs"
    shown_by = "steering or one-sided bumps together with heave: roll against heave"
    source = "Venture et al. (2003); paper, table 6 (karf, karr)"

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """One variant for each axle."""
        return [cls(axle) for axle in AXLES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness k, per metre of travel difference."""
        return (self.named("k", "N/m", 0.0, 1e5, "positive"),)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """s_left − s_right on the left, its opposite on the right."""
        left, right = self.corners()
        difference = motion.corners[left].travel - motion.corners[right].travel
        return {f"suspension.{left}": difference[None], f"suspension.{right}": -difference[None]}
