"""Clocks that differ: instruments of one run that see the same motion at different times.

Two groups of a log may have clocks of their own, started apart, of another rate, or one of them lost some seconds.
Wheel forces are mass times acceleration, and the body rolls as its travels differ: the lag at which the two are most
alike is that of their clocks, where they are nearly the same at it and clearly less without it. A lag that grows or
jumps is one where the same holds against any constant lag. The fit finds smaller lags, and far better
(`regression.latency`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from lacet.daq.channels import CORNERS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun

_LEAST = 0.2
"""Least difference that is reported [s]. Source: a choice; instruments have latencies of some hundredths, and in a
slalom the acceleration of the body's origin is up to 0.08 s from the centre of gravity's (20 sound runs of two
cars)."""
_FARTHEST = 5.0
"""Farthest lag that is looked at [s]."""
_SAME = 0.9
"""Correlation from which two signals are the same motion. Source: a choice."""
_LESS = 4.0
"""How much farther from 1 the correlation without lag is than that at the lag, at least: a slow or periodic motion is
nearly alike at many lags."""
_REVERSED = -0.5
"""Correlation without lag below which the sign may be the other one: a periodic motion is then alike half a period
away."""
_FASTEST = 0.05
"""Largest difference of two clocks' rates that is looked at [s/s]."""
_WINDOW, _MOST_WINDOWS = 1.0, 40
"""Least length of the windows in which the lag may differ [s], and their largest number: longer runs have longer
ones."""
_ROUNDING = 1e-9
"""Largest variation of a constant series ÷ its size, by rounding."""
_AS_GOOD = 0.95
"""Part of the best correlation of all axes from which a lag is as good: a periodic motion is alike at many, and the
smallest is reported."""


@dataclass(frozen=True)
class ClockDifference:
    """Two instruments whose stamps differ.

    Attributes
    ----------
    late, other : the one that follows, in the end, and the one that it follows.
    lag : of `late` behind `other` at the run's beginning [s].
    alike : their correlation with the lag.
    drift : growth of the lag [s/s], where their clocks run at different rates.
    jump : time from which on another lag holds, and that lag [s]; None where there is none.
    seconds : length of the run [s].
    """

    late: str
    other: str
    lag: float
    alike: float
    drift: float = 0.0
    jump: tuple[float, float] | None = None
    seconds: float = 0.0

    @property
    def last(self) -> float:
        """Lag at the run's end [s]."""
        return self.lag + self.drift * self.seconds if self.jump is None else self.jump[1]


def differing_clocks(run: PreparedRun) -> list[ClockDifference]:
    """Instruments that see the inertial unit's motion earlier or later than it does; empty where their clocks agree."""
    run, out = run.overview(), list[ClockDifference]()
    rate = run.recording.filters.rate
    for other, pairs in _pairs(run).items():
        axes = [_Windows.of(own, same, rate) for own, same in pairs]
        each = np.array([one.alike() for one in axes])
        most, together = each.shape[1] // 2, each.mean(axis=0)
        if not np.max(together) > 0.0:  # a car that stands
            continue
        begin = float(run.recording.t[0])
        if (changing := _changing(axes, other, begin)) is not None:
            out.append(changing)
            continue
        at = _nearest(together, most)
        axis = int(np.argmax(each[:, at]))
        lag, alike, without = (at - most) / rate, float(each[axis, at]), float(each[axis, most])
        clear = abs(lag) >= _LEAST and alike >= _SAME and 1.0 - without >= _LESS * (1.0 - alike)
        if not clear or without < _REVERSED:
            continue
        out.append(_named(other, ClockDifference("", "", lag, alike)))
    return out


def _named(other: str, found: ClockDifference) -> ClockDifference:
    """A lag of the inertial unit behind an instrument, with the names of what is late in the end."""
    if found.last > 0.0:
        return replace(found, late="inertial unit", other=other)
    jump = None if found.jump is None else (found.jump[0], -found.jump[1])
    return replace(found, late=other, other="inertial unit", lag=-found.lag, drift=-found.drift, jump=jump)


def _changing(axes: Sequence[_Windows], other: str, begin: float) -> ClockDifference | None:
    """A lag that grows or jumps, where it explains far more than any constant one; None where none is."""
    found: list[tuple[float, ClockDifference]] = []
    for one in axes:
        constant, seconds = float(np.max(one.alike())), len(one.products) * one.step
        if 1.0 - constant < _LESS * (1.0 - one.most_alike):
            continue
        lag, drift, alike = one.drifting()
        found.append((constant, ClockDifference("", "", lag, alike, drift, seconds=seconds)))
        lag, since, later, alike = one.jumping()
        if abs(later - lag) >= _LEAST:
            found.append((constant, ClockDifference("", "", lag, alike, jump=(begin + since, later), seconds=seconds)))
    clear = [d for constant, d in found if d.alike >= _SAME and 1.0 - constant >= _LESS * (1.0 - d.alike)]
    best = max(clear, key=lambda d: d.alike, default=None)
    return None if best is None else _named(other, best)


@dataclass(frozen=True)
class _Windows:
    """Products of two series in W windows at lags of the second behind the first from −K to K samples.

    Attributes
    ----------
    a, b : (N,) the two series, less their means.
    products : (W, 2 K + 1) sums of products; `first`, `second` of the squares of each where both are known.
    rate : samples a second; `step` : length of a window [s].
    """

    a: Array
    b: Array
    products: Array
    first: Array
    second: Array
    rate: float
    step: float

    @classmethod
    def of(cls, a: Array, b: Array, rate: float) -> _Windows:
        """Those of two series (N,)."""
        a, b = (np.where(np.ptp(x) > _ROUNDING * np.max(np.abs(x)), x - x.mean(), 0.0) for x in (a, b))
        most, size = min(round(_FARTHEST * rate), a.size // 2), round(max(_WINDOW * rate, a.size / _MOST_WINDOWS))
        count = a.size // size
        padded, known = (np.pad(x, most) for x in (b, np.ones(b.size)))
        products, first, second = (np.empty((count, 2 * most + 1)) for _ in range(3))
        for w in range(count):
            own, beside = slice(w * size, (w + 1) * size), slice(w * size, (w + 1) * size + 2 * most)
            products[w] = sliding_window_view(padded[beside], size) @ a[own]
            first[w] = sliding_window_view(known[beside], size) @ a[own] ** 2
            second[w] = sliding_window_view(padded[beside] ** 2, size).sum(axis=1)
        return cls(a, b, products, first, second, rate, size / rate)

    @property
    def most(self) -> int:
        """K."""
        return self.products.shape[1] // 2

    @property
    def most_alike(self) -> float:
        """Correlation with the best lag of each window: no course of the lag has much more."""
        squares = np.sqrt(self.first * self.second)
        each = np.divide(self.products, squares, out=np.zeros_like(squares), where=squares > 0.0)
        at = np.arange(len(each)), np.argmax(each, axis=1)
        # By the inequality of Cauchy and Schwarz the whole is no more alike than its windows are in the mean.
        return float(np.sum(squares[at] * each[at]) / max(float(np.sum(squares[at])), 1e-300))

    def alike(self, windows: slice = slice(None)) -> Array:
        """(2 K + 1,) correlation at each lag over some of the windows."""
        products, first, second = (part[windows].sum(axis=0) for part in (self.products, self.first, self.second))
        # At a lag of little overlap anything is alike.
        return np.where(first >= 0.5 * np.max(first), _correlation(products, first, second), -1.0)

    def drifting(self) -> tuple[float, float, float]:
        """Lag at the beginning [s], its growth [s/s] and the correlation, where that is largest."""
        count, width = self.products.shape
        seconds = count * self.step
        most = int(min(_FASTEST * seconds, 2.0 * _FARTHEST) * self.rate)
        middle = (np.arange(count) + 0.5) / count - 0.5
        best, most_alike = (0.0, 0.0, -1.0), -1.0
        for change in range(-most, most + 1):  # of the lag over the run [samples]
            places = np.arange(width) + np.round(change * middle).astype(int)[:, None]
            inside = np.all((places >= 0) & (places < width), axis=0)
            if not inside.any():
                continue
            at = np.arange(count)[:, None], places[:, inside]
            alike = _correlation(*(part[at].sum(axis=0) for part in (self.products, self.first, self.second)))
            if np.max(alike) > most_alike:
                begin = np.flatnonzero(inside) - self.most - 0.5 * change
                k = _nearest(alike, int(np.argmin(np.abs(begin))))
                best = (float(begin[k]) / self.rate, change / self.rate / seconds, float(alike[k]))
                most_alike = float(np.max(alike))
        return best

    def jumping(self) -> tuple[float, float, float, float]:
        """Lag before a jump [s], the jump's time after the beginning [s], the lag after it, and the correlation.

        Where the second lost samples, as much of the first after the jump is without any of the second.
        """
        lags, most = (self.most, self.most), -1.0
        for w in range(1, len(self.products)):
            k = _nearest(self.alike(slice(None, w)), self.most), int(np.argmax(self.alike(slice(w, None))))
            on = w + math.ceil(max(0, k[0] - k[1]) / self.rate / self.step)
            sums = (part[:w, k[0]].sum() + part[on:, k[1]].sum() for part in (self.products, self.first, self.second))
            alike = float(_correlation(*map(np.asarray, sums)))
            if alike > most:
                lags, most = k, alike
        # The jump is within a window: of all samples, the one where it leaves most.
        before, after = (self._courses(k - self.most) for k in lags)
        lost = max(0, lags[0] - lags[1])
        whole = [
            np.cumsum(x)[: x.size - lost] + (np.sum(y) - np.cumsum(y))[lost:]
            for x, y in zip(before, after, strict=True)
        ]
        alike = _correlation(*whole)
        at = int(np.argmax(alike))
        return (lags[0] - self.most) / self.rate, at / self.rate, (lags[1] - self.most) / self.rate, float(alike[at])

    def _courses(self, lag: int) -> list[Array]:
        """(N,) products and squares of both at a lag [samples], zero where one is not known."""
        n = self.a.size
        there = np.arange(n) + lag
        inside = (there >= 0) & (there < n)
        b = self.b[np.clip(there, 0, n - 1)]
        return [np.where(inside, x, 0.0) for x in (self.a * b, self.a**2, b**2)]


def _nearest(alike: Array, to: int) -> int:
    """Place of the lag nearest to another one of those that are as good as the best."""
    peaks, best = np.append(scipy.signal.find_peaks(alike)[0], np.argmax(alike)), float(np.max(alike))
    near = peaks[alike[peaks] >= min(_AS_GOOD * best, best)]  # all may be opposed
    return int(near[np.argmin(np.abs(near - to))])


def _correlation(products: Array, first: Array, second: Array) -> Array:
    """Correlation from the sums of products and of the squares of both."""
    squares = np.sqrt(first * second)
    return np.divide(products, squares, out=np.zeros_like(squares), where=squares > 0.0)


def _pairs(run: PreparedRun) -> dict[str, list[tuple[Array, Array]]]:
    """Instrument → series of its (N,), each with what the inertial unit makes of the same."""
    values, outline, rate = run.recording.signals.value, run.outline, run.recording.filters.rate
    out: dict[str, list[tuple[Array, Array]]] = {}
    if "imu.accel" in values and all(f"wheel.{c}.force" in values for c in CORNERS):
        total = np.sum([corner.force for corner in outline.corners.values()], axis=0)
        out["wheel forces"] = list(zip(total, outline.accel, strict=True))
    if "imu.rate" in values:
        for right, left in (("fr", "fl"), ("rr", "rl")):
            if all({f"laser.{c}.hub", f"damper.{c}.travel"} & values.keys() for c in (right, left)):
                difference = outline.corners[right].travel - outline.corners[left].travel
                change = np.gradient(difference) * rate
                out.setdefault("suspension travels", []).append((change, outline.omega[0]))
    return out
