"""Rows of the equations of motion: their definitions, the channels each needs, and why one can be absent.

F, M: measured wheel load in body axes, about the wheel centre; p, φ: wheel centre and carrier rotation relative to the
body; s: suspension travel along body z; n: spin axis; e: the road's normal. Inertia is that of all bodies where the
loads are ``contact`` loads, of those inboard of the transducer where they are ``hub`` loads.

- ``chassis.f*``, ``chassis.m*``: ΣF and Σ(M + p × F) about the body origin, in body axes = inertia. Drive and brake
  torques are internal to the car and do not appear.
- ``suspension.{c}``: F·∂p/∂s + M·∂φ/∂s + T_shaft n·∂φ/∂s = inertia_s + k s + c ṡ + offset. The slopes are those of the
  bench tables. T_shaft is the torque of the half-shaft on the wheel, of the engine and of inboard brakes; it reacts on
  the body. Outboard brakes act between wheel and carrier and do no work. Where T_shaft is not measured it is taken from
  the spin row, T_shaft = I ω̇ + T_brake − n·M, which leaves
  F·∂p/∂s + M·ψ + T_brake n·∂φ/∂s = inertia_s with ψ for ∂φ/∂s in the wheel's part + k s + c ṡ + offset,
  ψ = ∂φ/∂s − n (n·∂φ/∂s): the virtual motion in which the wheel does not turn about its axis.
  Where joint tables say that the axle's other wheel moves with this travel, its load, torque and inertia are in the row
  too, with its own ∂p/∂s, ∂φ/∂s and ψ by this travel; its torque is measured or eliminated in the same way.
- ``tyre.{c}``: F·e = kt δ (``contact``), F·e = kt δ − m_out a·e (``hub``), δ = R0 − h/√(1 − (n·e)²).
- ``spin.{c}``: n·M + T_shaft − T_brake = I ω̇, ω̇ in space: that of the wheel on its carrier and of the carrier.
- ``body.heave``, ``body.roll``, ``body.pitch``: combinations of chassis and suspension rows in which vertical forces
  of the wheels cancel (`Motion.weights`). They are formed where no wheel load is measured and the sprung mass is known.

Torques are positive when they drive (shaft) and when they slow (brake) a wheel that rolls forward. Docs: rows.md.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from types import MappingProxyType

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS, other_corner
from lacet.daq.errors import UsageError, nearest
from lacet.daq.joint_tables import PLACE, JointCurve
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.signals.for_equations import alternatives
from lacet.identify.signals.sources import Kind, Method, Source


class Row(str):
    """A row of the equations of motion: a scalar equation of the car, ``suspension.fl`` or ``chassis.mz``.

    It equals its text, so that it is a key of a dictionary by row and a string of JSON. `Row.parse` makes one and
    refuses a text that is none of `ROWS`.

    Examples
    --------
    >>> from lacet.identify.car.rows import Row
    >>> row = Row.parse("spin.fl")
    >>> row.kind, row.place, row.corner, row.unit
    ('spin', 'fl', 'fl', 'N·m')
    """

    __slots__ = ()

    @classmethod
    def parse(cls, text: str) -> Row:
        """The row of a text. Raises UsageError with the nearest match."""
        if text not in _BY_TEXT:
            raise UsageError(f"there is no row '{text}'{nearest(text, _BY_TEXT)} (lacet info --rows lists them)")
        return _BY_TEXT[text]

    @property
    def kind(self) -> str:
        """``chassis``, ``suspension``, ``tyre``, ``spin`` or ``body``."""
        return self.partition(".")[0]

    @property
    def place(self) -> str:
        """The corner; of the chassis its component, ``fx`` … ``mz``; of the body ``heave``, ``roll`` or ``pitch``."""
        return self.partition(".")[2]

    @property
    def corner(self) -> str | None:
        """The corner, ``fl`` … ``rr``; None for a row of the chassis or the body."""
        return self.place if self.place in CORNERS else None

    @property
    def unit(self) -> str:
        """N, or N·m for moments on the chassis or the body and about the wheels' axes."""
        turning = self.kind == "spin" or self.place in ("mx", "my", "mz", "roll", "pitch")
        return "N·m" if turning else "N"


CHASSIS_ROWS = tuple(Row(f"chassis.{component}") for component in ("fx", "fy", "fz", "mx", "my", "mz"))
SUSPENSION_ROWS = tuple(Row(f"suspension.{c}") for c in CORNERS)
TYRE_ROWS = tuple(Row(f"tyre.{c}") for c in CORNERS)
SPIN_ROWS = tuple(Row(f"spin.{c}") for c in CORNERS)
BODY_ROWS = tuple(Row(f"body.{motion}") for motion in ("heave", "roll", "pitch"))
ROWS = (*CHASSIS_ROWS, *SUSPENSION_ROWS, *TYRE_ROWS, *SPIN_ROWS, *BODY_ROWS)
"""Every row of the equations, in the order of all reports."""
_BY_TEXT: dict[str, Row] = {str(row): row for row in ROWS}

ROLL_AND_PITCH = (CHASSIS_ROWS[3], CHASSIS_ROWS[4])
"""The chassis' rows that no run without wheel loads on the move has."""
SPRUNG_MASS = "sprung_mass"
"""The assumption that fixes the scale of all parameters where no load is measured (`daq.assumptions`)."""

PRESSURE = "brake.pressure"
"""Channel that shows whether the brakes are applied."""
RELEASED = 1e5
"""Brake line pressure below which the brakes count as released [Pa]."""
SMALL_SLOPE = 0.01
"""Rotation of a half-shaft per unit of travel that is neglected while outboard brakes act [rad/m].

An engine's braking torque of 300 N·m at the wheel then contributes 3 N to the row."""
_LARGE_CAMBER = 0.1
"""Camber with which a carrier's toe change is taken as rotation about the spin axis, where its size matters [rad]."""


def body_levers(vehicle: Vehicle) -> dict[Row, float]:
    """Proportions of the residuals of the body's rows: levers with which an error of one suspension's force enters.

    1 for heave; for roll and pitch the RMS distance of the wheel centres from the body's origin in y and x [m].
    """
    x, y = (np.array([corner.position[axis] for corner in vehicle.corners.values()]) for axis in (0, 1))
    roll, pitch = (float(np.sqrt(np.mean(lever**2))) for lever in (y, x))
    return dict(zip(BODY_ROWS, (1.0, roll, pitch), strict=True))


class Absence(Enum):
    """Reason why a row of the equations cannot be formed on a run."""

    CHANNELS = auto()
    """The row's own channels are not measured."""
    SHAFT_TORQUE = auto()
    """The half-shaft torque does work on the travel, and no channel measures or eliminates it."""
    DRIVE_TORQUE = auto()
    """The drive torque of the wheel is not measured."""
    BRAKE_TORQUE = auto()
    """Neither the wheel's brake torque nor the time of braking is measured."""
    BRAKES_ALWAYS = auto()
    """The brakes act all the time, and the torques on the wheel are not all measured."""
    MEASURED_ELSEWHERE = auto()
    """The row would need assumptions on this run, and another run measures it."""
    NO_KNOWN_LOAD = auto()
    """All terms of the row are in proportion to unknown parameters; a known load is needed, the sprung mass."""


@dataclass(frozen=True)
class RowAbsence:
    """Absence of a row: its `cause`, the `channels` that are not measured (or show it), the run's `brakes`."""

    cause: Absence
    channels: tuple[str, ...]
    brakes: str = ""


def needs(
    row: Row, reference: str, grounds: tuple[str, ...] = CORNERS, vehicle: Vehicle | None = None
) -> tuple[str, ...]:
    """Channels that a row of the equations needs, without those of torques (`torque_in`).

    `reference`: ``contact`` or ``hub``; `grounds`: corners whose ground lasers give the road's normal; `vehicle`: with
    it, channels that enter through a bench table only are not needed at corners without one.
    """
    kind, name = row.kind, row.place
    imu = ("imu.accel", "imu.rate")
    if kind in ("chassis", "body"):
        # Wheel speeds for the gyroscopic moments: 160 N·m of roll at 80 rad/s and 0.5 rad/s of yaw.
        per_corner = (
            "wheel.{c}.force", "wheel.{c}.moment", "wheel.{c}.speed", "laser.{c}.hub", "camera.{c}.steer",
            "camera.{c}.camber",
        )  # fmt: skip
        return imu + tuple(pattern.format(c=c) for c in CORNERS for pattern in per_corner)
    attitude = (f"camera.{name}.steer", f"camera.{name}.camber")
    moment, speed, hub = f"wheel.{name}.moment", f"wheel.{name}.speed", f"laser.{name}.hub"
    turns = vehicle is None or _turns(vehicle.corners[name])
    coupled = () if vehicle is None else _by_other_wheel(row, vehicle)
    if kind == "suspension":
        own = (*imu, f"wheel.{name}.force", moment, *((speed,) if turns else ()), hub, *attitude)
        return tuple(dict.fromkeys((*own, *coupled)))
    if kind == "tyre":
        road = tuple(f"laser.{c}.ground" for c in grounds) if len(grounds) >= 3 else ("imu.attitude",)
        own = (f"wheel.{name}.force", f"laser.{name}.ground", hub, *attitude)
        return tuple(dict.fromkeys((*own, *road, *(imu if reference == "hub" else ()), *coupled)))
    return (moment, speed, *((hub,) if turns else ()), *attitude, "imu.rate", *coupled)


def _by_other_wheel(row: Row, vehicle: Vehicle) -> tuple[str, ...]:
    """Channels of the axle's other wheel that a row of a corner needs where one of both wheels moves with the other."""
    other = vehicle.corners[other_corner(row.place)]
    hub = (f"laser.{other.name}.hub",)
    if row.kind == "suspension" and other.follows_other:
        load = tuple(f"wheel.{other.name}.{what}" for what in ("force", "moment", "speed"))
        return (*load, *hub, *(f"camera.{other.name}.{angle}" for angle in ("steer", "camber")))
    return hub if vehicle.corners[row.place].follows_other else ()


_LEADING: dict[str, tuple[str, str]] = {
    # Components of wheel force and of the inertial unit (specific force xyz, rates pqr) that no assumption may replace:
    # the row is an equation of just these.
    "fx": ("xy", "x"), "fy": ("y", "y"), "fz": ("z", "z"), "mx": ("yz", "py"), "my": ("xz", "qx"), "mz": ("xy", "ry"),
    "heave": ("", "z"), "roll": ("", "py"), "pitch": ("", "qx"),
}  # fmt: skip


def leading(row: Row) -> dict[str, tuple[int, ...]]:
    """Channels, with their components, that must be measured or derived for a row: what it is an equation of.

    The others may be assumed with a tolerance (`identify.car.sources`).
    """
    if row.kind in ("chassis", "body"):
        force, inertial = _LEADING[row.place]
        out = {f"wheel.{c}.force": tuple("xyz".index(k) for k in force) for c in CORNERS if force}
        out |= {f"laser.{c}.hub": (0,) for c in CORNERS if row.kind == "body"}
        out["imu.accel"] = tuple("xyz".index(k) for k in inertial if k in "xyz")
        out["imu.rate"] = tuple("pqr".index(k) for k in inertial if k in "pqr")
        return out
    force, hub = {f"wheel.{row.place}.force": (2,)}, {f"laser.{row.place}.hub": (0,)}
    if row.kind == "suspension":
        return {**force, **hub, "imu.accel": (2,)}
    if row.kind == "tyre":
        return {**force, **hub, f"laser.{row.place}.ground": (0,)}
    return {f"wheel.{row.place}.moment": (1,), f"wheel.{row.place}.speed": (0,)}


def _turns(corner: Corner) -> bool:
    """Whether the carrier rotates with travel: only then do moments and the wheel's momentum enter its row."""
    if corner.joints is not None:
        return any(np.any(np.diff(corner.joints.own.values[:, PLACE[a]])) for a in ("toe", "camber", "pitch"))
    table = corner.table
    return table is not None and any(np.any(np.diff(column)) for column in (table.toe, table.camber, table.pitch))


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
    if row.kind == "body":
        return _with(Torque(), {r.place: torque_in(r, vehicle, measured, brakes) for r in SUSPENSION_ROWS})
    return Torque()


def _with(own: Torque, each: Mapping[str, Torque]) -> Torque:
    """A row's own torques, with those of corners in it."""
    missing = next((one.missing for one in (own, *each.values()) if one.missing), None)
    released = any(one.released for one in (own, *each.values()))
    return replace(own, released=released, missing=missing, corners=each)


def suspension_torque(rows: Mapping[Row, Torque], corner: str) -> Torque:
    """The torques in a corner's suspension row, by itself or as a part of a body row, of `rows` → their torques."""
    found = rows.get(SUSPENSION_ROWS[CORNERS.index(corner)])
    bodies = (rows[row].corners[corner] for row in BODY_ROWS if row in rows)
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
    if shaft not in measured:
        if corner.driven:
            return Torque(missing=RowAbsence(Absence.DRIVE_TORQUE, (shaft,)))
        shaft = ""
    elif corner.brakes == "inboard":  # the brake's torque is in the half-shaft's
        return Torque(shaft=shaft)
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


_NEVER_ASSUMED = ("imu.accel", "imu.rate", "imu.attitude", "laser.ground")
"""Families of channels that nothing stands in for by an assumption."""


_PARTIAL = {"wheel.force": {2}, "imu.accel": {1}, "imu.rate": {2}}
"""Families of channels that others stand in for in some components only."""


def instead(row: Row, channel: str) -> tuple[str, ...]:
    """Channels that serve a row as well as one that it needs, any of them, the best first."""
    given = _PARTIAL.get(CHANNELS[channel].family)
    if given is not None and not set(leading(row).get(channel, ())) <= given:
        return ()
    return alternatives(channel)


def lacking(row: Row, reference: str, recorded: Container[str]) -> tuple[str, ...]:
    """The fewest channels that a recording would need besides those `recorded` for a row; empty where it can be formed.

    Torques are not counted, nor what can be assumed or obtained from another channel.
    """
    absent = tuple(c for c in needs(row, reference) if c not in recorded)
    must = {*leading(row)}
    return tuple(
        c
        for c in absent
        if (c in must or CHANNELS[c].family in _NEVER_ASSUMED) and not any(o in recorded for o in instead(row, c))
    )


def serves(source: Source | None, channel: str, row: Row) -> bool:
    """Whether what is known of a channel serves a row: its leading components are not assumed."""
    if source is None or row.kind in source.unfit:
        return False
    return all(source.kinds[k] is not Kind.ASSUMED for k in leading(row).get(channel, ()))


def _least(row: Row, absent: tuple[str, ...]) -> tuple[str, ...]:
    """Of absent channels the fewest that would have to be measured: with them the others can be assumed."""
    needed = {*leading(row)}
    return tuple(c for c in absent if c in needed or CHANNELS[c].family in _NEVER_ASSUMED) or absent


def available(
    measured: Container[str], vehicle: Vehicle, reference: str, brakes: str, grounds: tuple[str, ...],
    sources: Mapping[str, Source] = MappingProxyType({}), elsewhere: Container[str] = (),
) -> tuple[dict[Row, Torque], dict[Row, RowAbsence]]:  # fmt: skip
    """Rows whose left side is known, row → its torques; and every other row → why it is absent.

    `sources` : where channels that are not `measured` come from; `elsewhere` : rows that another run measures,
    which are not taken on assumptions here. Body rows say nothing beside measured wheel loads: with any they are in
    neither.
    """
    rows: dict[Row, Torque] = {}
    left_out: dict[Row, RowAbsence] = {}
    loads = [f"wheel.{c}.force" for c in CORNERS]
    known = any(c in measured or (c in sources and sources[c].method is not Method.NOMINAL_LOAD) for c in loads)
    for row in ROWS:
        if row.kind == "body" and known:
            continue
        needed = needs(row, reference, grounds, vehicle)
        lacking = tuple(channel for channel in needed if channel not in measured)
        absent = tuple(channel for channel in lacking if not serves(sources.get(channel), channel, row))
        torque = torque_in(row, vehicle, measured, brakes)
        if row.kind == "body" and absent and not any(c in absent for c in leading(row)):
            left_out[row] = RowAbsence(Absence.NO_KNOWN_LOAD, (SPRUNG_MASS,))
        elif row.kind == "body" and not absent and all(one in elsewhere for one in ROLL_AND_PITCH):
            left_out[row] = RowAbsence(Absence.MEASURED_ELSEWHERE, lacking)
        elif absent:
            left_out[row] = RowAbsence(Absence.CHANNELS, _least(row, absent))
        elif row in elsewhere and any(sources[channel].kind is Kind.ASSUMED for channel in lacking):
            left_out[row] = RowAbsence(Absence.MEASURED_ELSEWHERE, lacking)
        elif torque.missing is not None:
            left_out[row] = torque.missing
        else:
            rows[row] = torque
    return rows, left_out
