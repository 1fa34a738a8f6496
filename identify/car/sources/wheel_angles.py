"""Steer and camber of a wheel where no camera measures them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.channels import other_corner
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Corner, SteeringTable
from lacet.identify.car.body_motion import body_motion
from lacet.identify.car.car_tree import kingpin_camber
from lacet.identify.car.motion import Course
from lacet.identify.car.sources.wheel_speed import Speed
from lacet.identify.car.wheel_joints import WheelJoints, wheel_joints
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Signals
from lacet.identify.signals.sources import Law, Series
from lacet.identify.signals.spline import CubicSpline

SLOW = 5.0
"""Speed below which a turn's steer is taken as at this speed [m/s]."""
LEAST_LOAD = 500.0
"""Load of an axle below which its lateral force ÷ load is taken as at this load [N]."""


@dataclass(frozen=True)
class Travels:
    """Travels that the bench tables of a wheel are against.

    `design` : reading of its hub laser at design height [m]; `other` : that of the axle's other wheel, None where that
    does not move this one, or its travel is not known: then it is taken to be this one's.
    """

    corner: Corner
    design: float
    other: float | None = None

    def own(self, signals: Signals) -> Course:
        """The wheel's own travel (N,) [m] and its derivatives."""
        return _travel(self.corner.name, self.design, signals)

    def joints(self, signals: Signals, steer: Course, *, rack: bool) -> WheelJoints:
        """The wheel's joints along them; without `rack` those at the rack's middle."""
        own, corner = self.own(signals), self.corner
        name = other_corner(corner.name)
        other = own if self.other is None else _travel(name, self.other, signals)
        if corner.joints is not None and not rack:
            corner = replace(corner, joints=replace(corner.joints, rack=None))
        return wheel_joints(corner, own, other if corner.follows_other else None, steer)


def _travel(c: str, design: float, signals: Signals) -> Course:
    hub, rate, accel = (part[f"laser.{c}.hub"][0] for part in (signals.value, signals.rate, signals.accel))
    return design - hub, -rate, -accel


def _series(course: Course) -> Series:
    value, rate, accel = (part[None] for part in course)
    return Series(value, rate, accel)


def _sum(*parts: Series) -> Series:
    return Series(
        np.sum([one.value for one in parts], axis=0),
        np.sum([one.rate for one in parts], axis=0),
        np.sum([one.accel for one in parts], axis=0),
    )


def _constant(value: Array) -> Series:
    return Series(value, np.zeros_like(value), np.zeros_like(value))


@dataclass(frozen=True)
class Steer(Law[Signals]):
    """Steer of a wheel: static toe, toe of the bench table, a zero, and what a subclass says of the steering."""

    travels: Travels
    zero: Assumption

    @property
    def corner(self) -> Corner:
        """The wheel's corner."""
        return self.travels.corner

    @property
    def channel(self) -> str:
        """The steer camera."""
        return f"camera.{self.corner.name}.steer"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """The zero."""
        return (self.zero,)

    def series(self, signals: Signals) -> Series:
        """The steer angle and its derivatives."""
        zero = signals.assumed[self.zero.name] - self.corner.side * self.corner.static_toe
        own = self.travels.own(signals)
        joints = self.travels.joints(signals, (0.0 * own[0],) * 3, rack=False)
        return _sum(_constant(zero), _series(joints.steer), self.steered(signals))

    def steered(self, signals: Signals) -> Series:
        """Steer from the steering; of an axle that does not steer none."""
        return _constant(np.zeros_like(signals.assumed[self.zero.name]))


@dataclass(frozen=True)
class SteerOfOther(Steer):
    """Steer of the other wheel of the axle, which a camera measures."""

    other: Corner

    def series(self, signals: Signals) -> Series:
        """The other's, with this wheel's static toe."""
        name = f"camera.{self.other.name}.steer"
        value, rate, accel = (part[name] for part in (signals.value, signals.rate, signals.accel))
        toe = -self.corner.side * self.corner.static_toe + self.other.side * self.other.static_toe
        return Series(value + signals.assumed[self.zero.name] + toe, rate, accel)


@dataclass(frozen=True)
class SteeringWheel(Steer):
    """Steer by the angle of the steering wheel, through the vehicle's table or its ratio."""

    scale: Assumption
    table: SteeringTable | None

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """The zero, and the scale: the ratio, or with a table the steer ÷ the table's."""
        return (self.zero, self.scale)

    def steered(self, signals: Signals) -> Series:
        """The table's angle × scale, or the steering wheel's ÷ ratio."""
        wheel, rate, accel = (part["steering.angle"] for part in (signals.value, signals.rate, signals.accel))
        scale = signals.assumed[self.scale.name]
        if self.table is None:
            return Series(wheel / scale, rate / scale, accel / scale)
        angles = self.table.left if self.corner.side > 0 else self.table.right
        spline = CubicSpline.of(self.table.wheel, angles[None], natural=True)
        value, slope, bend = (spline.at(wheel[0], order) for order in range(3))
        return Series(scale * value, scale * slope * rate, scale * (slope * accel + bend * rate**2))


@dataclass(frozen=True)
class Turning(Steer):
    """Steer of the front wheels as the turn needs it: L ψ̇ ÷ v + λ_f F_f ÷ Z_f − λ_r F_r ÷ Z_r.

    F, Z: lateral and vertical force of an axle, λ the slip angle per F ÷ Z; it holds in transients too: the side slip
    of front and rear differs by L ψ̇ ÷ v. Derivatives are neglected. Source: Mitschke and Wallentowitz, Dynamik der
    Kraftfahrzeuge, chapter 20.
    """

    rig: Rig
    wheelbase: float
    speed: Speed
    front: Assumption
    rear: Assumption

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """The zero, the speed where none is measured, slip angles."""
        return (self.zero, *self.speed.assumptions, self.front, self.rear)

    def steered(self, signals: Signals) -> Series:
        """The turn's steer."""
        front, rear = signals.assumed[self.front.name], signals.assumed[self.rear.name]
        body = body_motion(signals, self.rig, front.shape[1])
        v = np.maximum(self.speed.forward(signals), SLOW)
        steer = self.wheelbase * body.omega[2] / v
        for axle, slip in (("f", front), ("r", -rear)):
            force = signals.value[f"wheel.{axle}l.force"] + signals.value[f"wheel.{axle}r.force"]
            steer = steer + slip * force[1] / np.maximum(force[2], LEAST_LOAD)
        return _constant(steer)


@dataclass(frozen=True)
class Camber(Law[Signals]):
    """Camber of a wheel: static, of the bench table, of the steering, zero and slope.

    Of the steering it is the bench table's against the rack, or without one that about the inclined kingpin.
    """

    travels: Travels
    zero: Assumption
    slope: Assumption

    @property
    def corner(self) -> Corner:
        """The wheel's corner."""
        return self.travels.corner

    @property
    def channel(self) -> str:
        """The camber camera."""
        return f"camera.{self.corner.name}.camber"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """The zero and a slope beyond the bench table's."""
        return (self.zero, self.slope)

    def series(self, signals: Signals) -> Series:
        """The camber angle and its derivatives."""
        c, side = self.corner.name, self.corner.side
        zero = signals.assumed[self.zero.name] - side * self.corner.static_camber
        slope = -side * signals.assumed[self.slope.name]
        travel = Series(*(slope * part for part in self.travels.own(signals)))
        turned, rate, accel = (part[f"camera.{c}.steer"][0] for part in (signals.value, signals.rate, signals.accel))
        tabled = _series(self.travels.joints(signals, (turned, rate, accel), rack=True).camber)
        if self.corner.joints is not None and self.corner.joints.steered:
            return _sum(_constant(zero), travel, tabled)
        change, by, bend = kingpin_camber(self.corner, turned)
        return _sum(_constant(zero), travel, tabled, _series((change, by * rate, by * accel + bend * rate**2)))
