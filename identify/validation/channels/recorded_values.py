"""Recorded values that no instrument gives: a column that stands still while others of its kind move, and copies.

Both are read off the values as recorded, before any filter and any equation, so that they hold for every car.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.channels import CHANNELS, Channel
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.identify.multibody.vectors import Array

_CHANCE = 1e-6
"""Probability, below which a stretch of equal values is a fault, that a sound column has one as long."""
_MOVES = 3.0
"""Standard deviation ÷ noise of the sensor sheet from which a column moves."""
_NOISES = 0.3
"""The same from which a column has noise at least."""
_LEAST = 30
"""Least number of samples of a stretch, and of a column that is compared."""
_KIN: Mapping[str, Sequence[str]] = {
    "correvit.speed": ("wheel.speed",),
    "wheel.speed": ("correvit.speed",),
    "wheel.angle": ("wheel.speed",),
    "imu.accel": ("wheel.force",),
    "imu.rate": ("imu.attitude",),
    "imu.attitude": ("imu.rate",),
    "wheel.moment": ("wheel.force",),
    "laser.hub": ("wheel.force",),
    "laser.ground": ("wheel.force",),
}
"""Family → families that move when it does, beside itself."""


@dataclass(frozen=True)
class StandStill:
    """Columns of the exchange table that have one value each [SI] from `start` to `stop` [s], while others of their
    kind move; several where they stop and go on together."""

    values: Mapping[str, float]
    start: float
    stop: float


@dataclass(frozen=True)
class Copies:
    """Columns of the exchange table that have the same values in every sample."""

    columns: tuple[str, ...]


def columns_at_rest(run: Run, rig: Rig) -> list[StandStill]:
    """Columns with a stretch of equal values that is no chance, in which others of their kind move.

    Those whose stretches begin and end within one sample of each other are one entry: a logger, or one wire.

    A stretch of m equal values among n is chance where n p^m is not small, p the part of equal neighbours in the rest
    of the column: a coarse or a held value repeats itself all the time. Optional channels (brakes) may rest.
    """
    found: list[StandStill] = []
    for name, signal in run.signals.items():
        channel = CHANNELS[name]
        if channel.optional or np.count_nonzero(signal.usable) < _LEAST:
            continue
        t, values = signal.t[signal.usable], signal.values[signal.usable]
        for column, series in zip(channel.columns, values.T, strict=True):
            first, last = _longest(series)
            if not _by_chance(series, first, last) and _others_move(run, rig, channel, column, t[first], t[last]):
                step = float(np.median(np.diff(t)))
                start, stop, value = float(t[first]), float(t[last]), float(series[first])
                for i, one in enumerate(found):
                    if max(abs(one.start - start), abs(one.stop - stop)) <= step:
                        found[i] = replace(one, values={**one.values, column: value})
                        break
                else:
                    found.append(StandStill({column: value}, start, stop))
    return found


def copied_columns(run: Run) -> list[Copies]:
    """Groups of columns with the same values in every sample; those that are constant are not compared."""
    alike: defaultdict[bytes, list[str]] = defaultdict(list)
    for name, signal in run.signals.items():
        for column, series in zip(CHANNELS[name].columns, signal.values[signal.usable].T, strict=True):
            if series.size >= _LEAST and float(np.ptp(series)) > 0.0:
                alike[hashlib.sha256(np.ascontiguousarray(series).data).digest()].append(column)
    return [Copies(tuple(columns)) for columns in alike.values() if len(columns) > 1]


def _longest(series: Array) -> tuple[int, int]:
    """First and last index of the longest stretch of equal values."""
    ends = np.flatnonzero(np.concatenate([[True], np.diff(series) != 0.0, [True]]))
    longest = int(np.argmax(np.diff(ends)))
    return int(ends[longest]), int(ends[longest + 1]) - 1


def _by_chance(series: Array, first: int, last: int) -> bool:
    """Whether a stretch of equal values is one that a sound column has."""
    length = last - first + 1
    if length < _LEAST:
        return True
    equal = np.diff(np.concatenate([series[:first], series[last + 1 :]])) == 0.0
    part = (np.count_nonzero(equal) + 1.0) / (equal.size + 2.0)
    return series.size * part ** (length - 1) > _CHANCE


def _others_move(run: Run, rig: Rig, channel: Channel, column: str, start: float, stop: float) -> bool:
    """Whether another column of its family, or of one that moves with it, moves in an interval.

    Where it is the whole run, noise in its own family is enough: an instrument that is read has some.
    """
    families = (channel.family, *_KIN.get(channel.family, ()))
    t = run.signals[channel.name].t
    least = _NOISES if start <= t[0] and stop >= t[-1] else _MOVES
    return any(
        float(np.std(series)) > (least if CHANNELS[name].family == channel.family else _MOVES) * rig.noise(name)
        for name, signal in run.signals.items()
        if CHANNELS[name].family in families
        for other, series in _between(name, signal, start, stop)
        if other != column
    )


def _between(name: str, signal: Signal, start: float, stop: float) -> Iterator[tuple[str, Array]]:
    """Columns of a channel with their usable values in an interval; none of fewer than two."""
    keep = signal.usable & (signal.t >= start) & (signal.t <= stop)
    if np.count_nonzero(keep) > 1:
        yield from zip(CHANNELS[name].columns, signal.values[keep].T, strict=True)
