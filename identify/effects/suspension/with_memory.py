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


class SuspensionForceOnPath(AtSuspensions):
    """A force in each suspension that follows from the path of its travel alone; a subclass defines `path`.

    Noise of the travel is a path, too, and no correction of second order repairs that: the columns follow the travel
    expected given its record (docs/decisions/noise-in-regressors.md).
    """

    instantaneous: ClassVar[bool] = False

    @property
    def conditional(self) -> bool:
        """True: columns follow what is expected of the travel."""
        return True

    @abstractmethod
    def path(self, travel: Array) -> Array:
        """(…, N) force per unit of the one parameter along travels (…, N) [m]."""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The force in the suspension rows of the corners acted on."""
        return {f"suspension.{c}": self.path(expected_travel(motion.corners[c]))[None] for c in self.corners()}


def expected_travel(corner: CornerMotion) -> Array:
    """(N,) suspension travel expected given its record [m], or the travel itself where that is exact."""
    return corner.travel if corner.conditional is None else corner.conditional.travel
