"""Derived values of a fit: ride, roll, load transfer, static loads, damper curves.

Definitions and formulae: ``docs/derived.md``. Every value is a smooth function of the parameters; its interval follows
from their covariance (delta method), that of parameters which the runs do not determine included.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import CHASSIS_ROWS, SUSPENSION_ROWS, Row, RowAbsence
from lacet.identify.effects.base import SuspensionForce, with_places
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.corner_rates import BLOCKS, CornerNumbers, corner_numbers, rows_unseen, suspension_laws
from lacet.identify.properties.ride_model import ride_values
from lacet.identify.properties.sums_of_places import sums_of_places
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import WIDE
from lacet.identify.validation.prediction_uncertainty import Knowledge, OpenParameters

_SEEN = (0.005, 0.995)
"""Quantiles that bound a range covered, so that a few noisy samples do not widen it."""
_MOVES = 1e-3
"""Part of a derived value that an effect of a plausible size moves, from which the value depends on it [ratio]: far
below any interval."""


@dataclass(frozen=True)
class RowMissing:
    """A row that a derived value depends on exists in no run; `absence` : why."""

    row: Row
    absence: RowAbsence


@dataclass(frozen=True)
class ImpossibleCar:
    """The estimated masses, inertias and stiffnesses are impossible: one of them is not positive."""


@dataclass(frozen=True)
class Derived:
    """One derived value; `why` is the reason where it is not `determined`.

    `half` is half of its 95 % interval from noise and from what the runs leave open; `half_sheet` the same with what
    the sensor sheet's gains and latencies may add. `effects` : keys of those whose sizes it depends on.
    """

    name: str
    value: float
    unit: str
    half: float
    half_sheet: float
    determined: bool
    why: OpenParameters | RowMissing | ImpossibleCar | None
    effects: tuple[str, ...] = ()


@dataclass(frozen=True)
class DamperCurve:
    """A corner's damper force against travel rate over the range covered, at the mean travel.

    `rate` (n,) m/s, compression positive; `force` (n,) N, resisting compression; `half` (n,) of the 95 % band;
    `travel` m; `effects` : keys of those that act on it.
    """

    rate: Array
    force: Array
    half: Array
    travel: float
    effects: tuple[str, ...] = ()


def derived_values(fitted: Fit, vehicle: Vehicle, knowledge: Knowledge) -> list[Derived]:
    """The derived values of a fit; empty when the model has no chassis.

    Of a fit to the rows of the body alone, whose mass is no parameter, only sums of laws (`inseparable_sums`).
    """
    if "M6" not in knowledge.names:
        return []
    if any(row.combined for row in fitted.rows) and not any(row in SUSPENSION_ROWS for row in fitted.rows):
        return inseparable_sums(fitted, knowledge)
    table = corner_numbers(fitted)
    x = table @ fitted.physics
    names, units, values = _values(x, vehicle)
    by_number = _jacobian(x, vehicle, np.any(table != 0.0, axis=1))
    slopes = _by_parameter(by_number, table)
    rows = rows_unseen(fitted)
    unseen = np.array([row is not None for row in rows])
    # At zero, which an unseen rate is, a frequency has no slope: what depends on it is found away from there.
    at_zero = unseen & (x == 0.0)
    shown = _jacobian(np.where(at_zero, 1.0, x), vehicle, unseen) if at_zero.any() else by_number
    moved = (np.abs(shown) > 0.0) & unseen
    usable = np.isfinite(values) & np.all(np.isfinite(slopes), axis=1)
    finite = np.where(usable[:, None], slopes, 0.0)
    spread = knowledge.spread(finite)
    p = finite.shape[1]
    sheet = np.einsum("ij,jk,ik->i", finite, fitted.covariance_sheet[:p, :p], finite)
    with_sheet = np.hypot(spread, np.sqrt(np.maximum(0.0, sheet)))
    out: list[Derived] = []
    for k, name in enumerate(names):
        half = TWO_SIDED_95 * float(spread[k])
        determined = bool(usable[k]) and not moved[k].any() and half <= WIDE * abs(float(values[k]))
        why = None
        if not determined:
            which: tuple[int, ...] = ()
            if usable[k]:
                enough = (WIDE * abs(float(values[k])) / TWO_SIDED_95) ** 2
                which = knowledge.responsible(np.asarray(np.outer(slopes[k], slopes[k]), float), enough)
                why = knowledge.open_parameters(which)
            else:
                why = ImpossibleCar()
            blind = next((row for row, at in zip(rows, moved[k] if usable[k] else unseen, strict=True) if at), None)
            why = _not_measured(fitted, name) or (_missing(fitted, blind) if blind else None) or why
        half_sheet = TWO_SIDED_95 * float(with_sheet[k])
        moving = _moving(fitted, finite[k], float(values[k]))
        out.append(Derived(name, float(values[k]), units[k], half, half_sheet, determined, why, moving))
    return [*out, *inseparable_sums(fitted, knowledge)]


def inseparable_sums(fitted: Fit, knowledge: Knowledge) -> list[Derived]:
    """Sums of laws of which the runs do not determine how they are split among their places, as of both anti-roll bars
    without wheel loads and without a road that twists the car; the sensor sheet is in both intervals."""
    out: list[Derived] = []
    for one in sums_of_places(fitted, knowledge):
        if one.inseparable:
            which = tuple(i for i, name in enumerate(knowledge.names) if name in one.members)
            why = None if one.determined else knowledge.open_parameters(which)
            out.append(Derived(one.name, one.value, one.unit, one.half, one.half, one.determined, why, one.keys))
    return out


def _values(x: Array, vehicle: Vehicle) -> tuple[list[str], list[str], Array]:
    found = ride_values(CornerNumbers.unpack(x), vehicle)
    return list(found), [unit for _, unit in found.values()], np.array([value for value, _ in found.values()])


def _moving(fitted: Fit, slopes: Array, value: float) -> tuple[str, ...]:
    """Keys of the effects that a value with these slopes (p,) by the parameters depends on."""
    out: list[str] = []
    for effect, part in with_places(fitted.model.physics):
        plausible = np.array([q.prior for q in effect.parameters])
        if np.any(np.abs(slopes[part]) * plausible > _MOVES * abs(value)):
            out.append(effect.key)
    return tuple(out)


def _by_parameter(by_number: Array, table: Array) -> Array:
    """(values, parameters) from derivatives by number; a value with an infinite one, an impossible car's, has NaN."""
    finite = np.all(np.isfinite(by_number), axis=1)
    slopes: Array = np.where(finite[:, None], by_number, 0.0) @ table
    slopes[~finite] = np.nan
    return slopes


def _jacobian(x: Array, vehicle: Vehicle, free: NDArray[np.bool_]) -> Array:
    """(values, numbers) by central differences, each `free` number moved by 1e-5 of the largest of its kind.

    Infinite or NaN where a value is, as of a car without mass; zero by numbers that are not free.
    """
    blocks = np.array(BLOCKS)
    out = np.zeros((_values(x, vehicle)[2].size, x.size))
    for i in np.flatnonzero(free):
        step = np.zeros(x.size)
        largest = float(np.max(np.abs(x[blocks == blocks[i]])))
        step[i] = 1e-5 * (largest or 1.0)
        up, down = (_values(x + sign * step, vehicle)[2] for sign in (1.0, -1.0))
        with np.errstate(invalid="ignore"):
            out[:, i] = (up - down) / (2.0 * step[i])
    return out


def _not_measured(fitted: Fit, name: str) -> RowMissing | None:
    """The first of the rows that a value depends on which exists in no run."""
    where = name.split(".")[1] if "." in name else ""
    corners = {"front": ("fl", "fr"), "rear": ("rl", "rr")}.get(where, (where,) if where in CORNERS else CORNERS)
    for row in (Row.parse(f"{kind}.{c}") for kind in ("suspension", "tyre") for c in corners):
        if missing := _missing(fitted, row):
            return missing
    return None


def _missing(fitted: Fit, row: Row) -> RowMissing | None:
    """A row as the reason where it exists in no run, else None."""
    found = [run.measured_rows.left_out for run in fitted.runs]
    reasons = [left_out[row] for left_out in found if row in left_out]
    return RowMissing(row, reasons[0]) if reasons and len(reasons) == len(fitted.runs) else None


def damper_curves(fitted: Fit, knowledge: Knowledge, points: int = 41) -> dict[str, DamperCurve]:
    """Corner → damper curve: all suspension forces of the model at the mean travel, less their values at zero rate."""
    out: dict[str, DamperCurve] = {}
    for corner in CORNERS:
        row = Row.parse(f"suspension.{corner}")
        runs = [run for run in fitted.runs if row in run.index]
        if not runs:
            continue
        low, high = seen(fitted, row, lambda motion, c=corner: motion.corners[c].rate)
        travel = float(np.mean(np.concatenate([d.kept_motion.corners[corner].travel[d.kept(row)] for d in runs])))
        rate = np.linspace(min(low, 0.0), max(high, 0.0), points)
        laws, acting = np.zeros((points, len(fitted.physics))), list[str]()
        for effect, part in with_places(fitted.model.physics):
            if isinstance(effect, SuspensionForce):
                at = {c: np.full(points, travel) for c in CORNERS}
                moving = suspension_laws(effect, runs[0].kept_motion, at, dict.fromkeys(CORNERS, rate))
                still = suspension_laws(effect, runs[0].kept_motion, at, dict.fromkeys(CORNERS, np.zeros(points)))
                if corner in moving:
                    laws[:, part] = (moving[corner] - still[corner]).T
                    acting += [effect.key] if np.any(laws[:, part] != 0.0) else []
        half = TWO_SIDED_95 * knowledge.spread(laws)
        out[corner] = DamperCurve(rate, laws @ fitted.physics, half, travel, tuple(acting))
    return out


@dataclass(frozen=True)
class Range:
    """Range of a quantity covered by the runs used: `low` to `high` [`unit`]."""

    name: str
    low: float
    high: float
    unit: str


def ranges(fitted: Fit) -> list[Range]:
    """Ranges covered by the runs used: travel, travel rate and vertical load of each wheel, speed and accelerations."""
    out: list[Range] = []
    for corner in CORNERS:
        row = Row.parse(f"suspension.{corner}")
        if not any(row in drive.index for drive in fitted.runs):
            continue

        def series(part: str, c: str = corner) -> Callable[[Motion], Array]:
            return lambda motion: getattr(motion.corners[c], part)

        out.append(Range(f"travel.{corner}", *seen(fitted, row, series("travel")), "m"))
        out.append(Range(f"rate.{corner}", *seen(fitted, row, series("rate")), "m/s"))
        out.append(
            Range(f"load.{corner}", *seen(fitted, row, lambda motion, c=corner: motion.corners[c].force[2]), "N")
        )
    if any(CHASSIS_ROWS[0] in drive.index for drive in fitted.runs):
        if all(drive.kept_motion.velocity is not None for drive in fitted.runs):
            out.append(Range("speed", *seen(fitted, CHASSIS_ROWS[0], _speed), "m/s"))
        for k, name in enumerate(("longitudinal", "lateral")):
            low, high = seen(fitted, CHASSIS_ROWS[0], lambda motion, k=k: motion.body.accel[k])
            out.append(Range(f"acceleration.{name}", low, high, "m/s²"))
    return out


def seen(fitted: Fit, row: Row, pick: Callable[[Motion], Array]) -> tuple[float, float]:
    """Range of a series of the motion over the samples of a row that entered the fit, all runs together."""
    values = [pick(run.kept_motion)[run.kept(row)] for run in fitted.runs if row in run.index]
    low, high = np.quantile(np.concatenate(values), _SEEN)
    return float(low), float(high)


def _speed(motion: Motion) -> Array:
    assert motion.velocity is not None
    return np.hypot(motion.velocity[0], motion.velocity[1])
