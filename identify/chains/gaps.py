"""Gaps of a record: samples that are missing by their times, and positions that leap, of an encoder that misread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.spline import CubicSpline

_LONGER = 1.5
"""Step in time ÷ the median one from which samples are missing in it [ratio]: between one step and two."""
_USUAL = 0.99
"""Part of the steps of a position that are usual [share]: a larger part of a record is no fault of a sample."""
_QUANTA = 3.0
"""Smallest usual steps by which a position may leap [count]: the reading of a coarse encoder that flickers by one step
is off its neighbours by up to 16 ÷ 6 steps."""
_AROUND = 0.25
"""Part of a leap by which a sample is off the others because of those beside it, and not itself [ratio]: of the second
beside one that leaps it is a sixth, of the first two thirds."""
_REACH = 2
"""Samples on either side that show where a sample should be [count]: the cubic through them."""


@dataclass(frozen=True)
class Gap:
    """Samples that are missing.

    `start` : time of the last one before, since the first sample [s]. `seconds` : to the next one.
    """

    start: float
    seconds: float


@dataclass(frozen=True)
class Leap:
    """A position that leaps.

    Attributes
    ----------
    joint : its column, from 0.
    start, seconds : time of the last sample before, since the first sample, and time to the first after [s].
    size : how far the worst sample is off the others around it [rad, m]; of one that lasts how far it goes on.
    lasts : whether the position goes on from where it leapt to: a count that was lost, or samples that are missing.
    """

    joint: int
    start: float
    seconds: float
    size: float
    lasts: bool


def uniform_times(times: Array) -> tuple[Array, float, Array]:
    """Uniform times (M,) for samples at increasing `times` (N,) [s], their rate [Hz], and (g, 2) the gaps between them.

    Of a gap the time of the sample before it, since the first one, and the time to the next [s].

    The rate is that of the steps in which no sample is missing, so that samples stay where they were taken.
    """
    steps = np.diff(times)
    long = steps > _LONGER * float(np.median(steps))
    rate = np.count_nonzero(~long) / float(np.sum(steps[~long]))
    count = round(float(times[-1] - times[0]) * rate) + 1
    grid = times[0] + np.arange(count) / rate
    return np.minimum(grid, times[-1]), rate, np.column_stack([times[:-1][long] - times[0], steps[long]])


def missing_at(times: Array, grid: Array) -> NDArray[np.bool_]:
    """(M,) whether a sample is missing at each of the uniform times, between samples at `times` (N,) [s]."""
    steps = np.diff(times)
    usual = float(np.median(steps))
    place = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, len(steps) - 1)
    from_others = np.minimum(np.abs(grid - times[place]), np.abs(times[place + 1] - grid))
    return (steps[place] > _LONGER * usual) & (from_others > 0.5 * usual)


def on_grid(times: Array, values: Array, grid: Array) -> Array:
    """(M, k) values (N, k) at `times` [s] on uniform times, by a cubic spline."""
    return CubicSpline.of(times, np.ascontiguousarray(values.T)).at(grid).T


def bridged(values: Array, missing: NDArray[np.bool_], smooth: bool) -> Array:
    """Samples (N, k), those `missing` (N,) put on a line between the others, or on a cubic spline (`smooth`).

    A spline goes through positions, which have no corners and little noise; torques have both.
    """
    if not missing.any():
        return values
    out, places = values.copy(), np.arange(len(values), dtype=float)
    if smooth:
        out[missing] = on_grid(places[~missing], values[~missing], places[missing])
    else:
        for k in range(values.shape[1]):
            out[missing, k] = np.interp(places[missing], places[~missing], values[~missing, k])
    return out


def without_leaps(q: Array, rate: float) -> tuple[Array, tuple[Leap, ...]]:
    """Positions (N, f) sampled at `rate` [Hz] with samples that leap and come back put on a spline, and all leaps.

    A sample leaps that is off the cubic through the two samples on either side by more than noise (σ from the median;
    family-wise over all samples) and by more than the joint moves between two samples: motion that is sampled four
    times in its period is not.
    """
    out, found = q.copy(), list[Leap]()
    count, joints = q.shape
    if count <= 4 * _REACH:
        return out, ()
    quantile = float(scipy.stats.norm.isf(0.5 * SELECTION.significance / q.size))
    off = np.zeros_like(q)
    off[2:-2] = q[2:-2] - (4.0 * (q[1:-3] + q[3:-1]) - (q[:-4] + q[4:])) / 6.0
    sigma = np.median(np.abs(off), axis=0) / float(scipy.stats.norm.isf(0.25))
    steps = np.abs(np.diff(q, axis=0))
    for k in range(joints):
        moving = steps[steps[:, k] > 0.0, k]
        if not moving.size:
            continue
        fastest = float(np.quantile(steps[:, k], _USUAL))
        usual = fastest + _QUANTA * float(np.median(moving))
        large = max(usual, quantile * float(sigma[k]))
        removed = np.zeros(count, bool)
        for start, stop in _runs(np.abs(off[:, k]) > large):
            here = np.abs(off[start : stop + 1, k])
            worst = float(np.max(here))
            first, last = (start + int(place) for place in np.flatnonzero(here > _AROUND * worst)[[0, -1]])
            before, after = max(first - 1, 0), min(last + 1, count - 1)
            step = float(q[after, k] - q[before, k])
            lasts = abs(step) > large + (after - before) * fastest
            found.append(Leap(k, before / rate, (after - before) / rate, abs(step) if lasts else worst, lasts))
            removed[first : last + 1] = not lasts
        out[:, [k]] = bridged(q[:, [k]], removed, True)
    return out, tuple(sorted(found, key=lambda leap: leap.start))


def continuous(q: Array, rate: float, leaps: tuple[Leap, ...]) -> Array:
    """Positions (N, f) that go on without the leaps that last: for the frequencies of their motion."""
    out = q.copy()
    for leap in leaps:
        if leap.lasts:
            before = round(leap.start * rate)
            after = before + round(leap.seconds * rate)
            out[after:, leap.joint] -= q[after, leap.joint] - q[before, leap.joint]
            out[before:after, leap.joint] = out[before, leap.joint]
    return out


def _runs(bad: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last place of every run of samples that are bad, those nearer than `_REACH` in one."""
    places = np.flatnonzero(bad)
    ends = np.flatnonzero(np.diff(places) > _REACH)
    firsts, lasts = np.concatenate([[0], ends + 1]), np.concatenate([ends, [len(places) - 1]])
    return [(int(places[a]), int(places[b])) for a, b in zip(firsts, lasts, strict=True)] if places.size else []
