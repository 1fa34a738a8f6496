"""Places that are not as the files say, from the car's equations: of the inertial unit, or of the wheels.

Levers of the wheels' loads, and the acceleration of a unit beside where it is thought to be, act in the chassis rows; a
track in the tyre rows, too. Those rows alone must show the place, and hold better for it by half of their excess: no
law that a suspension lacks acts in them, and one of a tyre, or a force on the body, moves a place and explains little.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.channels.delays import instrument_delays
from lacet.identify.validation.channels.evidence import EXPLAINS, PART, SHOWS, USUAL, reach
from lacet.identify.validation.channels.fault_columns import LATE, FaultColumns, PlaceEstimate
from lacet.identify.validation.channels.vehicle_lengths import Length, with_lengths

_PART_OF_ROWS: Final = 0.5
"""Least part of the excess of the rows in which a place acts that another place takes away: more than all that acts on
the body and is not in the model."""
_UNIT: Final = "imu.accel"
_ELSEWHERE: Final = 0.02
"""Least distance from the rig's position at which the inertial unit is elsewhere, and least error of a length [m]: less
is a tape's."""
_OF_LENGTHS: Final = ("chassis", "tyre")
"""Kinds of the rows in which lengths of the car act most."""
_CLOSE: Final = 1e-3
"""Change of a length with which its estimate is settled [m]."""
_STEPS: Final = 4
"""Largest number of times that lengths are corrected and estimated again."""

Seconds = Mapping[str, tuple[float, float]]
"""Run → the seconds looked at, from and to."""


@dataclass(frozen=True)
class OtherLengths:
    """Lengths of the car that are not those of the vehicle file.

    Attributes
    ----------
    off, half : length → found less the file's, and half of its 95 % interval [m], of those that differ.
    file : length → the file's [m].
    """

    off: Mapping[Length, float]
    half: Mapping[Length, float]
    file: Mapping[Length, float]
    misfit: float
    remaining: float
    runs: Seconds


@dataclass(frozen=True)
class Misplaced:
    """The inertial unit somewhere else than the rig says.

    Attributes
    ----------
    off, half : axis → position found less the rig's, and half of its 95 % interval [m], of the axes that differ.
    or_lengths : the wheelbase that does much the same in its place; None where none does.
    """

    off: Mapping[str, float]
    half: Mapping[str, float]
    misfit: float
    remaining: float
    runs: Seconds
    or_lengths: OtherLengths | None = None


@dataclass(frozen=True)
class AboutContact:
    """Wheel moments that are about the contact of tyre and road, and not about the wheel centre."""

    misfit: float
    remaining: float
    runs: Seconds


WrongPlace = Misplaced | OtherLengths | AboutContact
"""What may be somewhere else than the files say."""


def wrong_place(products: FaultColumns, runs: Sequence[PreparedRun], seconds: Seconds) -> WrongPlace | None:
    """What is certainly at another place than the files say, the one that explains most; None where all may be right.

    `products` : of these runs together. A wrong wheelbase and another place of the unit along the car do much the same,
    and noise decides which of them explains more.
    """
    if not any(row.kind == "chassis" for run in runs for row in run.rows):
        return None
    unit, lengths = _misplaced(products, runs, seconds), _other_lengths(products, runs, seconds)
    if lengths is None or isinstance(unit, AboutContact):
        return unit
    if unit is None:
        return lengths
    if unit.off.keys() == {"x"} and lengths.off.keys() == {Length.WHEELBASE}:
        return replace(unit, or_lengths=lengths)
    return min(unit, lengths, key=lambda one: one.remaining)


def _misplaced(
    products: FaultColumns, runs: Sequence[PreparedRun], seconds: Seconds
) -> Misplaced | AboutContact | None:
    """The inertial unit at a place that is certainly another than the rig's; None where it may be right.

    Moments about the contacts do nearly the same as a unit that much higher, but in the rows of spinning wheels.
    """
    if any(_UNIT in one.kinds and abs(one.delay) > LATE for one in instrument_delays(products)):
        return None  # to first order alone its delay is not removed
    found = products.unit_position()
    late = max((one.delay_fall for one in products.estimates() if one.column.startswith("imu.accel")), default=0.0)
    if found is None or late > found.fall:  # one of its columns is late
        return None
    least = max(_ELSEWHERE, 3.0 * runs[0].recording.rig.tolerance("imu.accel", "position"))
    apart = _shown(products, runs, ("chassis",), FaultColumns.unit_position, least)
    if not apart.any():
        return None
    off: dict[str, float] = {}
    half: dict[str, float] = {}
    for axis, value, spread, far in zip("xyz", found.value.tolist(), found.spread.tolist(), apart, strict=True):
        if far:
            off[axis], half[axis] = value, USUAL * spread
    misfit, remaining = products.misfit, max(0.0, products.misfit - found.fall)
    about = _about_centres(runs)
    if about is not None and about < remaining:
        return AboutContact(misfit**0.5, about**0.5, seconds)
    return Misplaced(off, half, misfit**0.5, remaining**0.5, seconds)


def _shown(
    products: FaultColumns, runs: Sequence[PreparedRun], kinds: Sequence[str],
    estimate: Callable[[FaultColumns], PlaceEstimate | None], least: float,
) -> NDArray[np.bool_]:  # fmt: skip
    """(k,) which of the places estimated are certainly more than `least` [m] off, by all rows and by `kinds` alone."""
    found, none = estimate(products), np.zeros(3, bool)
    if found is None or found.fall < PART * (products.misfit - 1.0):  # the model lacks a law
        return none
    apart = _far(found, products.block_count, least)
    if not apart.any():
        return none
    alone = _alone(runs, kinds)
    own = estimate(alone)
    if own is None or own.fall < _PART_OF_ROWS * (alone.misfit - 1.0):
        return none
    said = _far(own, alone.block_count, least) & (own.value * found.value > 0.0)
    return apart if np.all(said[apart]) else none


def _alone(runs: Sequence[PreparedRun], kinds: Sequence[str]) -> FaultColumns:
    """The products of the runs' rows of these kinds, of which some run has one."""
    return FaultColumns.joined([of for run in runs if (of := FaultColumns.of_kinds(run, kinds, Length)) is not None])


def _far(found: PlaceEstimate, blocks: int, least: float) -> NDArray[np.bool_]:
    """(k,) whether places are farther than `least` [m] from those of the files, beyond chance."""
    return np.abs(found.value) - reach(blocks) * found.spread > least


def _other_lengths(products: FaultColumns, runs: Sequence[PreparedRun], seconds: Seconds) -> OtherLengths | None:
    """Lengths that are certainly not those of the vehicle file; None where all may be right.

    They are corrected, both tracks together, and the rows in which they act must hold then: what else these lack would
    be taken for a length.
    """
    apart = _shown(products, runs, _OF_LENGTHS, FaultColumns.lengths, _ELSEWHERE)
    of_track = np.array([length is not Length.WHEELBASE for length in Length])
    apart = apart | (of_track if np.any(apart & of_track) else False)
    lengths = [length for length, far in zip(Length, apart.tolist(), strict=True) if far]
    off, half, found, corrected = np.zeros(len(lengths)), np.zeros(len(lengths)), products, list(runs)
    promised = 0.0
    for _ in range(_STEPS if lengths else 0):
        step = found.lengths(np.flatnonzero(apart))
        if step is None:
            return None
        off, half = off + step.value, USUAL * step.spread
        longer = dict(zip(lengths, off.tolist(), strict=True))
        corrected = [PreparedRun(_with_lengths(run.recording, longer), is_piece=True) for run in runs]
        again = [of for run in corrected if (of := FaultColumns.of(run, lengths)) is not None]
        if len(again) < len(runs):
            return None
        found, promised = FaultColumns.joined(again), max(promised, step.fall)
        if products.misfit - found.misfit < _PART_OF_ROWS * promised:
            return None  # far less than first order says
        if np.max(np.abs(step.value)) < _CLOSE:
            break
    else:
        return None
    before, after = (_alone(some, _OF_LENGTHS).misfit for some in (runs, corrected))
    if before - after < max(SHOWS, EXPLAINS * (before - 1.0)):
        return None
    stated = {
        one: (value, around) for one, value, around in zip(lengths, off.tolist(), half.tolist(), strict=True)
        if abs(value) > max(around, _ELSEWHERE)
    }  # fmt: skip
    vehicle = runs[0].recording.vehicle
    return OtherLengths(
        {one: value for one, (value, _) in stated.items()}, {one: around for one, (_, around) in stated.items()},
        {one: one.of(vehicle) for one in stated}, products.misfit**0.5, found.misfit**0.5, seconds,
    ) if stated else None  # fmt: skip


def _with_lengths(recording: Recording, longer: Mapping[Length, float]) -> Recording:
    return replace(recording, vehicle=with_lengths(recording.vehicle, longer))


def _about_centres(runs: Sequence[PreparedRun]) -> float | None:
    """Misfit of the equations with moments that were about the contacts; None of runs without moments."""
    out: list[FaultColumns] = []
    for run in runs:
        recording = run.recording
        changed: dict[str, Array] = {}
        for corner in CORNERS:
            moment, force = (recording.signals.value.get(f"wheel.{corner}.{kind}") for kind in ("moment", "force"))
            if moment is None or force is None:
                return None
            radius = recording.vehicle.corners[corner].tyre_radius
            about = np.stack([-radius * force[1], radius * force[0], np.zeros_like(force[2])])
            changed[f"wheel.{corner}.moment"] = moment - about
        signals = recording.signals.changed(changed, recording.filters.rate)
        products = FaultColumns.of(PreparedRun(recording.with_signals(signals), is_piece=True))
        if products is None:
            return None
        out.append(products)
    return FaultColumns.joined(out).misfit
