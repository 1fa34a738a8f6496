"""Steer and camber of a wheel where no camera measures them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Corner, SteeringTable
from lacet.identify.car.body_motion import body_motion
from lacet.identify.car.car_tree import kinematics, kingpin_camber
from lacet.identify.car.sources.wheel_speed import Speed
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Signals
from lacet.identify.signals.sources import Law, Series
from lacet.identify.signals.spline import CubicSpline

SLOW = 5.0
"""Speed below which a turn's steer is taken as at this speed [m/s]."""
LEAST_LOAD = 500.0
"""Load of an axle below which its lateral force ÷ load is taken as at this load [N]."""


def along_travel(corner: Corner, design: float, column: int, signals: Signals) -> Series:
    """A column of the bench table (2 toe, 3 camber) along the travel, with its derivatives (1, N)."""
    hub, rate, accel = (part[f"laser.{corner.name}.hub"][0] for part in (signals.value, signals.rate, signals.accel))
    table = kinematics(corner, design - hub)
    slope, bend = table.slope[column], table.curvature[column]
    return Series(table.change[column][None], (-slope * rate)[None], (-slope * accel + bend * rate**2)[None])


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
    """Steer of a wheel: static toe, toe of the bench table, a zero, and what a subclass says of the steering.

    `design` : reading of the hub laser at design height [m].
    """

    corner: Corner
    design: float
    zero: Assumption

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
        return _sum(_constant(zero), along_travel(self.corner, self.design, 2, signals), self.steered(signals))

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
    """Camber of a wheel: static, of the bench table, of the steering about the inclined kingpin, zero and slope."""

    corner: Corner
    design: float
    zero: Assumption
    slope: Assumption

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
        hub, rate, accel = (part[f"laser.{c}.hub"] for part in (signals.value, signals.rate, signals.accel))
        slope = -side * signals.assumed[self.slope.name]
        travel = Series(slope * (self.design - hub), -slope * rate, -slope * accel)
        steer, steer_rate, steer_accel = (
            part[f"camera.{c}.steer"][0] for part in (signals.value, signals.rate, signals.accel)
        )
        change, by, bend = kingpin_camber(self.corner, steer)
        kingpin = Series(change[None], (by * steer_rate)[None], (by * steer_accel + bend * steer_rate**2)[None])
        return _sum(_constant(zero), travel, kingpin, along_travel(self.corner, self.design, 3, signals))
