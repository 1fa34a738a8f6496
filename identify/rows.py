"""The rows of the equations: their names and units, what each needs measured, and why a row can be absent."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from daq.channels import CORNERS
from daq.vehicle import Corner, Vehicle
from identify.vectors import Array

CHASSIS_ROWS = ("chassis.fx", "chassis.fy", "chassis.fz", "chassis.mx", "chassis.my", "chassis.mz")
SUSPENSION_ROWS = tuple(f"suspension.{c}" for c in CORNERS)
TYRE_ROWS = tuple(f"tyre.{c}" for c in CORNERS)
SPIN_ROWS = tuple(f"spin.{c}" for c in CORNERS)
ROWS = (*CHASSIS_ROWS, *SUSPENSION_ROWS, *TYRE_ROWS, *SPIN_ROWS)
"""Every row of the equations, in the order of all reports."""


def row_unit(row: str) -> str:
    """Unit of a row: N, or N·m for chassis moments and spins."""
    return "N·m" if row.startswith("spin") or row.startswith("chassis.m") else "N"


def needs(
    row: str, reference: str, grounds: tuple[str, ...] = CORNERS, vehicle: Vehicle | None = None
) -> tuple[str, ...]:
    """Channels without which a row does not exist.

    `grounds`: corners whose ground lasers give the road's normal; `vehicle`: with it, what only a bench table brings
    in is not asked for where there is none.
    """
    kind, name = row.split(".")
    imu = ("imu.accel", "imu.rate")
    if kind == "chassis":
        # Speeds for the gyroscopic moments of the wheels: 160 N·m of roll at 80 rad/s and 0.5 rad/s of yaw.
        per_corner = (
            "wheel.{c}.force", "wheel.{c}.moment", "wheel.{c}.speed", "laser.{c}.hub", "camera.{c}.steer",
            "camera.{c}.camber",
        )  # fmt: skip
        return imu + tuple(pattern.format(c=c) for c in CORNERS for pattern in per_corner)
    attitude = (f"camera.{name}.steer", f"camera.{name}.camber")
    moment, speed, hub = f"wheel.{name}.moment", f"wheel.{name}.speed", f"laser.{name}.hub"
    turns = vehicle is None or _turns(vehicle.corners[name])
    if kind == "suspension":
        return (*imu, f"wheel.{name}.force", moment, *((speed,) if turns else ()), hub, *attitude)
    if kind == "tyre":
        road = tuple(f"laser.{c}.ground" for c in grounds) if len(grounds) >= 3 else ("imu.attitude",)
        own = (f"wheel.{name}.force", f"laser.{name}.ground", hub, *attitude)
        return tuple(dict.fromkeys((*own, *road, *(imu if reference == "hub" else ()))))
    return (moment, speed, *((hub,) if turns else ()), *attitude, "imu.rate")


def _turns(corner: Corner) -> bool:
    """Whether the carrier turns with the travel: only then do moments and the wheel's momentum enter its row."""
    table = corner.table
    return table is not None and any(np.any(np.diff(column)) for column in (table.toe, table.camber, table.pitch))


def available(
    values: Mapping[str, Array], vehicle: Vehicle, reference: str, brakes: str, grounds: tuple[str, ...]
) -> tuple[tuple[str, ...], dict[str, str]]:
    rows: list[str] = []
    left_out: dict[str, str] = {}
    for row in ROWS:
        kind, name = row.split(".")
        absent = [channel for channel in needs(row, reference, grounds, vehicle) if channel not in values]
        if absent:
            left_out[row] = f"not measured: {', '.join(absent)}"
        elif kind == "spin" and vehicle.corners[name].driven:
            left_out[row] = "the drive torque of this wheel is not measured"
        elif kind == "spin" and brakes != "off":
            left_out[row] = f"the brake torque is not measured and the run's brakes are '{brakes}' (say brakes = 'off')"
        elif kind == "suspension" and _shaft_matters(vehicle.corners[name]):
            left_out[row] = "the half-shaft torque acts on this travel (carrier pitch in the bench table) unmeasured"
        else:
            rows.append(row)
    return tuple(rows), left_out


def _shaft_matters(corner: Corner) -> bool:
    """Half-shaft or inboard-brake torque works on the travel when the carrier pitches with it."""
    pitches = corner.table is not None and bool(np.any(corner.table.pitch))
    return pitches and (corner.driven or corner.brakes == "inboard")
