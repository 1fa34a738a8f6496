"""Position error of the inertial unit against the rig file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Parameter, SensorFault
from lacet.identify.multibody.vectors import Array, cross, unit
from lacet.identify.signals.mounting import sensor_to_body
from lacet.identify.signals.reconstruct import Recording


class SensorPosition(SensorFault):
    """The inertial unit is mounted p farther along a body axis: it feels ω̇ × p + ω × (ω × p) more."""

    name = "sensor_position"
    about = "inertial unit mounted elsewhere than the rig file says"
    signature = "force rows follow angular accelerations and squares of rates"
    shown_by = "fast steering, one-sided bumps: large angular accelerations"
    source = "Titterton and Weston (2004), Strapdown Inertial Navigation Technology (size effect)"

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each body axis."""
        return [cls(f"imu.{axis}") for axis in "xyz"]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Distance beyond the rig's position."""
        return (self.named("p", "m", -0.5, 0.5),)

    def channels(self) -> tuple[str, ...]:
        """The specific force: rates are the same everywhere on a body."""
        return ("imu.accel",)

    def perturb(self, channel: str, recording: Recording) -> Array:
        """ω̇ × e + ω × (ω × e), in the unit's axes; nothing without rates."""
        signals = recording.signals
        if "imu.rate" not in signals.value:
            return np.zeros_like(signals.value[channel])
        R = sensor_to_body(recording.rig, channel)
        omega, omega_dot = R @ signals.value["imu.rate"], R @ signals.rate["imu.rate"]
        e = unit("xyz".index(self.where[-1]))
        return R.T @ (cross(omega_dot, e) + cross(omega, cross(omega, e)))

    @property
    def tolerance(self) -> str:
        """The sheet's position."""
        return "position"
