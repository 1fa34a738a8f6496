"""Aerodynamic lift and downforce."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array


class AeroLift(PhysicalEffect):
    """Lift on the body at one axle: the wheels carry less by l v²."""

    name = "aero_lift"
    about = "aerodynamic lift at an axle (negative: downforce)"
    signature = "vertical force and pitch moment fall with the square of speed"
    shown_by = "a change of speed"
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics, chapter 4; Hucho (1998), chapter 4"
    rows = ("chassis.fz", "chassis.my")
    needs = ("correvit.speed",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle."""
        return [cls(axle) for axle in AXLES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """½ρ·cl·A of the axle."""
        return (self.named("l", "N·s²/m²", -3.0, 3.0),)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−v² on the vertical force, +x v² on the pitching moment of an axle at x."""
        assert motion.velocity is not None
        v2 = motion.velocity[0] ** 2
        x = np.mean([motion.corners[c].centre[0] for c in self.corners()], axis=0)
        return {"chassis.fz": -v2[None], "chassis.my": (x * v2)[None]}
