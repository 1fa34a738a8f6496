"""Wheel speed from the car's, where no encoder measures it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Corner
from lacet.identify.car.body_motion import body_motion
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Signals
from lacet.identify.signals.sources import Law, Series

TURNS = 0.02
"""RMS of the yaw rate from which a turn gives the speed [rad/s]."""
SLOWEST = 1.0
"""Least speed that turns give [m/s]."""
USUAL = 20.0
"""Speed of a run without turns or a speed, in which hardly anything depends on it [m/s]."""


def speed_of_turns(signals: Signals, rig: Rig, n: int) -> float:
    """The speed that lateral acceleration and yaw rate have in common over a run, v = a_y ÷ ψ̇ [m/s]."""
    body = body_motion(signals, rig, n)
    yaw, lateral = np.asarray(body.omega[2], float), np.asarray(body.accel[1], float)
    square = float(yaw @ yaw)
    return USUAL if square < TURNS**2 * n else max(float(lateral @ yaw) / square, SLOWEST)


@dataclass(frozen=True)
class Speed:
    """Forward speed: of a `channel`'s first component, or `nominal` [m/s] times an assumed `scale`."""

    channel: str
    nominal: float = 0.0
    scale: Assumption | None = None

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """The scale of a nominal speed."""
        return (self.scale,) if self.scale else ()

    def forward(self, signals: Signals) -> Array:
        """(1, N) the speed [m/s]."""
        return signals.assumed[self.scale.name] * self.nominal if self.scale else signals.value[self.channel][:1]


@dataclass(frozen=True)
class RolledSpeed(Law[Signals]):
    """Wheel speed (v − ψ̇ y) (1 + slip) ÷ radius, y the wheel's place to the left.

    Its derivative is the longitudinal specific force's.
    """

    corner: Corner
    rig: Rig
    speed: Speed
    radius: Assumption
    slip: Assumption

    @property
    def channel(self) -> str:
        """The wheel's speed."""
        return f"wheel.{self.corner.name}.speed"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Radius, slip and, without a speed, the scale of the nominal one."""
        return (self.radius, self.slip, *self.speed.assumptions)

    def series(self, signals: Signals) -> Series:
        """The wheel's speed and its derivative."""
        radius, slip = (signals.assumed[one.name] for one in (self.radius, self.slip))
        n = radius.shape[1]
        body = body_motion(signals, self.rig, n)
        scale = (1.0 + slip) / radius
        rolling = (self.speed.forward(signals) - body.omega[2] * self.corner.position[1]) * scale
        return Series(rolling, body.accel[:1] * scale, np.zeros((1, n)))
