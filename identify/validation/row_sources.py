"""Sources of the rows: what each is measured, derived or assumed from, how much that may move it, what others lack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from lacet.daq.assumptions import Assumption
from lacet.identify.car.rows import ROWS, Row, RowAbsence, needs
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.tolerances import ASSUMED
from lacet.identify.regression.wls import Fit
from lacet.identify.signals.sources import Kind, Method


class RowKind(Enum):
    """How a row of the equations is known on some runs."""

    MEASURED = auto()
    DERIVED = auto()
    ASSUMED = auto()
    IMPOSSIBLE = auto()


@dataclass(frozen=True)
class RowSource:
    """What a row of the equations is formed from on runs, or why it cannot be.

    Attributes
    ----------
    row, kind : the row, and how it is known.
    runs : the runs that this holds for.
    derived, assumed : channels that are not measured → how they are obtained.
    assumptions : assumptions that move the row → RMS change of the row by one tolerance [N or N·m].
    moved : RMS change of the row by all of them together, one tolerance each [N or N·m].
    size : RMS of the row about its mean [N or N·m].
    absence : why it cannot be formed.
    """

    row: Row
    kind: RowKind
    runs: tuple[str, ...]
    derived: Mapping[str, Method]
    assumed: Mapping[str, Method]
    assumptions: Mapping[Assumption, float]
    moved: float
    size: float
    absence: RowAbsence | None = None


def row_sources(fitted: Fit) -> list[RowSource]:
    """The sources of every row, runs that are alike together, in the order of `ROWS`."""
    found: list[RowSource] = []
    for number, run in enumerate(fitted.runs):
        found += _of_run(run, _responses(fitted, number))
    out: list[RowSource] = []
    for row in ROWS:
        alike: dict[object, list[RowSource]] = {}
        for one in found:
            if one.row == row:
                key = (one.kind, tuple(one.derived.items()), tuple(one.assumed.items()), one.absence)
                alike.setdefault(key, []).append(one)
        out += [_together(group) for group in alike.values()]
    return out


def assumed_channels(fitted: Fit, rests: Mapping[Row, float]) -> dict[Row, tuple[str, ...]]:
    """Row → channels assumed in some run, of rows that the assumptions may move by as much as remains in them (95 %).

    `rests` : row → RMS of what remains above its floor [N or N·m], of the rows asked for.
    """
    out: dict[Row, dict[str, None]] = {}
    for one in row_sources(fitted) if rests else ():
        if one.assumed and TWO_SIDED_95 * one.moved >= rests.get(one.row, np.inf):
            out.setdefault(one.row, {}).update(dict.fromkeys(one.assumed))
    return {row: tuple(channels) for row, channels in out.items()}


def _responses(fitted: Fit, number: int) -> dict[str, dict[Row, float]]:
    """Assumption → row → RMS change of a run's residual by one tolerance."""
    sums: dict[str, dict[Row, list[Array]]] = {}
    if not fitted.runs[number].recording.assumptions:
        return {}
    for piece in fitted.assembly.pieces_of(number):
        if piece.sensitivity is None:
            return {}
        for (what, name, _), rows in fitted.assembly.sheet_responses(piece).items():
            if what == ASSUMED:
                for row, series in rows.items():
                    sums.setdefault(name, {}).setdefault(row, []).append(series)
    return {
        name: {row: float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for row, parts in rows.items()}
        for name, rows in sums.items()
    }


def _of_run(run: PreparedRun, responses: Mapping[str, Mapping[Row, float]]) -> list[RowSource]:
    recording, measured_rows = run.recording, run.measured_rows
    assumptions = recording.assumptions
    grounds = tuple(c for c in recording.vehicle.corners if f"laser.{c}.ground" in recording.signals.value)
    out: list[RowSource] = []
    for row in ROWS:
        if row.combined and row not in measured_rows.torques and row not in measured_rows.left_out:
            continue  # beside measured wheel loads it says nothing
        if row not in run.rows:
            absence = measured_rows.left_out.get(row)
            out.append(RowSource(row, RowKind.IMPOSSIBLE, (run.name,), {}, {}, {}, 0.0, 0.0, absence))
            continue
        needed = needs(row, recording.reference, grounds, recording.vehicle)
        others = {name: recording.sources[name] for name in needed if name in recording.sources}
        moves = {assumptions[name]: rows[row] for name, rows in responses.items() if rows.get(row, 0.0) > 0.0}
        derived = {name: one.method for name, one in others.items() if one.kind is not Kind.ASSUMED}
        assumed = {name: one.method for name, one in others.items() if one.kind is Kind.ASSUMED}
        if assumed and not moves:  # they do not enter this row
            assumed.clear()
        kind = RowKind.ASSUMED if assumed else RowKind.DERIVED if derived else RowKind.MEASURED
        moved = float(np.sqrt(sum(size**2 for size in moves.values())))
        size = float(np.std(run.measured[row]))
        out.append(RowSource(row, kind, (run.name,), derived, assumed, moves, moved, size))
    return out


def _together(group: Sequence[RowSource]) -> RowSource:
    """One source of several runs: RMS over them."""
    first = group[0]
    assumptions = {
        one: float(np.sqrt(np.mean([source.assumptions.get(one, 0.0) ** 2 for source in group])))
        for one in dict.fromkeys(one for source in group for one in source.assumptions)
    }
    moved, size = (
        float(np.sqrt(np.mean([value**2 for value in values])))
        for values in ([source.moved for source in group], [source.size for source in group])
    )
    runs = tuple(run for source in group for run in source.runs)
    return RowSource(first.row, first.kind, runs, first.derived, first.assumed, assumptions, moved, size, first.absence)
