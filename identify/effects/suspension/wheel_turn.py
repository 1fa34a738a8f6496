"""Wheels that turn with the travel more than the bench table says: errors of its toe and camber slopes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Self

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import CornerMotion, Course, Motion
from lacet.identify.effects.base import AXLES, Parameter, PhysicalEffect
from lacet.identify.multibody.vectors import Array, dot, turn, unit


class WheelTurn(PhysicalEffect):
    """Both wheels of an axle turn about an axis by p s more than the table says, mirrored left and right.

    The angles themselves are measured; what the slope is needed for is the work of the wheel's moment on the travel.
    The moment about the spin axis is left out: a bearing passes none, and what brake or engine pass is in the row.
    """

    rows = ("suspension",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each axle."""
        return [cls(axle) for axle in AXLES]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Error of the slope p."""
        return (self.named("p", "rad/m", -1.0, 1.0),)

    @abstractmethod
    def axis(self, corner: CornerMotion) -> Array:
        """(3, N) axis the wheels turn about: positive is outward-leaning, or toe-in, on the right side."""

    def columns(self, motion: Motion) -> dict[str, Array]:
        """−M·Δ∂φ/∂s, the moment without its part about the spin axis."""
        out: dict[str, Array] = {}
        for c in self.corners():
            out |= self.moved(motion, c, c, 1.0, motion.corners[c].travelled)
        return out

    def moved(self, motion: Motion, corner: str, by: str, slope: Array | float, shift: Course) -> dict[str, Array]:
        """The column of one wheel that turns by `slope` per travel of `by`; the angle itself is measured."""
        del shift
        wheel, side = motion.corners[corner], 1.0 if corner.endswith("l") else -1.0
        moment = wheel.moment - wheel.spin_axis * dot(wheel.moment, wheel.spin_axis)
        return {f"suspension.{by}": side * (slope * dot(moment, self.axis(wheel)))[None]}


class CamberChange(WheelTurn):
    """Camber changes with travel more than the table says: top outward by p s.

    A contact force F at the radius R below the wheel centre has the moment R F about this axis, so that a half-track
    slope error of p R (`jacking`) looks the same in the suspension rows.
    """

    name = "camber_change"
    about = "camber that changes with travel more than the bench table says"
    signature = "suspension rows of an axle follow the moment about the x axis, outward on both sides"
    shown_by = "cornering: fast steering, lift-off in a turn"
    source = "Reimpell et al. (2001), The Automotive Chassis, section 3.5; Dixon (2009), chapter 7"
    looks_like = ("jacking", "camber_table")

    def axis(self, corner: CornerMotion) -> Array:
        """x, steered."""
        return turn(2, corner.steer, unit(0))


class ToeChange(WheelTurn):
    """Toe changes with travel more than the table says (bump steer): toe-in by p s."""

    name = "toe_change"
    about = "toe that changes with travel more than the bench table says (bump steer)"
    signature = "suspension rows of an axle follow the self-aligning moment, mirrored left and right"
    shown_by = "cornering, braking: large moments about the vertical axis"
    source = "Reimpell et al. (2001), The Automotive Chassis, section 3.6; Dixon (2009), chapter 6"
    looks_like = ("toe_table",)

    def axis(self, corner: CornerMotion) -> Array:
        """z."""
        return unit(2)
