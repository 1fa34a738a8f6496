"""Vehicle: geometry, bench (K&C) tables and a-priori values, every number with its source, read from a TOML file.

The file format is documented in ``docs/vehicle.md``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.assumptions import Assumption, assumption_of, read_assumptions
from lacet.daq.channels import CORNERS
from lacet.daq.compliance import JOINTS
from lacet.daq.errors import VehicleError, nearest
from lacet.daq.joint_tables import JointTables, bench_column, read_joints
from lacet.daq.shipped import find_shipped
from lacet.daq.toml_reader import Quantity, Reader
from lacet.daq.units import is_unit, read_unit

FORMAT = "lacet-vehicle 1"


@dataclass(frozen=True)
class KinematicTable:
    """Bench (K&C) table of one corner against suspension travel, as changes from the design position.

    Attributes
    ----------
    travel : (n,) m, compression positive, strictly increasing.
    half_track : (n,) m, outward positive.
    half_wheelbase : (n,) m, forward positive.
    toe : (n,) rad, toe-in positive.
    camber : (n,) rad, top outward positive (ISO 8855).
    pitch : (n,) rad, carrier rotation about body y (side view: caster change, anti-dive), nose down positive.
    """

    travel: NDArray[np.float64]
    half_track: NDArray[np.float64]
    half_wheelbase: NDArray[np.float64]
    toe: NDArray[np.float64]
    camber: NDArray[np.float64]
    pitch: NDArray[np.float64]


@dataclass(frozen=True)
class SteeringTable:
    """Steer of the front wheels by the angle of the steering wheel, all (n,) [rad], to the left positive.

    `wheel` is strictly increasing; `left`, `right` are changes from straight ahead.
    """

    wheel: NDArray[np.float64]
    left: NDArray[np.float64]
    right: NDArray[np.float64]


@dataclass(frozen=True)
class Corner:
    """One corner of the car at design position, body axes.

    `position` is the wheel centre [m], setback included; `height` that of the wheel centre above a flat road [m];
    `tyre_radius` the unloaded radius R0 [m]; `caster` (top rearward) and `kingpin_inclination` (top inward) the
    steering axis [rad]; `static_toe` the toe-in and `static_camber` the camber, top outward positive [rad]; `joints`
    the bench tables by own travel, the other wheel's and the rack.
    """

    name: str
    position: tuple[float, float, float]
    height: float
    tyre_radius: float
    caster: float
    kingpin_inclination: float
    static_toe: float
    driven: bool
    brakes: str
    table: KinematicTable | None
    static_camber: float = 0.0
    joints: JointTables | None = None

    @property
    def side(self) -> int:
        """+1 on the left, -1 on the right."""
        return 1 if self.name.endswith("l") else -1

    @property
    def follows_other(self) -> bool:
        """Whether the wheel moves or turns with the travel of the axle's other wheel."""
        return self.joints is not None and self.joints.follows_other

    @property
    def depends_on_other(self) -> bool:
        """Whether travel or load of the axle's other wheel moves or turns the wheel."""
        given = None if self.joints is None else self.joints.compliance
        return self.follows_other or (given is not None and bool(given.other))


@dataclass(frozen=True)
class Vehicle:
    """Geometry and bench tables of a car; `apriori` holds values known beforehand, by parameter name, for comparison.

    `assumed` : values of the file that stand in for channels which are not measured; `steering` : the steering's table.

    Examples
    --------
    >>> sorted(lacet.Vehicle.load("peugeot-406").corners)
    ['fl', 'fr', 'rl', 'rr']
    """

    name: str
    corners: Mapping[str, Corner]
    apriori: Mapping[str, Quantity]
    numbers: Mapping[str, Quantity]
    text: str
    assumed: Mapping[str, Assumption] = field(default_factory=dict[str, Assumption])
    steering: SteeringTable | None = None

    @property
    def wheelbase(self) -> float:
        """Distance of the axles [m]."""
        x = {name: corner.position[0] for name, corner in self.corners.items()}
        return 0.5 * (x["fl"] + x["fr"] - x["rl"] - x["rr"])

    def assumption(self, key: str, corner: str = "") -> Assumption:
        """What is assumed at a corner, or of the car, where it is not measured (`daq.assumptions.ASSUMABLE`)."""
        height = self.corners[corner].height if corner else 0.0
        return assumption_of(self.assumed, key, corner, height)

    @classmethod
    def load(cls, path: str | Path) -> Vehicle:
        """The vehicle of a file, or a shipped one by its name. Raises VehicleError with every fault at once."""
        found = find_shipped(path, "vehicles", VehicleError)
        return cls.parse(found.read_text(encoding="utf-8", errors="replace"), str(path))

    @classmethod
    def parse(cls, text: str, name: str = "vehicle") -> Vehicle:
        """The vehicle that a text describes. Raises VehicleError with every fault at once."""
        reader = Reader(text, name, VehicleError, FORMAT)
        root = reader.root
        reader.known(
            root, ("format", "name", "description", "geometry", "axle", "corner", "steering", "assumed", "apriori"), ""
        )
        numbers: dict[str, Quantity] = {}
        geometry = reader.table(root, "geometry", "", required=True)
        reader.known(geometry, ("wheelbase",), "geometry")
        wheelbase = _required(reader, numbers, geometry, "wheelbase", "geometry", "m")
        axles = reader.table(root, "axle", "", required=True)
        reader.known(axles, ("front", "rear"), "axle")
        overrides = reader.table(root, "corner", "")
        reader.known(overrides, CORNERS, "corner")
        height = _front_height(reader, axles, overrides)
        corners: dict[str, Corner] = {}
        for corner in CORNERS:
            axle = "front" if corner[0] == "f" else "rear"
            base = reader.table(axles, axle, "axle", required=corner[1] == "l")
            rows = {**base, **reader.table(overrides, corner, "corner")}
            place = f"corner.{corner}" if corner in overrides else f"axle.{axle}"
            corners[corner] = _corner(reader, numbers, corner, rows, place, wheelbase, height)
        _of_one_car(reader, numbers)
        apriori = {
            key: q
            for key, row in reader.table(root, "apriori", "").items()
            if (q := reader.quantity({key: row}, key, "apriori", _unit_of(row))) is not None
        }
        vehicle = cls(
            reader.text(root, "name", ""), corners, apriori, numbers, text,
            read_assumptions(reader, reader.table(root, "assumed", "")),
            _steering(reader, reader.table(root, "steering", "")),
        )  # fmt: skip
        reader.faults = list(dict.fromkeys(reader.faults))
        reader.finish()
        return vehicle


_LENGTHS = ("wheelbase", "track", "wheel_centre_height", "tyre_radius")
"""Lengths that are of a like size on a car."""
_UNLIKE = 50.0
"""Ratio of one of them to their median from which a unit must be wrong; of a lorry's wheelbase it is 14."""
_CORNER_KEYS = (
    "track", "wheel_centre_height", "tyre_radius", "caster", "kingpin_inclination", "driven", "brakes", "kinematics",
    "static_camber", "static_toe", "setback", "joints",
)  # fmt: skip


def _unit_of(row: Any) -> str:
    unit = str(row.get("unit", "")) if isinstance(row, dict) else ""
    return read_unit(unit).si if is_unit(unit) else "-"


def _required(
    reader: Reader, numbers: dict[str, Quantity], rows: dict[str, Any], key: str, place: str, unit: str
) -> float:
    quantity = reader.quantity(rows, key, place, unit)
    if quantity is None:
        if key not in rows:
            reader.fault(place, f"{key} is missing" + nearest(key, [k for k in rows if k not in _CORNER_KEYS]))
        return 1.0
    if unit == "m" and quantity.value <= 0.0 and key != "setback":
        reader.fault(f"{place}.{key}", f"must be above zero, found {quantity.value:g} m")
    numbers[f"{place}.{key}"] = quantity
    return quantity.value


def _of_one_car(reader: Reader, numbers: Mapping[str, Quantity]) -> None:
    """Fault of each length that no car has beside the others: in mm, and stated as in m."""
    lengths = {name: q.value for name, q in numbers.items() if name.rpartition(".")[2] in _LENGTHS and q.value > 0.0}
    usual = float(np.median(list(lengths.values()))) if lengths else 1.0
    for name, length in lengths.items():
        if not 1.0 / _UNLIKE < length / usual < _UNLIKE:
            reader.fault(name, f"is {length:g} m where the car's other lengths are about {usual:.2g} m: check its unit")


def _optional(
    reader: Reader, numbers: dict[str, Quantity], rows: dict[str, Any], key: str, place: str, unit: str
) -> float:
    return _required(reader, numbers, rows, key, place, unit) if key in rows else 0.0


def _front_height(reader: Reader, axles: dict[str, Any], overrides: dict[str, Any]) -> float:
    """Mean wheel-centre height of the front axle: the height of the body origin above a flat road."""
    rows = [{**reader.table(axles, "front", "axle"), **reader.table(overrides, c, "corner")} for c in ("fl", "fr")]
    heights = [reader.quantity(row, "wheel_centre_height", "axle.front", "m") for row in rows]
    return float(np.mean([h.value for h in heights if h is not None] or [0.3]))


def _corner(
    reader: Reader, numbers: dict[str, Quantity], name: str, rows: dict[str, Any], place: str, wheelbase: float,
    origin_height: float,
) -> Corner:  # fmt: skip
    reader.known(rows, _CORNER_KEYS, place)
    side = 1 if name.endswith("l") else -1
    height = _required(reader, numbers, rows, "wheel_centre_height", place, "m")
    track = _required(reader, numbers, rows, "track", place, "m")
    setback = _optional(reader, numbers, rows, "setback", place, "m")
    static_camber = _optional(reader, numbers, rows, "static_camber", place, "rad")
    driven = rows.get("driven", False)
    if not isinstance(driven, bool):
        reader.fault(f"{place}.driven", "must be true or false")
        driven = False
    return Corner(
        name=name,
        position=((0.0 if name[0] == "f" else -wheelbase) - setback, side * track / 2, height - origin_height),
        height=height,
        tyre_radius=_required(reader, numbers, rows, "tyre_radius", place, "m"),
        caster=_optional(reader, numbers, rows, "caster", place, "rad"),
        kingpin_inclination=_optional(reader, numbers, rows, "kingpin_inclination", place, "rad"),
        static_toe=_optional(reader, numbers, rows, "static_toe", place, "rad"),
        driven=driven,
        brakes=reader.choice(rows, "brakes", place, ("outboard", "inboard"), "outboard"),
        table=_table(reader, reader.table(rows, "kinematics", place), f"{place}.kinematics"),
        static_camber=static_camber,
        joints=read_joints(reader, reader.table(rows, "joints", place), f"{place}.joints"),
    )


def _table(reader: Reader, rows: dict[str, Any], place: str) -> KinematicTable | None:
    if not rows:
        return None
    reader.known(rows, ("travel", *JOINTS), place)
    travel = reader.series(rows, "travel", place, "m")
    if travel is None or len(travel) < 2 or np.any(np.diff(travel) <= 0):
        reader.fault(f"{place}.travel", "needs at least two travels, strictly increasing")
        return None
    columns = {key: bench_column(reader, rows, key, place, len(travel), "travel") for key in JOINTS}
    return KinematicTable(np.asarray(travel, float), **columns)


def _steering(reader: Reader, rows: dict[str, Any]) -> SteeringTable | None:
    if not rows:
        return None
    reader.known(rows, ("wheel", "left", "right"), "steering")
    found = {key: reader.series(rows, key, "steering", "rad") for key in ("wheel", "left", "right")}
    wheel = found["wheel"]
    if wheel is None or len(wheel) < 2 or np.any(np.diff(wheel) <= 0):
        reader.fault("steering.wheel", "needs at least two angles of the steering wheel, strictly increasing")
        return None
    for key in ("left", "right"):
        if (series := found[key]) is None or len(series) != len(wheel):
            reader.fault(f"steering.{key}", f"needs as many angles as steering.wheel, {len(wheel)}")
            return None
    return SteeringTable(*(np.asarray(found[key], float) for key in ("wheel", "left", "right")))
