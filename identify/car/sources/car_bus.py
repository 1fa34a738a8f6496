"""Motion of the body from the car's own bus: yaw rate and lateral acceleration alone, the rest nominal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.identify.car.sources.wheel_force import GRAVITY
from lacet.identify.multibody.vectors import Array, cross
from lacet.identify.signals.reconstruct import Signals
from lacet.identify.signals.sources import Law, Series

YAW_RATE, LATERAL = "car.yaw_rate", "car.lateral_accel"


@dataclass(frozen=True)
class BusRates(Law[Signals]):
    """Angular rates in body axes: roll rate G ȧ_y, no pitch rate, the yaw rate of the bus."""

    roll: Assumption

    @property
    def channel(self) -> str:
        """The inertial unit's rates."""
        return "imu.rate"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """The roll gradient."""
        return (self.roll,)

    def series(self, signals: Signals) -> Series:
        """The rates and angular accelerations."""
        roll = signals.assumed[self.roll.name][0]
        yaw, none = signals.value[YAW_RATE][0], np.zeros(roll.size)
        value = np.stack([roll * signals.rate[LATERAL][0], none, yaw])
        rate = np.stack([roll * signals.accel[LATERAL][0], none, signals.rate[YAW_RATE][0]])
        return Series(value, rate, np.zeros_like(value))


@dataclass(frozen=True)
class BusAccel(Law[Signals]):
    """Specific force at the body's origin from a lateral accelerometer at `position` [m]; the rest is nominal."""

    position: tuple[float, ...]
    forward: Assumption
    upward: Assumption

    @property
    def channel(self) -> str:
        """The inertial unit's specific force."""
        return "imu.accel"

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Longitudinal acceleration, and the vertical one in g."""
        return (self.forward, self.upward)

    def series(self, signals: Signals) -> Series:
        """The specific force."""
        omega, omega_dot = signals.value["imu.rate"], signals.rate["imu.rate"]
        r = np.asarray(self.position)[:, None]
        arm: Array = cross(omega_dot, r) + cross(omega, cross(omega, r))
        lateral = signals.value[LATERAL][0] - arm[1]
        upward = GRAVITY * signals.assumed[self.upward.name][0]
        value = np.stack([signals.assumed[self.forward.name][0], lateral, upward])
        return Series(value, np.zeros_like(value), np.zeros_like(value))
