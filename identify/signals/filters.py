"""Zero-phase Butterworth filters, central differences, resampling and decimation.

Two stages, as the method asks: a pre-filter alike for all channels, before anything is multiplied or differentiated;
then one parallel filter on both sides of the equations, before decimation. Every cut-off given is the −3 dB point of
the two passes together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.signals.spline import CubicSpline

Array = NDArray[np.float64]

VANISHED = 1e-18
"""Size below which a power of a pole adds nothing to a sum that begins with 1."""


@dataclass(frozen=True)
class Filters:
    """Filter settings of a run's channels and equations.

    Attributes
    ----------
    rate : common rate the channels are brought to [Hz].
    pre_cutoff : pre-filter, −3 dB of the two passes [Hz]; None leaves channels as they are (exact derivatives given).
    fit_cutoff : parallel filter, −3 dB of the two passes [Hz].
    order : order of one pass (5 to 8).
    edge : left out at both ends of a run and around unusable samples [s]: the filters' transients.
    """

    rate: float = 125.0
    pre_cutoff: float | None = 20.0
    fit_cutoff: float = 6.0
    order: int = 6
    edge: float = 0.75

    def __post_init__(self) -> None:
        if not 5 <= self.order <= 8:
            raise ValueError(f"filter order must be 5 to 8, found {self.order}")
        if self.pre_cutoff is not None and self.pre_cutoff < 3.0 * self.fit_cutoff:
            raise ValueError(
                f"the pre-filter ({self.pre_cutoff:g} Hz) must be at least 3 times the fit's cut-off "
                f"({self.fit_cutoff:g} Hz): nearer, it biases inertia and damping"
            )
        if 2.0 * self.fit_cutoff >= self.rate:
            raise ValueError(f"a fit up to {self.fit_cutoff:g} Hz needs a rate above {2 * self.fit_cutoff:g} Hz")

    @property
    def step(self) -> int:
        """Decimation: every `step`-th sample is kept, just above twice the fit's cut-off."""
        return max(1, math.floor(self.rate / (2.2 * self.fit_cutoff)))

    @property
    def memory(self) -> float:
        """Time after which the parallel filter has forgotten a sample but for one part in 10¹² [s]."""
        slowest = float(np.max(np.abs(poles(self.fit_cutoff, self.rate, self.order))))
        return math.log(1e-12) / math.log(slowest) / self.rate


# A Butterworth low-pass of order n made digital by the bilinear transform has |H|² = 1/(1 + (w/wd)^2n) on the warped
# axis w = tan(π f/rate): what two passes do to an amplitude (A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal
# Processing, 2010, 7.2). With wd^2n = w(cutoff)^2n ÷ (√2 − 1) two passes are at −3 dB at the cut-off. Written out: to
# import scipy.signal takes longer than to fit a run.


def two_pass_gain(frequency: Array, cutoff: float, rate: float, order: int) -> Array:
    """Gain of both passes together at frequencies [Hz] up to half the rate, for −3 dB at `cutoff` [Hz]."""
    warped = np.tan(np.pi * np.minimum(frequency, 0.5 * rate) / rate) / math.tan(math.pi * cutoff / rate)
    return np.asarray(1.0 / (1.0 + (math.sqrt(2.0) - 1.0) * warped ** (2 * order)), float)


@cache
def poles(cutoff: float, rate: float, order: int) -> NDArray[np.complex128]:
    """Poles (order,) of one pass in the z plane, conjugates beside each other; its `order` zeros are all at −1."""
    warped = math.tan(math.pi * cutoff / rate) * (math.sqrt(2.0) - 1.0) ** (-0.5 / order)
    angle = np.pi * (2.0 * np.arange(order) + order + 1.0) / (2.0 * order)
    s = warped * np.exp(1j * angle)
    if order % 2:
        s[order // 2] = -warped
    return np.asarray((1.0 + s) / (1.0 - s), complex)


def zero_phase(x: Array, cutoff: float, rate: float, order: int) -> Array:
    """A series (…, N) after a low-pass forward and backward along its last axis, without phase shift.

    `cutoff` : −3 dB of the two passes [Hz]; `rate` [Hz]; `order` of one pass. The series counts as continued without
    end, turned about its first and its last sample, so that a straight line stays as it is.
    """
    n = x.shape[-1]
    if n < 4:
        return x.copy()
    if further := _further(n, cutoff, rate, order):
        x = np.concatenate([x, 2.0 * x[..., -1:] - x[..., -2 : -2 - further : -1]], axis=-1)
    # Turned about both ends a series without its line is odd and periodic: a sum of sines.
    line = x[..., :1] + (x[..., -1:] - x[..., :1]) * np.linspace(0.0, 1.0, n + further)
    sines = np.asarray(scipy.fft.dst((x - line)[..., 1:-1], 1, axis=-1), float)
    frequency = np.arange(1.0, n + further - 1.0) * (0.5 * rate / (n + further - 1))
    sines *= two_pass_gain(frequency, cutoff, rate, order)
    line[..., 1:-1] += np.asarray(scipy.fft.idst(sines, 1, axis=-1), float)
    return np.ascontiguousarray(line[..., :n]) if further else line


@lru_cache(256)
def _further(n: int, cutoff: float, rate: float, order: int) -> int:
    """Samples by which a series of `n` is continued, turned about its last one, before it is made a sum of sines.

    Their number times two has a large prime factor where n − 1 has one, and the sum is then up to ten times slower.
    As many that the filter has forgotten, up to rounding, how the longer series ends; 0 where they are too many.
    """
    if scipy.fft.next_fast_len(n - 1) == n - 1:
        return 0
    slowest = float(np.max(np.abs(poles(cutoff, rate, order))))
    seen = math.ceil(math.log(VANISHED) / math.log(slowest))
    further = int(scipy.fft.next_fast_len(n - 1 + seen)) + 1 - n
    return further if further <= n // 4 else 0


# Central differences of eighth order: at 6 Hz and 125 Hz sampling one part in ten million low, at 20 Hz 0.15 %; the
# three-point rule 1.5 % and 16 %.
_STENCIL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])


def derivative(x: Array, rate: float) -> Array:
    """Time derivative along the last axis by central differences of eighth order, without phase shift."""
    if x.shape[-1] < _STENCIL.size:
        return np.gradient(x, 1.0 / rate, axis=-1)
    out = scipy.ndimage.correlate1d(x, _STENCIL * rate, axis=-1, output=float)
    # At the ends the stencil has no samples on one side: differences of neighbours there.
    step = 1.0 / rate
    out[..., 1:4] = (x[..., 2:5] - x[..., :3]) / (2.0 * step)
    out[..., -4:-1] = (x[..., -3:] - x[..., -5:-2]) / (2.0 * step)
    out[..., 0], out[..., -1] = (x[..., 1] - x[..., 0]) / step, (x[..., -1] - x[..., -2]) / step
    return out


def zero_phase_of(x: Array, filters: Filters) -> Array:
    """The zero-phase parallel filter (the fit's cut-off) along the last axis of a series (…, N)."""
    return zero_phase(x, filters.fit_cutoff, filters.rate, filters.order)


def decimate(x: Array, filters: Filters, keep: NDArray[np.intp]) -> Array:
    """A series (…, N) after the parallel filter, at the n samples `keep` of its last axis: (…, n)."""
    return zero_phase_of(x, filters)[..., keep]


def bring_to_grid(t: Array, values: Array, grid: Array, cutoff: float | None, order: int) -> Array:
    """A channel pre-filtered at its own rate and evaluated on the common time grid, (k, N).

    Parameters
    ----------
    t : (M,) s, strictly increasing, uniform or not.
    values : (M, k) without NaN.
    grid : (N,) s, inside the span of `t`.
    cutoff : −3 dB of the two passes [Hz], or None not to filter.

    Stamps that are not uniform are first interpolated to the channel's own mean rate.
    """
    step = (t[-1] - t[0]) / (len(t) - 1)
    uniform = t[0] + step * np.arange(len(t))
    if np.max(np.abs(t - uniform)) > 1e-3 * step:
        values = CubicSpline.of(t, values.T).at(uniform).T
    series = np.ascontiguousarray(values.T)
    if cutoff is not None and cutoff < 0.45 / step:
        series = zero_phase(series, cutoff, 1.0 / step, order)
    return _cubic(uniform, series, grid)


def _cubic(t: Array, series: Array, grid: Array) -> Array:
    """Cubic interpolation of uniform series (k, M) at `grid`; exact where the grid falls on samples."""
    position = (grid - t[0]) / (t[1] - t[0])
    if np.max(np.abs(position - np.rint(position))) < 1e-9:
        return series[:, np.rint(position).astype(np.intp)]
    return CubicSpline.of(t, series).at(grid)
