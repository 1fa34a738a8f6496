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
  of the wheels cancel (`Motion.weights`). They are formed where no wheel load is measured and the sprung mass, or
  another parameter, is given.
- ``corner.{c}``: likewise of the suspension and the tyre row: the wheel's load by its tyre's deflection.

Torques are positive when they drive (shaft) and when they slow (brake) a wheel that rolls forward. Docs: rows.md.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS, other_corner
from lacet.daq.errors import UsageError, nearest
from lacet.daq.joint_tables import PLACE
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.signals.for_equations import alternatives


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
        """``chassis``, ``suspension``, ``tyre``, ``spin``, ``body`` or ``corner``."""
        return self.partition(".")[0]

    @property
    def combined(self) -> bool:
        """Whether it is a combination of other rows in which vertical wheel forces cancel: of the body or a corner."""
        return self.kind in ("body", "corner")

    @property
    def parts(self) -> tuple[Row, ...]:
        """The rows that a combined row consists of (`Motion.weights`); of any other row itself.

        Without the tyre of the axle's other wheel, which joint tables bring into a corner's row.
        """
        if self.kind == "body":
            return (*_OF_CHASSIS[self.place], *SUSPENSION_ROWS)
        own = (Row(f"suspension.{self.place}"), Row(f"tyre.{self.place}"))
        return own if self.kind == "corner" else (self,)

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
CORNER_ROWS = tuple(Row(f"corner.{c}") for c in CORNERS)
ROWS = (*CHASSIS_ROWS, *SUSPENSION_ROWS, *TYRE_ROWS, *SPIN_ROWS, *BODY_ROWS, *CORNER_ROWS)
"""Every row of the equations, in the order of all reports."""
_OF_CHASSIS = {"heave": (CHASSIS_ROWS[2],), "roll": CHASSIS_ROWS[3:0:-2], "pitch": CHASSIS_ROWS[4::-4]}
"""Rows of the chassis in those of the body: the moment, and the force that has a lever about it."""
_BY_TEXT: dict[str, Row] = {str(row): row for row in ROWS}

ROLL_AND_PITCH = (CHASSIS_ROWS[3], CHASSIS_ROWS[4])
"""The chassis' rows that no run without wheel loads on the move has."""
SPRUNG_MASS = "sprung_mass"
"""Assumption that sets the scale of all parameters where no load is measured; a parameter does too (`PARAMETER_OF`)."""
PARAMETER_OF: Mapping[str, str] = {
    "static_load": "offset.{c}.f0", "spring_rate": "spring.{c}.k", "damper_rate": "damper.{c}.c",
    "tyre_rate": "tyre_stiffness.{c}.kt", "roll_inertia": "XX6",
    "pitch_inertia": "YY6",
}  # fmt: skip
"""Assumption that does so → name of the parameter that it is, with the corner to be filled in.

Not an anti-roll bar: it differs from springs of another scale by the damping of roll alone, and a fit with one bar
given has half the true mass."""

PRESSURE = "brake.pressure"
"""Channel that shows whether the brakes are applied."""
RELEASED = 1e5
"""Brake line pressure below which the brakes count as released [Pa]."""


def body_levers(vehicle: Vehicle) -> dict[Row, float]:
    """Proportions of the residuals of combined rows: levers with which an error of one suspension's force enters.

    1 for heave and corners; for roll and pitch the RMS distance of the wheel centres from the body's origin in y and x
    [m].
    """
    x, y = (np.array([corner.position[axis] for corner in vehicle.corners.values()]) for axis in (0, 1))
    roll, pitch = (float(np.sqrt(np.mean(lever**2))) for lever in (y, x))
    return {**dict(zip(BODY_ROWS, (1.0, roll, pitch), strict=True)), **dict.fromkeys(CORNER_ROWS, 1.0)}


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
    """All terms of the row are in proportion to unknown parameters, of which one must be given."""


@dataclass(frozen=True)
class RowAbsence:
    """Absence of a row: its `cause`, the `channels` that are not measured (or show it), the run's `brakes`.

    `beside` : what else is lacking, of the torques on the wheel.
    """

    cause: Absence
    channels: tuple[str, ...]
    brakes: str = ""
    beside: RowAbsence | None = None

    @property
    def fewest(self) -> tuple[str, ...]:
        """The fewest channels to be added: all of its own, or of those that show a torque the first; and `beside`."""
        own = self.channels if self.cause is Absence.CHANNELS else self.channels[:1]
        return own + (self.beside.fewest if self.beside else ())


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
    if kind == "corner":
        parts = (f"suspension.{name}", f"tyre.{name}", *_tyre_of_other(name, vehicle))
        every = [c for part in parts for c in needs(_BY_TEXT[part], reference, grounds, vehicle)]
        return tuple(dict.fromkeys((*every, *(f"laser.{c}.hub" for c in CORNERS))))
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


def followed(row: Row) -> tuple[str, ...]:
    """Channels that laws of a row may follow beside those it needs: the travel of the axle's other wheel, by a bar."""
    return (f"laser.{other_corner(row.place)}.hub",) if row.kind == "suspension" else ()


def _tyre_of_other(name: str, vehicle: Vehicle | None) -> tuple[str, ...]:
    """Tyre row of the axle's other wheel where its load is in the suspension row of this one."""
    other = other_corner(name)
    return (f"tyre.{other}",) if vehicle is not None and vehicle.corners[other].follows_other else ()


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
    if row.kind == "corner":
        hubs = {f"laser.{c}.hub": (0,) for c in CORNERS}
        return {**hubs, f"laser.{row.place}.ground": (0,), "imu.accel": (2,)}
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


_NEVER_ASSUMED = ("imu.accel", "imu.rate", "imu.attitude", "laser.ground")
"""Families of channels that nothing stands in for by an assumption."""


_INERTIAL = ("imu.accel", "imu.rate")
_PARTIAL = {"wheel.force": {2}, "imu.accel": {1}, "imu.rate": {2}}
"""Families of channels that others stand in for in some components only."""


def instead(row: Row, channel: str) -> tuple[str, ...]:
    """Channels that serve a row as well as one that it needs, any of them, the best first."""
    # Of an inertial unit the car's own bus replaces all or nothing.
    together = _INERTIAL if channel in _INERTIAL else (channel,)
    must = leading(row)
    for one in together:
        given = _PARTIAL.get(CHANNELS[one].family)
        if given is not None and not set(must.get(one, ())) <= given:
            return ()
    return alternatives(channel)


def lacking(row: Row, reference: str, recorded: Container[str]) -> tuple[str, ...]:
    """The fewest channels that a recording would need besides those `recorded` for a row; empty where it can be formed.

    Torques are not counted, nor what can be assumed or obtained from another channel. Nothing for combined rows, which
    are not formed, where a wheel load is recorded.
    """
    loads = [f"wheel.{c}.force" for c in CORNERS]
    if row.combined and any(name in recorded for load in loads for name in (load, *alternatives(load))):
        return ()
    grounds = tuple(c for c in CORNERS if f"laser.{c}.ground" in recorded)
    if len(grounds) < 3 and row.corner is not None:
        grounds = (row.corner,)
    absent = tuple(c for c in needs(row, reference, grounds) if c not in recorded)
    must = {*leading(row)}
    return tuple(
        c
        for c in absent
        if (c in must or CHANNELS[c].family in _NEVER_ASSUMED) and not any(o in recorded for o in instead(row, c))
    )


def fewest(row: Row, absent: tuple[str, ...]) -> tuple[str, ...]:
    """Of absent channels the fewest that would have to be measured: with them the others can be assumed."""
    needed = {*leading(row)}
    return tuple(c for c in absent if c in needed or CHANNELS[c].family in _NEVER_ASSUMED) or absent


def least(row: Row, reference: str) -> tuple[str, ...]:
    """Channels that must be measured for a row, or what serves as well (`instead`); the others can be assumed.

    For a tyre its own ground laser and the attitude: those of three corners serve in place of that.
    """
    grounds = CORNERS if row.corner is None else (row.corner,)
    return fewest(row, needs(row, reference, grounds))
