"""A force in a suspension that depends on what the suspension did before."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Self

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.effects.base import AXLES, PhysicalEffect
from lacet.identify.multibody.vectors import Array


class SuspensionForceWithMemory(PhysicalEffect):
    """A force in each suspension that follows from its motion up to now; a subclass defines the course of it."""

    rows = ("suspension",)
    instantaneous: ClassVar[bool] = False

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle and for each corner."""
        return [cls(where) for where in (*AXLES, *vehicle.corners)]

    @abstractmethod
    def course(self, corner: CornerMotion, step: float) -> Array:
        """(N,) force per unit of the one parameter along a run sampled every `step` [s]."""

    def parts(self) -> Sequence[PhysicalEffect]:
        """The same force at each corner."""
        return [replace(self, where=corner) for corner in self.corners()]

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The force in the suspension rows of the corners acted on."""
        step = float(motion.t[1] - motion.t[0])
        return {f"suspension.{c}": self.course(motion.corners[c], step)[None] for c in self.corners()}
