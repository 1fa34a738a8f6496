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

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_DRIFT = 500e-6
"""Largest drift of two quartz clocks relative to each other, as a fraction; a steeper slope is an error of a short
stretch, unless the delays of the arrivals are too short for such an error."""

JUMP_NS = 100_000_000
"""Lasting step of (arrival − device) that is a jump of a clock, however few samples show it [ns]."""

STEP_NS = 20_000_000
"""Smallest lasting step that is one when `STRETCH` samples show it [ns]: more than one period of the slowest timer that
holds samples back, 16 ms of a USB serial adapter."""

SHOWN_NS = 4_000_000
"""Smallest step that is one when the device stamps show it themselves [ns]: the interval between two of them is longer
or shorter by as much as the least delays step. So steps of 5 ms and more are followed; least delays scatter by less."""

ALIKE_NS = 2_000_000
"""Difference of the two steps, of stamps and of delays, up to which they are the same, if it is less than half of them
[ns]. Through a timer of 16 ms the least delays of 2 ms samples step by 2 ms themselves."""

AROUND_NS = 2_000_000_000
"""Time before and after a shown step in which the least delays are taken [ns]."""

UNEVEN = 0.05
"""Share of intervals between device stamps that may differ from the usual one: a sensor that samples when it likes
shows no steps."""

MISFIT_NS = 5_000_000
"""Largest delay of the least delayed sample of a window of `LEVEL_NS` for which its stamps are believed [ns]. Where
every sample is later, the line is not that of the clock there."""

STRETCH = 50
"""Samples in a row from which a small step is believed, and a steady rate fitted, at least."""

UNSEEN = 16
"""Smallest number of lost samples that a sample counter may not show: all values of one of four bits."""

WINDOW_SAMPLES = 100
"""Number of samples in which a least delay is looked for, at least."""

SHORT_NS = 1_000_000_000
"""Duration below which a stretch between two that agree is a burst of delayed or wrong stamps, not a new clock [ns]."""

LEVEL_NS = 10_000_000_000
"""Length over which least delays are compared [ns]: what a stall of the reader held back is delivered within it, and
`MAX_DRIFT` comes to less than a small step."""


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
    stamps : (N,) int64, the device stamps converted to the arrival clock, each by the line of its stretch [ns].
    delay_mean_ns, delay_std_ns, delay_max_ns : delays of the arrivals above the envelope [ns], which the fit removes.
    misfit_ns : the largest gap between the line and the least delayed sample of any window [ns]: large when the drift
        is not constant, or for a jump too small to be distinguished from a delay.
    doubtful : (M,) int64, samples of windows in which that gap is more than `MISFIT_NS`.
    """

    segments: tuple[ClockSegment, ...]
    jumps: NDArray[np.int64]
    outliers: NDArray[np.int64]
    stamps: NDArray[np.int64]
    delay_mean_ns: float
    delay_std_ns: float
    delay_max_ns: float
    misfit_ns: float
    doubtful: NDArray[np.int64]

    @property
    def offset_ns(self) -> int:
        """Arrival minus device at the first sample, on the envelope [ns]."""
        return self.segments[0].offset_ns

    @property
    def drift(self) -> float:
        """Drift of the longest segment, as a fraction."""
        return max(self.segments, key=lambda segment: segment.stop - segment.start).drift


def fit_clock(
    arrival_ns: NDArray[np.int64],
    device_ns: NDArray[np.int64],
    step_ns: int = STEP_NS,
    gap: NDArray[np.bool_] | None = None,
) -> ClockFit:
    """The fit of a device clock by the lower envelope of (arrival − device).

    Parameters
    ----------
    arrival_ns : (N,) receipt stamps, in the order received [ns]; N ≥ 1.
    device_ns : (N,) the sensor's own stamps, unwrapped [ns].
    step_ns : smallest lasting step of (arrival − device) that is a jump of a clock [ns]; a passing step is a delay.
    gap : (N,) samples before which others were lost: the interval before them shows no step.

    Raises
    ------
    ValueError : no samples, or arrays of different lengths.
    """
    arrival, device = np.asarray(arrival_ns, np.int64), np.asarray(device_ns, np.int64)
    if not len(arrival) or arrival.shape != device.shape:
        raise ValueError(f"{len(arrival)} arrivals, {len(device)} device stamps")
    lag = arrival - device
    group, outlier = _stretches(lag, device, arrival, step_ns)
    shown = _shown_steps(lag, device, arrival, group)
    group = _parted_at(group, [at for at in shown if gap is None or not gap[at]])
    found = _fit(arrival, device, group, outlier)
    if len(found.doubtful) and np.any(early := _early_alone(lag) & ~outlier):
        found = _fit(arrival, device, group, outlier | early)
    return found


def _fit(
    arrival: NDArray[np.int64], device: NDArray[np.int64], group: NDArray[np.int64], outlier: NDArray[np.bool_]
) -> ClockFit:
    """The fit of stretches, of the number `group` (N,) each, without their outliers (N,)."""
    lag = arrival - device
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
    stamps = np.concatenate([one.apply(device[a:b]) for one, (a, b) in zip(segments, spans, strict=True)])
    kept = np.flatnonzero(~outlier)
    delay = (arrival - stamps)[kept]
    least = _least_in_windows(delay, arrival[kept])
    return ClockFit(
        tuple(segments),
        starts[1:].astype(np.int64),
        np.flatnonzero(outlier).astype(np.int64),
        stamps,
        float(delay.mean()),
        float(delay.std()),
        float(delay.max()),
        float(least.max()),
        kept[least > MISFIT_NS].astype(np.int64),
    )


def _shown_steps(
    lag: NDArray[np.int64], device: NDArray[np.int64], arrival: NDArray[np.int64], group: NDArray[np.int64]
) -> list[int]:
    """First samples after steps of a device clock that are too small to be distinguished from a delay, but shown by it.

    A clock that is set forward makes one interval between its own stamps longer and all delays after it shorter by the
    same amount. A lost sample changes no delay, and a delay no interval.
    """
    intervals = np.diff(device)
    if len(intervals) < STRETCH:
        return []
    step = intervals - int(np.median(intervals))
    candidates = np.flatnonzero((np.abs(step) >= SHOWN_NS) & (np.abs(step) <= JUMP_NS)) + 1
    if len(candidates) > UNEVEN * len(intervals):
        return []
    out: list[int] = []
    for at in candidates.tolist():
        # No further than the steps on either side, which would hide it.
        first, last = np.searchsorted(group, [group[at], group[at] + 1]).tolist()
        first = max(first, out[-1] if out else 0)
        before = slice(first + int(np.searchsorted(arrival[first:at], arrival[at] - AROUND_NS)), at)
        after = slice(at, at + int(np.searchsorted(arrival[at:last], arrival[at] + AROUND_NS)))
        around = [arrival[side] for side in (before, after)]
        # What a stall held back comes at once, and shows no level.
        if any(len(side) < STRETCH // 2 or side[-1] - side[0] < AROUND_NS // 4 for side in around):
            continue
        size = int(step[at - 1])
        # The least delays, and the third least ones: one or two wrong stamps are no level.
        levels = [np.partition(lag[side], 2)[[0, 2]] for side in (before, after)]
        apart = int(np.abs(levels[1] - levels[0] + size).max())
        if apart <= ALIKE_NS and 2 * apart < abs(size):
            out.append(at)
    return out


def _parted_at(group: NDArray[np.int64], steps: Sequence[int]) -> NDArray[np.int64]:
    """(N,) numbers of stretches, with further ones from these samples on."""
    further = np.zeros(len(group), np.int64)
    further[list(steps)] = 1
    return group + np.cumsum(further)


def _early_alone(lag: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N,) samples more than `MISFIT_NS` earlier than any of `STRETCH` before and after them: their stamps are wrong.

    One of them would hold the whole line down.
    """
    padded = np.concatenate((np.full(STRETCH, lag.max()), lag, np.full(STRETCH, lag.max())))
    least = np.lib.stride_tricks.sliding_window_view(padded, STRETCH).min(axis=1)
    before, after = least[: len(lag)], least[STRETCH + 1 :]
    return lag < np.minimum(before, after) - MISFIT_NS


def _least_in_windows(delay: NDArray[np.int64], arrival: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) least delay in the window of each sample [ns]; 0 in windows with half of `WINDOW_SAMPLES`, or fewer."""
    since = np.maximum.accumulate(arrival - arrival[0])
    length = min(max(LEVEL_NS, WINDOW_SAMPLES * int(since[-1]) // len(arrival)), np.iinfo(np.int64).max)
    number = np.minimum(since // length, max(0, int(since[-1]) // length - 1))  # what remains belongs to the last
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(np.append(begins, len(number)))
    least = np.where(2 * counts > WINDOW_SAMPLES, np.minimum.reduceat(delay, begins), 0)
    return np.repeat(least, counts)


def _envelope_slope(device: NDArray[np.int64], lag: NDArray[np.int64]) -> float:
    """Slope of the line below all points (device, lag) that is nearest to them on average, if it is a clock's."""
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
            return _likely_drift(float(slope), float(np.ptp(x)), below)
        a, b = (lowest, b) if x[lowest] < 0 else (a, lowest)


def _shared_slope(stretches: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]]) -> float:
    """Slope of the least-squares lines, parallel to each other, through the lower hulls of (device, lag) of stretches.

    Each stretch has an offset of its own and counts by the square of its length and its number of samples. A slope that
    is no clock's is cut to `MAX_DRIFT`; 0 when no stretch has any length.
    """
    rise, run, length, above = 0.0, 0.0, 0.0, np.zeros(0)
    for device, lag in (_between_least(*stretch) for stretch in stretches):
        order = np.lexsort((lag, device))
        x = (device[order] - device[order[0]]).astype(float)
        y = (lag[order] - lag[order[0]]).astype(float)
        hull = _lower_hull(x, y)
        length, above = max(length, float(x[-1])), np.append(above, y - hull)
        x -= x.mean()
        rise += float(x @ hull)
        run += float(x @ x)
    return _likely_drift(rise / run, length, above) if run else 0.0


def _between_least(device: NDArray[np.int64], lag: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """A stretch from the least delayed sample of its first second to that of its last: a hull ends at its ends.

    A stretch after a stall begins with samples that were held back.
    """
    arrival = device + lag
    first = int(np.argmin(np.where(arrival <= arrival[0] + SHORT_NS, lag, lag.max())))
    last = int(np.argmin(np.where(arrival >= arrival[-1] - SHORT_NS, lag, lag.max())))
    return (device[first : last + 1], lag[first : last + 1]) if first < last else (device, lag)


def _likely_drift(slope: float, length: float, above: NDArray[np.float64]) -> float:
    """The slope, cut to `MAX_DRIFT` where the line may be that steep by error.

    The slope of an envelope is wrong by at most two delays in the length of the stretch. `length` of the longest one
    [ns]; `above` delays above the envelope [ns]. A delay is twice their median: few samples are held back for longer.
    """
    if length and len(above) >= STRETCH:
        delay = 2.0 * float(np.median(above))
        if abs(slope) > MAX_DRIFT + 2.0 * delay / length:
            return slope
    return float(np.clip(slope, -MAX_DRIFT, MAX_DRIFT))


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
    lag: NDArray[np.int64], device: NDArray[np.int64], arrival: NDArray[np.int64], step_ns: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Number of the stretch without a jump for each sample (0, 1, …), and the samples that belong to none.

    The record is cut at each step of `lag`. Pieces whose least lags agree where they meet are one clock, whatever
    delays lie between; so are short pieces between two that agree.
    """
    cuts = np.concatenate(([0], np.flatnonzero(np.abs(np.diff(lag)) > step_ns) + 1))
    stops = np.append(cuts[1:], len(lag))
    length = arrival[stops - 1] - arrival[cuts]
    group, outlier = np.zeros(len(lag), np.int64), np.zeros(len(lag), bool)
    number, level, seen = 0, _least_lags(lag, arrival, 0, int(stops[0]))[1], int(arrival[stops[0] - 1])
    waiting: list[slice] = []

    def to_the_clock_before(parts: list[slice]) -> None:
        for part in parts:  # late ones are harmless to it, early ones are wrong
            outlier[part] = lag[part].min() < level
            group[part] = number
        parts.clear()

    for k in range(1, len(cuts)):  # over the steps, of which there are few
        begin, end = int(cuts[k]), int(stops[k])
        first, final = _least_lags(lag, arrival, begin, end)
        few = end - begin < STRETCH
        room = (JUMP_NS if few else step_ns) + MAX_DRIFT * abs(int(arrival[begin]) - seen)
        agrees = abs(first - level) <= room
        short = length[k] < SHORT_NS
        # What comes after a short piece decides what it is; at the end a sample that may be late is taken for late.
        decided_later = k < len(cuts) - 1 or (first > level and device[begin] >= device[begin - 1])
        if not agrees and short and decided_later:
            waiting.append(slice(begin, end))
            continue
        to_the_clock_before(waiting)
        if not agrees:
            number += 1
        # A few late samples are no level to compare the next ones with.
        level, seen = min(level, final) if agrees and (few or short) else final, int(arrival[end - 1])
        group[begin:end] = number
    to_the_clock_before(waiting)
    return group, outlier


def _least_lags(lag: NDArray[np.int64], arrival: NDArray[np.int64], begin: int, end: int) -> tuple[int, int]:
    """Least lag in the first and in the last `LEVEL_NS` of the samples ``begin … end − 1``."""
    first = begin + int(np.searchsorted(arrival[begin:end], arrival[begin] + LEVEL_NS, "right"))
    final = begin + int(np.searchsorted(arrival[begin:end], arrival[end - 1] - LEVEL_NS))
    return int(lag[begin : max(first, begin + 1)].min()), int(lag[min(final, end - 1) : end].min())


@dataclass(frozen=True)
class SteadyStamps:
    """Time stamps of samples taken at a constant rate, from their delayed arrivals.

    Attributes
    ----------
    stamps : (N,) stamps [ns], increasing; stretches of fewer than 50 samples keep their arrivals.
    losses : index of a sample → number of samples that were lost just before it and that no counter has shown.
    doubtful : (M,) samples whose stamps do not fit the arrivals.
    """

    stamps: NDArray[np.int64]
    losses: Mapping[int, int]
    doubtful: NDArray[np.int64]


def steady_stamps(arrival_ns: NDArray[np.int64], gap: NDArray[np.bool_], period_ns: float) -> SteadyStamps:
    """Time stamps of samples taken at a constant rate, from their delayed arrivals.

    Samples are numbered; the lower envelope of (arrival − number × period) gives the true period, and in each stretch
    without losses the earliest arrival gives the offset, so that a miscounted loss cannot shift the rest of a run. A
    counter of four bits does not show a loss of 16 samples or a multiple of it: the arrivals do, by a lasting step.

    Parameters
    ----------
    arrival_ns : (N,) receipt stamps [ns].
    gap : (N,) samples before which others were lost: the numbering begins anew there.
    period_ns : nominal time between samples [ns].
    """
    out = arrival_ns.copy()
    starts = np.flatnonzero(gap | (np.arange(len(arrival_ns)) == 0))
    stops = np.append(starts[1:], len(arrival_ns))
    losses, doubtful = dict[int, int](), list[NDArray[np.int64]]()
    if not len(starts) or np.max(stops - starts) < STRETCH:
        return SteadyStamps(out, losses, np.zeros(0, np.int64))
    step = min(STEP_NS, int(UNSEEN / 2 * period_ns))

    def fit(start: int, stop: int, period: float) -> ClockFit:
        return fit_clock(arrival_ns[start:stop], np.rint(np.arange(stop - start) * period).astype(np.int64), step)

    longest = int(np.argmax(stops - starts))
    period = period_ns * (1.0 + fit(int(starts[longest]), int(stops[longest]), period_ns).drift)
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):  # stretches, not samples
        if stop - start < STRETCH:
            continue
        segments = fit(start, stop, period).segments
        for before, after in itertools.pairwise(segments):
            lost = round((after.offset_ns - before.offset_ns) / period)
            losses[start + after.start] = max(0, lost)
        for one in segments:
            inside = slice(start + one.start, start + one.stop)
            even = np.rint(np.arange(one.stop - one.start) * period).astype(np.int64)
            late = arrival_ns[inside] - even
            out[inside] = even + late.min()
            least = _least_in_windows(late - late.min(), arrival_ns[inside])
            doubtful.append(start + one.start + np.flatnonzero(least > MISFIT_NS))
    return SteadyStamps(np.maximum.accumulate(out), losses, np.concatenate(doubtful).astype(np.int64))
