"""Aerodynamic forces on the body, all with the square of the speed."""

from __future__ import annotations

from typing import Self

import numpy as np

from daq.vehicle import Vehicle
from identify.effect import AXLES, Effect, Parameter
from identify.motion import Motion
from identify.vectors import Array


def _square(motion: Motion) -> Array:
    assert motion.velocity is not None
    vx = motion.velocity[0]
    return np.abs(vx) * vx


class AeroDrag(Effect):
    """Drag, with the pitching moment of its height above the body origin: ΣFx = … + d v², ΣMy = … + m v²."""

    name = "aero_drag"
    rows = ("chassis.fx", "chassis.my")
    about = "aerodynamic drag and its pitching moment"
    signature = "longitudinal force and pitch moment grow with the square of speed"
    shown_by = "a change of speed: coasting, sudden deceleration; not constant speed"
    source = "Gillespie (1992), chapter 4; ISO 8855"
    needs = ("correvit.speed",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """One."""
        return [cls()]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """½ρ·cd·A, and the same times the height of its centre above the body origin."""
        return (
            self.named("d", "N·s²/m²", -1.5, 1.5, "positive"),
            self.named("m", "N·s²/m", -1.5, 1.5),
        )

    def columns(self, motion: Motion) -> dict[str, Array]:
        """v|v| on the longitudinal force and on the pitching moment."""
        v2, zero = _square(motion), np.zeros(motion.t.size)
        return {"chassis.fx": np.stack([v2, zero]), "chassis.my": np.stack([zero, v2])}


class AeroLift(Effect):
    """Lift at one axle: the wheels carry less by l v²."""

    name = "aero_lift"
    rows = ("chassis.fz", "chassis.my")
    about = "aerodynamic lift at an axle (negative: downforce)"
    signature = "vertical force and pitch moment fall with the square of speed"
    shown_by = "a change of speed"
    source = "Gillespie (1992), chapter 4"
    needs = ("correvit.speed",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """Both axles; `place` is where the axle stands."""
        return [cls(axle, {"x": vehicle.corners[AXLES[axle][0]].position[0]}) for axle in AXLES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """½ρ·cl·A."""
        return (self.named("l", "N·s²/m²", -1.5, 1.5),)

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−v|v| on the vertical force, +x v|v| on the pitching moment of an axle at x."""
        v2 = _square(motion)[None]
        return {"chassis.fz": -v2, "chassis.my": self.shape["x"] * v2}
