"""Random draws of the channels' noise, with the sensor sheet's σ and the spectrum that the pre-filter passes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
import scipy

from lacet.daq.channels import CHANNELS
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import two_pass_gain
from lacet.identify.signals.reconstruct import Recording

_STOPPED = 1e-3
"""Gain of the pre-filter below which a frequency is not drawn: the parallel filter lets 1e-5 of that pass at most."""


def draw_noise(recording: Recording, channels: Iterable[str], rng: np.random.Generator) -> dict[str, Array]:
    """One random draw of the sensor noise on a recording's grid: channel → (k, N) [SI]."""
    return {name: series[:, 0] for name, series in draw_noises(recording, channels, rng, 1).items()}


def draw_noises(
    recording: Recording, channels: Iterable[str], rng: np.random.Generator, draws: int
) -> dict[str, Array]:
    """Random draws of the sensor noise on a recording's grid, channel → (k, draws, N) [SI]: as many of `draw_noise`.

    White noise of the sheet's σ at each channel's own rate has the same spectrum below the pre-filter's cut-off as
    white noise on the grid with σ scaled by the root of the rates.
    """
    # Longer than needed and cut: a transform is several times faster where its length has small prime factors.
    filters, n = recording.filters, scipy.fft.next_fast_len(recording.t.size, real=True)
    names = list(channels)
    if not names:
        return {}
    widths = [CHANNELS[channel].width for channel in names]
    scales = [recording.rig.noise(c) * np.sqrt(filters.rate / recording.rates[c]) for c in names]
    gain = _passed(filters.pre_cutoff, filters.rate, filters.order, n)
    # Drawn in frequency, where the filter is a product and all that it stops need not be drawn at all.
    drawn = rng.standard_normal((draws, 2, sum(widths), gain.size)).swapaxes(0, 2)
    spectrum = np.empty((sum(widths), draws, gain.size), complex)
    spectrum.real, spectrum.imag = drawn[:, 0], drawn[:, 1]
    spectrum *= np.repeat(scales, widths)[:, None, None] * (np.sqrt(n / 2.0) * gain)
    whole = np.asarray(scipy.fft.irfft(spectrum, n, axis=-1), float)
    series = np.ascontiguousarray(whole[..., : recording.t.size])
    parts = np.split(series, np.cumsum(widths)[:-1])
    return dict(zip(names, parts, strict=True))


@lru_cache(maxsize=16)
def _passed(cutoff: float | None, rate: float, order: int, n: int) -> Array:
    """Gain of the pre-filter at the frequencies of `n` samples, up to the last that it lets pass."""
    frequency = np.asarray(np.fft.rfftfreq(n, 1.0 / rate), float)
    if cutoff is None:
        return np.ones(frequency.size)
    gain = two_pass_gain(frequency, cutoff, rate, order)
    return gain[: int(np.flatnonzero(gain > _STOPPED)[-1]) + 1]
