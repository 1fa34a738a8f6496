"""Rim and tyre outside the wheel dynamometer."""

from __future__ import annotations

from typing import Self

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import CornerMotion
from lacet.identify.effects.base import Parameter, TyreForce
from lacet.identify.multibody.vectors import Array, dot


class OutboardMass(TyreForce):
    """Rim and tyre outside the transducer: F·e = kt δ − m a·e, in the ``hub`` reference only."""

    name = "outboard_mass"
    about = "mass of rim and tyre outboard of the wheel dynamometer"
    signature = "tyre row follows the wheel's vertical acceleration"
    shown_by = "rough road"
    source = "Newton's law for what turns outside the transducer; docs/rows.md"
    base = True

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """Each corner for hub loads; none for contact loads, where it is part of the axle."""
        return [cls(corner) for corner in vehicle.corners] if reference == "hub" else []

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Mass; rims and tyres of an axle are the same parts, to 1 kg."""
        twin = f"{self.name}.{self.where[0]}r.m" if self.where.endswith("l") else ""
        return (Parameter(f"{self.key}.m", "kg", 0.0, 80.0, "positive", twin, 1.0),)

    def law(self, corner: CornerMotion) -> Array:
        """−a·e."""
        return -dot(corner.centre_accel, corner.normal)
