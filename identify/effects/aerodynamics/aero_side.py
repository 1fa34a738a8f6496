"""Aerodynamic side force of a car that slips."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array


class AeroSide(PhysicalEffect):
    """Side force in proportion to the air's slip angle, −c V v_y, with its roll and yaw moments; no wind.

    V is the speed and v_y its lateral part at the body origin: ½ρA·V²·∂c_y/∂β·β with β = v_y/V.
    """

    name = "aero_side"
    about = "aerodynamic side force, roll and yaw moment of a car that slips"
    signature = "lateral force, roll and yaw moment follow speed times lateral speed"
    shown_by = "fast cornering with large slip angles; a slalom at several speeds"
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics, chapter 4; Hucho (1998), chapter 5"
    rows = ("chassis.fy", "chassis.mx", "chassis.mz")
    needs = ("correvit.speed",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant: the car as a whole."""
        return [cls()]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """½ρA·∂c_y/∂β, and what its roll and yaw moments about the body origin are (force times lever)."""
        return (
            self.named("c", "N·s²/m²", -10.0, 10.0, "positive"),
            self.named("roll", "N·s²/m", -10.0, 10.0),
            self.named("yaw", "N·s²/m", -30.0, 30.0),
        )

    def columns(self, motion: Motion) -> dict[str, Array]:
        """V v_y, one row for each parameter."""
        assert motion.velocity is not None
        vx, vy, _ = motion.velocity
        side, zero = np.hypot(vx, vy) * vy, np.zeros(motion.t.size)
        rows = ("chassis.fy", "chassis.mx", "chassis.mz")
        return {row: np.stack([side if k == i else zero for k in range(3)]) for i, row in enumerate(rows)}
