"""Sensor mounting: rotations from sensor to body axes; attitude as rotation matrices and as angles [rad]."""

from __future__ import annotations

import numpy as np

from lacet.daq.rig import Rig
from lacet.identify.multibody.vectors import Array, rpy, turn, unit


def sensor_to_body(rig: Rig, channel: str) -> Array:
    """3 × 3 rotation from the axes a channel's vector is delivered in to body axes, for a sensor fixed to the body.

    It is the identity where the rig declares other axes than the sensor's own. Specific force and rates come from one
    instrument and have one mounting.
    """
    sensor = rig.sensor_of(channel)
    if channel.startswith("imu.") and channel != "imu.attitude":
        sensor = rig.sensor_of("imu.accel") or rig.sensor_of("imu.rate")
    return np.eye(3) if sensor is None or sensor.axes != "sensor" else rpy(*sensor.orientation)


def attitude_matrix(attitude: Array) -> Array:
    """Rotations Rz(yaw) Ry(pitch) Rx(roll), (3, 3, N), of roll, pitch, yaw (3, N) [rad]."""
    roll, pitch, yaw = attitude
    axes = (unit(k) * np.ones(roll.size) for k in range(3))
    return np.stack([turn(2, yaw, turn(1, pitch, turn(0, roll, axis))) for axis in axes], axis=1)


def attitude_angles(R: Array, near: Array) -> Array:
    """Roll, pitch, yaw (3, N) [rad] of rotations (3, 3, N); yaw unwrapped to within half a turn of `near` (3, N)."""
    roll = np.arctan2(R[2, 1], R[2, 2])
    pitch = -np.arcsin(np.clip(R[2, 0], -1.0, 1.0))
    yaw = np.arctan2(R[1, 0], R[0, 0])
    turns = np.rint((near[2] - yaw) / (2.0 * np.pi))
    return np.stack([roll, pitch, yaw + 2.0 * np.pi * turns])


def small_turn(axis: Array, attitude: Array) -> Array:
    """Derivative of roll, pitch, yaw (3, N) by the angle of a rotation about `axis` (3,) of the rotating frame."""
    roll, pitch, _ = attitude
    across = axis[1] * np.sin(roll) + axis[2] * np.cos(roll)
    return np.stack(
        [axis[0] + across * np.tan(pitch), axis[1] * np.cos(roll) - axis[2] * np.sin(roll), across / np.cos(pitch)]
    )


def turned(axis: int, angle: float) -> Array:
    """3 × 3 rotation by `angle` [rad] about body axis 0, 1 or 2."""
    angles = [0.0, 0.0, 0.0]
    angles[axis] = angle
    return rpy(*angles)
