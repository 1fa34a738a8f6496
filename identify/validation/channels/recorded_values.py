"""Recorded values that no instrument gives: a column that stands still while others of its kind move, and copies.

Both are read off the values as recorded, before any filter and any equation, so that they hold for every car.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, MAY_REST, Channel
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.identify.multibody.vectors import Array

CHANCE = 1e-6
"""Probability, below which a stretch of equal values is a fault, that a sound column has one as long."""
MOVES = 3.0
"""Standard deviation ÷ noise of the sensor sheet from which a column moves."""
_NOISES = 0.3
"""The same from which a column has noise at least."""
LEAST = 30
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
    "steering.angle": ("imu.rate", "camera.steer"),
    "car.yaw_rate": ("wheel.force",),
    "car.lateral_accel": ("wheel.force",),
}
"""Family → families that move when it does, beside itself."""


@dataclass(frozen=True)
class StandStill:
    """Columns of the exchange table that have one value each [SI] from `start` to `stop` [s], while others of their
    kind move; several where they stop and go on together.

    `more` : further such stretches of them, at most; `left_out` : whether all those samples are flagged.
    """

    values: Mapping[str, float]
    start: float
    stop: float
    more: int = 0
    left_out: bool = False


@dataclass(frozen=True)
class Copies:
    """Columns of the exchange table that have the same values in every sample."""

    columns: tuple[str, ...]


def resting_stretches(run: Run, rig: Rig) -> list[tuple[StandStill, dict[str, NDArray[np.bool_]]]]:
    """Columns with a stretch of equal values that is no chance, in which others of their kind move; each entry with its
    columns → (N,) samples of the channel in their stretches.

    Those whose stretches begin and end within one sample of each other are one entry: a logger, or one wire.

    A stretch of m equal values among n is chance where n p^m is not small, p the part of equal neighbours in the rest
    of the column: a coarse or a held value repeats itself all the time. Some channels (brakes) may rest.
    """
    found: list[tuple[StandStill, dict[str, NDArray[np.bool_]]]] = []
    for name, signal in run.signals.items():
        channel = CHANNELS[name]
        if channel.family in MAY_REST or np.count_nonzero(signal.usable) < LEAST:
            continue
        t, values = signal.t[signal.usable], signal.values[signal.usable]
        for column, series in zip(channel.columns, values.T, strict=True):
            spans = [
                (first, last)
                for first, last in _no_chance(series)
                if others_move(run, rig, channel, column, t[first], t[last], resolution(series))
            ]
            if not spans:
                continue
            first, last = spans[0]
            step = float(np.median(np.diff(t)))
            start, stop, value, more = float(t[first]), float(t[last]), float(series[first]), len(spans) - 1
            mask = np.zeros(len(signal.t), bool)
            for first, last in spans:
                mask |= signal.usable & (signal.t >= t[first]) & (signal.t <= t[last])
            for i, (one, masks) in enumerate(found):
                if max(abs(one.start - start), abs(one.stop - stop)) <= step:
                    together = replace(one, values={**one.values, column: value}, more=max(one.more, more))
                    found[i] = together, {**masks, column: mask}
                    break
            else:
                found.append((StandStill({column: value}, start, stop, more), {column: mask}))
    return found


def copied_columns(run: Run) -> list[Copies]:
    """Groups of columns with the same values in every sample; those that are constant are not compared."""
    alike: defaultdict[bytes, list[str]] = defaultdict(list)
    for name, signal in run.signals.items():
        for column, series in zip(CHANNELS[name].columns, signal.values[signal.usable].T, strict=True):
            if series.size >= LEAST and float(np.ptp(series)) > 0.0:
                alike[hashlib.sha256(np.ascontiguousarray(series).data).digest()].append(column)
    return [Copies(tuple(columns)) for columns in alike.values() if len(columns) > 1]


def _no_chance(series: Array) -> list[tuple[int, int]]:
    """First and last index of the stretches of equal values that a sound column does not have, the longest first."""
    ends = np.flatnonzero(np.concatenate([[True], np.diff(series) != 0.0, [True]]))
    lengths = np.diff(ends)
    order = np.argsort(-lengths, kind="stable")
    order = order[lengths[order] >= LEAST]
    # Equal neighbours in what is beside the first k stretches, of which each one may join two others.
    within = np.cumsum(lengths[order])
    equal = series.size - lengths.size - np.cumsum(lengths[order] - 1)
    others = np.maximum(0, series.size - within - 1)
    part = (np.minimum(equal, others) + 1.0) / (others + 2.0)
    chance = series.size * part ** (lengths[order] - 1) > CHANCE
    sure = order[: int(np.argmax(chance)) if chance.any() else order.size]
    return [(int(ends[one]), int(ends[one + 1]) - 1) for one in sure]


def resolution(series: Array) -> float:
    """Smallest step of a column between two samples; 0 of a constant one."""
    steps = np.abs(np.diff(series))
    return float(np.min(steps[steps > 0.0], initial=np.inf)) if np.any(steps) else 0.0


def others_move(
    run: Run, rig: Rig, channel: Channel, column: str, start: float, stop: float, resolution: float = 0.0
) -> bool:
    """Whether another column of its family, or of one that moves with it, moves in an interval.

    Where it is the whole run, noise in its own family is enough: an instrument that is read has some. Beside a column
    whose `resolution` [SI] is coarser than its noise the same of other corners has to move by that: what is rounded
    stands still.
    """
    if resolution > rig.noise(channel.name):
        return _twins_by(run, channel, column, start, stop) > MOVES * resolution
    t = run.signals[channel.name].t
    least = _NOISES if start <= t[0] and stop >= t[-1] else MOVES
    return _one_varies(run, rig, channel, column, lambda signal: (signal.t >= start) & (signal.t <= stop), least)


def _twins_by(run: Run, channel: Channel, column: str, start: float, stop: float) -> float:
    """Largest standard deviation of the same column at other corners in an interval [SI]; 0 without one."""
    component = channel.columns.index(column)
    moves = [
        float(np.std(series))
        for name, signal in run.signals.items()
        if name != channel.name and CHANNELS[name].family == channel.family
        for place, (_, series) in enumerate(_in_part(name, signal, (signal.t >= start) & (signal.t <= stop)))
        if place == component
    ]
    return max(moves, default=0.0)


def others_move_at(run: Run, rig: Rig, channel: Channel, column: str, at: NDArray[np.bool_]) -> bool:
    """The same at (N,) samples of the channel, all together."""
    t = run.signals[channel.name].t
    return _one_varies(run, rig, channel, column, lambda signal: np.interp(signal.t, t, at) > 0.5, MOVES)


def _one_varies(
    run: Run, rig: Rig, channel: Channel, column: str, part: Callable[[Signal], NDArray[np.bool_]], least: float
) -> bool:
    """Whether another column of its family varies by `least` times its noise in a part of the run, or one of a family
    that moves with it by `MOVES`."""
    families = (channel.family, *_KIN.get(channel.family, ()))
    return any(
        float(np.std(series)) > (least if CHANNELS[name].family == channel.family else MOVES) * rig.noise(name)
        for name, signal in run.signals.items()
        if CHANNELS[name].family in families
        for other, series in _in_part(name, signal, part(signal))
        if other != column
    )


def _in_part(name: str, signal: Signal, part: NDArray[np.bool_]) -> Iterator[tuple[str, Array]]:
    """Columns of a channel with their usable values in a part of the run; none of fewer than two."""
    keep = signal.usable & part
    if np.count_nonzero(keep) > 1:
        yield from zip(CHANNELS[name].columns, signal.values[keep].T, strict=True)
