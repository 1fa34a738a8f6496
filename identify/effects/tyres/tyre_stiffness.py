"""Linear vertical stiffness of the tyres."""

from __future__ import annotations

from typing import Self

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import CornerMotion
from lacet.identify.effects.base import Parameter, TyreForce
from lacet.identify.multibody.vectors import Array


class TyreStiffness(TyreForce):
    """Linear vertical stiffness: F·e = kt δ."""

    name = "tyre_stiffness"
    about = "linear vertical tyre stiffness"
    signature = "tyre row follows deflection"
    shown_by = "rough road, spiral"
    source = "paper, table 4"
    base = True

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """One variant for each corner."""
        return [cls(corner) for corner in vehicle.corners]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness kt."""
        return (self.named("kt", "N/m", 0.0, 1e6, "positive"),)

    def law(self, corner: CornerMotion) -> Array:
        """δ."""
        return corner.deflection
