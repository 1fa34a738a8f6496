"""Compliance from the readings of a bench: slopes of the joints by loads on both wheels of an axle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lacet.daq.bench_readings import LOADED, MOVED, SOURCE, BenchReadings, joint_tables
from lacet.daq.channels import CORNERS, other_corner
from lacet.daq.compliance import JOINTS, LOADS, PLACES, Compliance
from lacet.daq.joint_tables import JointTables

Array = NDArray[np.float64]

READING = {"longitudinal": "fx", "traction": "traction", "lateral": "fy", "aligning": "mz"}
"""Reading that a load is."""
APART = 1e-3
"""Part of the loads' largest common direction below which two loads count as one: a bench repeats loads to a hundredth.
"""


@dataclass(frozen=True)
class MeasuredCompliance:
    """Compliance of a corner as a bench measured it.

    `bend` : largest departure of the readings from the straight lines, by joint [m, rad]. `together` : loads that were
    only put on both wheels of the axle at once, so that nobody knows which of them did what; they are left out.
    """

    slopes: Compliance
    bend: Mapping[str, float]
    together: tuple[str, ...]


def tables_with_compliance(bench: BenchReadings) -> tuple[dict[str, JointTables], dict[str, MeasuredCompliance]]:
    """Joint tables of every corner with the compliance of those that were loaded, and what is known of that.

    Raises BenchError naming the corners whose own travel was not measured alone.
    """
    tables = joint_tables(bench)
    found = {corner: one for corner in CORNERS if (one := _of_corner(bench, corner)) is not None}
    return {c: replace(t, compliance=found[c].slopes if c in found else None) for c, t in tables.items()}, found


def _of_corner(bench: BenchReadings, corner: str) -> MeasuredCompliance | None:
    """Least squares of the joints by all loads, at the design position; None where the axle was not loaded."""
    still = np.all([np.abs(moved) < MOVED["travel"] for moved in bench.moved(corner)], axis=0)
    loads = {(place, load): _load(bench, load, wheel) for place, wheel in _wheels(corner) for load in LOADS}
    loads = {key: series[still] for key, series in loads.items() if np.any(series[still])}
    if not loads:
        return None
    together = tuple(load for load in LOADS if _together(loads, load))
    kept = [key for key in loads if key[1] not in together]
    aside = [series == 0.0 for key, series in loads.items() if key not in kept]
    clear = np.all([np.ones(np.count_nonzero(still), bool), *aside], axis=0)
    values = np.stack([bench.of(SOURCE[joint], corner) for joint in JOINTS], axis=1)[still][clear]
    A = np.column_stack([*(loads[key][clear] for key in kept), np.ones(len(values))])
    size = np.maximum(np.max(np.abs(A), axis=0), 1e-300)
    slopes = np.linalg.lstsq(A / size, values, rcond=None)[0] / size[:, None]
    bend = np.max(np.abs(values - A @ slopes), axis=0)
    parts = {place: {load: slopes[i] for i, (where, load) in enumerate(kept) if where == place} for place in PLACES}
    return MeasuredCompliance(Compliance(**parts), dict(zip(JOINTS, bend.tolist(), strict=True)), together)


def _wheels(corner: str) -> tuple[tuple[str, str], ...]:
    return tuple(zip(PLACES, (corner, other_corner(corner)), strict=True))


def _load(bench: BenchReadings, load: str, wheel: str) -> Array:
    """(n,) a load in the signs of the wheel it is on, 0 where it is only noise."""
    name = READING[load]
    series = bench.of(name, wheel)
    side = 1.0 if wheel.endswith("l") else -1.0
    series = series * {"lateral": side, "aligning": -side}.get(load, 1.0)
    return np.where(np.abs(series) < LOADED[name], 0.0, series)


def _together(loads: Mapping[tuple[str, str], Array], load: str) -> bool:
    """Whether a load was on both wheels always in the same proportion."""
    both = [loads[place, load] for place in PLACES if (place, load) in loads]
    if len(both) < len(PLACES):
        return False
    weak, strong = np.linalg.svd(np.column_stack(both), compute_uv=False)[::-1]
    return bool(weak < APART * strong)
