"""Rows of the equations that a recording measures, the samples usable in each, and why other rows are absent."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.assumptions import SETS_SCALE
from lacet.daq.channels import CORNERS
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import BrakingLeftOut, FlatRoad, GroundLaserOffset
from lacet.identify.car.road import ABOVE, Road
from lacet.identify.car.rows import (
    PRESSURE,
    RELEASED,
    ROLL_AND_PITCH,
    ROWS,
    Absence,
    Row,
    RowAbsence,
    fewest,
    followed,
    leading,
    needs,
)
from lacet.identify.car.torques import Torque, torque_in
from lacet.identify.signals.reconstruct import Recording, RunNote
from lacet.identify.signals.sources import Kind, Method, Source


@dataclass(frozen=True)
class MeasuredRows:
    """Rows of the equations that a recording measures.

    Attributes
    ----------
    torques : row → the torques on the wheel that enter it, in the order of `ROWS`.
    left_out : why each other row is absent.
    usable : row → (N,) whether a sample is outside flagged intervals, brakings and filter transients.
    notes : on the road and on brakings left out.
    ahead : distance of ground lasers ahead of their wheels' centres [m], negative behind: the largest in magnitude.
    """

    torques: Mapping[Row, Torque]
    left_out: Mapping[Row, RowAbsence]
    usable: Mapping[Row, NDArray[np.bool_]]
    notes: tuple[RunNote, ...]
    ahead: float

    @classmethod
    def of(cls, recording: Recording) -> MeasuredRows:
        """The rows of a recording; no geometry is computed."""
        values = recording.signals.value
        road = Road(recording.signals, recording.rig, recording.vehicle, recording.t.size)
        grounds = () if road.flat else road.grounds
        torques, left_out = available(
            values, recording.vehicle, recording.reference, recording.brakes, grounds, recording.sources,
            recording.measured_elsewhere,
        )  # fmt: skip
        usable, braking = _usable(recording, torques, grounds)
        why = RowAbsence(Absence.BRAKES_ALWAYS, (PRESSURE,))
        left_out |= {row: why for row, torque in torques.items() if torque.released and not np.any(usable[row])}
        about = (FlatRoad(),) if road.flat else _beside_the_wheels(road.ahead)
        return cls(torques, left_out, usable, (*about, *braking), road.ahead)

    def at(self, index: NDArray[np.intp] | slice) -> MeasuredRows:
        """The same rows at the samples `index`."""
        return replace(self, usable={row: mask[index] for row, mask in self.usable.items()})


def serves(source: Source | None, channel: str, row: Row) -> bool:
    """Whether what is known of a channel serves a row: its leading components are not assumed."""
    if source is None or row.kind in source.unfit:
        return False
    return all(source.kinds[k] is not Kind.ASSUMED for k in leading(row).get(channel, ()))


def available(
    measured: Container[str], vehicle: Vehicle, reference: str, brakes: str, grounds: tuple[str, ...],
    sources: Mapping[str, Source] = MappingProxyType({}), elsewhere: Container[str] = (),
) -> tuple[dict[Row, Torque], dict[Row, RowAbsence]]:  # fmt: skip
    """Rows whose left side is known, row → its torques; and every other row → why it is absent.

    `sources` : where channels that are not `measured` come from; `elsewhere` : rows that another run measures,
    which are not taken on assumptions here. Combined rows say nothing beside measured wheel loads: with any they are in
    neither.
    """
    rows: dict[Row, Torque] = {}
    left_out: dict[Row, RowAbsence] = {}
    loads = [f"wheel.{c}.force" for c in CORNERS]
    known = any(c in measured or (c in sources and sources[c].method is not Method.NOMINAL_LOAD) for c in loads)
    for row in ROWS:
        if row.combined and known:
            continue
        needed = needs(row, reference, grounds, vehicle)
        lacking = tuple(channel for channel in needed if channel not in measured)
        absent = tuple(channel for channel in lacking if not serves(sources.get(channel), channel, row))
        torque = torque_in(row, vehicle, measured, brakes)
        if row.combined and absent and not any(c in absent for c in leading(row)):
            left_out[row] = RowAbsence(Absence.NO_KNOWN_LOAD, SETS_SCALE)
        elif row.combined and not absent and all(one in elsewhere for one in ROLL_AND_PITCH):
            left_out[row] = RowAbsence(Absence.MEASURED_ELSEWHERE, lacking)
        elif absent:
            left_out[row] = RowAbsence(Absence.CHANNELS, fewest(row, absent), beside=torque.missing)
        elif row in elsewhere and any(sources[channel].kind is Kind.ASSUMED for channel in lacking):
            left_out[row] = RowAbsence(Absence.MEASURED_ELSEWHERE, lacking)
        elif torque.missing is not None:
            left_out[row] = torque.missing
        else:
            rows[row] = torque
    return rows, left_out


def _beside_the_wheels(ahead: float) -> tuple[GroundLaserOffset, ...]:
    return (GroundLaserOffset(ahead),) if abs(ahead) > ABOVE else ()


def _usable(
    recording: Recording, rows: Mapping[Row, Torque], grounds: tuple[str, ...]
) -> tuple[dict[Row, NDArray[np.bool_]], tuple[BrakingLeftOut, ...]]:
    """Usable samples of each row, row → (N,), and the durations left out because the brakes act."""
    t, edge = recording.t, recording.filters.edge
    inside = (t - t[0] >= edge) & (t[-1] - t >= edge)
    released = np.ones(t.size, bool)
    if any(torque.released for torque in rows.values()):
        # The filters spread a braking over their edge.
        applied = recording.signals.value[PRESSURE][0] > RELEASED
        released = (
            scipy.ndimage.maximum_filter1d(applied, 2 * round(edge * recording.filters.rate) + 1, mode="nearest") == 0
        )
    masks: dict[Row, NDArray[np.bool_]] = {}
    for row, torque in rows.items():
        mask = inside & released if torque.released else inside.copy()
        needed = needs(row, recording.reference, grounds, recording.vehicle)
        for channel in (*needed, *followed(row), *torque.channels):
            mask &= recording.usable.get(channel, True)
        masks[row] = mask
    cut = [row for row, torque in rows.items() if torque.released]
    if np.all(released):
        return masks, ()
    seconds = float(np.count_nonzero(inside & ~released)) / recording.filters.rate
    return masks, (BrakingLeftOut(seconds, tuple(cut), PRESSURE, RELEASED),)
