"""Rows of the equations that a recording measures, the samples usable in each, and why other rows are absent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.car.motion import BrakingLeftOut, FlatRoad, GroundLaserOffset
from lacet.identify.car.road import ABOVE, Road
from lacet.identify.car.rows import PRESSURE, RELEASED, Absence, Row, RowAbsence, Torque, available, needs
from lacet.identify.signals.reconstruct import Recording, RunNote


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
        for channel in (*needs(row, recording.reference, grounds, recording.vehicle), *torque.channels):
            mask &= recording.usable.get(channel, True)
        masks[row] = mask
    cut = [row for row, torque in rows.items() if torque.released]
    if np.all(released):
        return masks, ()
    seconds = float(np.count_nonzero(inside & ~released)) / recording.filters.rate
    return masks, (BrakingLeftOut(seconds, tuple(cut), PRESSURE, RELEASED),)
