"""Misalignment: instruments rotated against the orientation in the rig file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Parameter, SensorFault
from lacet.identify.multibody.vectors import Array, cross, unit
from lacet.identify.signals.mounting import attitude_angles, attitude_matrix, sensor_to_body, small_turn, turned
from lacet.identify.signals.reconstruct import Recording

_AXIS = {"roll": 0, "pitch": 1, "yaw": 2}


class SensorMisalignment(SensorFault):
    """An instrument turned by a small angle against what the rig says, about an axis of the body (or of the carrier).

    - ``imu.roll``, ``imu.pitch``, ``imu.yaw``: specific force, rates and attitude together;
    - ``correvit.yaw``: the velocity;
    - ``wheel.fl.pitch`` …: a dynamometer whose angle encoder is zeroed askew: force and moment about the spin axis;
    - ``camera.yaw``: the axes all four steer angles count from (a common toe of all wheels).

    The inertial unit turned in yaw is all wheel angles turned the other way (``camera.yaw``); turned in pitch it reads
    a part of gravity, which looks like drag at a constant speed.
    """

    name = "sensor_misalignment"
    about = "an instrument turned against what the rig file says"
    signature = "one axis' rows follow what belongs to the next axis"
    shown_by = "cornering and braking in the same set of runs; large accelerations"
    source = "Titterton and Weston (2004), Strapdown Inertial Navigation Technology (error analysis)"
    looks_like = ("aero_drag",)

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """The inertial unit about each axis, the speed sensor, each dynamometer's encoder, the cameras' axes."""
        wheels = [f"wheel.{c}.pitch" for c in vehicle.corners]
        return [cls(where) for where in (*(f"imu.{name}" for name in _AXIS), "correvit.yaw", *wheels, "camera.yaw")]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Angle by which the instrument is turned, beyond the rig's."""
        return (self.named("angle", "rad", -0.1, 0.1),)

    @property
    def axis(self) -> int:
        """The axis it is turned about: 0 x, 1 y, 2 z."""
        return _AXIS[self.where.rpartition(".")[2]]

    def channels(self) -> tuple[str, ...]:
        """All vectors of the instrument."""
        part, _, rest = self.where.partition(".")
        match part:
            case "imu":
                return ("imu.accel", "imu.rate", "imu.attitude")
            case "correvit":
                return ("correvit.speed",)
            case "camera":
                return tuple(f"camera.{c}.steer" for c in CORNERS)
            case _:
                corner = rest.partition(".")[0]
                return (f"wheel.{corner}.force", f"wheel.{corner}.moment")

    def perturb(self, channel: str, recording: Recording) -> Array:
        """−e × v in the instrument's axes, e the axis it is turned about."""
        value = recording.signals.value[channel]
        if CHANNELS[channel].family == "camera.steer":
            return -np.ones_like(value)
        axis = sensor_to_body(recording.rig, channel).T @ unit(self.axis)
        if channel == "imu.attitude":
            return small_turn(axis[:, 0], value)
        return -cross(axis, _vector(value))[: len(value)]

    def correct(self, channel: str, recording: Recording, p: float) -> Array:
        """Turned back, whatever the angle."""
        value = recording.signals.value[channel]
        if CHANNELS[channel].family == "camera.steer":
            return value + p
        R = sensor_to_body(recording.rig, channel)
        back = R.T @ turned(self.axis, p) @ R
        if channel == "imu.attitude":
            return attitude_angles(np.einsum("ijn,jk->ikn", attitude_matrix(value), back.T), value)
        return (back @ _vector(value))[: len(value)]

    @property
    def tolerance(self) -> str:
        """The sheet's misalignment."""
        return "misalignment"


def _vector(value: Array) -> Array:
    """(3, N) from what may be a vector in the plane (2, N)."""
    return value if len(value) == 3 else np.concatenate([value, np.zeros((1, value.shape[1]))])
