"""Gain errors: instruments whose scale is off, one by one or all lasers of a kind together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Parameter, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.reconstruct import Recording

_CORNER = {"force": "wheel.{c}.force", "hub": "laser.{c}.hub", "ground": "laser.{c}.ground"}
_TOGETHER = ("hub", "ground")
"""Instruments that may have one scale error in common at all corners, as of one supply, amplifier or setting."""
_IMU = {"accel": "imu.accel", "rate": "imu.rate"}


class SensorGain(SensorFault):
    """One scale off: y = (1 + g) x. Wheel forces and lasers by corner, the inertial unit by axis, the speed sensor.

    A hub laser's scale looks like other springs, dampers and bars at its corner; only the tyre row distinguishes them.
    `hub` and `ground` are an error common to all of these lasers. A scale common to all wheel forces, or to the
    specific force, is another mass and cannot be seen. Moments are not tried: they are mostly force times lever.
    """

    name = "sensor_gain"
    about = "an instrument's scale off by a fraction"
    signature = "every row it enters is too large or too small in proportion"
    shown_by = "large signals"
    source = "Doebelin (2004), Measurement Systems, chapter 3 (sensitivity)"
    looks_like = ("spring", "damper", "anti_roll_bar")

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """Each wheel's force, each laser, all lasers of a kind, each axis of the inertial unit, the speed sensor."""
        corners = [f"{what}.{c}" for what in _CORNER for c in vehicle.corners]
        axes = [f"{what}.{axis}" for what in _IMU for axis in "xyz"]
        return [cls(where) for where in (*corners, *_TOGETHER, *axes, "speed")]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Relative gain error g."""
        return (self.named("g", "-", -0.2, 0.2),)

    def channels(self) -> tuple[str, ...]:
        """The one channel, or those of all corners."""
        what, _, place = self.where.partition(".")
        if what in _CORNER:
            return tuple(_CORNER[what].format(c=c) for c in ((place,) if place else CORNERS))
        return (_IMU.get(what, "correvit.speed"),)

    def _scaled(self, channel: str) -> Array:
        """(k, 1) one for the components that are scaled."""
        what, _, place = self.where.partition(".")
        if what in _IMU:
            return (np.arange(3) == "xyz".index(place)).astype(float)[:, None]
        return np.ones((CHANNELS[channel].width, 1))

    def perturb(self, channel: str, recording: Recording) -> Array:
        """x."""
        return self._scaled(channel) * recording.signals.value[channel]

    def correct(self, channel: str, recording: Recording, p: float) -> Array:
        """y / (1 + g)."""
        return recording.signals.value[channel] / (1.0 + p * self._scaled(channel))

    @property
    def tolerance(self) -> str:
        """The sheet's gain."""
        return "gain"
