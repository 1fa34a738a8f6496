"""Latency errors: instruments that are later than the rig file says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.rig import Sensor
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Parameter, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import derivative
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.signals.spline import CubicSpline
from lacet.identify.signals.time_base import late

_GROUPS: dict[str, tuple[str, ...]] = {
    "wheel": ("wheel.force", "wheel.moment"),
    "imu": ("imu.accel", "imu.rate"),
    "laser": ("laser.ground", "laser.hub"),
    "camera": ("camera.steer", "camera.camber"),
    "correvit": ("correvit.speed",),
}


@dataclass(frozen=True)
class SensorLatency(SensorFault):
    """Samples of one instrument stamped later than the rig file says: y(t) = x(t − τ).

    A late laser makes a spring look like a spring and a damper, −k τ ṡ, which the dampers absorb, and a tyre's spring
    like a tyre with a damper.
    """

    members: tuple[str, ...] = ()
    """Channels that are late together, where they are not a kind of instrument but a row of a rig."""

    name = "sensor_latency"
    about = "an instrument later than the rig file says"
    signature = "every row it enters follows the rate of what it measures"
    shown_by = "anything fast: rough road, fast steering"
    source = "Isermann and Münchhof (2011), Identification of Dynamic Systems (dead times); docs/latency.md"
    looks_like = ("tyre_damping", "damper")

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """One variant for each kind of instrument."""
        return [cls(group) for group in _GROUPS]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Additional latency τ."""
        return (self.named("tau", "s", -0.05, 0.05),)

    @classmethod
    def of_sensor(cls, sensor: Sensor) -> Self:
        """The latency of one row of a rig, all its channels together."""
        return cls(sensor.name, members=sensor.channels)

    def channels(self) -> tuple[str, ...]:
        """All channels of the instrument."""
        if self.members:
            return self.members
        return tuple(name for name, channel in CHANNELS.items() if channel.family in _GROUPS[self.where])

    def perturb(self, channel: str, recording: Recording) -> Array:
        """−dx/dt."""
        return -derivative(recording.signals.value[channel], recording.filters.rate)

    def changes(self, recording: Recording) -> dict[str, Array]:
        """Change of the late channels, or of all others when these are the time base (`signals.time_base`)."""
        return late(self.channels(), recording)

    def correct(self, channel: str, recording: Recording, p: float) -> Array:
        """The channel read τ later, by cubic interpolation (exact for any τ, not to first order)."""
        value, shift = recording.signals.value[channel], p * recording.filters.rate
        samples = np.arange(value.shape[1], dtype=float)
        return CubicSpline.of(samples, value).at(np.clip(samples + shift, 0, samples[-1]))

    @property
    def tolerance(self) -> str:
        """The sheet's latency."""
        return "latency"
