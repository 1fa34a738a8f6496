"""Vertical behaviour of the tyres, along the road's normal."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Self

from daq.vehicle import Vehicle
from identify.effect import AXLES, Effect, Parameter
from identify.motion import CornerMotion, Motion
from identify.vectors import Array, dot


class _TyreForce(Effect):
    """A force of the tyres along the road's normal; a subclass gives the law per unit of its one parameter."""

    rows = ("tyre",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """Both axles."""
        return [cls(where) for where in AXLES]

    @abstractmethod
    def law(self, corner: CornerMotion) -> Array:
        """(N,) force per unit of the parameter [N]."""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The law at the tyres acted on."""
        return {f"tyre.{c}": self.law(motion.corners[c])[None] for c in self.corners()}


class TyreStiffness(_TyreForce):
    """Linear vertical stiffness: F·e = kt δ."""

    name = "tyre_stiffness"
    about = "linear vertical tyre stiffness"
    signature = "tyre row follows deflection"
    shown_by = "rough road, spiral"
    source = "paper, table 4"
    base = True

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """Each corner."""
        return [cls(corner) for corner in vehicle.corners]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness kt."""
        return (self.named("kt", "N/m", 0.0, 1e6, "positive"),)

    def law(self, corner: CornerMotion) -> Array:
        """δ."""
        return corner.deflection


class OutboardMass(_TyreForce):
    """Rim and tyre outside the transducer: F·e = kt δ − m a·e, in the ``hub`` reference only."""

    name = "outboard_mass"
    about = "mass of rim and tyre outboard of the wheel dynamometer"
    signature = "tyre row follows the wheel's vertical acceleration"
    shown_by = "rough road"
    source = "method, section 3 (tyre rows)"
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


class TyreDamping(_TyreForce):
    """Vertical damping of the tyre: c δ̇."""

    name = "tyre_damping"
    looks_like = ("sensor_latency",)
    about = "vertical damping of the tyres"
    signature = "tyre row follows the rate of deflection; a late ground laser looks the same"
    shown_by = "rough road"
    source = "Pacejka (2012), section 4.3"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Damping c."""
        return (self.named("c", "N·s/m", -2e3, 2e3, "positive"),)

    def law(self, corner: CornerMotion) -> Array:
        """δ̇."""
        return corner.deflection_rate


class TyreProgression(_TyreForce):
    """Stiffness that grows with deflection: k2 δ²."""

    name = "tyre_progression"
    about = "progressive vertical tyre stiffness"
    signature = "tyre row bends upwards with deflection"
    shown_by = "spiral, strong roll, rough road"
    source = "Pacejka (2012), section 4.3"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Quadratic stiffness k2."""
        return (self.named("k2", "N/m²", -3e6, 3e6, "positive"),)

    def law(self, corner: CornerMotion) -> Array:
        """δ²."""
        return corner.deflection**2
