"""Faults of the instruments that can pass for physics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.interpolate import CubicSpline

from daq.channels import CHANNELS, CORNERS
from daq.rig import Sensor
from daq.vehicle import Vehicle
from identify.effect import Parameter, SensorFault
from identify.filters import derivative
from identify.reconstruct import Recording
from identify.vectors import Array

_GROUPS: dict[str, tuple[str, ...]] = {
    "wheel": ("wheel.force", "wheel.moment"),
    "imu": ("imu.accel", "imu.rate"),
    "laser": ("laser.ground", "laser.hub"),
    "camera": ("camera.steer", "camera.camber"),
    "correvit": ("correvit.speed",),
}


def _channels(families: tuple[str, ...], corners: tuple[str, ...] = CORNERS) -> tuple[str, ...]:
    return tuple(
        name for name, channel in CHANNELS.items() if channel.family in families and channel.corner in (*corners, None)
    )


@dataclass(frozen=True)
class SensorLatency(SensorFault):
    """Samples of one instrument stamped later than the rig file says: y(t) = x(t − τ).

    `members` : the channels that are late together, where they are not a kind of instrument but a row of a rig.
    """

    members: tuple[str, ...] = ()

    name = "sensor_latency"
    about = "an instrument later than the rig file says"
    signature = "every row it enters follows the rate of what it measures"
    shown_by = "anything fast: rough road, fast steering"
    source = "method, section 7"

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """Each kind of instrument."""
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
        return self.members or _channels(_GROUPS[self.where])

    def perturb(self, channel: str, recording: Recording) -> Array:
        """−dx/dt."""
        return -derivative(recording.signals.value[channel], recording.filters.rate)

    def correct(self, channel: str, recording: Recording, p: float) -> Array:
        """The channel read τ later, by cubic interpolation (exact for any τ, not to first order)."""
        value, shift = recording.signals.value[channel], p * recording.filters.rate
        samples = np.arange(value.shape[1], dtype=float)
        return np.asarray(CubicSpline(samples, value, axis=1)(np.clip(samples + shift, 0, samples[-1])))

    @property
    def tolerance(self) -> str:
        """The sheet's latency."""
        return "latency"


class SensorGain(SensorFault):
    """One instrument's scale off: y = (1 + g) x."""

    name = "sensor_gain"
    about = "an instrument's scale off by a fraction"
    signature = "every row it enters is too large or too small in proportion"
    shown_by = "large signals"
    source = "method, section 7"

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> list[Self]:
        """Each wheel's force, each hub laser."""
        families = (("wheel.force", "force"), ("laser.hub", "hub"))
        return [cls(f"{what}.{corner}") for _, what in families for corner in vehicle.corners]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Relative gain error g."""
        return (self.named("g", "-", -0.2, 0.2),)

    def channels(self) -> tuple[str, ...]:
        """The one channel."""
        what, corner = self.where.split(".")
        return (f"wheel.{corner}.force" if what == "force" else f"laser.{corner}.hub",)

    def perturb(self, channel: str, recording: Recording) -> Array:
        """x."""
        return recording.signals.value[channel]

    def correct(self, channel: str, recording: Recording, p: float) -> Array:
        """y / (1 + g)."""
        return recording.signals.value[channel] / (1.0 + p)

    @property
    def tolerance(self) -> str:
        """The sheet's gain."""
        return "gain"
