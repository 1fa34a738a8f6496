"""One channel's column with another sign, in another unit or late, from the car's own equations.

Beside all parameters of the base model, and spring and damping across each axle, the column's scale and delay are
estimated (`fault_columns`). A fault is stated where the estimate excludes every value of a sound column, whatever the
car lacks: a missing effect changes forces by parts of them, and is never worth a wheel's side force with the other
sign. It may be worth a small load, as the drag of a free wheel. A reversed column is reversed in each row that it
enters, while what the car lacks is divided among the rows to suit: a wrong sign is stated only where one row shows it
by itself, and none shows that it is right. Where that row is certain, the others may miss −1 by what the car lacks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final

import numpy as np
import scipy

from lacet.daq.channels import COLUMNS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.channels.earlier import earlier
from lacet.identify.validation.channels.evidence import (
    CHANCE,
    EXPLAINS,
    LATE_PART,
    MUCH,
    NOISY,
    PART,
    SHOWS,
    USUAL,
    is_large,
    reach,
)
from lacet.identify.validation.channels.exchanged_pairs import ExchangedPair, exchanged_pairs
from lacet.identify.validation.channels.fault_columns import (
    BLOCKS,
    LATE,
    FaultColumns,
    FaultEstimate,
)
from lacet.identify.validation.channels.late_instruments import (
    LateInstruments,
    WithoutDelays,
    in_common,
    late_instruments,
)
from lacet.identify.validation.channels.vehicle_lengths import Length
from lacet.identify.validation.channels.wrong_places import WrongPlace, wrong_place

_TWICE: Final = 2.0
"""Factor from which a scale is no calibration error, either way."""
_OPPOSITE: Final = 0.1
"""Distance from −1 within which a scale is taken for it."""
_TENFOLD: Final = 10.0
"""Factor from which a scale is another unit: no missing effect is worth nine tenths of a channel."""
_ANOTHER: Final = 10.0**0.5
"""Ratio of the scales of two halves of a run from which they are no one unit's: between 1 and the factor of the nearest
other unit that is looked for."""
_NOISY_SIGN: Final = 0.3
"""`NOISY` for a wrong sign, which noise makes smaller and not another."""
_MATTERS: Final = 0.001
"""Least fall of weighted squares ÷ samples for a scale: less moves no estimate."""
_GROSS: Final = 30.0
"""Misfit from which the columns that explain most of it are named: no effect that a car lacks is worth as much."""
_SUSPECTS: Final = 4
"""Largest number of columns named."""
_LITTLE: Final = 0.005
"""The same in all runs together, where a delay is the same in each."""
_ALIKE: Final = 0.2
"""Part of a delay's fall by which that of another column must be less for the two to be distinguished."""
_TRIED: Final = 3
"""Number of columns whose delay is removed, one at a time."""
_STEPS: Final = 4
"""Largest number of times that a delay is removed and estimated again."""
_LATEST: Final = 0.06
"""Largest delay that is looked for [s]: half a period at the fit's cut-off and more, where estimates mean nothing."""
_CLOSE: Final = 1e-3
"""Change of a delay with which it is settled [s]."""


class Fault(Enum):
    """A kind of fault of one column."""

    SIGN = auto()
    UNIT = auto()
    UNSTEADY = auto()
    """Its scale is another in one half of the run than in the other."""
    LATE = auto()


@dataclass(frozen=True)
class ColumnFault:
    """Fault of one column, from the equations of runs.

    Attributes
    ----------
    column : name in the exchange table.
    fault : its kind.
    value, half : true ÷ recorded value, or delay [s], and half of its 95 % interval.
    misfit, remaining : root of the weighted squares ÷ samples (1 : noise alone) as it is, and without the fault.
    runs : run → the seconds looked at, from and to.
    unit : in what the column seems to be recorded; empty where it is no question of unit.
    ties : other columns whose delay would explain as much, but for chance.
    others : other columns with the wrong sign, beside which the value of this one is.
    halves : of an unsteady scale, true ÷ recorded value in the first and in the second half of the run.
    """

    column: str
    fault: Fault
    value: float
    half: float
    misfit: float
    remaining: float
    runs: Mapping[str, tuple[float, float]]
    unit: str = ""
    ties: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    halves: tuple[float, ...] = ()


@dataclass(frozen=True)
class Suspects:
    """Columns that explain most of what the laws leave in a run, where none is at fault for sure.

    `misfit` : root of the weighted squares ÷ samples (1 : noise alone); `columns` : column → the part of the excess
    that its scale or delay takes away, the largest first.
    """

    misfit: float
    columns: Mapping[str, float]
    runs: Mapping[str, tuple[float, float]]


EquationFault = ColumnFault | WrongPlace | Suspects | LateInstruments | ExchangedPair
"""What the car's equations say of the channels of runs."""


def column_faults(runs: Sequence[PreparedRun]) -> list[EquationFault]:
    """Columns at fault in runs, or those to look at, or a misplaced inertial unit; empty where the equations hold.

    Each run is looked at by itself first, one column a run at most; where no run shows a fault, all together. A unit at
    another place explains columns that seem late. Runs without measured wheel loads are passed over: in rows of the
    body alone the car's parameters take any scale of a column (the height of the centre of gravity that of a_x).
    """
    runs = [next(iter(run.pieces())) for run in runs if not all(row.combined for row in run.rows)]
    products = [FaultColumns.of(run, Length) for run in runs]
    as_recorded = [(run, found) for run, found in zip(runs, products, strict=True) if found is not None]
    pairs = exchanged_pairs(as_recorded)
    seen = {name for pair in pairs for name in pair.runs}
    late, each = _without_delays([one for one in as_recorded if one[0].name not in seen])
    return [*pairs, *late, *_of_columns(each)]


def _without_delays(
    each: Sequence[tuple[PreparedRun, FaultColumns]],
) -> tuple[list[LateInstruments], list[tuple[PreparedRun, FaultColumns]]]:
    """Whole instruments that are late, and the runs with their products without these delays."""
    late: list[LateInstruments] = []
    out: list[tuple[PreparedRun, FaultColumns]] = []
    for run, found in each:
        fault = late_instruments(run, found)
        if fault is None or _is_of_one_column(run, found, fault):
            out.append((run, found))
        else:
            late.append(fault.found)
            out.append((fault.run, FaultColumns.of(fault.run, Length) or fault.products))
    return in_common(late), out


def _is_of_one_column(run: PreparedRun, products: FaultColumns, fault: WithoutDelays) -> bool:
    """Whether the fault of one column alone leaves no more than delays of instruments, or kinds of columns."""
    one = _fault(run, products)
    return isinstance(one, ColumnFault) and one.remaining**2 <= fault.products.misfit


def _of_columns(each: Sequence[tuple[PreparedRun, FaultColumns]]) -> list[EquationFault]:
    """Single columns at fault, or those to look at, or a misplaced inertial unit."""
    out = [fault for run, found in each if (fault := _with_others(run, found)) is not None]
    if len({found.columns for _, found in each}) != 1:
        return list[EquationFault](_together(out))
    seconds = {run.name: _seconds(run) for run, _ in each}
    joined = FaultColumns.joined([found for _, found in each])
    if all(isinstance(one, ColumnFault) and one.fault is Fault.LATE for one in out):
        least = sum(found.count * _taken(out, run.name) for run, found in each) / joined.count
        elsewhere = wrong_place(joined, [run for run, _ in each], seconds)
        if elsewhere is not None and elsewhere.misfit**2 - elsewhere.remaining**2 > least:
            return [elsewhere]
    if not out and len(each) > 1:
        found = _joint_fault([run for run, _ in each], joined, seconds)
        out = [found] if found is not None else []
    return list[EquationFault](_together(out))


def _taken(found: Sequence[ColumnFault | Suspects], run: str) -> float:
    """Weighted squares ÷ samples of a run that the faults found in it take away."""
    return sum(one.misfit**2 - one.remaining**2 for one in found if isinstance(one, ColumnFault) and run in one.runs)


def _joint_fault(
    runs: Sequence[PreparedRun], products: FaultColumns, seconds: Mapping[str, tuple[float, float]]
) -> ColumnFault | None:
    """The fault of one column in all runs together, too small to be seen in one; None where there is none."""
    estimates, misfit = products.estimates(), products.misfit
    if (wrong := _first_wrong_scale(runs, products, estimates, seconds)) is not None or not estimates:
        return wrong
    one = max(estimates, key=lambda one: one.delay_fall)
    least = abs(one.delay) - reach(products.block_count) * one.delay_spread
    fall = one.delay_fall
    if one.rate_noise > NOISY or not least > LATE or fall < max(_LITTLE, EXPLAINS * (misfit - 1.0)):
        return None
    half, remaining = USUAL * one.delay_spread, max(0.0, misfit - fall) ** 0.5
    apart = max(_ALIKE * fall, float(scipy.special.chdtri(1, CHANCE)) / products.count)
    ties = tuple(other.column for other in estimates if other is not one and fall - other.delay_fall < apart)
    return ColumnFault(one.column, Fault.LATE, one.delay, half, misfit**0.5, remaining, seconds, ties=ties)


def _seconds(run: PreparedRun) -> tuple[float, float]:
    return float(run.recording.t[0]), float(run.recording.t[-1])


def _together(found: Sequence[ColumnFault | Suspects]) -> list[ColumnFault | Suspects]:
    """Faults of the same kind in the same column of several runs as one, with the values of the first.

    Columns to look at are left out where other runs show which it is.
    """
    named = any(isinstance(one, ColumnFault) for one in found)
    out: dict[object, ColumnFault | Suspects] = {}
    for one in found:
        if named and isinstance(one, Suspects):
            continue
        key = (one.column, one.fault, one.halves, one.others) if isinstance(one, ColumnFault) else tuple(one.columns)
        out[key] = replace(out[key], runs={**out[key].runs, **one.runs}) if key in out else one
    return list(out.values())


def _with_others(run: PreparedRun, products: FaultColumns) -> ColumnFault | Suspects | None:
    """The fault of one run; a column with the wrong sign with those found as it is turned round, one after another."""
    first = one = _fault(run, products)
    turned: list[str] = []
    found = products
    while isinstance(one, ColumnFault) and one.fault is Fault.SIGN and one.column not in turned:
        turned.append(one.column)
        reversed_ = PreparedRun(_turned(run.recording, turned), is_piece=True)
        again = FaultColumns.of(reversed_)
        if again is None:
            break
        found, one = again, _fault(reversed_, again)
    values = {one.column: one for one in found.estimates()}
    better = len(turned) > 1 and found.misfit < products.misfit
    if not isinstance(first, ColumnFault) or not better or first.column not in values:
        return first
    value = values[first.column]
    return replace(
        first, value=-value.scale, half=USUAL * value.scale_spread, remaining=found.misfit**0.5,
        others=tuple(turned[1:]),
    )  # fmt: skip


def _turned(recording: Recording, columns: Sequence[str]) -> Recording:
    """The recording with these columns of the other sign."""
    changed: dict[str, Array] = {}
    for column in columns:
        channel, place = COLUMNS[column]
        changed.setdefault(channel.name, recording.signals.value[channel.name].copy())[place] *= -1.0
    return recording.with_signals(recording.signals.changed(changed, recording.filters.rate))


def _fault(run: PreparedRun, products: FaultColumns) -> ColumnFault | Suspects | None:
    """The fault of one run, or the columns to look at; None where the equations hold."""
    estimates, misfit, seconds = products.estimates(), products.misfit, {run.name: _seconds(run)}
    late = [
        ColumnFault(column, Fault.LATE, delay, USUAL * spread, misfit**0.5, remaining**0.5, seconds)
        for column, delay, spread, remaining in _delays(run, estimates, misfit)
        if remaining < _GROSS**2 and is_large(misfit - remaining, misfit) and abs(delay) - reach(BLOCKS) * spread > LATE
    ]
    wrong = _first_wrong_scale([run], products, estimates, seconds)
    if late or wrong is not None:
        return min([*late, *([wrong] if wrong is not None else [])], key=lambda one: one.remaining)
    if misfit**0.5 < _GROSS:
        return None
    parts = {one.column: max(one.scale_fall, one.delay_fall) / (misfit - 1.0) for one in estimates[:_SUSPECTS]}
    return Suspects(misfit**0.5, parts, seconds)


def _first_wrong_scale(
    runs: Sequence[PreparedRun], products: FaultColumns, estimates: Sequence[FaultEstimate],
    seconds: Mapping[str, tuple[float, float]],
) -> ColumnFault | None:  # fmt: skip
    """The first of the columns whose scale is certainly wrong; None where all may be right."""
    misfit, most = products.misfit, reach(products.block_count)
    by_row: list[dict[str, FaultEstimate]] | None = None
    for one in estimates:
        if (fault := _wrong_scale(one, misfit, most * one.scale_spread)) is not None:
            remaining = max(0.0, misfit - one.scale_fall) ** 0.5
            kind, unit = fault
            if kind is Fault.SIGN:
                by_row = _by_row(runs) if by_row is None else by_row
                said = [row[one.column] for row in by_row if one.column in row]
                width = USUAL if _is_opposite(one) else most
                if not any(_is_reversed(row, width) for row in said) or any(_is_sound(row, most) for row in said):
                    continue
            half = USUAL * one.scale_spread
            if kind is Fault.UNIT and len(runs) == 1 and _differ(parts := products.scales(one.column), half):
                halves = tuple(parts.tolist())
                return ColumnFault(
                    one.column, Fault.UNSTEADY, one.scale, half, misfit**0.5, remaining, seconds, halves=halves
                )
            return ColumnFault(one.column, kind, one.scale, half, misfit**0.5, remaining, seconds, unit)
    return None


def _by_row(runs: Sequence[PreparedRun]) -> list[dict[str, FaultEstimate]]:
    """Estimates of each row by itself in all runs together, by column."""
    each = [FaultColumns.by_row(run) for run in runs]
    rows = dict.fromkeys(row for found in each for row in found)
    joined = [FaultColumns.joined([found[row] for found in each if row in found]) for row in rows]
    return [{one.column: one for one in products.estimates()} for products in joined]


def _is_opposite(one: FaultEstimate) -> bool:
    return abs(one.scale + 1.0) < max(USUAL * one.scale_spread, _OPPOSITE)


def _is_reversed(one: FaultEstimate, width: float) -> bool:
    """Whether an estimate of one row is that of a column with the other sign, and of no sound one within `width` σ."""
    return _is_opposite(one) and one.scale + width * one.scale_spread < 1.0 / _TWICE


def _is_sound(one: FaultEstimate, width: float) -> bool:
    """Whether an estimate of one row is that of a sound column, and certainly of no reversed one."""
    sound = abs(one.scale - 1.0) < max(USUAL * one.scale_spread, _OPPOSITE)
    return sound and one.scale - width * one.scale_spread > -1.0 / _TWICE


def _differ(halves: Array, half: float) -> bool:
    """Whether the scales of two halves of a run are not those of one unit; `half` : of the whole run's interval."""
    least, most = float(np.min(np.abs(halves))), float(np.max(np.abs(halves)))
    alike = float(np.prod(np.sign(halves))) > 0.0 and most < _ANOTHER * least
    return not alike and float(np.ptp(halves)) > 2.0**0.5 * half


def _wrong_scale(one: FaultEstimate, misfit: float, half: float) -> tuple[Fault, str] | None:
    """Kind of fault, and unit, of a scale that is certainly wrong; None where it may be right."""
    if one.noise > _NOISY_SIGN or one.scale_fall < max(_MATTERS, PART * (misfit - 1.0)):
        return None
    if misfit - one.scale_fall > _GROSS**2:  # beside a misfit as large any value may come out
        return None
    if one.scale + half < (1.0 / _TWICE if _is_opposite(one) else -_OPPOSITE):
        # A reversed column is as large as it was: one that should be far larger stands in for another fault.
        larger = one.scale < -_TWICE and one.scale_fall < EXPLAINS * (misfit - 1.0)
        return None if larger else (Fault.SIGN, "")
    if one.noise > NOISY or one.scale_fall < max(MUCH, EXPLAINS * (misfit - 1.0)):
        return None
    if abs(one.scale) + half < 1.0 / _TENFOLD:
        return Fault.UNIT, "thousandths of its unit"
    return (Fault.UNIT, "thousands of its unit") if abs(one.scale) - half > _TENFOLD else None


def _delays(
    run: PreparedRun, estimates: Sequence[FaultEstimate], misfit: float
) -> list[tuple[str, float, float, float]]:
    """Column, delay [s], its 1 σ and remaining weighted squares ÷ samples, of columns that may be late.

    The delay is removed from the recording and estimated again until it is settled: 30 ms are more than a first-order
    estimate reaches.
    """
    least = max(SHOWS, LATE_PART * (misfit - 1.0))
    able = [one for one in estimates if one.rate_noise < NOISY and one.delay_fall > least]
    out: list[tuple[str, float, float, float]] = []
    for one in sorted(able, key=lambda one: -one.delay_fall)[:_TRIED]:
        delay = one.delay
        for _ in range(_STEPS):
            if abs(delay) > _LATEST:
                break
            moved = FaultColumns.of(PreparedRun(earlier(run.recording, {one.column: delay}), is_piece=True))
            again = None if moved is None else next((e for e in moved.estimates() if e.column == one.column), None)
            if moved is None or again is None:
                break
            now, remaining = again, moved.misfit
            delay += now.delay
            if abs(now.delay) < _CLOSE:
                out.append((one.column, delay, now.delay_spread, remaining))
                break
    return out
