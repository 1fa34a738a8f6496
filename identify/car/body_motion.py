"""Motion of the body axes' origin, from the inertial unit at its mount, and the body's attitude."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lacet.daq.rig import Rig
from lacet.identify.car.car_tree import orientation
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.multibody.vectors import Array, cross, turn, unit
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


def body_attitude(values: Mapping[str, Array], rig: Rig) -> Array | None:
    """Roll, pitch, yaw of the body (3, N) [rad], or None where they are not measured."""
    if "imu.attitude" not in values:
        return None
    sensor = rig.sensor_of("imu.attitude")
    measured = values["imu.attitude"]
    if sensor is None or sensor.axes != "sensor" or not any(sensor.orientation):
        return measured
    # R_ground_body = R_ground_sensor R_sensor_body, as angles again.
    R = orientation(sensor.orientation).T
    columns = [_to_ground(measured, R[:, [k]]) for k in range(3)]
    (xx, xy, xz), (_, _, yz), (_, _, zz) = columns
    return np.stack([np.arctan2(yz, zz), -np.arcsin(np.clip(xz, -1, 1)), np.unwrap(np.arctan2(xy, xx))])


def _to_ground(attitude: Array, v: Array) -> Array:
    roll, pitch, yaw = attitude
    return turn(2, yaw, turn(1, pitch, turn(0, roll, v * np.ones(roll.size))))


def vertical(attitude: Array | None, n: int) -> Array:
    """(3, N) the vertical in body axes, by roll, pitch and yaw (3, N) [rad]; a body of no known attitude is level."""
    up = unit(2) * np.ones(n)
    return up if attitude is None else turn(0, -attitude[0], turn(1, -attitude[1], up))
