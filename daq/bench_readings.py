"""Readings of a kinematics and compliance (K&C) bench: text tables of any rig, by a map, checked, and joints from them.

A bench map is a TOML file that says which column of the rig's tables is which of `COLUMNS`:

    format = "lacet-bench-map 1"
    [columns]
    rack = "RackDisp"
    "travel.fl" = { from = "WCZ_LF", unit = "mm" }
    "toe.fr" = { from = "-Steer_RF", unit = "deg" }

A minus turns the sign. A unit stands behind the name in the table (``WCZ_LF [mm]``) or in the map. Without a map the
names are those of `COLUMNS`.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.errors import FileFault, nearest
from lacet.daq.joint_tables import JOINTS, REACHED, JointCurve, JointTables, beyond_reach
from lacet.daq.toml_reader import Reader
from lacet.daq.units import UnitFault, read_unit

Array = NDArray[np.float64]

FORMAT = "lacet-bench-map 1"
SOURCE = {"half_track": "y", "half_wheelbase": "x", "toe": "toe", "camber": "camber", "pitch": "spin"}
"""Reading that a joint is."""
QUANTITIES = {
    "travel": "m", "x": "m", "y": "m", "z": "m", "toe": "rad", "camber": "rad", "spin": "rad", "fx": "N", "fy": "N",
    "mz": "N·m", "traction": "N",
}  # fmt: skip
"""Readings of each wheel with their SI units; docs/bench.md has their signs."""
NEEDED = ("travel", "x", "y", "toe", "camber", "spin")
COLUMNS: dict[str, str] = {"rack": "m", **{f"{q}.{c}": unit for c in CORNERS for q, unit in QUANTITIES.items()}}
"""Every column with its SI unit. ``rack``, ``z`` and the loads may be absent: 0, and not checked."""

MOVED = {"travel": 5e-4, "rack": 5e-4}
"""What counts as moved [m]: readings of what is held scatter by less."""
LOADED = {"fx": 25.0, "fy": 25.0, "mz": 5.0, "traction": 25.0}
"""What counts as loaded [N, N·m]: such rows are of compliance and not of kinematics."""
CLEAR = {"m": 1e-3, "rad": np.radians(0.1)}
"""Change of a joint over a test from which its sign is judged."""
SWEPT = 1e-3
"""Travel over which the readings of a sweep without settings are averaged [m]. Source: a choice, well below what a
curve bends over."""
REPEATABILITY = np.array([2e-5 if unit == "m" else np.radians(0.003) for unit in JOINTS.values()])
"""What a usual rig's readings of each joint scatter by, 1 σ [m, rad]. Source: repeatability of K&C rigs, as of
`lacet bench --noise 1`."""
SMOOTHING = (-14.0, 4.0)
"""log₁₀ of the least and the largest smoothing: through the readings; a straight line."""
LEAST_SMOOTHED = 5
"""Settings of a test from which a curve is smoothed. Source: what `scipy.interpolate.make_smoothing_spline` needs."""
RIGID = 0.5
"""Change of the track ÷ shift of a wheel to the side, below which an axle counts as rigid. Source: a choice."""
LARGEST = {SOURCE[joint]: most for joint, most in REACHED.items()} | dict.fromkeys(("rack", "travel", "z"), 0.5)
"""Readings that no car reaches [m, rad]. Source: as of `REACHED`."""


class BenchError(FileFault):
    """Fault of bench tables or their map; lists every one."""


@dataclass(frozen=True)
class BenchReadings:
    """Readings by column (`COLUMNS`), each (n,) in SI; `files` they came from."""

    columns: Mapping[str, Array]
    files: tuple[str, ...]

    def of(self, quantity: str, corner: str) -> Array:
        """(n,) a reading of a wheel; 0 where it was not recorded."""
        return self.columns.get(f"{quantity}.{corner}", np.zeros(len(self.columns["rack"])))

    def moved(self, corner: str) -> tuple[Array, Array, Array]:
        """(n,) own travel, travel of the axle's other wheel, rack, of a corner."""
        return self.of("travel", corner), self.of("travel", other_corner(corner)), self.columns["rack"]

    @property
    def free(self) -> NDArray[np.bool_]:
        """(n,) rows without a load in the plane of the road."""
        out = np.ones(len(self.columns["rack"]), bool)
        for quantity, least in LOADED.items():
            for corner in CORNERS:
                out &= np.abs(self.of(quantity, corner)) < least
        return out


def read_bench(files: Sequence[str | Path], bench_map: str | Path | None = None) -> BenchReadings:
    """The tables of a bench, all together. Raises BenchError with every fault of names, units, signs and sides."""
    mapped = {} if bench_map is None else _map(Path(bench_map))
    parts = [_table(Path(file), mapped) for file in files]
    known = [name for name in COLUMNS if all(name in part for part in parts)]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in known}
    if "rack" not in columns:
        columns["rack"] = np.zeros(sum(len(next(iter(part.values()))) for part in parts))
    out = BenchReadings(columns, tuple(str(file) for file in files))
    faults = sign_faults(out)
    if faults:
        raise BenchError(", ".join(out.files), faults)
    return out


def _map(path: Path) -> dict[str, tuple[str, float, str | None]]:
    """Column → name in the tables, sign, unit (None: the table's)."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as cause:
        raise BenchError(str(path), [str(cause.strerror or cause)]) from None
    reader = Reader(text, str(path), BenchError, FORMAT)
    reader.known(reader.root, ("format", "columns"), "")
    rows = reader.table(reader.root, "columns", "", required=True)
    reader.known(rows, COLUMNS, "columns")
    out: dict[str, tuple[str, float, str | None]] = {}
    for column, row in rows.items():
        entry: dict[str, Any] = row if isinstance(row, dict) else {"from": row}
        name, unit = entry.get("from"), entry.get("unit")
        if not isinstance(name, str) or not name.lstrip("-") or not (unit is None or isinstance(unit, str)):
            reader.fault(f"columns.{column}", 'write "NAME", "-NAME" or { from = "NAME", unit = "mm" }')
            continue
        out[column] = (name.removeprefix("-"), -1.0 if name.startswith("-") else 1.0, unit)
    reader.finish()
    return out


def _table(path: Path, mapped: Mapping[str, tuple[str, float, str | None]]) -> dict[str, Array]:
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as cause:
        raise BenchError(str(path), [str(cause.strerror or cause)]) from None
    head, *rows = [line for line in text.splitlines() if line.strip()] or [""]
    separator = max(";\t,", key=head.count)
    names = [name.strip() for name in next(csv.reader([head], delimiter=separator))]
    units = {name.partition("[")[0].strip(): name.partition("[")[2].rstrip("] ").strip() for name in names}
    place = {name.partition("[")[0].strip(): i for i, name in enumerate(names)}
    wanted = mapped or {column: (column, 1.0, None) for column in COLUMNS if column in place}
    faults: list[str] = []
    numbers = np.zeros((0, len(names)))
    try:
        numbers = np.array([[float(v) for v in row] for row in csv.reader(rows, delimiter=separator)], float)
        numbers = numbers.reshape(len(rows), -1)
        if not len(rows) or numbers.shape[1] != len(names) or not np.all(np.isfinite(numbers)):
            raise ValueError("a row is empty, or has no finite numbers")
    except ValueError as cause:
        raise BenchError(
            str(path), [f"each row needs a number for each of the {len(names)} columns: {cause}"]
        ) from None
    out: dict[str, Array] = {}
    for column, (name, sign, given) in wanted.items():
        if name not in place:
            faults.append(f"{column}: no column is called '{name}'{nearest(name, place) or '.'}")
            continue
        try:
            if not (given or units[name]):
                raise UnitFault("no unit behind its name, and none in the map")
            unit = read_unit(given or units[name])
            if not unit.fits(COLUMNS[column]):
                raise UnitFault(f"unit '{unit.text}' is not one of a quantity in {COLUMNS[column]}")
        except UnitFault as cause:
            faults.append(f"{column}: {cause}")
            continue
        out[column] = sign * (unit.factor * numbers[:, place[name]] + unit.offset)
    missing = [f"{q}.{c}" for c in CORNERS for q in NEEDED if f"{q}.{c}" not in (mapped or out)]
    if missing and not faults:
        faults.append(f"missing: {', '.join(missing)}")
    if faults:
        raise BenchError(str(path), faults)
    return out


def _slope(x: Array, y: Array) -> float:
    """Slope of y on x."""
    return float(np.polyfit(x, y, 1)[0])


def sign_faults(bench: BenchReadings) -> list[str]:
    """Faults that no car can have: columns with another sign, or of the other side."""
    out: list[str] = []
    free, rack = bench.free, bench.columns["rack"]
    for column, values in bench.columns.items():
        if beyond := beyond_reach(values, COLUMNS[column], LARGEST.get(column.partition(".")[0], np.inf)):
            out.append(f"{column}: {beyond}")
    for corner in CORNERS:
        travel = bench.of("travel", corner)[free]
        if (
            f"z.{corner}" in bench.columns
            and np.ptp(travel) > 0.01
            and _slope(travel, bench.of("z", corner)[free]) < 0.5
        ):
            out.append(f"z.{corner}: does not rise with travel.{corner}: one of them has another sign or unit")
    for left, right in (("fl", "fr"), ("rl", "rr")):
        a, b = bench.of("travel", left), bench.of("travel", right)
        still = np.abs(rack) < MOVED["rack"]
        for moved, held, rows in (
            (left, right, free & still & (np.abs(b) < MOVED["travel"])),
            (right, left, free & still & (np.abs(a) < MOVED["travel"])),
        ):
            if not np.any(rows) or np.ptp(bench.of("travel", moved)[rows]) < 0.02:
                continue
            shifts = {q: [np.ptp(bench.of(q, c)[rows]) for c in (moved, held)] for q in ("x", "y")}
            if all(own < 0.8 * other for own, other in shifts.values()):
                out.append(
                    f"where travel.{moved} alone changes, x and y of {held} move more than those of {moved}: "
                    "columns of left and right are exchanged"
                )
        together = free & still & (np.abs(a - b) < MOVED["travel"])
        if np.any(together) and np.ptp(a[together]) > 0.02:
            for q in ("toe", "camber"):
                slopes = [_slope(a[together], bench.of(q, c)[together]) * np.ptp(a[together]) for c in (left, right)]
                if slopes[0] * slopes[1] < 0.0 and min(map(abs, slopes)) > CLEAR["rad"]:
                    out.append(
                        f"{q}.{left} and {q}.{right} change against each other where both wheels rise: "
                        f"{'toe-in' if q == 'toe' else 'top outwards'} is positive on both sides"
                    )
            y = {c: bench.of("y", c) for c in (left, right)}
            slopes = [_slope(a[together], y[c][together]) * np.ptp(a[together]) for c in (left, right)]
            # A rigid axle shifts to one side as a whole: its track stays what it is whatever its wheels do.
            track, shift = np.ptp((y[left] + y[right])[free & still]), np.ptp(y[left][free & still])
            if slopes[0] * slopes[1] < 0.0 and CLEAR["m"] < min(map(abs, slopes)) and track > RIGID * shift:
                out.append(
                    f"y.{left} and y.{right} change against each other where both wheels rise, of no rigid axle: "
                    "outwards is positive on both sides"
                )
        turned = free & (np.abs(a) < MOVED["travel"]) & (np.abs(b) < MOVED["travel"])
        if np.any(turned) and np.ptp(rack[turned]) > 0.01:
            slopes = [_slope(rack[turned], bench.of("toe", c)[turned]) * np.ptp(rack[turned]) for c in (left, right)]
            if slopes[0] * slopes[1] > 0.0 and min(map(abs, slopes)) > CLEAR["rad"]:
                out.append(
                    f"toe.{left} and toe.{right} change alike with the rack, as steer angles do: toe-in is wanted, "
                    "turn the sign of one side"
                )
    return out


def joint_tables(bench: BenchReadings) -> dict[str, JointTables]:
    """Joint tables of every corner: curves from rows where one variable moved, mixed errors from all others.

    Without the compliance, which `bench_compliance` has.

    Raises BenchError naming the corners whose own travel was not measured alone.
    """
    out: dict[str, JointTables] = {}
    faults: list[str] = []
    for corner in CORNERS:
        own, other, rack = bench.moved(corner)
        moves = [np.abs(own) >= MOVED["travel"], np.abs(other) >= MOVED["travel"], np.abs(rack) >= MOVED["rack"]]
        values = np.stack([bench.of(SOURCE[joint], corner) for joint in JOINTS], axis=1)
        curves = []
        for k, x in enumerate((own, other, rack)):
            alone = bench.free & ~np.any([m for i, m in enumerate(moves) if i != k], axis=0)
            curves.append(_curve(x[alone], values[alone]))
        alike = None if curves[0] else _of_bump_and_roll(own, other, values, bench.free & ~moves[2])
        if alike is not None:
            curves[:2] = alike
        if curves[0] is None:
            faults.append(
                f"{corner}: no test moves it through 0 while the other wheel and the rack are held, nor both wheels of "
                "the axle together and in opposite directions: add a test of one wheel, or a bump and a roll test"
            )
            continue
        table = JointTables(curves[0], curves[1], curves[2], {})
        if not table.steered:
            table = replace(table, rack=None)  # what the readings of a wheel that no rack steers scatter by
            curves[2] = None
        middle = values[bench.free & ~np.any(moves, axis=0)]
        several = bench.free & (np.sum(moves, axis=0) > 1)
        if np.any(several) and len(middle):
            inside = several.copy()
            for curve, x in zip(curves, (own, other, rack), strict=True):
                if curve is None:
                    inside &= np.abs(x) < MOVED["travel"]
                else:
                    inside &= (x >= curve.at[0] - MOVED["travel"]) & (x <= curve.at[-1] + MOVED["travel"])
            if np.any(inside):
                table = _with_mixed(table, values - middle.mean(axis=0), inside, (own, other, rack))
        out[corner] = table
    if faults:
        raise BenchError(", ".join(bench.files), faults)
    return out


def _of_bump_and_roll(
    own: Array, other: Array, values: Array, rows: NDArray[np.bool_]
) -> tuple[JointCurve, JointCurve] | None:  # fmt: skip
    """The joints against own and other travel, from rows with both wheels together and in opposite directions.

    T(s, s) and T(s, −s) determine what is odd in each travel, and of what is even the sum alone: it is taken as own.
    None where one of the tests is missing, or has no travel on both sides of 0. As far as both tests reach.
    """
    bump, roll = (
        _curve(own[where], values[where])
        for where in (rows & (np.abs(own - other) < MOVED["travel"]), rows & (np.abs(own + other) < MOVED["travel"]))
    )
    if bump is None or roll is None:
        return None
    reach = min(abs(end) for curve in (bump, roll) for end in (curve.at[0], curve.at[-1]))
    at = bump.at[np.abs(bump.at) <= reach + MOVED["travel"]]
    odd = [(curve.value(at) - curve.value(-at)) / 2.0 for curve in (bump, roll)]
    return JointCurve(at, (bump.value(at) + roll.value(at)) / 2.0), JointCurve(at, (odd[0] - odd[1]) / 2.0)


def _with_mixed(
    table: JointTables, changes: Array, rows: NDArray[np.bool_], moved: tuple[Array, Array, Array]
) -> JointTables:
    """Joint tables with the products of travels and rack, from rows with several moved, and the error that remains."""
    own, other, rack = moved
    still = np.abs(rack) < MOVED["rack"]
    for name, product, where in (("product", own * other, rows & still), ("rack_product", own * rack, rows & ~still)):
        by = product[where]
        if np.any(by):
            error = (changes - table.at(*moved))[where]
            fitted = by @ error / (by @ by)
            table = replace(table, product=fitted) if name == "product" else replace(table, rack_product=fitted)
    largest = np.max(np.abs((changes - table.at(*moved))[rows]), axis=0)
    return replace(table, mixed=dict(zip(JOINTS, largest.tolist(), strict=True)))


def _curve(x: Array, values: Array) -> JointCurve | None:
    """Means of the rows at each setting of x, without their scatter; None when they do not reach both sides of 0."""
    if len(x) < 3 or not x.min() < -MOVED["travel"] < MOVED["travel"] < x.max():
        return None
    order = np.argsort(x, kind="stable")
    x, values = x[order], values[order]
    apart = np.diff(x) > MOVED["travel"]
    begins = np.concatenate([[True], apart])
    cell = np.floor((x - x[begins][np.cumsum(begins) - 1]) / SWEPT)
    groups = np.concatenate([[0], np.cumsum(apart | (np.diff(cell) != 0.0))])
    n = int(groups[-1]) + 1
    weight = np.bincount(groups, minlength=n)
    at = np.bincount(groups, x, n) / weight
    means = np.stack([np.bincount(groups, column, n) / weight for column in values.T], axis=1)
    means = _smoothed(at, means, REPEATABILITY / np.sqrt(np.mean(weight)))
    zero = int(np.argmin(np.abs(at)))
    return JointCurve(at, means - means[zero] if abs(at[zero]) < MOVED["travel"] else means)


def _smoothed(at: Array, values: Array, scatter: Array) -> Array:
    """Joints (n, 5) at n settings without their `scatter` (5,), of which a curve through each would make slopes.

    Cubic smoothing splines, as smooth as generalised cross-validation has them, and no farther from the readings than
    these scatter: P. Craven and G. Wahba, Smoothing noisy data with spline functions, Numerische Mathematik 31 (1979);
    C. H. Reinsch, Smoothing by spline functions, Numerische Mathematik 10 (1967).
    """
    # Only here: SciPy is not needed to read a vehicle file.
    from scipy.interpolate import make_smoothing_spline
    from scipy.optimize import brentq

    if len(at) < LEAST_SMOOTHED:
        return values
    x, out = (at - at[0]) / (at[-1] - at[0]), values.copy()
    for k, sigma in enumerate(scatter.tolist()):
        y = values[:, k] / sigma

        def smooth(lam: float | None, y: Array = y) -> Array:
            return np.asarray(make_smoothing_spline(x, y, lam=lam)(x), float)

        def beyond(power: float, y: Array = y) -> float:
            return float(np.mean((smooth(10.0**power, y) - y) ** 2)) - 1.0

        found = smooth(None)
        if np.mean((found - y) ** 2) > 1.0:
            found = smooth(10.0 ** float(brentq(beyond, *SMOOTHING, xtol=0.05)))
        out[:, k] = sigma * found
    return out
