"""A force in a suspension that depends on what the suspension did before."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.effects.base import AtSuspensions
from lacet.identify.multibody.vectors import Array


class SuspensionForceWithMemory(AtSuspensions):
    """A force in each suspension that follows from its motion up to now; a subclass defines the course of it."""

    instantaneous: ClassVar[bool] = False

    @abstractmethod
    def course(self, corner: CornerMotion, step: float) -> Array:
        """(N,) force per unit of the one parameter along a run sampled every `step` [s]."""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The force in the suspension rows of the corners acted on."""
        step = float(motion.t[1] - motion.t[0])
        return {f"suspension.{c}": self.course(motion.corners[c], step)[None] for c in self.corners()}
