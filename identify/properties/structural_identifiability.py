"""Structural identifiability of a car: its joint tree, and its base parameters for a motion that excites everything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.joint_tables import PLACE
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Corner, Vehicle
from lacet.identify.car.car_tree import AXLE, CHASSIS, CORNER_OF_BRANCH, FIRST_JOINT, WHEEL, car_chain
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.rows import Row, RowAbsence
from lacet.identify.effects.base import PhysicalEffect, columns_by_row
from lacet.identify.multibody.base_parameters import BaseParameters, find_base
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import Recording, Signals

_POSTURE = (
    ("lateral", "slides", "y", ()),
    ("longitudinal", "slides", "x", ()),
    ("vertical", "slides", "z", ()),
    ("yaw", "turns", "z", ("imu.rate", "imu.accel")),
    ("pitch", "turns", "y", ("imu.rate", "imu.accel")),
    ("roll", "turns", "x", ("imu.rate", "imu.accel")),
)
_BRANCH = (
    ("half track", "slides", "y", "half_track"),
    ("half wheelbase", "slides", "x", "half_wheelbase"),
    ("damper clearance", "slides", "z", ""),
    ("steering", "turns", "z", "toe"),
    ("camber", "turns", "x", "camber"),
    ("caster with travel", "turns", "y", "pitch"),
    ("kingpin", "turns", "y", ""),
    ("wheel rotation", "turns", "y", ""),
    ("tyre deflection", "slides", "z", ""),
)
# Centre and half width of the channels' values, rates and accelerations in a lively drive.
_RANGES: Mapping[str, tuple[tuple[float, float], ...]] = {
    "imu.accel": ((0.0, 6.0),), "imu.rate": ((0.0, 0.8), (0.0, 4.0)), "imu.attitude": ((0.0, 0.1),),
    "laser.ground": ((0.6, 0.02), (0.0, 0.5)), "laser.hub": ((0.3, 0.06), (0.0, 1.0), (0.0, 20.0)),
    "camera.steer": ((0.0, 0.3), (0.0, 1.0), (0.0, 10.0)), "camera.camber": ((0.0, 0.05), (0.0, 0.3), (0.0, 5.0)),
    "wheel.speed": ((70.0, 40.0), (0.0, 20.0)), "wheel.force": ((0.0, 3000.0),), "wheel.moment": ((0.0, 300.0),),
    "correvit.speed": ((20.0, 10.0),),
}  # fmt: skip
_INSTANTS = 200
"""Number of independent instants: with 18 rows some thirty times more equations than parameters."""


class Fixed(Enum):
    """Reason why a joint's position is not measured."""

    FREE = auto()
    """No row is about the ground's axes: the position is not needed."""
    NO_KINGPIN = auto()
    """Neither caster nor kingpin inclination: the position stays 0."""
    NO_TABLE = auto()
    """No bench table: the position stays at design."""


@dataclass(frozen=True)
class JointPosition:
    """Source of a joint's position.

    Attributes
    ----------
    channels : channels it is measured by.
    table : column of the bench table that it follows, alone or (beside channels) as the slope by travel.
    geometry : whether caster and kingpin inclination enter.
    wheel : for a wheel's rotation, whether the wheel is driven, and where its brakes are.
    fixed : why it is not measured, None where it is.
    """

    channels: tuple[str, ...] = ()
    table: str = ""
    geometry: bool = False
    wheel: tuple[bool, str] | None = None
    fixed: Fixed | None = None


@dataclass(frozen=True)
class RowsNotFormed:
    """No row depends on the parameter; `kind` : ``spin`` or ``tyre`` where that row is the one not formed."""

    kind: str


@dataclass(frozen=True)
class HeldTogether:
    """Every row holds the parameter only in combination with others; `names` are those that hold its value."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class TreeJoint:
    """One joint of the car's tree: number, antecedent, kind and axis of motion.

    `follows` : the source of its position; `body` : the body it carries, if that has mass.
    """

    number: int
    antecedent: int
    name: str
    corner: str
    kind: str
    axis: str
    follows: JointPosition
    body: str


@dataclass(frozen=True)
class Structure:
    """Base parameters of a model's rows for a motion that excites everything.

    `base` groups the parameters `names`; `units` are theirs; `effects` the keys of their effects; `rows` are those
    formed, `left_out` has the reason for each of the others.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    effects: tuple[str, ...]
    base: BaseParameters
    rows: tuple[Row, ...]
    left_out: Mapping[Row, RowAbsence]

    def group(self, i: int) -> str:
        """Parameter `i` with those grouped into it; empty when it is no base parameter."""
        place = np.flatnonzero(self.base.independent == i)
        return self.base.describe(int(place[0])) if place.size else ""

    def why(self, i: int) -> RowsNotFormed | HeldTogether | None:
        """Why parameter `i` has no value of its own; None where it has one, alone or as the head of a group."""
        if i in self.base.independent:
            return None
        if i in self.base.absent:
            rows = {"ZZ": "spin", "kt": "tyre"}
            kind = self.names[i].rsplit(".", 1)[-1].rstrip("0123456789")
            return RowsNotFormed(rows.get(kind, ""))
        column = int(np.flatnonzero(self.base.dependent == i)[0])
        holders = [self.names[int(k)] for k in self.base.independent[self.base.relations[:, column] != 0.0]]
        return HeldTogether(tuple(holders))


def car_tree(vehicle: Vehicle) -> list[TreeJoint]:
    """The 42 joints of the paper's car, with the source of each position on this vehicle."""
    chain = car_chain().chain
    bodies = {
        CHASSIS: "chassis",
        **{k: f"axle {c}" for c, k in AXLE.items()},
        **{k: f"wheel {c}" for c, k in WHEEL.items()},
    }
    out: list[TreeJoint] = []
    for joint in chain.joints:
        corner = ""
        if joint.j <= CHASSIS:
            name, kind, axis, channels = _POSTURE[joint.j - 1]
            follows = JointPosition(channels, fixed=None if channels else Fixed.FREE)
        else:
            corner = CORNER_OF_BRANCH[(joint.j - 1 - CHASSIS) // len(_BRANCH)]
            name, kind, axis, column = _BRANCH[joint.j - FIRST_JOINT[corner]]
            follows = _follows(vehicle, corner, name, column)
        out.append(TreeJoint(joint.j, joint.ant, name, corner, kind, axis, follows, bodies.get(joint.j, "")))
    return out


def structure(
    vehicle: Vehicle,
    reference: str,
    effects: Sequence[PhysicalEffect],
    brakes: str = "off",
    rig: Rig | None = None,
    seed: int = 0,
) -> Structure:
    """The base parameters of a model on a car, from instants with independent positions, rates and accelerations.

    Parameters
    ----------
    reference : ``contact`` or ``hub``.
    effects : the model's physics.
    brakes : state of the brakes as runs have it; spin rows need ``off``.
    rig : mounting of the instruments; by default all in body or carrier axes.
    """
    recording = _free_instants(vehicle, rig or Rig("generic", reference, {}, (), ""), reference, brakes, seed)
    motion = build_motion(recording)
    parameters = [p for effect in effects for p in effect.parameters]
    owners = [effect.key for effect in effects for _ in effect.parameters]
    blocks: list[Array] = []
    columns = [columns_by_row(effect, motion) for effect in effects]
    for row in motion.rows:
        parts = [
            found[row] if row in found else np.zeros((len(effect.parameters), motion.t.size))
            for effect, found in zip(effects, columns, strict=True)
        ]
        blocks.append(np.concatenate(parts).T)
    W = np.concatenate(blocks) if blocks else np.zeros((1, len(parameters)))
    return Structure(
        tuple(p.name for p in parameters), tuple(p.unit for p in parameters), tuple(owners),
        find_base(W, [p.name for p in parameters]), motion.rows, dict(motion.left_out),
    )  # fmt: skip


def _follows(vehicle: Vehicle, corner: str, name: str, column: str) -> JointPosition:
    own = vehicle.corners[corner]
    table = column if _tabled(own, column) else ""
    if name == "steering":
        return JointPosition((f"camera.{corner}.steer",), table)
    if name == "camber":
        return JointPosition((f"camera.{corner}.camber",), table)
    if name == "damper clearance":
        return JointPosition((f"laser.{corner}.hub",))
    if name == "kingpin":
        tilted = own.caster != 0.0 or own.kingpin_inclination != 0.0
        steer = f"camera.{corner}.steer"
        return JointPosition((steer,), geometry=True) if tilted else JointPosition(fixed=Fixed.NO_KINGPIN)
    if name == "wheel rotation":
        return JointPosition((f"wheel.{corner}.speed",), wheel=(own.driven, own.brakes))
    if name == "tyre deflection":
        return JointPosition((f"laser.{corner}.ground", f"laser.{corner}.hub"))
    return JointPosition(table=table, fixed=None if table else Fixed.NO_TABLE)


def _tabled(corner: Corner, column: str) -> bool:
    """Whether a column of the corner's bench tables moves its joint."""
    if not column:
        return False
    if corner.joints is not None:
        curves = (corner.joints.own, corner.joints.other, corner.joints.rack if corner.joints.steered else None)
        return any(curve is not None and bool(np.any(curve.values[:, PLACE[column]])) for curve in curves)
    return corner.table is not None and bool(np.any(getattr(corner.table, column)))


def _free_instants(vehicle: Vehicle, rig: Rig, reference: str, brakes: str, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    parts: list[dict[str, Array]] = [{}, {}, {}]
    for name, channel in CHANNELS.items():
        ranges = _RANGES.get(channel.family)
        if ranges is None:
            continue
        for part, (centre, half) in zip(parts, ranges, strict=False):
            part[name] = centre + half * rng.uniform(-1.0, 1.0, (channel.width, _INSTANTS))
    grounds = {f"laser.{c}.ground" for c in CORNERS}
    assert grounds <= parts[0].keys()
    filters = Filters()
    usable = {name: np.ones(_INSTANTS, bool) for name in parts[0]}
    rates = {name: CHANNELS[name].rate for name in parts[0]}
    t = np.arange(_INSTANTS) / filters.rate
    return Recording("generic", t, Signals(*parts), usable, rates, vehicle, rig, filters, reference, brakes)
