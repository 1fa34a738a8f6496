"""Assumptions on a car: nominal values with tolerances that stand in for channels which a rig does not measure, and
how far the bench tables of the vehicle file may be off.

The former are used only where a channel is absent (``docs/fewer-instruments.md``). Each has a default here and may be
given in the table ``[assumed]`` of the vehicle file: one place for a value and for how far it may be off.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from lacet.daq.channels import CORNERS
from lacet.daq.errors import nearest
from lacet.daq.table_tolerances import TABLE_TOLERANCES
from lacet.daq.toml_reader import Reader

AXLE_OF = {corner: "front" if corner[0] == "f" else "rear" for corner in CORNERS}
"""Axle of each corner."""


@dataclass(frozen=True)
class Assumption:
    """Assumed value: `name` (``loaded_radius.front``), `value` and `tolerance` (1 σ) in `unit`, and its `source`.

    `given` : whether the vehicle file has it; else it is lacet's default.
    """

    name: str
    value: float
    tolerance: float
    unit: str
    source: str
    given: bool = False


@dataclass(frozen=True)
class Assumable:
    """Value that may be assumed: its `unit`, default `value` and `tolerance`, `scope`, and what it is `about`.

    `value` is None where there is no default; `scope` is ``car``, ``axle`` or ``corner``: what has an error of its own.
    `source` : where the default comes from. `sets_scale` : whether it is a parameter of the model which, where the
    vehicle file gives it, sets the scale of all others when no wheel load is measured; it must be positive.
    """

    unit: str
    value: float | None
    tolerance: float
    scope: str
    about: str
    source: str
    sets_scale: bool = False


_CLASS = "usual in passenger cars"
ASSUMABLE: dict[str, Assumable] = {
    "loaded_radius": Assumable(
        "m", None, 0.010, "axle", "height of the wheel centre above the contact patch, under load",
        "wheel_centre_height of the vehicle file; 2 kN more load deflect a tyre by 10 mm",
    ),
    "pneumatic_trail": Assumable(
        "m", 0.030, 0.015, "axle", "distance of a small lateral force behind the wheel centre",
        "a third of half the contact length, and caster of the patch",
    ),
    "friction": Assumable(
        "-", 1.0, 0.15, "axle", "largest lateral force ÷ load, at which the trail is gone", "dry asphalt",
    ),
    "rolling_resistance": Assumable(
        "-", 0.012, 0.006, "axle", "rolling resistance per vertical load", "0.008 to 0.015 on asphalt",
    ),
    "lateral_shift": Assumable(
        "m/N", 3e-6, 3e-6, "axle", "lateral shift of the contact patch per lateral force",
        "lateral stiffness of a tyre, 150 to 300 kN/m",
    ),
    "outboard_mass": Assumable(
        "kg", 20.0, 6.0, "axle", "rim, tyre and whatever else is outside the transducer (hub loads)", _CLASS,
    ),
    "outboard_spin_inertia": Assumable(
        "kg·m²", 0.9, 0.35, "axle", "moment of inertia of these about the spin axis (hub loads)", _CLASS,
    ),
    "camber": Assumable(
        "rad", 0.0, 0.007, "corner", "camber beyond static_camber and bench table, positive about x",
        "0.4°: an alignment sheet, and compliance",
    ),
    "camber_slope": Assumable(
        "rad/m", 0.0, 0.2, "axle", "camber per travel, top outward, beyond the bench table", "0.2° per 20 mm of travel",
    ),
    "toe": Assumable(
        "rad", 0.0, 0.004, "corner", "steer beyond static_toe, bench table and steering wheel, to the left",
        "0.2°: an alignment sheet, and compliance",
    ),
    "slip_angle": Assumable(
        "rad", 0.065, 0.015, "axle", "slip angle of the tyres × load ÷ lateral force",
        "cornering stiffness of 12 to 20 times the load per radian",
    ),
    "steering_ratio": Assumable(
        "-", None, 0.5, "car", "angle of the steering wheel per steer angle of the front wheels", "",
    ),
    "steering_table": Assumable(
        "-", 1.0, 0.02, "car", "steer of the front wheels ÷ what the table [steering] makes it",
        "elasticity of the steering",
    ),
    "motion_ratio": Assumable(
        "-", None, 0.01, "axle", "damper (or potentiometer) travel per suspension travel", "",
    ),
    "pushrod_ratio": Assumable(
        "-", None, 0.01, "axle", "vertical force at the wheel per force in the pushrod", "",
    ),
    "static_deflection": Assumable(
        "m", 0.08, 0.04, "axle", "travel that twice the static load would give, springs and anti-roll bar together",
        "ride frequencies of 1.2 to 2 Hz",
    ),
    "travel": Assumable(
        "m", 0.0, 0.008, "corner", "travel at the mean load of the run", "ride height without a measurement",
    ),
    "travel_accel": Assumable(
        "-", 0.9, 0.6, "axle", "part of the body's vertical acceleration at a corner that its travel follows",
        "1 on a smooth road with stiff tyres, from 0.5 to 1.6 on a rough one",
    ),
    "travel_accel_other": Assumable(
        "-", 0.0, 0.4, "axle", "the same of the body's vertical acceleration at the other axle",
        "a road that both axles meet one after the other",
    ),
    "slip": Assumable(
        "-", 0.0, 0.03, "axle", "wheel speed × loaded radius ÷ speed, less 1", "rolling and loaded radius differ",
    ),
    "speed": Assumable(
        "-", 1.0, 0.15, "car", "speed ÷ what lateral acceleration and yaw rate make it, without a measurement",
        "the body's roll adds 5 to 8 % of the lateral acceleration",
    ),
    "roll_gradient": Assumable(
        "rad·s²/m", 0.006, 0.003, "car", "roll per lateral acceleration, where only yaw rate and it are measured",
        "3.4° per g, of 2 to 6° per g",
    ),
    "longitudinal_accel": Assumable("m/s²", 0.0, 0.5, "car", "longitudinal acceleration, likewise", "steady speed"),
    "vertical_accel": Assumable("-", 1.0, 0.01, "car", "vertical specific force in g, likewise", "level road"),
    "lateral_share": Assumable(
        "-", 1.0, 0.3, "axle", "lateral force of a wheel ÷ (its load × lateral acceleration in g)",
        "tyres of one axle share lateral force nearly as their loads",
    ),
    "longitudinal_share": Assumable(
        "-", 1.0, 1.0, "axle", "longitudinal force of a wheel ÷ (its load × longitudinal acceleration in g)",
        "1 for braking in proportion to load, 0 or 2 where one axle drives",
    ),
    "load_transfer": Assumable(
        "-", 0.6, 0.3, "axle", "load that a wheel takes from the other of its axle ÷ its own at rest, per g of lateral "
        "acceleration, where no wheel load is measured", "2 × height of the centre of gravity ÷ track is 0.7",
    ),
    "unsprung_mass": Assumable(
        "kg", 38.0, 8.0, "axle", "carrier, hub, wheel and shares of the arms of one corner", _CLASS,
    ),
    "sprung_mass": Assumable(
        "kg", None, 20.0, "car", "mass above the suspensions: what scales show, less four unsprung masses", "", True,
    ),
    "static_load": Assumable(
        "N", 3200.0, 1200.0, "corner", "vertical force of a suspension at rest, at design height",
        "sprung masses of 900 to 1800 kg", True,
    ),
    "spring_rate": Assumable("N/m", None, 500.0, "axle", "rate of a spring at its wheel", "", True),
    "damper_rate": Assumable("N·s/m", None, 100.0, "axle", "rate of a damper at its wheel", "", True),
    "tyre_rate": Assumable("N/m", None, 10000.0, "axle", "vertical stiffness of a tyre", "", True),
    "roll_inertia": Assumable(
        "kg·m²", None, 30.0, "car", "moment of inertia of the sprung mass about the body's x axis (XX6)", "", True,
    ),
    "pitch_inertia": Assumable(
        "kg·m²", None, 100.0, "car", "moment of inertia of the sprung mass about the body's y axis (YY6)", "", True,
    ),
    **{key: Assumable(*row) for key, row in TABLE_TOLERANCES.items()},
}  # fmt: skip
"""Every value that may be assumed, by key."""
SETS_SCALE = tuple(key for key, one in ASSUMABLE.items() if one.sets_scale)
"""Those of which any, given, sets the scale of all parameters where no wheel load is measured."""


def assumption_of(assumed: Mapping[str, Assumption], key: str, corner: str = "", value: float = 0.0) -> Assumption:
    """The assumption that holds at a corner: the file's for it, its axle or the car, else the default.

    `value` : what stands for a default of None. The assumption's name has the place that has an error of its own.
    """
    entry = ASSUMABLE[key]
    place = {"car": "", "axle": AXLE_OF.get(corner, ""), "corner": corner}[entry.scope]
    name = f"{key}.{place}" if place else key
    for written in (f"{key}.{corner}", f"{key}.{AXLE_OF.get(corner, '')}", key):
        if written in assumed:
            found = assumed[written]
            return Assumption(name, found.value, found.tolerance, entry.unit, found.source, given=True)
    nominal = value if entry.value is None else entry.value
    return Assumption(name, nominal, entry.tolerance, entry.unit, entry.source)


def read_assumptions(reader: Reader, table: Mapping[str, Any]) -> dict[str, Assumption]:
    """The table ``[assumed]`` of a vehicle file; faults go to the reader."""
    out: dict[str, Assumption] = {}
    for name, row in _entries(table):
        key, _, place = name.partition(".")
        where = f"assumed.{name}"
        if key not in ASSUMABLE:
            reader.fault(where, f"unknown key{nearest(key, ASSUMABLE)}")
            continue
        entry = ASSUMABLE[key]
        places = {"car": (), "axle": ("front", "rear"), "corner": ("front", "rear", *CORNERS)}[entry.scope]
        if place and place not in places:
            known = ", ".join(f"{key}.{one}" for one in places) or key
            reader.fault(where, f"{place!r} is no place of it; known: {known}")
            continue
        tolerance = row.get("tolerance") if isinstance(row, dict) else None
        if tolerance is None:
            reader.fault(where, 'tolerance is missing: write { value = …, tolerance = …, unit = "…", source = "…" }')
            continue
        stated = {k: v for k, v in row.items() if k != "tolerance"}
        value = reader.quantity({name: stated}, name, "assumed", entry.unit)
        spread = reader.quantity({name: {**stated, "value": tolerance}}, name, "assumed", entry.unit)
        if value is None or spread is None:
            continue
        if spread.value < 0.0:
            reader.fault(where, "tolerance must not be negative")
        if key.endswith("ratio") and value.value == 0.0:
            reader.fault(where, "must not be 0")
        if entry.sets_scale and value.value <= 0.0:
            reader.fault(where, "must be positive")
        out[name] = Assumption(name, value.value, spread.value, entry.unit, value.source, given=True)
    return out


def _entries(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Entries by dotted name: ``trail.front`` without quotes is nested in TOML."""
    for key, row in table.items():
        if isinstance(row, dict) and row and "value" not in row and all(isinstance(v, dict) for v in row.values()):
            yield from _entries(row, f"{before}{key}.")
        else:
            yield f"{before}{key}", row
