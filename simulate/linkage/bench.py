"""Virtual kinematics and compliance (K&C) bench: a second car's body is clamped at its design height, its wheels moved.

The wheels are locked to their carriers and stand on pads. A pad holds the height of its wheel centre and, in the tests
of compliance, loads the contact point straight below it; of traction, the wheel centre. At every step the mechanism is
in equilibrium. A table has what such rigs deliver: one row a step, columns by wheel, named in `COLUMNS`, angles and
displacements in the signs of the vehicle file (``docs/vehicle.md``).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lacet.daq.bench_compliance import tables_with_compliance
from lacet.daq.bench_readings import BenchReadings
from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError, nearest
from lacet.daq.joint_tables import JointTables
from lacet.daq.units import read_unit
from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.mechanism import Mechanism
from lacet.simulate.linkage.statics import Loads, Shape, Statics

Array = NDArray[np.float64]

SIDE = np.array([1.0, -1.0, 1.0, -1.0])
"""1 for wheels on the left, -1 for those on the right."""

COLUMNS: dict[str, tuple[str, str]] = {
    "travel": ("mm", "wheel centre along body z, compression positive; what the pad holds"),
    "fx": ("N", "load of the pad on the contact point, forwards"),
    "fy": ("N", "load of the pad on the contact point, to the left"),
    "fz": ("N", "load of the pad, upwards: with it the pad holds the travel"),
    "mz": ("N·m", "moment of the pad about z, to the left"),
    "traction": ("N", "load on the wheel centre, forwards, as of a wheel that is free to turn"),
    "x": ("mm", "displacement of the wheel centre forwards, from the design position"),
    "y": ("mm", "displacement of the wheel centre outwards"),
    "z": ("mm", "displacement of the wheel centre upwards"),
    "toe": ("deg", "toe-in, static toe included"),
    "camber": ("deg", "top outwards, static camber included"),
    "spin": ("deg", "rotation of the wheel, locked to its carrier, nose down about its axis"),
}
"""Columns of each wheel, ``toe.fl`` …: unit and meaning. One more is of the car: ``rack`` [mm], to the left."""

NOISE = {"mm": 0.02, "deg": 0.003, "N": 4.0, "N·m": 0.5}
"""Repeatability of a usual rig, 1 σ by unit."""


@dataclass(frozen=True)
class Step:
    """What the bench sets: travels (4,) [m], rack [m], loads on the contact points, `traction` (4,) [N]."""

    travel: Array
    rack: float
    loads: Loads
    traction: Array = field(default_factory=lambda: np.zeros(4))

    def all_loads(self, heights: Array) -> Loads:
        """Loads on the contact points, `heights` (4,) [m] below the wheel centres, that do what all of these do."""
        force, moment = self.loads.force.copy(), self.loads.moment.copy()
        force[:, 0] += self.traction
        moment[:, 1] += heights * self.traction
        return Loads(force, moment)


@dataclass(frozen=True)
class BenchTest:
    """A test: its `name`, what is moved or loaded in words, and the steps."""

    name: str
    moved: str
    steps: tuple[Step, ...]


@dataclass(frozen=True)
class BenchTable:
    """Result of a test: `columns` by name (``rack``, ``toe.fl`` …), each (steps,), in the units of `COLUMNS`."""

    test: BenchTest
    columns: dict[str, Array]

    def csv(self) -> str:
        """The table as CSV: names with units in the first line, one row a step."""
        units = {name: COLUMNS[name.partition(".")[0]][0] if name != "rack" else "mm" for name in self.columns}
        lines = [",".join(f"{name} [{unit}]" for name, unit in units.items())]
        lines += [",".join(f"{value:.6g}" for value in row) for row in zip(*self.columns.values(), strict=True)]
        return "\n".join(lines) + "\n"


def _travels(shape: Iterable[float], at: Array) -> list[Step]:
    return [Step(at * np.asarray(shape), 0.0, Loads.none()) for at in np.atleast_1d(at)]


def bench_tests() -> dict[str, BenchTest]:
    """All tests by name. Travels reach 60 mm, the rack 50 mm, forces 2 kN, moments 120 N·m."""
    none, still = Loads.none(), np.zeros(4)
    travel = np.linspace(-0.06, 0.06, 13)
    grid = np.linspace(-0.05, 0.05, 5)
    force, moment = np.linspace(-2000.0, 2000.0, 9), np.linspace(-120.0, 120.0, 7)

    def loaded(axis: int, sizes: Array, sides: Array, of_moment: bool = False) -> list[Step]:
        out = []
        for size in sizes:
            own = np.zeros((4, 3))
            own[:, axis] = size * sides
            other = np.zeros((4, 3))
            out.append(Step(still, 0.0, Loads(other, own) if of_moment else Loads(own, other)))
        return out

    def driven(sides: Array) -> tuple[Step, ...]:
        return tuple(Step(still, 0.0, none, size * sides) for size in force)

    both, apart = np.ones(4), SIDE
    own_and_other = [Step(np.array([a, b, a, b]), 0.0, none) for a in grid for b in grid]
    rack = [Step(s * both, r, none) for s in (-0.03, 0.0, 0.03) for r in np.linspace(-0.05, 0.05, 11)]
    made = [
        BenchTest("bump", "both wheels of an axle together", tuple(_travels(both, travel))),
        BenchTest("roll", "the wheels of an axle in opposite directions", tuple(_travels(apart, 0.8 * travel))),
        BenchTest("single-left", "the left wheels, the right ones held", tuple(_travels((1, 0, 1, 0), travel))),
        BenchTest("single-right", "the right wheels, the left ones held", tuple(_travels((0, 1, 0, 1), travel))),
        BenchTest("grid", "each wheel at every travel of the other one", tuple(own_and_other)),
        BenchTest("steer", "the rack, at three travels", tuple(rack)),
        BenchTest("lateral", "all wheels loaded to the left", tuple(loaded(1, force, both))),
        BenchTest("lateral-opposed", "the wheels of an axle loaded outwards", tuple(loaded(1, force, apart))),
        BenchTest("longitudinal", "all wheels loaded forwards, braked", tuple(loaded(0, force, both))),
        BenchTest("longitudinal-opposed", "left wheels forwards, right ones backwards", tuple(loaded(0, force, apart))),
        BenchTest("traction", "wheel centres loaded forwards, wheels free to turn", driven(both)),
        BenchTest("traction-opposed", "left wheel centres forwards, right ones backwards", driven(apart)),
        BenchTest("aligning", "moments on all wheels to the left", tuple(loaded(2, moment, both, True))),
        BenchTest("aligning-opposed", "moments on the left wheels to the left, on the right ones to the right",
                  tuple(loaded(2, moment, apart, True))),
    ]  # fmt: skip
    return {test.name: test for test in made}


def find_test(name: str) -> BenchTest:
    """A test by name. Raises UsageError naming the known ones."""
    known = bench_tests()
    if name not in known:
        raise UsageError(f"no bench test is called '{name}'{nearest(name, known) or '.'} Known: {', '.join(known)}")
    return known[name]


def toe_camber_spin(attitudes: Array, design: Array) -> Array:
    """(4, 3) toe-in, camber (top outwards) and carrier pitch against the design [rad], of carriers R_body_carrier."""

    def angles(R: Array) -> Array:
        steer = np.arctan2(-R[:, 0, 1], R[:, 1, 1])
        return np.stack([-SIDE * steer, -SIDE * np.arcsin(R[:, 2, 1]), np.arctan2(-R[:, 2, 0], R[:, 2, 2])], axis=1)

    out = angles(attitudes)
    out[:, 2] -= angles(design)[:, 2]
    return out


class Bench:
    """A bench with a car on it. `noise` : of its readings, in multiples of `NOISE`, drawn with `seed`."""

    def __init__(self, mechanism: Mechanism, noise: float = 0.0, seed: int = 0):
        self._statics = Statics(mechanism)
        self._design = mechanism.car.wheel_centres
        self._noise, self._rng = noise, np.random.default_rng([seed, 2026])

    def run(self, test: BenchTest) -> BenchTable:
        """Drive the car through a test."""
        rows: list[dict[str, float]] = []
        start = None
        for step in test.steps:
            loads = step.all_loads(self._statics.mechanism.car.heights)
            shape = self._statics.solve(step.travel, step.rack, loads, start)
            start = shape.q
            rows.append(self._reading(step, shape))
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        if self._noise:
            for name, values in columns.items():
                unit = COLUMNS[name.partition(".")[0]][0] if name != "rack" else "mm"
                values += self._noise * NOISE[unit] * self._rng.standard_normal(len(values))
        return BenchTable(test, columns)

    def _reading(self, step: Step, shape: Shape) -> dict[str, float]:
        moved = 1e3 * (shape.centres - self._design)
        angles = np.degrees(toe_camber_spin(shape.attitudes, self._statics.mechanism.design_attitudes))
        out = {"rack": 1e3 * step.rack}
        for i, corner in enumerate(CORNERS):
            load, about = step.loads.force[i], step.loads.moment[i]
            values = (
                1e3 * step.travel[i], load[0], load[1], load[2] + shape.held[i], about[2], step.traction[i],
                moved[i, 0], SIDE[i] * moved[i, 1], moved[i, 2], *angles[i],
            )  # fmt: skip
            out |= {f"{name}.{corner}": float(value) for name, value in zip(COLUMNS, values, strict=True)}
        return out


JOINT_TESTS = ("single-left", "single-right", "grid", "steer")
"""Tests that give the joints of every corner: each variable alone, and several together for the mixed terms."""
LOAD_TESTS = tuple(
    f"{load}{how}" for load in ("lateral", "longitudinal", "traction", "aligning") for how in ("", "-opposed")
)
"""Tests that give the compliance."""


@dataclass(frozen=True)
class BenchTables:
    """What the vehicle file of a car has from its bench.

    Attributes
    ----------
    kinematics : by axle, "front" and "rear": series of the table of the bump test [m, rad], `travel`, `half_track`,
        `half_wheelbase`, `camber`, `toe`, `pitch` as changes from the design position, mean of both sides.
    joints : joint tables by corner.
    """

    kinematics: dict[str, dict[str, Array]]
    joints: dict[str, JointTables]

    @classmethod
    def of(cls, car: SecondCar) -> BenchTables:
        """The tables of a car, from a bench without noise. Some seconds of computing."""
        bench, tests = Bench(Mechanism(car)), bench_tests()
        wanted = JOINT_TESTS if car.rigid else (*JOINT_TESTS, *LOAD_TESTS)
        parts = [bench.run(tests[name]).columns for name in wanted]
        columns = {name: np.concatenate([_si(name, part[name]) for part in parts]) for name in parts[0]}
        tables, _ = tables_with_compliance(BenchReadings(columns, wanted))
        return cls(_bump(bench.run(tests["bump"]).columns), tables)


def _si(name: str, values: Array) -> Array:
    """A column of a test in SI units."""
    unit = read_unit(COLUMNS[name.partition(".")[0]][0] if name != "rack" else "mm")
    return values * unit.factor


def _bump(columns: dict[str, Array]) -> dict[str, dict[str, Array]]:
    """Series of the bump test by axle [m, rad]."""
    middle = len(columns["rack"]) // 2
    series = {"half_track": "y", "half_wheelbase": "x", "camber": "camber", "toe": "toe", "pitch": "spin"}
    out = {}
    for axle in ("front", "rear"):
        out[axle] = {"travel": 1e-3 * columns[f"travel.{axle[0]}l"]}
        for name, column in series.items():
            both = 0.5 * (columns[f"{column}.{axle[0]}l"] + columns[f"{column}.{axle[0]}r"])
            out[axle][name] = _si(f"{column}.", both - both[middle])
    return out
