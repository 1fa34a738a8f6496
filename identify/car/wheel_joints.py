"""Joints of a wheel along a motion, from the bench tables of its corner: places, derivatives, slopes by travel.

Without joint tables a joint is T(s) of the bump table, s the wheel's own travel. With them it is T(s, s', r) = own(s) +
other(s') + rack(r) + product s s' + rack_product s r, s' the travel of the axle's other wheel, r the rack's: slopes
are at a fixed rack.
The rack is that at which the wheel has its measured steer: what the tie rod gives beside its bench's compliance counts
as rack, and turns the wheel about the same kingpin. The table of the rack then stands in place of the kingpin's axis.
What loads change is added to T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.joint_tables import TOE, JointCurve, JointTables
from lacet.daq.vehicle import Corner
from lacet.identify.car.car_tree import kinematics, kingpin_pitch, table_signs
from lacet.identify.car.motion import Course
from lacet.identify.car.table_errors import SlopeErrors
from lacet.identify.multibody.vectors import Array

_ROUNDS = 8
"""Steps of Newton's method for the rack; its start is the table's own line, so that four are enough."""


@dataclass(frozen=True)
class WheelJoints:
    """Joints of one wheel that follow from its tables.

    Attributes
    ----------
    half_track, half_wheelbase, pitch : y and x of the wheel centre [m]; pitch with travel and, by a table of it, with
        the rack [rad].
    steer, camber : changes in the same way [rad].
    kingpin : pitch from steering about the kingpin's axis, where no table of the rack has it [rad].
    by_own : (5, N) slopes of y, x, steer, camber, pitch by the wheel's own travel.
    by_other : the same by the travel of the axle's other wheel; None where it does not move with it.
    velocity : (2, N) of x and y of the wheel centre [m/s]; None where it is the slopes times the travel's rate.
    """

    half_track: Course
    half_wheelbase: Course
    pitch: Course
    steer: Course
    camber: Course
    kingpin: Course
    by_own: Array
    by_other: Array | None
    velocity: Array | None


def wheel_joints(
    corner: Corner, own: Course, other: Course | None, steer: Course, given: Array | None = None,
    errors: SlopeErrors | None = None,
) -> WheelJoints:  # fmt: skip
    """The joints of a corner along the travels [m] of its wheel and of the axle's `other` one, and its steer [rad].

    `other` is needed where the wheel follows the other one (`Corner.follows_other`). `given` : (5, N) changes of the
    joints by loads, `errors` : what their slopes are beyond the tables; in the signs of these.
    """
    if corner.joints is None:
        return _by_bump_table(corner, own, steer, errors)
    return _by_joint_tables(corner, corner.joints, own, other, steer, given, errors)


def _by_bump_table(corner: Corner, own: Course, steer: Course, errors: SlopeErrors | None) -> WheelJoints:
    travel, speed, accel = own
    table = kinematics(corner, travel)
    beyond = np.zeros((5, 1)) if errors is None else table_signs(corner) * errors.own
    change, slope = table.change + beyond * travel, table.slope + beyond

    def tabled(k: int, offset: float) -> Course:
        s, d, dd = change[k], slope[k], table.curvature[k]
        return offset + s, d * speed, d * accel + dd * speed**2

    return WheelJoints(
        tabled(0, corner.position[1]), tabled(1, corner.position[0]), tabled(4, 0.0), tabled(2, 0.0),
        tabled(3, 0.0), _kingpin(corner, steer), slope, None, None,
    )  # fmt: skip


def _kingpin(corner: Corner, steer: Course) -> Course:
    kingpin, slope, curvature = kingpin_pitch(corner, steer[0])
    return kingpin, slope * steer[1], slope * steer[2] + curvature * steer[1] ** 2


def _by_joint_tables(
    corner: Corner, tables: JointTables, own: Course, other: Course | None, steer: Course, given: Array | None,
    errors: SlopeErrors | None,
) -> WheelJoints:  # fmt: skip
    signs = table_signs(corner)
    joints, by_own = _along(tables.own, own)
    if errors is not None:
        joints, by_own = _sum(joints, _line(errors.own, own)), by_own + errors.own
    if given is not None:
        joints = (joints[0] + given, joints[1], joints[2])
    by_other: Array | None = None
    if other is not None and tables.follows_other:
        if tables.other is not None:
            moved, by_other = _along(tables.other, other)
            joints = _sum(joints, moved)
        joints = _sum(joints, _product(tables.product[:, None], own, other))
        by_own = by_own + tables.product[:, None] * other[0]
        by_other = (0.0 if by_other is None else by_other) + tables.product[:, None] * own[0]
        if errors is not None:
            joints, by_other = _sum(joints, _line(errors.other, other)), by_other + errors.other
    kingpin = _kingpin(corner, steer)
    if tables.rack is not None and tables.steered:
        # Toe of the rack: the measured one less what both travels and the loads give.
        toe = tuple(-corner.side * part - joint[TOE] for part, joint in zip(steer, joints, strict=True))
        lever = tuple(tables.rack_product[TOE] * part for part in own)
        if errors is not None:
            lever = (lever[0] + errors.rack[TOE], *lever[1:])
        rack = _rack(tables.rack, (toe[0] - corner.static_toe, toe[1], toe[2]), lever)
        turned, _ = _along(tables.rack, rack)
        joints = _sum(_sum(joints, turned), _product(tables.rack_product[:, None], own, rack))
        if errors is not None:
            joints = _sum(joints, _line(errors.rack, rack))
        by_own = by_own + tables.rack_product[:, None] * rack[0]
        zero = np.zeros_like(steer[0])
        kingpin = zero, zero, zero
    value, rate, accel = (signs * part for part in joints)
    return WheelJoints(
        (corner.position[1] + value[0], rate[0], accel[0]), (corner.position[0] + value[1], rate[1], accel[1]),
        (value[4], rate[4], accel[4]), (value[2], rate[2], accel[2]), (value[3], rate[3], accel[3]), kingpin,
        signs * by_own,
        None if by_other is None else signs * by_other, rate[[1, 0]],
    )  # fmt: skip


def _along(curve: JointCurve, x: Course) -> tuple[Course, Array]:
    """The joints (5, N) along the course of what they are against, and their slopes by it."""
    value, slope, curvature = (np.moveaxis(curve.value(x[0], order), -1, 0) for order in range(3))
    return (value, slope * x[1], slope * x[2] + curvature * x[1] ** 2), slope


def _product(factor: Array, a: Course, b: Course) -> Course:
    """Course of factor × a × b, (5, N)."""
    rate = a[1] * b[0] + a[0] * b[1]
    return factor * a[0] * b[0], factor * rate, factor * (a[2] * b[0] + 2.0 * a[1] * b[1] + a[0] * b[2])


def _line(slope: Array, x: Course) -> Course:
    """Course of slope × x, (5, N), the slope a constant."""
    return slope * x[0], slope * x[1], slope * x[2]


def _sum(a: Course, b: Course) -> Course:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _rack(curve: JointCurve, toe: Course, lever: Course) -> Course:
    """Course of the rack [m] at which the toe of its curve plus `lever` [rad/m] times the rack is `toe` [rad]."""
    line = curve.value(curve.at)[:, TOE]
    order = np.argsort(line)
    at = np.interp(toe[0], line[order], curve.at[order])
    for _ in range(_ROUNDS):
        at = at + (toe[0] - curve.value(at)[:, TOE] - lever[0] * at) / (curve.value(at, 1)[:, TOE] + lever[0])
    slope, curvature = (curve.value(at, order)[:, TOE] for order in (1, 2))
    slope = slope + lever[0]
    rate = (toe[1] - lever[1] * at) / slope
    return at, rate, (toe[2] - curvature * rate**2 - 2.0 * lever[1] * rate - lever[2] * at) / slope
