"""Torques on the wheels in rows of the equations: which enter, from which channel, and where they are eliminated.

What they are, and their signs: `car.rows`.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.joint_tables import PLACE, JointCurve
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.car.rows import BODY_ROWS, CORNER_ROWS, PRESSURE, SUSPENSION_ROWS, Absence, Row, RowAbsence

SMALL_SLOPE = 0.01
"""Rotation of a half-shaft per unit of travel that is neglected while outboard brakes act [rad/m].

An engine's braking torque of 300 N·m at the wheel then contributes 3 N to the row."""
_LARGE_CAMBER = 0.1
"""Camber with which a carrier's toe change is taken as rotation about the spin axis, where its size matters [rad]."""


@dataclass(frozen=True)
class Torque:
    """Torques on a wheel in one row of the equations.

    Attributes
    ----------
    shaft, brake : channel of the torque that enters, or empty where it is zero or not in the row.
    eliminated : whether the half-shaft's torque is eliminated from a suspension row by means of the spin row.
    released : whether the row holds only while the brakes are released, as `PRESSURE` shows.
    missing : why the row cannot be formed; None where it can.
    corners : of a row that contains suspension rows, the torques in these by corner; of a suspension row, that on the
        axle's other wheel, where it moves with this one's travel.
    """

    shaft: str = ""
    brake: str = ""
    eliminated: bool = False
    released: bool = False
    missing: RowAbsence | None = None
    corners: Mapping[str, Torque] = field(default_factory=dict[str, "Torque"])

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels the row needs for its torques."""
        own = (name for name in (self.shaft, self.brake, PRESSURE if self.released else "") if name)
        return tuple(dict.fromkeys([*own, *(name for one in self.corners.values() for name in one.channels)]))


def torque_in(row: Row, vehicle: Vehicle, measured: Container[str], brakes: str) -> Torque:
    """The torques on the wheel in `row`, with the channels `measured` and the brakes as the run declares them."""
    if row.kind == "suspension":
        corner, other = (vehicle.corners[c] for c in (row.place, other_corner(row.place)))
        own = _suspension_torque(corner, _shaft_slope(corner), measured, brakes)
        if not other.follows_other:
            return own
        return _with(own, {other.name: _suspension_torque(other, _shaft_slope_by_other(other), measured, brakes)})
    if row.kind == "spin":
        return _spin_torque(vehicle.corners[row.place], measured, brakes)
    if row.kind == "corner":
        own = f"suspension.{row.place}"
        return _with(Torque(), {row.place: torque_in(Row.parse(own), vehicle, measured, brakes)})
    if row.kind == "body":
        return _with(Torque(), {r.place: torque_in(r, vehicle, measured, brakes) for r in SUSPENSION_ROWS})
    return Torque()


def torque_on_carrier(corner: Corner, measured: Container[str], brakes: str) -> Torque:
    """Torques on a wheel that do work on a pitch of its carrier with travel, whether a table has one or not."""
    found = _suspension_torque(corner, np.inf, measured, brakes)
    return Torque(eliminated=True) if found.missing is not None else found


def _with(own: Torque, each: Mapping[str, Torque]) -> Torque:
    """A row's own torques, with those of corners in it."""
    missing = next((one.missing for one in (own, *each.values()) if one.missing), None)
    released = any(one.released for one in (own, *each.values()))
    return replace(own, released=released, missing=missing, corners=each)


def suspension_torque(rows: Mapping[Row, Torque], corner: str) -> Torque:
    """The torques in a corner's suspension row, by itself or as a part of a combined row, of `rows` → their torques."""
    found = rows.get(SUSPENSION_ROWS[CORNERS.index(corner)])
    combined = (rows[row].corners for row in (*BODY_ROWS, *CORNER_ROWS) if row in rows)
    bodies = (corners[corner] for corners in combined if corner in corners)
    return found or next(bodies, Torque())


def _suspension_torque(corner: Corner, slope: float, measured: Container[str], brakes: str) -> Torque:
    """Torques on a wheel in a suspension row; `slope` : largest n·∂φ/∂s of it in that row [rad/m]."""
    shaft, brake = f"shaft.{corner.name}.torque", f"brake.{corner.name}.torque"
    inboard = corner.brakes == "inboard"
    if slope == 0.0:
        return Torque()
    if shaft in measured:
        return Torque(shaft=shaft)
    if not (corner.driven or inboard):
        return Torque()
    if inboard:
        return Torque(eliminated=True)
    if brakes == "off":
        return Torque(eliminated=True, released=PRESSURE in measured)
    if brake in measured:
        return Torque(brake=brake, eliminated=True)
    if slope < SMALL_SLOPE:
        return Torque()
    if PRESSURE in measured:
        return Torque(eliminated=True, released=True)
    return Torque(missing=RowAbsence(Absence.SHAFT_TORQUE, (shaft, brake, PRESSURE), brakes))


def _spin_torque(corner: Corner, measured: Container[str], brakes: str) -> Torque:
    shaft, brake = f"shaft.{corner.name}.torque", f"brake.{corner.name}.torque"
    by_shaft = corner.brakes == "inboard"  # the brake's torque is in the half-shaft's
    if shaft not in measured and corner.driven:
        beside = None if by_shaft else _brake_torque(shaft, brake, measured, brakes).missing
        return Torque(missing=RowAbsence(Absence.DRIVE_TORQUE, (shaft,), beside=beside))
    if shaft not in measured:
        shaft = ""
    elif by_shaft:
        return Torque(shaft=shaft)
    return _brake_torque(shaft, brake, measured, brakes)


def _brake_torque(shaft: str, brake: str, measured: Container[str], brakes: str) -> Torque:
    """Torques on a wheel with an outboard brake in its spin row, the half-shaft's measured or none."""
    if brakes == "off":
        return Torque(shaft=shaft, released=PRESSURE in measured)
    if brake in measured:
        return Torque(shaft=shaft, brake=brake)
    if PRESSURE in measured:
        return Torque(shaft=shaft, released=True)
    return Torque(missing=RowAbsence(Absence.BRAKE_TORQUE, (brake, PRESSURE), brakes))


def _shaft_slope(corner: Corner) -> float:
    """Largest rotation of the carrier about the spin axis per unit of travel by its table, n·∂φ/∂s [rad/m]."""
    if corner.joints is not None:
        return _curve_slope(corner.joints.own)
    if corner.table is None:
        return 0.0
    travel = corner.table.travel
    pitch, toe = (np.max(np.abs(np.gradient(column, travel))) for column in (corner.table.pitch, corner.table.toe))
    return float(pitch + _LARGE_CAMBER * toe)


def _shaft_slope_by_other(corner: Corner) -> float:
    """The same per unit of the other wheel's travel."""
    return 0.0 if corner.joints is None or corner.joints.other is None else _curve_slope(corner.joints.other)


def _curve_slope(curve: JointCurve) -> float:
    slope = np.max(np.abs(np.gradient(curve.values, curve.at, axis=0)), axis=0)
    return float(slope[PLACE["pitch"]] + _LARGE_CAMBER * slope[PLACE["toe"]])
