"""The geometry and the loads of a recording, point by point: axes, poses, lasers, bench tables, rows that exist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import CORNERS
from daq.errors import RunError
from daq.rig import Rig
from daq.run import Run
from daq.vehicle import Corner, Vehicle
from identify.car import AXLE, CHASSIS, FIRST_JOINT, WHEEL, CarChain, car_chain, kinematics, kingpin_pitch, orientation
from identify.chain import FrameMotion
from identify.filters import Filters
from identify.motion import CornerMotion, Motion
from identify.reconstruct import Recording, Signals, bring_together
from identify.rows import available, needs
from identify.vectors import Array, cross, dot, turn, unit

_CAR = car_chain()


def reconstruct(run: Run, vehicle: Vehicle, rig: Rig, filters: Filters | None = None) -> Motion:
    """The motion of `vehicle` along `run`, measured by `rig`.

    Raises RunError when the run is too short for the filters or has no channel that any row could use.
    """
    return build_motion(bring_together(run, vehicle, rig, filters or Filters()))


def build_motion(recording: Recording) -> Motion:
    """Geometry and loads, point by point: every sample of the motion depends on the same sample of the signals only."""
    grid, signals, vehicle, rig = recording.t, recording.signals, recording.vehicle, recording.rig
    values, reference = signals.value, recording.reference
    n = grid.size
    body = _body_motion(signals, rig, n)
    attitude = _attitude(values, rig)
    road = _Road(signals, rig, vehicle, n)
    normal, flat = road.normal(attitude)
    q, qd, qdd = (np.zeros((_CAR.chain.n, n)) for _ in range(3))
    geometry = {c: _geometry(vehicle.corners[c], signals, road, q, qd, qdd) for c in CORNERS}
    frames = _CAR.chain.propagate(q, qd, qdd, start=CHASSIS, base=_into_frame6(body))
    corners: dict[str, CornerMotion] = {}
    for c, part in geometry.items():
        axle = _turned(_CAR, AXLE[c], frames)
        wheel = frames[WHEEL[c] - 1]
        assert wheel is not None
        spin_axis = turn(2, part.steer, turn(0, part.camber, unit(1) * np.ones(n)))
        tilt = np.sqrt(1.0 - dot(spin_axis, normal) ** 2)
        height = road.height(c, normal, part.centre)
        corners[c] = CornerMotion(
            travel=part.travel,
            rate=part.rate,
            accel=part.accel,
            steer=part.steer,
            camber=part.camber,
            pitch=part.pitch,
            centre=part.centre,
            dp_ds=part.dp_ds,
            dphi_ds=part.dphi_ds,
            axle_dphi_ds=part.axle_dphi_ds,
            force=_load_in_body(values, f"wheel.{c}.force", part, rig, normal, spin_axis),
            moment=_load_in_body(values, f"wheel.{c}.moment", part, rig, normal, spin_axis),
            spin_axis=spin_axis,
            spin=part.spin,
            spin_accel=part.spin_accel,
            normal=normal,
            height=height,
            deflection=vehicle.corners[c].tyre_radius - height / tilt,
            # The road's normal turns so little that its own rate is left out (second order in roll and pitch).
            deflection_rate=-road.height_rate(c) * normal[2] / tilt,
            centre_accel=turn(2, part.steer, turn(0, part.camber, axle.accel)),
            axle=axle,
            wheel=wheel,
        )
    grounds = () if flat else road.grounds
    rows, left_out = available(values, vehicle, reference, recording.brakes, grounds)
    extra = () if not flat else ("fewer than three ground lasers: a flat road and the attitude give the road's normal",)
    return Motion(
        name=recording.run, t=grid, filters=recording.filters, reference=reference, body=body,
        velocity=_velocity(values, rig, body, attitude), attitude=attitude, corners=corners,
        rows=rows, left_out=left_out, usable=_masks(recording, rows, grounds), channels=frozenset(values),
        notes=(*recording.notes, *extra),
    )  # fmt: skip


def _masks(recording: Recording, rows: tuple[str, ...], grounds: tuple[str, ...]) -> dict[str, NDArray[np.bool_]]:
    t, edge = recording.t, recording.filters.edge
    inside = (t - t[0] >= edge) & (t[-1] - t >= edge)
    masks: dict[str, NDArray[np.bool_]] = {}
    for row in rows:
        mask = inside.copy()
        for channel in needs(row, recording.reference, grounds, recording.vehicle):
            mask &= recording.usable.get(channel, True)
        masks[row] = mask
    return masks


def _body_motion(signals: Signals, rig: Rig, n: int) -> FrameMotion:
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


def _attitude(values: Mapping[str, Array], rig: Rig) -> Array | None:
    """Roll, pitch, yaw of the body (3, N)."""
    if "imu.attitude" not in values:
        return None
    sensor = rig.sensor_of("imu.attitude")
    measured = values["imu.attitude"]
    if sensor is None or sensor.axes != "sensor" or not any(sensor.orientation):
        return measured
    # R_ground_body = R_ground_sensor R_sensor_body, taken apart again.
    R = orientation(sensor.orientation).T
    columns = [_to_ground(measured, R[:, [k]]) for k in range(3)]
    (xx, xy, xz), (_, _, yz), (_, _, zz) = columns
    return np.stack([np.arctan2(yz, zz), -np.arcsin(np.clip(xz, -1, 1)), np.unwrap(np.arctan2(xy, xx))])


def _to_ground(attitude: Array, v: Array) -> Array:
    roll, pitch, yaw = attitude
    return turn(2, yaw, turn(1, pitch, turn(0, roll, v * np.ones(roll.size))))


def _velocity(values: Mapping[str, Array], rig: Rig, body: FrameMotion, attitude: Array | None) -> Array | None:
    """Velocity of the body origin in body axes (3, N) [m/s], from the speed sensor at its mount."""
    if "correvit.speed" not in values:
        return None
    vx, vy = values["correvit.speed"]
    v = np.stack([vx, vy, np.zeros_like(vx)])
    sensor = rig.sensor_of("correvit.speed")
    mount = np.zeros((3, 1))
    if sensor is not None:
        mount = np.asarray(sensor.position.get("", (0.0, 0.0, 0.0)))[:, None]
        if sensor.axes == "sensor":
            v = orientation(sensor.orientation) @ v
        elif sensor.axes == "heading" and attitude is not None:
            v = turn(0, -attitude[0], turn(1, -attitude[1], v))
    return v - cross(body.omega, mount)


def _into_frame6(body: FrameMotion) -> FrameMotion:
    T = _CAR.to_body[CHASSIS - 1].T
    return FrameMotion(T @ body.omega, T @ body.omega_dot, T @ body.accel)


def _turned(car: CarChain, number: int, frames: list[FrameMotion | None]) -> FrameMotion:
    """A frame's motion in body-like axes (x forward, y left, z up at zero angles)."""
    frame = frames[number - 1]
    assert frame is not None
    T = car.to_body[number - 1]
    return FrameMotion(T @ frame.omega, T @ frame.omega_dot, T @ frame.accel)


@dataclass(frozen=True)
class _Branch:
    """One corner's geometry before loads."""

    travel: Array
    rate: Array
    accel: Array
    steer: Array
    camber: Array
    pitch: Array
    centre: Array
    dp_ds: Array
    dphi_ds: Array
    axle_dphi_ds: Array
    spin: Array
    spin_accel: Array


def _geometry(corner: Corner, signals: Signals, road: _Road, q: Array, qd: Array, qdd: Array) -> _Branch:
    """Fill the branch's joint positions and derivatives in `q`, `qd`, `qdd`, and give the corner's geometry."""
    c, first = corner.name, FIRST_JOINT[corner.name] - 1
    centre_z, speed, accel = road.centre_z(c)
    n = centre_z.size
    travel = centre_z - corner.position[2]
    table = kinematics(corner, travel)
    zero = np.zeros(n)
    steer, steer_rate, steer_accel = _scalar(signals, f"camera.{c}.steer", zero)
    camber, camber_rate, camber_accel = _scalar(signals, f"camera.{c}.camber", zero)
    spin, spin_accel, _ = _scalar(signals, f"wheel.{c}.speed", zero)
    kingpin, slope, curvature = kingpin_pitch(corner, steer)

    def tabled(k: int, offset: float) -> tuple[Array, Array, Array]:
        s, d, dd = table.change[k], table.slope[k], table.curvature[k]
        return offset + s, d * speed, d * accel + dd * speed**2

    joints = (
        tabled(0, corner.position[1]),
        tabled(1, corner.position[0]),
        (centre_z, speed, accel),
        (steer, steer_rate, steer_accel),
        (camber, camber_rate, camber_accel),
        tabled(4, 0.0),
        (kingpin, slope * steer_rate, slope * steer_accel + curvature * steer_rate**2),
        # The wheel is a balanced body of revolution: its angle does not matter, and stays at zero.
        (zero, spin, spin_accel),
    )
    for k, (position, velocity, acceleration) in enumerate(joints):
        q[first + k], qd[first + k], qdd[first + k] = position, velocity, acceleration
    ones = np.ones(n)
    camber_axis = turn(2, steer, unit(0) * ones)
    pitch_axis = turn(2, steer, turn(0, camber, unit(1) * ones))
    axle_dphi_ds = unit(2) * table.slope[2] + camber_axis * table.slope[3]
    return _Branch(
        travel, speed, accel, steer, camber, joints[5][0] + kingpin,
        centre=np.stack([joints[1][0], joints[0][0], centre_z]),
        dp_ds=np.stack([table.slope[1], table.slope[0], ones]),
        dphi_ds=axle_dphi_ds + pitch_axis * table.slope[4],
        axle_dphi_ds=axle_dphi_ds,
        spin=spin, spin_accel=spin_accel,
    )  # fmt: skip


def _scalar(signals: Signals, channel: str, absent: Array) -> tuple[Array, Array, Array]:
    """A scalar channel with its two derivatives, `absent` where there is none."""
    parts = (part.get(channel) for part in (signals.value, signals.rate, signals.accel))
    value, rate, accel = (absent if part is None else part[0] for part in parts)
    return value, rate, accel


def _load_in_body(
    values: Mapping[str, Array], channel: str, part: _Branch, rig: Rig, normal: Array, spin_axis: Array
) -> Array:
    """A wheel load in body axes (3, N), from the axes the rig declares for it."""
    load = values.get(channel)
    if load is None:
        return np.zeros_like(spin_axis)
    sensor = rig.sensor_of(channel)
    axes = "carrier" if sensor is None else sensor.axes
    if axes == "body":
        return load
    if axes == "tydex_c":  # x parallel to the road, y along the spin axis
        x = cross(spin_axis, normal)
        x = x / np.linalg.norm(x, axis=0)
        return x * load[0] + spin_axis * load[1] + cross(x, spin_axis) * load[2]
    if axes == "heading":
        raise RunError(rig.name, [f"{channel}: wheel loads cannot be in heading axes; use carrier, tydex_c or body"])
    if sensor is not None and axes == "sensor":  # mounted askew in the carrier
        load = orientation(sensor.orientation) @ load
    return turn(2, part.steer, turn(0, part.camber, turn(1, part.pitch, load)))


class _Road:
    """Laser mounts, wheel-centre heights and the road under them."""

    def __init__(self, signals: Signals, rig: Rig, vehicle: Vehicle, n: int):
        self.signals, self.vehicle, self.n = signals, vehicle, n
        self.mount = {c: _laser_mount(rig, vehicle.corners[c]) for c in CORNERS}
        self.grounds = tuple(c for c in CORNERS if f"laser.{c}.ground" in signals.value)

    def centre_z(self, c: str) -> tuple[Array, Array, Array]:
        """Wheel-centre height in body axes [m] and its derivatives, (N,); at design where it is not measured."""
        zero = np.zeros(self.n)
        hub, rate, accel = _scalar(self.signals, f"laser.{c}.hub", zero)
        if f"laser.{c}.hub" not in self.signals.value:
            return zero + self.vehicle.corners[c].position[2], zero, zero
        return self.mount[c][2] - hub, -rate, -accel

    def point(self, c: str) -> Array:
        """(3, N) point of the road under a ground laser, body axes."""
        mount = self.mount[c]
        z = mount[2] - self.signals.value[f"laser.{c}.ground"][0]
        return np.stack([np.full(self.n, mount[0]), np.full(self.n, mount[1]), z])

    def normal(self, attitude: Array | None) -> tuple[Array, bool]:
        """(3, N) unit normal of the plane through the ground-laser points, and whether a flat road was assumed."""
        ones = np.ones(self.n)
        if len(self.grounds) >= 3:
            xy = np.array([[1.0, self.mount[c][0], self.mount[c][1]] for c in self.grounds])
            z = np.stack([self.point(c)[2] for c in self.grounds])
            _, slope_x, slope_y = np.linalg.pinv(xy) @ z
            normal = np.stack([-slope_x, -slope_y, ones])
            return normal / np.linalg.norm(normal, axis=0), False
        if attitude is None:
            return unit(2) * ones, True
        roll, pitch, _ = attitude
        return turn(0, -roll, turn(1, -pitch, unit(2) * ones)), True

    def height(self, c: str, normal: Array, centre: Array) -> Array:
        """(N,) wheel centre (3, N) above the road along its normal [m]."""
        if c not in self.grounds:
            return np.full(self.n, self.vehicle.corners[c].height)
        return dot(centre - self.point(c), normal)

    def height_rate(self, c: str) -> Array:
        """(N,) rate of the wheel centre's height above the road, along body z [m/s]."""
        ground = self.signals.rate.get(f"laser.{c}.ground")
        return np.zeros(self.n) if ground is None else self.centre_z(c)[1] + ground[0]


def _laser_mount(rig: Rig, corner: Corner) -> Array:
    """(3,) where a corner's lasers are mounted, body axes [m]; 0.3 m above the wheel centre where the rig is silent."""
    sensor = rig.sensor_of(f"laser.{corner.name}.hub") or rig.sensor_of(f"laser.{corner.name}.ground")
    centre = np.asarray(corner.position)
    if sensor is not None and corner.name in sensor.position:
        return np.asarray(sensor.position[corner.name])
    offset = (0.0, 0.0, 0.3) if sensor is None or sensor.from_wheel_centre is None else sensor.from_wheel_centre
    return centre + np.asarray(offset)
