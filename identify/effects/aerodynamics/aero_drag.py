"""Aerodynamic drag."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array


class AeroDrag(PhysicalEffect):
    """Drag, with the pitching moment of its height above the body origin: ΣFx = … + d v|v|, ΣMy = … + m v|v|.

    At a constant speed it is a constant, as is an inertial unit turned in pitch or with a zero in x: only a change of
    speed distinguishes them.
    """

    name = "aero_drag"
    about = "aerodynamic drag and its pitching moment"
    signature = "longitudinal force and pitch moment grow with the square of speed"
    shown_by = "a change of speed: coasting, sudden deceleration; not constant speed"
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics, chapter 4; Hucho (1998), chapter 4"
    rows = ("chassis.fx", "chassis.my")
    looks_like = ("sensor_misalignment",)
    needs = ("correvit.speed",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant: the car as a whole."""
        return [cls()]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """½ρ·cd·A, and the same times the height of its centre above the body origin."""
        return (
            self.named("d", "N·s²/m²", 0.0, 3.0, "positive"),
            self.named("m", "N·s²/m", -5.0, 5.0),
        )

    def columns(self, motion: Motion) -> dict[str, Array]:
        """v|v| on the longitudinal force and on the pitching moment."""
        assert motion.velocity is not None
        v2, zero = np.abs(motion.velocity[0]) * motion.velocity[0], np.zeros(motion.t.size)
        return {"chassis.fx": np.stack([v2, zero]), "chassis.my": np.stack([zero, v2])}
