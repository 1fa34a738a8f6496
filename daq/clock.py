"""Clock synchronisation of a sensor with the recorder: a line as the lower envelope of (arrival − device) stamps.

A frame can be late, never early. Delays in transit (a USB latency timer, a busy scheduler) therefore lie *above* the
line through the least delayed frames, and that line maps the sensor's clock to the recording machine's, up to the
least delay of all. A least-squares line would keep the mean delay as a bias.

Of all lines below the points, the one nearest to them on average touches the lower convex hull above the mean of the
device stamps: a linear program with two unknowns, solved exactly by exchanging its two touching points.

Where a clock jumps, stretches are too short for that. Device stamps of a constant rate meet an adapter's timer on a
grid of h (1 ms for 5 ms samples and a 16 ms timer), so that the envelope is a staircase with steps of h; in a stretch
of length T the nearest line may touch one step only and have a slope wrong by up to 2h/T, which is 0.58 h σ along the
stretch. There the drift is that of the least-squares line through the whole lower hull, wrong by about h/T, with one
slope for all stretches: they are of one oscillator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_DRIFT = 500e-6
"""Largest drift of two quartz clocks relative to each other, as a fraction; a steeper slope is an error of a short
stretch."""

SHORT_NS = 1_000_000_000
"""Duration below which a stretch between two that agree is a burst of delayed or wrong stamps, not a new clock [ns]."""


@dataclass(frozen=True)
class ClockSegment:
    """Line from the device clock to the arrival clock over a stretch without a jump.

    Attributes
    ----------
    start, stop : samples ``start … stop − 1``.
    arrival_ns : stamp of its first sample [ns].
    device_ns : device stamp the line refers to [ns].
    offset_ns : arrival minus device there, on the envelope [ns].
    drift : rate of the arrival clock relative to the device clock less 1 (1e-6 is 1 ppm).
    """

    start: int
    stop: int
    arrival_ns: int
    device_ns: int
    offset_ns: int
    drift: float

    def apply(self, device_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Device stamps converted to the arrival clock [ns]."""
        since = device_ns - self.device_ns
        return device_ns + self.offset_ns + np.rint(self.drift * since).astype(np.int64)


@dataclass(frozen=True)
class ClockFit:
    """A device clock fitted to the arrival clock, stretch by stretch.

    Attributes
    ----------
    segments : one a stretch between jumps, in order.
    jumps : (J,) int64, index of the first sample after each jump of either clock.
    outliers : (O,) int64, samples whose device stamp agrees with none before or after it.
    delay_mean_ns, delay_std_ns, delay_max_ns : delays of the arrivals above the envelope [ns], which the fit removes.
    misfit_ns : the largest gap between the line and the least delayed of any 100 consecutive samples [ns]: large when
        the drift is not constant, or for a jump too small to be distinguished from a delay.
    """

    segments: tuple[ClockSegment, ...]
    jumps: NDArray[np.int64]
    outliers: NDArray[np.int64]
    delay_mean_ns: float
    delay_std_ns: float
    delay_max_ns: float
    misfit_ns: float

    @property
    def offset_ns(self) -> int:
        """Arrival minus device at the first sample, on the envelope [ns]."""
        return self.segments[0].offset_ns

    @property
    def drift(self) -> float:
        """Drift of the longest segment, as a fraction."""
        return max(self.segments, key=lambda segment: segment.stop - segment.start).drift

    def apply(self, device_ns: NDArray[np.int64], arrival_ns: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
        """Device stamps converted to the arrival clock [ns].

        Parameters
        ----------
        device_ns : (N,) device stamps [ns].
        arrival_ns : (N,) their arrivals [ns], which distinguish the segments; not needed when there is one only.

        Raises
        ------
        ValueError : there are several segments and no arrivals.
        """
        device = np.asarray(device_ns, np.int64)
        if len(self.segments) == 1:
            return self.segments[0].apply(device)
        if arrival_ns is None:
            raise ValueError("the device clock jumped: give the arrivals, which tell its segments apart")
        starts = np.array([segment.arrival_ns for segment in self.segments])
        which = np.clip(np.searchsorted(starts, arrival_ns, side="right") - 1, 0, None)
        out = np.empty_like(device)
        for number, segment in enumerate(self.segments):
            out[which == number] = segment.apply(device[which == number])
        return out


def fit_clock(arrival_ns: NDArray[np.int64], device_ns: NDArray[np.int64], jump_ns: int = 100_000_000) -> ClockFit:
    """The fit of a device clock by the lower envelope of (arrival − device).

    Parameters
    ----------
    arrival_ns : (N,) receipt stamps, in the order received [ns]; N ≥ 1.
    device_ns : (N,) the sensor's own stamps, unwrapped [ns].
    jump_ns : smallest lasting step of (arrival − device) that is a jump of a clock [ns]; a passing step is a delay.

    Raises
    ------
    ValueError : no samples, or arrays of different lengths.
    """
    arrival, device = np.asarray(arrival_ns, np.int64), np.asarray(device_ns, np.int64)
    if not len(arrival) or arrival.shape != device.shape:
        raise ValueError(f"{len(arrival)} arrivals, {len(device)} device stamps")
    lag = arrival - device
    group, outlier = _stretches(lag, arrival, jump_ns)
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    stops = np.append(starts[1:], len(lag))
    spans = [(int(a), int(b)) for a, b in zip(starts, stops, strict=True)]
    good = [np.arange(a, b)[~outlier[a:b]] for a, b in spans]
    if len(good) == 1:
        drift = _envelope_slope(device[good[0]], lag[good[0]])
    else:  # one oscillator: a jump or a reset does not change its rate
        drift = _shared_slope([(device[rows], lag[rows]) for rows in good])
    segments = []
    for (a, b), rows in zip(spans, good, strict=True):
        offset = int(np.floor(np.min((lag[rows] - lag[a]) - drift * (device[rows] - device[a])))) + int(lag[a])
        segments.append(ClockSegment(a, b, int(arrival[a]), int(device[a]), offset, drift))
    parts = [arrival[rows] - s.apply(device[rows]) for s, rows in zip(segments, good, strict=True)]
    delay = np.concatenate(parts).astype(float)
    windows = [np.minimum.reduceat(part, np.arange(0, max(len(part) - 99, 1), 100)).max() for part in parts]
    return ClockFit(
        tuple(segments),
        starts[1:].astype(np.int64),
        np.flatnonzero(outlier).astype(np.int64),
        float(delay.mean()),
        float(delay.std()),
        float(delay.max()),
        float(max(windows)),
    )


def _envelope_slope(device: NDArray[np.int64], lag: NDArray[np.int64]) -> float:
    """Slope of the line below all points (device, lag) that is nearest to them on average, within `MAX_DRIFT`."""
    x = (device - device[0]).astype(float)
    y = (lag - lag[0]).astype(float)
    x -= x.mean()
    left, right = np.flatnonzero(x < 0), np.flatnonzero(x >= 0)
    if not len(left) or not len(right):
        return 0.0
    # Touching points on either side of the mean. A point below their line replaces the one on its side; each exchange
    # raises the optimum of a concave function with finitely many corners, so the loop ends, after a few rounds.
    a, b = left[np.argmin(y[left])], right[np.argmin(y[right])]
    while True:
        slope = (y[b] - y[a]) / (x[b] - x[a])
        below = y - y[a] - slope * (x - x[a])
        lowest = int(np.argmin(below))
        if below[lowest] > -1e-3 or lowest in (a, b):  # 1e-3 ns: rounding
            return float(np.clip(slope, -MAX_DRIFT, MAX_DRIFT))
        a, b = (lowest, b) if x[lowest] < 0 else (a, lowest)


def _shared_slope(stretches: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]]) -> float:
    """Slope of the least-squares lines, parallel to each other, through the lower hulls of (device, lag) of stretches.

    Each stretch has an offset of its own and counts by the square of its length and its number of samples. Within
    `MAX_DRIFT`; 0 when no stretch has any length.
    """
    rise, run = 0.0, 0.0
    for device, lag in stretches:
        order = np.lexsort((lag, device))
        x = (device[order] - device[order[0]]).astype(float)
        hull = _lower_hull(x, (lag[order] - lag[order[0]]).astype(float))
        x -= x.mean()
        rise += float(x @ hull)
        run += float(x @ x)
    return float(np.clip(rise / run, -MAX_DRIFT, MAX_DRIFT)) if run else 0.0


def _lower_hull(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """The greatest convex function below all points (x, y), at each x; x in order, of equal ones the lowest first."""
    first = np.flatnonzero(np.diff(x, prepend=-1.0) > 0.0)
    u, v = x[first], y[first]
    corners, open_chords = [0, len(u) - 1], [(0, len(u) - 1)]
    while open_chords:
        a, b = open_chords.pop()
        if b - a < 2:
            continue
        below = v[a:b] - v[a] - (v[b] - v[a]) / (u[b] - u[a]) * (u[a:b] - u[a])
        lowest = a + int(np.argmin(below))
        if below[lowest - a] < -1e-3:  # 1e-3 ns: rounding
            corners.append(lowest)
            open_chords += [(a, lowest), (lowest, b)]
    corners = sorted(set(corners))
    return np.interp(x, u[corners], v[corners])


def _stretches(
    lag: NDArray[np.int64], arrival: NDArray[np.int64], jump_ns: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Number of the stretch without a jump for each sample (0, 1, …), and the samples that belong to none.

    The record is cut at each step of `lag`. Pieces whose least lags agree are one clock, whatever delays lie between;
    so are short pieces between two that agree.
    """
    cuts = np.concatenate(([0], np.flatnonzero(np.abs(np.diff(lag)) > jump_ns) + 1))
    stops = np.append(cuts[1:], len(lag))
    levels = np.minimum.reduceat(lag, cuts)
    length = arrival[stops - 1] - arrival[cuts]
    group, outlier = np.zeros(len(lag), np.int64), np.zeros(len(lag), bool)
    number, level, seen, waiting = 0, int(levels[0]), int(arrival[stops[0] - 1]), []
    for k in range(1, len(cuts)):  # over the steps, of which there are few
        room = jump_ns + MAX_DRIFT * abs(int(arrival[cuts[k]]) - seen)
        agrees = abs(int(levels[k]) - level) <= room
        last = k == len(cuts) - 1
        if not agrees and length[k] < SHORT_NS and not last:
            waiting.append(k)
            continue
        for j in waiting:  # counted to the clock before them: late ones are harmless to it, early ones are wrong
            if levels[j] < level:
                outlier[cuts[j] : stops[j]] = True
            group[cuts[j] : stops[j]] = number
        waiting = []
        if not agrees:
            number += 1
        level, seen = int(levels[k]), int(arrival[stops[k] - 1])
        group[cuts[k] : stops[k]] = number
    return group, outlier


def steady_stamps(arrival_ns: NDArray[np.int64], gap: NDArray[np.bool_], period_ns: float) -> NDArray[np.int64]:
    """Time stamps of samples taken at a constant rate, from their delayed arrivals.

    Samples are numbered; the lower envelope of (arrival − number × period) gives the true period, and in each stretch
    without losses the earliest arrival gives the offset, so that a miscounted loss cannot shift the rest of a run.

    Parameters
    ----------
    arrival_ns : (N,) receipt stamps [ns].
    gap : (N,) samples before which others were lost: the numbering begins anew there.
    period_ns : nominal time between samples [ns].

    Returns (N,) stamps [ns], increasing; stretches of fewer than 50 samples keep their arrivals.
    """
    out = arrival_ns.copy()
    starts = np.flatnonzero(gap | (np.arange(len(arrival_ns)) == 0))
    stops = np.append(starts[1:], len(arrival_ns))
    if not len(starts) or np.max(stops - starts) < 50:
        return out
    longest = int(np.argmax(stops - starts))
    stretch = slice(starts[longest], stops[longest])
    number = np.arange(stops[longest] - starts[longest])
    fit = fit_clock(arrival_ns[stretch], np.rint(number * period_ns).astype(np.int64))
    period = period_ns * (1.0 + fit.drift)
    for start, stop in zip(starts, stops, strict=True):  # stretches, not samples
        if stop - start < 50:
            continue
        even = np.rint(np.arange(stop - start) * period).astype(np.int64)
        # A long pause of the reader (a jump of its clock) is no late arrival: such a stretch keeps its stamps.
        late = arrival_ns[start:stop] - even
        if np.ptp(late) < 0.5e9:
            out[start:stop] = even + late.min()
    return np.maximum.accumulate(out)
