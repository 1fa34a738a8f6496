"""Kinematics of the car along a recording, sample by sample: poses, laser distances, bench tables, wheel loads."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.car.body_motion import body_attitude, body_motion
from lacet.identify.car.car_tree import (
    CARRIER,
    CHASSIS,
    FIRST_JOINT,
    WHEEL,
    CarChain,
    car_chain,
    carrier_axes,
    orientation,
)
from lacet.identify.car.compliance import joints_under_load
from lacet.identify.car.measured_rows import MeasuredRows
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.car.road import Road, RoadPlane
from lacet.identify.car.rows import Row
from lacet.identify.car.sources.completion import completed
from lacet.identify.car.sources.nominal_load import known_masses, known_parameters
from lacet.identify.car.torques import Torque, suspension_torque, torque_on_carrier
from lacet.identify.car.wheel_joints import WheelJoints
from lacet.identify.car.wheel_load import load_in_body, pitches
from lacet.identify.multibody.chain import FrameMotion
from lacet.identify.multibody.vectors import Array, cross, dot, turn, turned, unit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import Recording, Signals, bring_together

_CAR = car_chain()


def reconstruct(run: Run, vehicle: Vehicle, rig: Rig, filters: Filters | None = None) -> Motion:
    """The motion of `vehicle` along `run`, measured by `rig`.

    Raises RunError when the run is too short for the filters or has no channel that any row could use.
    """
    return build_motion(completed(bring_together(run, vehicle, rig, filters or Filters())))


def build_motion(
    recording: Recording, still: Motion | None = None, moved: Collection[str] = CORNERS,
    measured: MeasuredRows | None = None,
) -> Motion:  # fmt: skip
    """The motion of a recording: each sample depends on the same sample of the signals only.

    Parameters
    ----------
    still : a motion that differs by channels of the corners `moved` alone, ground lasers apart: other corners are its.
    measured : the rows that the recording measures, where they are known already.
    """
    grid, signals, vehicle, rig = recording.t, recording.completed, recording.vehicle, recording.rig
    values, measured = signals.value, measured or MeasuredRows.of(recording)
    n = grid.size
    body = body_motion(signals, rig, n)
    attitude = body_attitude(values, rig)
    road = Road(signals, rig, vehicle, n)
    plane = road.plane(attitude, body.omega)
    q, qd, qdd = (np.zeros((_CAR.chain.n, n)) for _ in range(3))
    joints = joints_under_load(recording, road, plane, moved)
    geometry = {c: _geometry(vehicle.corners[c], signals, road, table, q, qd, qdd) for c, table in joints.items()}
    wheels = [WHEEL[c] for c in geometry]
    frames = _CAR.chain.propagate(q, qd, qdd, start=CHASSIS, base=_into_frame6(body), wanted=wheels)
    corners = dict(still.corners) if still else {}
    for c, part in geometry.items():
        on_carrier = torque_on_carrier(vehicle.corners[c], recording.signals.value, recording.brakes)
        corners[c] = _corner(vehicle.corners[c], part, frames, road, plane, measured.torques, on_carrier, recording)
    road_height = float(np.mean([corner.position[2] - corner.height for corner in vehicle.corners.values()]))
    return Motion(
        name=recording.run, t=grid, filters=recording.filters, reference=recording.reference, body=body,
        velocity=body_velocity(values, rig, body, attitude), attitude=attitude, corners=corners,
        rows=tuple(measured.torques), left_out=measured.left_out, usable=measured.usable,
        channels=frozenset(recording.signals.value), notes=(*recording.notes, *measured.notes), ahead=measured.ahead,
        masses=known_masses(recording), known=known_parameters(recording), road_height=road_height,
        pitching=frozenset(c for c in CORNERS if pitches(f"wheel.{c}.force", recording)),
        derived=frozenset(law.channel for law in recording.laws),
    )  # fmt: skip


def _corner(
    corner: Corner, part: _Branch, frames: Sequence[FrameMotion | None], road: Road, plane: RoadPlane,
    rows: Mapping[Row, Torque], on_carrier: Torque, recording: Recording,
) -> CornerMotion:  # fmt: skip
    """One corner's motion and loads, from its geometry and the motion of the chain's frames."""
    c, values, spin_axis, normal = corner.name, road.signals.value, part.spin_axis, plane.normal
    axle, wheel = _turned(_CAR, CARRIER[c], frames), frames[WHEEL[c] - 1]
    assert wheel is not None
    lean, lean_rate = dot(spin_axis, normal), dot(part.spin_axis_rate, normal) + dot(spin_axis, plane.rate)
    tilt = np.sqrt(1.0 - lean**2)
    height, height_rate = road.height(c, plane, part.centre, part.velocity)
    torques = _torques(c, part.dphi_ds, spin_axis, rows, values)
    moment = load_in_body(values, f"wheel.{c}.moment", part.axes, recording, normal)
    turned_by, other_torques = _worked(on_carrier, spin_axis, spin_axis, values)
    by_other = None
    if part.other_dphi_ds is not None:
        by_other = _torques_by_other(c, part.other_dphi_ds, spin_axis, rows, values)
    return CornerMotion(
        travel=part.travel,
        rate=part.rate,
        accel=part.accel,
        steer=part.steer,
        camber=part.camber,
        pitch=part.pitch,
        axes=part.axes,
        centre=part.centre,
        shift=part.centre - np.array(corner.position)[:, None],
        dp_ds=part.dp_ds,
        dphi_ds=part.dphi_ds,
        wheel_dphi_ds=torques[0],
        torque_work=torques[1],
        torque=torques[2],
        torque_on_carrier=dot(moment, turned_by) + other_torques,
        wheel_on_carrier=np.full_like(part.travel, 0.0 if on_carrier.eliminated else 1.0),
        force=load_in_body(values, f"wheel.{c}.force", part.axes, recording, normal),
        moment=moment,
        spin_axis=spin_axis,
        spin=part.spin,
        spin_accel=part.spin_accel,
        normal=normal,
        height=height,
        deflection=corner.tyre_radius - height / tilt,
        deflection_rate=-height_rate / tilt - height * lean * lean_rate / tilt**3,
        centre_accel=turned(part.axes, axle.accel),
        axle=axle,
        wheel=wheel,
        conditional=road.conditional_travel(c),
        other_dp_ds=part.other_dp_ds,
        other_dphi_ds=part.other_dphi_ds,
        other_wheel_dphi_ds=None if by_other is None else by_other[0],
        other_torque_work=None if by_other is None else by_other[1],
    )


def _torques(
    c: str, dphi_ds: Array, spin_axis: Array, rows: Mapping[Row, Torque], values: Mapping[str, Array]
) -> tuple[Array, Array, Array]:
    """Rotation of the wheel per unit of travel in the suspension row, work of its torque, torque in the spin row.

    Sources: `car.rows`. Where the half-shaft's torque is eliminated, the brake's replaces it.
    """
    in_spin = rows.get(Row.parse(f"spin.{c}"), Torque())
    turned, work = _worked(suspension_torque(rows, c), dphi_ds, spin_axis, values)
    n = spin_axis.shape[1]
    return turned, work, _torque(in_spin.shaft, values, n) - _torque(in_spin.brake, values, n)


def _torques_by_other(
    c: str, dphi_ds: Array, spin_axis: Array, rows: Mapping[Row, Torque], values: Mapping[str, Array]
) -> tuple[Array, Array]:
    """Rotation of the wheel per unit of the other wheel's travel in that one's suspension row, work of its torque."""
    in_suspension = suspension_torque(rows, other_corner(c)).corners.get(c, Torque())
    return _worked(in_suspension, dphi_ds, spin_axis, values)


def _worked(of: Torque, dphi_ds: Array, spin_axis: Array, values: Mapping[str, Array]) -> tuple[Array, Array]:
    about_axis = dot(spin_axis, dphi_ds)
    turned = dphi_ds - spin_axis * about_axis if of.eliminated else dphi_ds
    n = spin_axis.shape[1]
    return turned, about_axis * (_torque(of.shaft, values, n) + _torque(of.brake, values, n))


def _torque(channel: str, values: Mapping[str, Array], n: int) -> Array:
    return values[channel][0] if channel else np.zeros(n)


def body_velocity(
    values: Mapping[str, Array], rig: Rig, body: FrameMotion, attitude: Array | None
) -> Array | None:  # fmt: skip
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


def _turned(car: CarChain, number: int, frames: Sequence[FrameMotion | None]) -> FrameMotion:
    """A frame's motion in body-like axes (x forward, y left, z up at zero angles)."""
    frame = frames[number - 1]
    assert frame is not None
    T = car.to_body[number - 1]
    return FrameMotion(T @ frame.omega, T @ frame.omega_dot, T @ frame.accel)


@dataclass(frozen=True)
class _Branch:
    """Geometry of one corner before loads."""

    travel: Array
    rate: Array
    accel: Array
    steer: Array
    camber: Array
    pitch: Array
    axes: Array
    centre: Array
    velocity: Array
    dp_ds: Array
    dphi_ds: Array
    other_dp_ds: Array | None
    other_dphi_ds: Array | None
    spin_axis: Array
    spin_axis_rate: Array
    spin: Array
    spin_accel: Array


def _geometry(
    corner: Corner, signals: Signals, road: Road, table: WheelJoints, q: Array, qd: Array, qdd: Array
) -> _Branch:
    """The geometry of a corner; the branch's joint positions and derivatives are entered in `q`, `qd`, `qdd`."""
    c, first = corner.name, FIRST_JOINT[corner.name] - 1
    centre_z, speed, accel = road.centre_z(c)
    n = centre_z.size
    travel = centre_z - corner.position[2]
    zero = np.zeros(n)
    steer, steer_rate, steer_accel = signals.scalar(f"camera.{c}.steer", n)
    camber, camber_rate, camber_accel = signals.scalar(f"camera.{c}.camber", n)
    spin, spin_accel, _ = signals.scalar(f"wheel.{c}.speed", n)
    joints = (
        table.half_track,
        table.half_wheelbase,
        (centre_z, speed, accel),
        (steer, steer_rate, steer_accel),
        (camber, camber_rate, camber_accel),
        table.pitch,
        table.kingpin,
        # The wheel is a balanced body of revolution: its angle has no influence and stays zero.
        (zero, spin, spin_accel),
    )
    for k, (position, velocity, acceleration) in enumerate(joints):
        q[first + k], qd[first + k], qdd[first + k] = position, velocity, acceleration
    pitch = table.pitch[0] + table.kingpin[0]
    axes = carrier_axes(steer, camber, pitch)
    camber_axis, spin_axis = np.stack([np.cos(steer), np.sin(steer), zero]), axes[:, 1]

    def turned_by(slope: Array) -> Array:
        return unit(2) * slope[2] + camber_axis * slope[3] + spin_axis * slope[4]

    by, by_other = table.by_own, table.by_other
    dp_ds = np.stack([by[1], by[0], np.ones(n)])
    return _Branch(
        travel, speed, accel, steer, camber, pitch, axes,
        centre=np.stack([table.half_wheelbase[0], table.half_track[0], centre_z]),
        velocity=dp_ds * speed if table.velocity is None else np.stack([*table.velocity, speed]),
        dp_ds=dp_ds,
        dphi_ds=turned_by(by),
        other_dp_ds=None if by_other is None else np.stack([by_other[1], by_other[0], zero]),
        other_dphi_ds=None if by_other is None else turned_by(by_other),
        spin_axis=spin_axis,
        spin_axis_rate=cross(unit(2) * steer_rate + camber_axis * camber_rate, spin_axis),
        spin=spin, spin_accel=spin_accel,
    )  # fmt: skip
