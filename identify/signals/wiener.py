"""Conditional distribution of a channel's true value and rate, given its noisy samples: a Wiener smoother.

A law that bends within the noise of its argument, force = law(ṡ), has another expectation than law(measured rate), and
no correction of second order in the noise repairs it. What least squares needs is E[law(ṡ) | measurement] (regression
calibration: Carroll, Ruppert, Stefanski and Crainiceanu, Measurement Error in Nonlinear Models, 2006, chapter 4), and
the measurement is the whole record, not its value at that instant: motion is slow and the noise of a rate is fast.

With motion and noise Gaussian and independent at each frequency, of densities S and N, the true rate given the record
is Gaussian with mean G × measured, G = S / (S + N), and variance ∫ G N df (N. Wiener, Extrapolation, Interpolation and
Smoothing of Stationary Time Series, 1949; A. Papoulis, Probability, Random Variables and Stochastic Processes, 1991,
chapter 14). N is known from the sensor sheet and the pre-filter; S is what the record holds beyond it, band by band. A
drive has quiet and lively seconds: S is one spectrum for the whole run times an intensity that varies in time.

Motion faster than the pre-filter lets pass is not in the record, but a law acts on it: a friction of 45 N on a road of
class A is 6 % smaller at the rate below 20 Hz than at the whole rate, without any noise. Its mean square is measured in
the raw samples and belongs to the conditional variance (`motion_beyond`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from lacet.identify.signals.filters import Array, Filters, two_pass_gain

_BAND = 2.0
"""Half width of a band of the spectrum, and distance of neighbouring bands [Hz]: parts body's and wheels' modes."""
_WINDOW = 1.0
"""Duration over which the intensity of the motion is averaged [s]: that of a body's mode when it dies out."""
_FREEDOM = 1.3 * _BAND
"""Degrees of freedom of a band's mean square, per second: 2 × (∫ b² df)² ÷ ∫ b⁴ df of its weights b = cos²."""
_SIGNIFICANT = 2.0
"""Standard errors by which a band's mean square must exceed the noise's to hold motion at all."""
_LAST = 24.0
"""Frequency above which the pre-filter leaves nothing [Hz]."""
_ENDS = 0.75
"""Duration at both ends that is not used to estimate spectra [s]: the filters' transients."""
_SEGMENT = 2.0
"""Duration of the segments of raw samples whose spectra are averaged [s]."""
_QUIET = 0.8
"""Part of half the sample rate above which a channel holds noise alone (as in `noise_level`)."""
_TURNS = 6
"""Steps of the scoring iteration for the intensity."""
_LEAST = 1e-3
"""Least intensity of the motion, relative to the run's mean."""


@dataclass(frozen=True)
class WienerSmoother:
    """Conditional mean and standard deviation of one channel's value and rate, given the record.

    Attributes
    ----------
    intensity : (N,) local mean square of the motion ÷ that of the run.
    motion, noise : (B,) mean square of the rate of motion and of noise in each band, over the run [1/s²].
    sigma, rate_sigma : (N,) conditional 1 σ of value and rate.
    rate : sample rate [Hz].
    beyond : mean square of the rate of motion faster than the record holds [1/s²].
    rate_rms : root mean square of the rate of motion over the run [1/s].
    """

    intensity: Array
    motion: Array
    noise: Array
    sigma: Array
    rate_sigma: Array
    rate: float
    beyond: float = 0.0
    rate_rms: float = 0.0

    @classmethod
    def of(cls, series: Array, sigma: float, filters: Filters, beyond: float = 0.0) -> WienerSmoother | None:
        """The smoother of a pre-filtered channel. None where there is no pre-filter: exact derivatives are given then.

        Parameters
        ----------
        series : (N,) the channel's rate.
        sigma : 1 σ of white noise of the channel on its grid.
        beyond : mean square of the rate of faster motion, which the pre-filter has stopped.
        """
        ends = round(_ENDS * filters.rate)
        if filters.pre_cutoff is None or series.size <= 4 * ends:
            return None
        turned = _Turned.of(series, filters.rate)
        power = np.stack([turned.part(band) ** 2 for band in range(_count(filters.rate))])
        noise, shares, rate_shares = _noise(sigma, filters)
        mean = power[:, ends:-ends].mean(axis=1)
        seconds = (series.size - 2 * ends) / filters.rate
        there = mean > 1e-12 * np.max(mean) + noise * (1.0 + _SIGNIFICANT * np.sqrt(2.0 / (_FREEDOM * seconds)))
        motion = np.where(there, mean - noise, 0.0)
        # The slowest band is measured far better than it moves: its gain is 1, and a constant passes unchanged.
        motion[0] = np.inf
        found = cls(np.ones(series.size), motion, noise, series, series, filters.rate)
        found = replace(found, intensity=_intensity(power[1:], motion[1:], noise[1:], filters.rate, ends))
        variances = np.stack([np.zeros(series.size), beyond * found.intensity])
        for band in found._open:
            variances += np.stack([shares[band], rate_shares[band]])[:, None] * found.gain(band)
        squares: Array = found.mean(series) ** 2 + variances[1]
        return replace(
            found, sigma=np.sqrt(variances[0]), rate_sigma=np.sqrt(variances[1]), beyond=beyond,
            rate_rms=float(np.sqrt(np.mean(squares[ends:-ends]))),
        )  # fmt: skip

    @property
    def _open(self) -> list[int]:
        """Bands in which there is motion."""
        return [int(band) for band in np.flatnonzero(self.motion)]

    def gain(self, band: int) -> Array:
        """(N,) part of the record that is motion in a band: G = S / (S + N); 1 in the slowest."""
        if np.isinf(self.motion[band]):
            return np.ones(self.intensity.size)
        motion = self.motion[band] * self.intensity
        return motion / (motion + self.noise[band])

    def at(self, part: slice) -> WienerSmoother:
        """The smoother of a part of the record: of successive samples."""
        return replace(self, intensity=self.intensity[part], sigma=self.sigma[part], rate_sigma=self.rate_sigma[part])

    def mean(self, series: Array) -> Array:
        """Conditional mean (…, N) of motion whose record is a series (…, N): of the channel, or of its rate."""
        return self._summed(series, [self.gain(band) for band in self._open])

    def error(self, noise: Array, other: Array) -> Array:
        """Conditional mean less truth (…, N) for a draw of the noise, and another one independent of it.

        The mean errs by G × noise − (1 − G) × motion. Of the motion only the spectrum is known: the other draw of
        the noise has it, when each band is multiplied by √(S / N).
        """
        gains = [self.gain(band) for band in self._open]
        missed = [(1.0 - gain) * np.sqrt(gain / np.maximum(1.0 - gain, 1e-9)) for gain in gains]
        return self._summed(noise, gains) - self._summed(other, missed)

    def faster(self, other: Array) -> Array:
        """A draw (…, N) of the rate of motion that the pre-filter stopped, made of a draw of the rate's noise.

        It has that motion's mean square, which alone is known, and the noise's spectrum; turned round in time it is
        independent of what `error` makes of the same draw.
        """
        size = np.sqrt(np.mean(other**2, axis=-1, keepdims=True))
        drawn = np.divide(other, size, out=np.zeros_like(other), where=size > 0.0)[..., ::-1]
        return np.asarray(np.sqrt(self.beyond * self.intensity) * drawn, float)

    def _summed(self, series: Array, weights: list[Array]) -> Array:
        """Σ over the bands with motion of weight (N,) × the band's part of a series (…, N)."""
        turned = _Turned.of(series, self.rate)
        out = np.zeros(series.shape)
        for band, weight in zip(self._open, weights, strict=True):
            out += weight * turned.part(band)
        return out


def motion_beyond(channels: Sequence[tuple[Array, float]], filters: Filters) -> float:
    """Mean square of the rate of motion that the pre-filter stops, the mean of some channels of the same kind.

    The white noise's density is that above 80 % of half the sample rate, where a car does not move; what remains of the
    spectrum up to twice the cut-off is motion, shrunk by the part that may be chance (James and Stein, 1961).

    Parameters
    ----------
    channels : raw samples (M,) of each, and its sample rate [Hz]; those that cannot show such motion are passed over.
    """
    cutoff = filters.pre_cutoff
    if cutoff is None:
        return 0.0
    found: list[tuple[float, float]] = []
    for samples, rate in channels:
        size = round(_SEGMENT * rate)
        if 0.5 * rate * _QUIET < 2.0 * cutoff or samples.size < 4 * size:
            continue
        frequency, density = np.arange(size // 2 + 1) * rate / size, _density(samples, size, rate)
        quiet = (frequency >= _QUIET * 0.5 * rate) & (frequency < 0.5 * rate)
        part = frequency <= 2.0 * cutoff
        stopped = 1.0 - two_pass_gain(frequency[part], cutoff, rate, filters.order)
        weight = (2.0 * np.pi * frequency[part] * stopped) ** 2 * rate / size
        noise = float(np.mean(density[quiet]))
        # Two degrees of freedom a bin and segment.
        floor = float(np.sum(weight)) * noise / math.sqrt(np.count_nonzero(quiet))
        error = float(np.hypot(np.linalg.norm(weight * density[part]), floor)) / math.sqrt(samples.size / size)
        found.append((float(weight @ (density[part] - noise)), error))
    if not found:
        return 0.0
    mean = sum(square for square, _ in found) / len(found)
    error = math.hypot(*(one for _, one in found)) / len(found)
    return max(0.0, mean - error**2 / mean) if mean > 0.0 else 0.0


def _density(samples: Array, size: int, rate: float) -> Array:
    """(size // 2 + 1,) spectral density of samples (M,), the mean of segments that overlap by half (Welch, 1967)."""
    window = np.hanning(size)
    parts = sliding_window_view(samples, size)[:: size // 2]
    spectra = np.abs(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
    return np.asarray(2.0 * spectra.mean(axis=0) / (rate * np.sum(window**2)), float)


def _intensity(power: Array, motion: Array, noise: Array, rate: float, ends: int) -> Array:
    """(N,) local mean square of the motion ÷ that of the run, from squares (B, N) of the record by band.

    By scoring (each band counts by its information on the intensity); then the logarithm is shrunk by the part of its
    scatter that is chance (empirical Bayes), so that a run of even intensity has 1 all along.
    """
    n = power.shape[1]
    there = motion > 0.0
    intensity = np.ones(n)
    if not np.any(there):
        return intensity
    motion, noise = motion[there, None], noise[there, None]
    window = np.hanning(2 * round(0.5 * _WINDOW * rate) + 3)[1:-1]
    local = scipy.ndimage.convolve1d(power[there], window / np.sum(window), axis=-1, mode="mirror")
    for _ in range(_TURNS):
        weight = motion / (intensity * motion + noise) ** 2
        found = np.sum(weight * (local - noise), axis=0) / np.sum(weight * motion, axis=0)
        intensity = np.maximum(_LEAST, found)
    parts = np.sum((intensity * motion / (intensity * motion + noise)) ** 2, axis=0)
    logarithm, inside = np.log(intensity), slice(ends, -ends)
    # Of the median second: one without motion shows nothing of its intensity but that it is small.
    chance = float(np.median(2.0 / (_FREEDOM * _WINDOW * parts[inside])))
    scatter = float(np.var(logarithm[inside]))
    shrunk = np.exp(max(0.0, 1.0 - chance / scatter) * logarithm) if scatter > 0.0 else np.ones(n)
    return shrunk / float(np.mean(shrunk[inside]))


def _noise(sigma: float, filters: Filters) -> tuple[Array, Array, Array]:
    """Mean square of the noise by band: (B,) of the rate's band parts; and shares of value's and rate's variance."""
    assert filters.pre_cutoff is not None
    size = round(64 * filters.rate)
    frequency = scipy.fft.rfftfreq(size, 1.0 / filters.rate)
    passed = two_pass_gain(frequency, filters.pre_cutoff, filters.rate, filters.order)
    density = sigma**2 * passed**2 * 2.0 / size
    moving = density * (2.0 * np.pi * frequency) ** 2
    bands = [_band(band, size, filters.rate) for band in range(_count(filters.rate))]
    noise = [weight**2 @ moving[part] for part, weight in bands]
    shares = [[weight @ power[part] for part, weight in bands] for power in (density, moving)]
    return np.array(noise), np.array(shares[0]), np.array(shares[1])


def _count(rate: float) -> int:
    """Number of bands at a sample rate [Hz]."""
    return int(min(0.5 * rate, _LAST) / _BAND)


@lru_cache(64)
def _band(band: int, size: int, rate: float) -> tuple[slice, Array]:
    """Frequencies of a band among those of `size` samples, and their weights cos²: all bands' add up to 1."""
    frequency = scipy.fft.rfftfreq(size, 1.0 / rate)
    first, last = np.searchsorted(frequency, [(band - 1) * _BAND, (band + 1) * _BAND])
    part = slice(int(first), int(last))
    return part, np.cos(0.5 * np.pi * (frequency[part] / _BAND - band)) ** 2


@dataclass(frozen=True)
class _Turned:
    """Transform of a series turned about its ends, of which each band's part is made.

    Attributes
    ----------
    spectrum : (…, F) transform of the series continued at both ends by `pad` samples, `size` in all.
    place : place of the series in it.
    """

    spectrum: NDArray[np.complex128]
    size: int
    place: slice
    rate: float

    @classmethod
    def of(cls, series: Array, rate: float) -> _Turned:
        """Of a series (…, N)."""
        n = series.shape[-1]
        # Some periods of the narrowest band, and as many samples as a transform is fast for.
        least = min(n - 1, round(1.5 / _BAND * rate))
        size = min(scipy.fft.next_fast_len(n + 2 * least, real=True), 3 * n - 2)
        pad, behind = least, size - n - least
        before = 2.0 * series[..., :1] - series[..., pad:0:-1]
        after = 2.0 * series[..., -1:] - series[..., -2 : -behind - 2 : -1]
        spectrum = scipy.fft.rfft(np.concatenate([before, series, after], axis=-1), axis=-1)
        return cls(np.asarray(spectrum), size, slice(pad, pad + n), rate)

    def part(self, band: int) -> Array:
        """(…, N) the part of the series in a band."""
        there, weight = _band(band, self.size, self.rate)
        passed = np.zeros_like(self.spectrum)
        passed[..., there] = self.spectrum[..., there] * weight
        return scipy.fft.irfft(passed, self.size, axis=-1)[..., self.place]
