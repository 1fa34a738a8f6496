"""Motion of the body axes' origin, from the inertial unit at its mount."""

from __future__ import annotations

import numpy as np

from lacet.daq.rig import Rig
from lacet.identify.car.car_tree import orientation
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.multibody.vectors import cross
from lacet.identify.signals.reconstruct import Signals


def body_motion(signals: Signals, rig: Rig, n: int) -> FrameMotion:
    """Specific force and rates of the body origin, from the inertial unit at its mount."""
    values, zero = signals.value, np.zeros((3, n))
    if "imu.rate" not in values:  # the specific force at the origin needs the rates too
        return FrameMotion(zero, zero, zero)
    sensor = rig.sensor_of("imu.accel") or rig.sensor_of("imu.rate")
    R = np.eye(3) if sensor is None or sensor.axes != "sensor" else orientation(sensor.orientation)
    r = np.zeros((3, 1))
    if sensor is not None:
        r = np.asarray(sensor.position.get("", (0.0, 0.0, 0.0)))[:, None]
    omega, omega_dot = R @ values["imu.rate"], R @ signals.rate["imu.rate"]
    if "imu.accel" not in values:
        return FrameMotion(omega, omega_dot, zero)
    force = R @ values["imu.accel"]
    return FrameMotion(omega, omega_dot, force - cross(omega_dot, r) - cross(omega, cross(omega, r)))
