"""Samples that are no measurement, by the values alone: sentinel values, the end of a range, and dead stretches.

They are flagged as in a recording, so that the rest of a run is used; the run's file keeps them. What is only doubtful
is found without being flagged: a column that has no noise may rest, and is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Flag
from lacet.daq.channels import CHANNELS, COLUMNS, MAY_REST
from lacet.daq.rig import Rig
from lacet.daq.run import ChosenSignals, Run, Signal
from lacet.daq.stuck import LEARNED, STUCK_SECONDS, TWINS, is_noisy, moves, noise_count, window_length
from lacet.identify.multibody.vectors import Array
from lacet.identify.validation.channels.recorded_values import (
    CHANCE,
    LEAST,
    MOVES,
    StandStill,
    others_move_at,
    resolution,
    resting_stretches,
)

_REPEATS = 3
"""Least number of samples with exactly the same value, for it to be a sentinel. Source: a choice; noise has
none."""
_HOLES = 10.0
"""Distance of a sentinel from all other values ÷ the widest hole among these, at least: a coarse distribution, and the
tail of any, has holes. Source: a choice."""
_CUT = 5.0
"""Step into the end of a range ÷ the column's smallest, at least. Source: a choice; a crest that is rounded has 1."""
_ONLY_NOISE = 1.5
"""Variation ÷ noise of the sensor sheet up to which a column shows noise alone: a measured noise is that of its sheet
to a quarter (`noise_level`), and a window's own scatter comes on top."""
_FROM_SAMPLE_TO_SAMPLE = 0.5
"""Part of its variance that a column has from sample to sample, below which it is no noise alone: that of white noise
is 1, that of a motion nearly 0 (half of von Neumann's ratio)."""
_FALLS = 10.0
"""Variation before a dead stretch ÷ that in it, at least. Source: a choice."""
_KEEPS = 0.5
"""Part of their variation that the same columns of all other corners keep, at least: the car drives on as before."""
_MAY_STAND = ("wheel.speed", "wheel.angle", "correvit.speed")
"""Families in which zero, or noise alone, is a measurement while others move: a locked wheel, a car that stands."""
_WINDOW = 0.5
"""Seconds of a window in which a variation is measured [s]: that in which a value is stuck (`daq.stuck`)."""
_DEAD = 2.0
"""Least duration of a stretch with noise alone [s]. Source: a choice; a wheel in the air carries no load for less."""
_FAR = 5.0
"""Distance from the middle of noise ÷ its σ that noise never has in a stretch."""


@dataclass(frozen=True)
class SentinelValue:
    """A value by which an instrument or a logger says that it has none: `column` is exactly `value` [SI] in `count`
    samples, `first` at a time [s], far from every other value."""

    column: str
    value: float
    count: int
    first: float


@dataclass(frozen=True)
class RangeEnd:
    """A column at the end of its range, at its `highest` or lowest value [SI] `times` times, `seconds` in all."""

    column: str
    value: float
    highest: bool
    times: int
    seconds: float
    first: float


@dataclass(frozen=True)
class NoiseAlone:
    """A column that shows noise alone, `variation` (1 σ) about `value` [SI], from `start` to `stop` [s]."""

    column: str
    value: float
    variation: float
    start: float
    stop: float


Unusable = SentinelValue | RangeEnd | StandStill | NoiseAlone
"""Samples of a column that are no measurement."""


def without_unusable(run: Run, rig: Rig) -> tuple[Run, list[Unusable]]:
    """The run with samples flagged that are no measurement, and what was found."""
    out: list[Unusable] = []
    for find, flag in (
        (_sentinels, Flag.STATUS),
        (_range_ends, Flag.RANGE),
        (_at_rest, Flag.STUCK),
        (_dead, Flag.STUCK),
    ):
        masks: dict[str, NDArray[np.bool_]] = {}
        for found, flagged in find(run, rig):
            out.append(found)
            for name, mask in flagged.items():
                masks[name] = masks[name] | mask if name in masks else mask
        run = _flagged(run, masks, flag)
    return run, out


_Found = Iterator[tuple[Unusable, Mapping[str, NDArray[np.bool_]]]]
"""What was found, and channel → (N,) its samples to flag."""


def _flagged(run: Run, masks: Mapping[str, NDArray[np.bool_]], flag: Flag) -> Run:
    if not masks:
        return run
    made: dict[str, Signal] = {}
    for name, mask in masks.items():
        signal = run.signals[name]
        made[name] = replace(signal, flags=signal.flags | np.where(mask, np.uint8(flag), np.uint8(0)))
    return replace(run, signals=ChosenSignals(run.signals, list(run.signals), made))


def _columns(run: Run) -> Iterator[tuple[str, str, Signal, NDArray[np.intp], Array]]:
    """Channel, column, signal, indices of its usable samples and their values; some channels (brakes) may rest."""
    for name, signal in run.signals.items():
        good = np.flatnonzero(signal.usable)
        if CHANNELS[name].family not in MAY_REST and good.size >= LEAST:
            for column, series in zip(CHANNELS[name].columns, signal.values[good].T, strict=True):
                yield name, column, signal, good, series


def _mask(signal: Signal, index: NDArray[np.intp]) -> NDArray[np.bool_]:
    out = np.zeros(len(signal.t), bool)
    out[index] = True
    return out


# -- sentinel values ---------------------------------------------------------------------------------------------------


def _sentinels(run: Run, rig: Rig) -> _Found:
    for name, column, signal, good, series in _columns(run):
        for value in _sentinel_values(series):
            index = good[series == value]
            found = SentinelValue(column, value, index.size, float(signal.t[index[0]]))
            yield found, {name: _mask(signal, index)}


def _sentinel_values(series: Array) -> list[float]:
    """Values that repeat exactly, in less than half of the samples, and have more room around than all others take.

    No sample lies between: what a car does, and the end of a range as well, is approached. A single stretch up to the
    first or the last sample is a column that stands still.
    """
    ends = float(np.min(series)), float(np.max(series))
    inner = series[(series != ends[0]) & (series != ends[1])]
    if inner.size < LEAST or 2 * inner.size < series.size:
        return []
    width = float(np.ptp(inner))
    gaps = float(np.min(inner)) - ends[0], ends[1] - float(np.max(inner))
    if not max(gaps) > width > 0.0:
        return []
    hole = float(np.max(np.diff(np.sort(inner))))
    return [
        value
        for value, gap in zip(ends, gaps, strict=True)
        if gap > max(width, _HOLES * hole)
        and np.count_nonzero(series == value) >= _REPEATS
        and not _one_end(series == value)
    ]


def _one_end(at: NDArray[np.bool_]) -> bool:
    """Whether samples are one stretch that holds the first or the last one."""
    return _stretches(at) == 1 and bool(at[0] or at[-1])


def _stretches(at: NDArray[np.bool_]) -> int:
    return int(np.count_nonzero(np.diff(at, prepend=False) & at))


# -- the end of a range ------------------------------------------------------------------------------------------------


def _range_ends(run: Run, rig: Rig) -> _Found:
    for name, column, signal, good, series in _columns(run):
        for highest in (True, False):
            at = series == (np.max(series) if highest else np.min(series))
            if not _is_range_end(signal, good, series, at):
                continue
            index = good[at]
            value, mask = float(series[at][0]), _mask(signal, index)
            if value == 0.0 and CHANNELS[name].family in _MAY_STAND:
                continue
            # At each crest of a steady slalom everything else has the same value again: there the speed says it.
            driven = 2 * np.count_nonzero(moves(run.signals, name, signal.t[index])) > index.size
            if driven or others_move_at(run, rig, CHANNELS[name], column, mask):
                seconds = index.size * float(np.median(np.diff(signal.t[good])))
                found = RangeEnd(column, value, highest, _stretches(at), seconds, float(signal.t[index[0]]))
                yield found, {name: mask}


def _is_range_end(signal: Signal, good: NDArray[np.intp], series: Array, at: NDArray[np.bool_]) -> bool:
    """Whether a noisy column returns to its highest or lowest value, and stays at it more often than by chance.

    By chance a noisy column has equal neighbours there as often as between its two ends, which may both be a range's.
    """
    pairs = int(np.count_nonzero(at[1:] & at[:-1]))
    rest = series[(series > np.min(series)) & (series < np.max(series))]
    if pairs == 0 or rest.size < LEAST or _stretches(at) < 2:
        return False
    part = (np.count_nonzero(np.diff(rest) == 0.0) + 1.0) / (rest.size + 1.0)
    if series.size * part**pairs > CHANCE:
        return False
    return _is_noisy(signal, good, rest) or _is_cut(series, at)


def _is_cut(series: Array, at: NDArray[np.bool_]) -> bool:
    """Whether a column comes to a value, and goes from it, in steps that no crest has: its own are the smallest."""
    edges = np.flatnonzero(at[1:] != at[:-1])
    return float(np.median(np.abs(np.diff(series))[edges])) > _CUT * resolution(series)


# -- dead stretches ----------------------------------------------------------------------------------------------------


def _at_rest(run: Run, rig: Rig) -> _Found:
    """Columns that stand still; flagged where noise of the column, or of its like at other corners, has stopped.

    Of columns that stop and go on together one with noise is enough: what reads them all has stopped.
    """
    for found, places in resting_stretches(run, rig):
        left_out = any(_noise_stopped(run, found, column, mask) for column, mask in places.items())
        flagged: dict[str, NDArray[np.bool_]] = {}
        for column, mask in places.items() if left_out else ():
            name, _ = _place(column)
            flagged[name] = flagged[name] | mask if name in flagged else mask
        yield replace(found, left_out=left_out), flagged


def _noise_stopped(run: Run, found: StandStill, column: str, mask: NDArray[np.bool_]) -> bool:
    """Whether a column that stands still at some samples is noisy otherwise; a wheel may be locked for a moment."""
    name, component = _place(column)
    signal = run.signals[name]
    may_be = found.values[column] == 0.0 and CHANNELS[name].family in _MAY_STAND
    if may_be and found.stop - found.start < STUCK_SECONDS:
        return False
    good = np.flatnonzero(signal.usable)
    rest = signal.values[good[~mask[good]], component]
    return _is_noisy(signal, good, rest) if _enough(signal, good, rest) else _twins_are_noisy(run, name, component)


def _dead(run: Run, rig: Rig) -> _Found:
    """Columns with a stretch of noise alone, while the same column of all other corners moves on as before."""
    for name, column, signal, good, series in _columns(run):
        component = CHANNELS[name].columns.index(column)
        like = _twins(run, name)
        if len(like) < TWINS or CHANNELS[name].family in _MAY_STAND:
            continue
        t = signal.t[good]
        span = _quiet_span(t, series, rig.noise(name))
        if span is None:
            continue
        first, last = span
        still = np.zeros(series.size, bool)
        still[first : last + 1] = True
        start, stop = float(t[first]), float(t[last])
        if all(_moves_on(run.signals[other], component, start, stop, rig.noise(other)) for other in like):
            dead = series[still]
            found = NoiseAlone(column, float(np.median(dead)), float(np.std(dead)), start, stop)
            yield found, {name: _mask(signal, good[still])}


def _quiet_span(t: Array, series: Array, noise: float) -> tuple[int, int] | None:
    """First and last index of the longest stretch of noise alone in a column that varies much more before or after it;
    None where there is none."""
    length = max(LEAST, int(np.ceil(_WINDOW / float(np.median(np.diff(t))))))
    windows = series.size // length
    if windows < 2:
        return None
    varied = np.std(series[: windows * length].reshape(windows, length), axis=1)
    quiet = varied <= _ONLY_NOISE * noise
    if not quiet.any() or quiet.all():
        return None
    begins = np.flatnonzero(np.diff(quiet, prepend=False) & quiet)
    ends = np.flatnonzero(np.diff(quiet, append=False) & quiet)
    longest = int(np.argmax(ends - begins))
    inside = series[begins[longest] * length : (ends[longest] + 1) * length]
    middle, spread = float(np.median(inside)), float(np.std(inside))
    by_sample = float(np.mean(np.diff(inside) ** 2)) / 2.0
    if spread > _ONLY_NOISE * noise or by_sample < _FROM_SAMPLE_TO_SAMPLE * spread**2:  # it moves slowly
        return None
    # To the sample: the stretch ends where a value is no noise about its middle.
    away = np.flatnonzero(np.abs(series - middle) > _FAR * max(spread, noise))
    centre = (begins[longest] + ends[longest] + 1) * length // 2
    before = int(np.count_nonzero(away < centre))
    first = int(away[before - 1]) + 1 if before else 0
    last = int(away[before]) - 1 if before < away.size else series.size - 1
    rest = np.concatenate([series[:first], series[last + 1 :]])
    if t[last] - t[first] < _DEAD or rest.size < LEAST:
        return None
    return (first, last) if float(np.std(rest)) > _FALLS * max(spread, noise) else None


def _moves_on(signal: Signal, component: int, start: float, stop: float, noise: float) -> bool:
    """Whether a column varies in an interval nearly as much as outside of it."""
    t, series = signal.t[signal.usable], signal.values[signal.usable, component]
    inside = (t >= start) & (t <= stop)
    if min(np.count_nonzero(inside), np.count_nonzero(~inside)) < LEAST:
        return False
    varied, usual = float(np.std(series[inside])), float(np.std(series[~inside]))
    return varied > max(MOVES * noise, _KEEPS * usual)


# -- noise -------------------------------------------------------------------------------------------------------------


def _place(column: str) -> tuple[str, int]:
    """Channel of a column, and the column's place in it."""
    channel, place = COLUMNS[column]
    return channel.name, place


def _length(signal: Signal, good: NDArray[np.intp]) -> int:
    """Samples of a window in which noise is judged."""
    return window_length(1.0 / float(np.median(np.diff(signal.t[good]))))


def _enough(signal: Signal, good: NDArray[np.intp], series: Array) -> bool:
    """Whether some of a signal's values are enough to judge its noise by themselves."""
    return series.size >= LEARNED * _length(signal, good)


def _is_noisy(signal: Signal, good: NDArray[np.intp], series: Array) -> bool:
    """Whether some of a signal's values, in their order, go up and down by noise."""
    length = _length(signal, good)
    return bool(is_noisy(noise_count(series[:, None], length).turns, length)[0])


def _twins(run: Run, name: str) -> list[str]:
    """The same channel of other corners, as far as it was measured."""
    family, corner = CHANNELS[name].family, CHANNELS[name].corner
    if corner is None:
        return []
    names = [other for other in run.signals if CHANNELS[other].family == family and other != name]
    return [other for other in names if np.count_nonzero(run.signals[other].usable) >= LEAST]


def _twins_are_noisy(run: Run, name: str, component: int) -> bool:
    """Whether the same column of all other corners is noisy, of two at least."""
    signals = [run.signals[other] for other in _twins(run, name)]
    each = [(signal, np.flatnonzero(signal.usable)) for signal in signals]
    return len(each) >= TWINS and all(_is_noisy(signal, good, signal.values[good, component]) for signal, good in each)


_PROCEDURES = ((_sentinels, Flag.STATUS), (_range_ends, Flag.RANGE), (_at_rest, Flag.STUCK), (_dead, Flag.STUCK))
"""What is looked for, and the flag of samples found, as in a recording."""
