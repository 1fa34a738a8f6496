"""Clocks that differ: instruments of one run that see the same motion at different times.

Two groups of a log may have clocks of their own, started apart. Wheel forces are mass times acceleration, and the body
rolls as its travels differ: the lag at which the two are most alike is that of their clocks, where they are nearly the
same at it and clearly less without it. The fit finds smaller lags, and far better (`regression.latency`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

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
_AS_GOOD = 0.95
"""Part of the best correlation of all axes from which a lag is as good: a periodic motion is alike at many, and the
smallest is reported."""


@dataclass(frozen=True)
class ClockDifference:
    """Two instruments whose stamps differ: `late` follows `other` by `lag` [s], at which they correlate by `alike`."""

    late: str
    other: str
    lag: float
    alike: float


def differing_clocks(run: PreparedRun) -> list[ClockDifference]:
    """Instruments that see the inertial unit's motion earlier or later than it does; empty where their clocks agree."""
    run, out = run.overview(), list[ClockDifference]()
    rate = run.recording.filters.rate
    for other, pairs in _pairs(run).items():
        each = np.array([_alike(own, same, rate) for own, same in pairs])
        most, together = each.shape[1] // 2, each.mean(axis=0)
        if not np.max(together) > 0.0:  # a car that stands
            continue
        peaks = np.append(scipy.signal.find_peaks(together)[0], np.argmax(together))
        near = peaks[together[peaks] >= _AS_GOOD * np.max(together)]
        at = int(near[np.argmin(np.abs(near - most))])
        axis = int(np.argmax(each[:, at]))
        lag, alike, without = (at - most) / rate, float(each[axis, at]), float(each[axis, most])
        clear = abs(lag) >= _LEAST and alike >= _SAME and 1.0 - without >= _LESS * (1.0 - alike)
        if not clear or without < _REVERSED:
            continue
        names = ("inertial unit", other) if lag > 0.0 else (other, "inertial unit")
        out.append(ClockDifference(*names, abs(lag), alike))
    return out


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


def _alike(first: Array, second: Array, rate: float) -> Array:
    """(2 K + 1,) correlation of two series (N,) at lags of the second behind the first from −K to K samples."""
    a, b = first - first.mean(), second - second.mean()
    most = min(round(_FARTHEST * rate), a.size // 2)
    n = int(scipy.fft.next_fast_len(2 * a.size, real=True))
    products = np.fft.irfft(np.fft.rfft(b, n) * np.conj(np.fft.rfft(a, n)), n)
    # Squares of what overlaps at each lag, of the first from its begin on and of the second to its end, or the reverse.
    of_a, of_b = (np.concatenate([[0.0], np.cumsum(x**2)]) for x in (a, b))
    k = np.arange(most + 1)
    behind = of_a[a.size - k] * (of_b[-1] - of_b[k])
    before = of_b[a.size - k] * (of_a[-1] - of_a[k])
    squares = np.concatenate([before[:0:-1], behind])
    around = np.concatenate([products[-most:], products[: most + 1]])
    return np.divide(around, np.sqrt(squares), out=np.zeros_like(around), where=squares > 0.0)
