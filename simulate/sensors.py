"""Ideal sensor signals of a simulated motion at its own rate: mounting, axes and constant faults, no noise.

Signs are those of the channels' vocabulary (``docs/channels.md``), axes those that the rig file declares.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.errors import UsageError
from lacet.daq.rig import Rig, Sensor
from lacet.simulate.hidden import Hidden, total_of
from lacet.simulate.motion import CarMotion, euler_zyx, rotate, rotate_back

Array = NDArray[np.float64]

BRAKE_TORQUE_PER_PASCAL = 25.0 / 1e5
"""Torque of a front brake per pressure [N·m/Pa]: 25 N·m a bar, usual for a disc of a passenger car."""

DEFAULT_MOUNT = (0.0, 0.0, 0.30)
"""Default position of a laser relative to the design wheel centre [m]."""


def pose_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """(3, 3) R = Rz(yaw)·Ry(pitch)·Rx(roll)."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def felt(motion: CarMotion, rig: Rig, faults: Sequence[Hidden] = ()) -> dict[str, Array]:
    """Ideal signals of the sensors of `rig`, channel → (N, k), at the motion's instants: no latency, noise or zeros.

    `faults` : misalignment, position, cross-talk and tilted beams are applied here, the others in `simulate.measuring`.
    Raises UsageError when the rig declares axes that a channel cannot have.
    """
    out: dict[str, Array] = {}
    for sensor in rig.sensors:
        families = {CHANNELS[name].family for name in sensor.channels}
        made: dict[str, Array] = {}
        if any(family.startswith("wheel.") for family in families):
            made |= _wheels(motion, rig.wheel_reference, sensor, faults)
        if any(family.startswith("imu.") for family in families):
            made |= _imu(motion, sensor, faults)
        if any(family.startswith("laser.") for family in families):
            made |= _lasers(motion, sensor, faults)
        if any(family.startswith("camera.") for family in families):
            made |= {f"camera.{c}.steer": motion.steer[:, i : i + 1] for i, c in enumerate(CORNERS)}
            made |= {f"camera.{c}.camber": motion.camber[:, i : i + 1] for i, c in enumerate(CORNERS)}
        if families & {"shaft.torque", "brake.torque", "brake.pressure"}:
            made |= _torques(motion)
        if "correvit.speed" in families:
            made |= _correvit(motion, sensor, faults)
        out |= {name: made[name] for name in sensor.channels}
    return out


def _axes_error(sensor: Sensor, allowed: str) -> UsageError:
    return UsageError(f"sensor {sensor.name}: its data cannot be given in '{sensor.axes}' axes, only in {allowed}")


def _turned(faults: Sequence[Hidden], part: str) -> Array:
    """Misalignment of a sensor relative to the rig file, (3, 3) R_nominal_true."""
    name = f"sensor_misalignment.{part}"
    angles = (sum(f.size for f in faults if f.name == f"{name}.{axis}") for axis in ("roll", "pitch", "yaw"))
    return pose_matrix(*angles)


def _wheels(motion: CarMotion, reference: str, sensor: Sensor, faults: Sequence[Hidden]) -> dict[str, Array]:
    force, moment = (motion.force, motion.moment) if reference == "contact" else motion.hub
    if sensor.axes == "carrier":
        R = motion.carrier_attitude
    elif sensor.axes == "body":
        R = np.broadcast_to(np.eye(3), (len(motion.t), 4, 3, 3))
    elif sensor.axes == "tydex_c":
        n, e = motion.carrier_attitude[..., 1], motion.normal[:, None, :]
        x = np.cross(n, e)
        x /= np.linalg.norm(x, axis=-1, keepdims=True)
        R = np.asarray(np.stack([x, n, np.cross(x, n)], axis=-1), np.float64)
    else:
        raise _axes_error(sensor, "carrier, body or tydex_c")
    force, moment = rotate_back(R, force), rotate_back(R, moment)
    talks = [f for f in faults if f.effect == "sensor_crosstalk"]
    if talks:
        true, force = force, force.copy()
        for fault in talks:
            at = [i for i, c in enumerate(CORNERS) if fault.where in (c, "wheel.force")]
            for j, name in enumerate("xy"):
                force[:, at, j] += fault.size * fault.shape[name] * true[:, at, 2]
                force[:, at, 2] += fault.size * fault.shape[f"z{name}"] * true[:, at, j]
    out: dict[str, Array] = {}
    for i, corner in enumerate(CORNERS):
        out[f"wheel.{corner}.force"], out[f"wheel.{corner}.moment"] = force[:, i], moment[:, i]
        out[f"wheel.{corner}.angle"] = motion.spin[:, 0, i : i + 1]
        out[f"wheel.{corner}.speed"] = motion.spin[:, 1, i : i + 1]
    return out


def _mount(sensor: Sensor) -> Array:
    return np.asarray(sensor.position.get("", (0.0, 0.0, 0.0)), float)


def _imu(motion: CarMotion, sensor: Sensor, faults: Sequence[Hidden]) -> dict[str, Array]:
    if sensor.axes not in ("sensor", "body"):
        raise _axes_error(sensor, "sensor or body")
    own = pose_matrix(*sensor.orientation) if sensor.axes == "sensor" else np.eye(3)
    R = own @ _turned(faults, "imu")
    mount = _mount(sensor) + [total_of(faults, f"sensor_position.imu.{axis}") for axis in "xyz"]
    acceleration = motion.at(mount[None, :])[1][:, 0]
    return {
        "imu.accel": rotate_back(R, acceleration - motion.gravity),
        "imu.rate": rotate_back(R, motion.turn),
        "imu.attitude": euler_zyx(motion.level_attitude @ R),
    }


def _lasers(motion: CarMotion, sensor: Sensor, faults: Sequence[Hidden]) -> dict[str, Array]:
    out: dict[str, Array] = {}
    tilt = pose_matrix(total_of(faults, "laser_tilt.roll"), total_of(faults, "laser_tilt.pitch"), 0.0)
    for i, corner in enumerate(CORNERS):
        if corner in sensor.position:
            mount = np.asarray(sensor.position[corner], float)
        else:
            offset = DEFAULT_MOUNT if sensor.from_wheel_centre is None else sensor.from_wheel_centre
            mount = motion.car.wheel_centres[i] + np.asarray(offset)
        on_rear = motion.twisted and corner[0] == "r"
        hub = mount[2] - motion.own_wheel_centres[:, i, 2]
        start = motion.position + rotate(motion.attitude, motion.on_rear(mount) if on_rear else mount)
        attitude = motion.attitude @ motion.rear_attitude if on_rear else motion.attitude
        beam = (attitude @ tilt)[:, :, 2]  # opposite to the light's direction
        distance = hub + motion.distance[:, i]
        if not motion.road.flat:
            for _ in range(3):
                ground = motion.road.height(start[:, 0] - distance * beam[:, 0], corner[1])
                distance = (start[:, 2] - ground) / beam[:, 2]
        else:
            distance = start[:, 2] / beam[:, 2]
        out[f"laser.{corner}.ground"] = distance[:, None]
        out[f"laser.{corner}.hub"] = hub[:, None]
    return out


def _torques(motion: CarMotion) -> dict[str, Array]:
    out = {f"shaft.{c}.torque": motion.shaft[:, i : i + 1] for i, c in enumerate(CORNERS)}
    out |= {f"brake.{c}.torque": motion.brake[:, i : i + 1] for i, c in enumerate(CORNERS)}
    drag = [motion.car.axle(c).brake_drag for c in CORNERS[:2]]  # without pressure
    front = np.mean(np.maximum(np.abs(motion.brake[:, :2]) - drag, 0.0), axis=1)
    return out | {"brake.pressure": (front / BRAKE_TORQUE_PER_PASCAL)[:, None]}


def _correvit(motion: CarMotion, sensor: Sensor, faults: Sequence[Hidden]) -> dict[str, Array]:
    if sensor.axes not in ("sensor", "body", "heading"):
        raise _axes_error(sensor, "sensor, body or heading")
    velocity = motion.at(_mount(sensor)[None, :])[0][:, 0]
    wrong = _turned(faults, "correvit")
    if sensor.axes == "heading":
        yaw = euler_zyx(motion.level_attitude)[:, 2]
        ground = rotate(motion.level_attitude, velocity)
        c, s = np.cos(yaw), np.sin(yaw)
        along, across = c * ground[:, 0] + s * ground[:, 1], -s * ground[:, 0] + c * ground[:, 1]
        velocity = np.stack([along, across, ground[:, 2]], axis=1)
        return {"correvit.speed": rotate_back(wrong, velocity)[:, :2]}
    own = pose_matrix(*sensor.orientation) if sensor.axes == "sensor" else np.eye(3)
    return {"correvit.speed": rotate_back(own @ wrong, velocity)[:, :2]}
