"""Whiteness of a residual: its spectrum and autocorrelation compared with those of the simulated noise floor.

The floor is filtered and comes from many sensors, so it is not white itself; a plain test for whiteness would reject
every residual. All statistics are relative to the floor's own spectrum, known from simulated draws.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array

SIGNIFICANCE = 0.01
"""Significance level of one row's test; at 0.05 one of a car's twenty rows would be rejected by chance."""
LEAST_EXCESS = 1.25
"""Power in a band ÷ the floor's below which an excess is not reported, however significant (12 % in amplitude)."""
_BINS = 6
"""Least number of Fourier bins in a band."""
_WIDTH = 2.0**0.5
"""Ratio of a band's upper to its lower edge, where it then has bins enough."""
_LAGS = 20
_RHO2 = (4.0 / 9.0, 1.0 / 36.0)
"""Squared correlation of Hann-tapered Fourier coefficients one and two bins apart."""


class Colour(Enum):
    """Comparison of a residual's spectrum with its noise floor's."""

    LIKE_NOISE = auto()
    LOUDER = auto()
    """The floor's shape at another level."""
    COLOURED = auto()
    """Another shape than the floor's."""
    TOO_SHORT = auto()
    """Too few samples for the test."""


@dataclass(frozen=True)
class Whiteness:
    """Spectrum and autocorrelation of a residual, compared with those of its noise floor.

    Attributes
    ----------
    frequency, spectrum, floor : (B,) band centres [Hz], power densities of residual and floor [unit²/Hz].
    high : (B,) power density that noise alone exceeds in any band with probability `SIGNIFICANCE`.
    lag, acf : (L,) [s], autocorrelation of the residual; `acf_low`, `acf_high` the 95 % band of the simulated floor.
    p : probability that noise alone is as far above the floor in any band.
    ljung_box : p of the whitened residual's autocorrelation (Ljung and Box, 1978): the spectrum's shape, whatever its
        level.
    peak : frequency of the largest excess [Hz], NaN where there is none.
    colour : the verdict.
    """

    frequency: Array
    spectrum: Array
    floor: Array
    high: Array
    lag: Array
    acf: Array
    acf_low: Array
    acf_high: Array
    p: float
    ljung_box: float
    peak: float
    colour: Colour


def whiteness(residual: Array, draws: Array, place: NDArray[np.intp], spacing: float) -> Whiteness | None:
    """The comparison of a residual with draws of its noise floor; None with fewer than 32 samples.

    Parameters
    ----------
    residual : (n,) [N or N·m].
    draws : (D, n) simulated residuals of a model that lacks nothing.
    place : (n,) position of each sample on a grid of `spacing` [s]; positions without a sample are gaps.
    """
    if residual.size < 32:
        return None
    series = _on_comb(np.vstack([residual, draws]), place)
    usable = _on_comb(np.ones((1, residual.size)), place)[0] > 0
    frequency, power = _periodograms(series, usable, spacing)
    bands = _bands(frequency, float(np.ptp(place) + 1) * spacing)
    means = np.stack([power[:, part].mean(axis=1) for part in bands], axis=1)
    bins = np.array([part.size for part in bands])
    own, floors = means[0], means[1:].mean(axis=0)
    alive = floors > 1e-6 * float(floors.max())
    bands = [part for part, keep in zip(bands, alive, strict=True) if keep]
    means, bins, own, floors = means[:, alive], bins[alive], own[alive], floors[alive]
    freedom = _freedom(bins, means[1:])
    count = len(draws)
    each = np.asarray(scipy.special.fdtrc(freedom, freedom * count, np.asarray(own / floors, float)), float)
    p = float(-np.expm1(len(bands) * np.log1p(-min(float(each.min()), 1 - 1e-12))))
    limit = -np.expm1(np.log1p(-SIGNIFICANCE) / len(bands))
    high = (
        np.maximum(LEAST_EXCESS, np.asarray(scipy.special.fdtri(freedom, freedom * count, 1.0 - limit), float)) * floors
    )
    shape = _ljung_box(series, usable, power)
    peak, colour = float("nan"), Colour.LIKE_NOISE
    above = own > high
    if above.any():
        raised = own > LEAST_EXCESS * floors
        louder = shape > SIGNIFICANCE and 2 * np.count_nonzero(raised) > raised.size
        colour = Colour.LOUDER if louder else Colour.COLOURED
        worst = int(np.argmax(np.where(above, (own - floors) * bins, -np.inf)))
        inside = bands[worst]
        peak = float(frequency[inside] @ power[0, inside] / power[0, inside].sum())
    lags = int(min(_LAGS * 2, residual.size // 4))
    acf = _acf(series, usable, lags)
    spread = TWO_SIDED_95 * acf[1:].std(axis=0, ddof=1 if count > 1 else 0)
    centre = acf[1:].mean(axis=0)
    return Whiteness(
        frequency=np.array([float(frequency[part].mean()) for part in bands]),
        spectrum=own, floor=floors, high=np.asarray(high, float),
        lag=np.asarray(spacing * np.arange(lags + 1), float), acf=acf[0],
        acf_low=centre - spread, acf_high=centre + spread,
        p=p, ljung_box=shape, peak=peak, colour=colour,
    )  # fmt: skip


def _on_comb(series: Array, place: NDArray[np.intp]) -> Array:
    """(k, n) samples on their regular grid, without their mean, zero in the gaps."""
    start = int(place.min())
    out = np.zeros((series.shape[0], int(place.max()) - start + 1))
    constant = bool(np.all(series == series[:, :1]))
    out[:, place - start] = series if constant else series - series.mean(axis=1, keepdims=True)
    return out


def _periodograms(series: Array, usable: NDArray[np.bool_], spacing: float) -> tuple[Array, Array]:
    """Frequencies [Hz] and one-sided power densities (k, F), Hann-tapered, without the mean."""
    n = series.shape[1]
    middle: Array = (np.arange(n, dtype=float) + 0.5) / n
    taper: Array = np.sin(np.pi * middle) ** 2
    spectrum = np.asarray(scipy.fft.rfft(np.asarray(series * taper, float), axis=1), np.complex128)
    power = 2.0 * spacing * np.abs(spectrum) ** 2 / float(np.sum(taper[usable] ** 2))
    return np.asarray(np.fft.rfftfreq(n, spacing), float)[1:], power[:, 1:]


def _bands(frequency: Array, length: float) -> list[NDArray[np.intp]]:
    """Fourier bins of each band: at least `_BINS` of them, more at higher frequencies."""
    least = max(_BINS, round(_BINS * frequency.size / max(1.0, length * float(frequency[-1]))))
    out: list[NDArray[np.intp]] = []
    start = 0
    while start < frequency.size:
        stop = max(start + least, int(np.searchsorted(frequency, _WIDTH * frequency[start])))
        if frequency.size - stop < least:
            stop = frequency.size
        out.append(np.arange(start, stop))
        start = stop
    return out


def _freedom(bins: NDArray[np.int64], draws: Array) -> Array:
    """Effective degrees of freedom of a band's mean power.

    Fewer than two a bin: a taper correlates neighbouring bins, and a floor whose level varies with the motion scatters
    more than stationary noise does; by how much is estimated from the draws.
    """
    tied: Array = np.array(
        [1.0 + 2.0 * sum(max(0.0, 1.0 - (k + 1) / m) * r for k, r in enumerate(_RHO2)) for m in bins]
    )
    freedom: Array = np.asarray(np.divide(2.0 * bins, tied), float)
    if len(draws) >= 10:
        seen: Array = np.asarray(draws.var(axis=0, ddof=1) / draws.mean(axis=0) ** 2, float)
        freedom = freedom / max(1.0, float(np.mean(0.5 * seen * freedom)))
    return freedom


def _ljung_box(series: Array, usable: NDArray[np.bool_], power: Array) -> float:
    """p of the first series' autocorrelation after whitening by the floor's spectrum; the others are the floor's draws.

    Mean and spread of the statistic are those of the draws, each whitened by the others: a floor whose level varies
    with the motion is not white after any filter.
    """
    count = len(series) - 1
    total = power[1:].sum(axis=0)
    others = np.vstack([total / count, (total - power[1:]) / (count - 1)]) if count > 1 else np.vstack([total] * 2)
    kernel = np.asarray(np.hanning(9)[1:-1], float)
    # Smoothed over seven bins, so that the draws' own scatter does not enter the whitened series.
    padded = np.pad(others, ((0, 0), (3, 3)), mode="edge")
    smooth = np.asarray(np.lib.stride_tricks.sliding_window_view(padded, kernel.size, axis=1) @ kernel, float)
    spectrum = scipy.fft.rfft(series, axis=1)
    spectrum[:, 1:] /= np.sqrt(np.maximum(smooth, 1e-6 * smooth.max(axis=1, keepdims=True)))
    spectrum[:, 0] = 0.0
    white = np.where(usable, scipy.fft.irfft(spectrum, series.shape[1], axis=1), 0.0)
    n = int(np.count_nonzero(usable))
    lags = min(_LAGS, n // 5)
    q = n * (n + 2.0) * np.sum(_acf(white, usable, lags)[:, 1:] ** 2 / (n - np.arange(1, lags + 1)), axis=1)
    if count < 10:
        return float(np.asarray(scipy.special.chdtrc(lags, q[0]), float))
    usual, spread = float(q[1:].mean()), float(q[1:].var(ddof=1))
    freedom = min(float(lags), 2.0 * usual**2 / spread) if spread > 0 else float(lags)
    return float(np.asarray(scipy.special.chdtrc(freedom, q[0] * freedom / usual), float))


def _acf(series: Array, usable: NDArray[np.bool_], lags: int) -> Array:
    """(k, lags + 1) autocorrelation; pairs with a gap do not count."""
    # Padded by zeros, so that what is correlated does not meet its own other end.
    size = scipy.fft.next_fast_len(series.shape[1] + lags, real=True)
    spectrum = scipy.fft.rfft(series, size, axis=1)
    sums = np.asarray(scipy.fft.irfft(np.abs(spectrum) ** 2, size, axis=1), float)[:, : lags + 1]
    pairs = np.asarray(scipy.fft.irfft(np.abs(scipy.fft.rfft(usable.astype(float), size)) ** 2, size), float)[
        : lags + 1
    ]
    covariance = sums * (pairs[0] / np.maximum(pairs, 1.0))
    return covariance / np.where(covariance[:, :1] > 0, covariance[:, :1], 1.0)
