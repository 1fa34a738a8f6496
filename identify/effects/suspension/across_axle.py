"""A force between the wheels of an axle."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Self

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.effects.base import AXLES, PhysicalEffect
from lacet.identify.multibody.vectors import Array


class AcrossAxle(PhysicalEffect):
    """A force on the left wheel that follows a difference left − right, and its opposite on the right wheel."""

    rows = ("suspension",)
    opposed = True

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle."""
        return [cls(axle) for axle in AXLES]

    @abstractmethod
    def state(self, corner: CornerMotion) -> Array:
        """(N,) what is subtracted left − right, force per unit of the one parameter."""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The difference on the left, its opposite on the right."""
        left, right = self.corners()
        difference = self.state(motion.corners[left]) - self.state(motion.corners[right])
        return {f"suspension.{left}": difference[None], f"suspension.{right}": -difference[None]}
