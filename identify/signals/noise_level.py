"""Noise level of each channel, measured in the runs themselves, and a test whether the noise is white.

Instruments sample many times faster than the car moves: the upper part of a channel's spectrum holds noise alone. White
noise has the same density at all frequencies, so that this part gives σ; comparison with a lower part tests whiteness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lacet.daq.angles import ContinuousAngle
from lacet.daq.channels import CHANNELS
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.own_rate import sample_rate

MOTION = 20.0
"""Frequency above which a car's motion is neglected beside the noise [Hz]: the pre-filter's cut-off."""

_SEGMENT = 128
_UPPER, _LOWER = (0.80, 1.00), (0.55, 0.75)
"""Bands of the spectrum as parts of half the sample rate: for σ, and for comparison with it."""

_ALIKE = 2.24
"""Variance inflation of a band's mean, because the window correlates neighbouring bins.

Σ |c_k|² of the coefficients of its square, over those of twelve bins."""

_FLAT = 1.25
"""Largest ratio of σ in the two bands, either way, that counts as white noise."""

_NEAR = 0.10
"""Relative difference up to which a measured σ counts as that of the sheet."""


_CLEAR = 0.25
"""Relative difference beyond which a measured σ takes the place of the sheet's: a floor off by less changes no verdict,
and of ten families in a run none differs by chance (they differ by two half-intervals as well)."""

_LEAST = 0.25
"""Least part of the sheet's noise that is believed: below it, errors that no sheet lists (clocks, geometry) count more.
"""


class NoiseVerdict(Enum):
    """Comparison of measured noise with the sensor sheet's; the values are those of the check's result."""

    AS_THE_SHEET = "as the sheet"
    LARGER = "larger"
    SMALLER = "smaller"
    NOT_WHITE = "not white"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class NoiseLevel:
    """Noise of one family of channels of one sensor, over all runs.

    Attributes
    ----------
    sensor, family : names in the rig and in the vocabulary of channels.
    sigma : measured 1 σ at the channels' own rate, root mean square over them, SI; None where it cannot be measured.
    half : half of its 95 % interval.
    sheet : the rig's σ.
    columns : measured σ by column (``wheel.fl.force.x``).
    flatness : σ of the upper band ÷ σ of the lower one, in the run where the lower one is quietest: 1 for white noise;
        None where the lower one holds motion.
    slow : sample rate, where it is too low to separate noise from motion [Hz]; None where it is not.
    """

    sensor: str
    family: str
    sigma: float | None
    half: float
    sheet: float
    columns: dict[str, float]
    flatness: float | None
    slow: float | None = None

    @property
    def white(self) -> bool:
        """Whether the noise is white, so that neighbouring samples are independent."""
        return self.flatness is None or 1.0 / _FLAT < self.flatness < _FLAT

    @property
    def verdict(self) -> NoiseVerdict:
        """The measured noise compared with the sheet's."""
        if self.sigma is None:
            return NoiseVerdict.UNKNOWN
        if not self.white:
            return NoiseVerdict.NOT_WHITE
        off = self.sigma - self.sheet
        if abs(off) <= max(_NEAR * self.sheet, 1.5 * self.half):
            return NoiseVerdict.AS_THE_SHEET
        return NoiseVerdict.LARGER if off > 0 else NoiseVerdict.SMALLER

    @property
    def corrects(self) -> bool:
        """Whether it takes the place of the sheet's noise: white in two bands of the spectrum, clearly different."""
        if self.sigma is None or self.flatness is None or not self.white:
            return False
        return abs(self.sigma - self.sheet) > max(_CLEAR * self.sheet, 2.0 * self.half)

    @property
    def used(self) -> float:
        """1 σ that the equations use: the measured one where it `corrects` the sheet's, else the sheet's."""
        return max(self.sigma, _LEAST * self.sheet) if self.corrects and self.sigma is not None else self.sheet

    @property
    def odd_ones(self) -> dict[str, float]:
        """Columns whose σ is above twice their family's median, or below half of it."""
        middle = float(np.median(list(self.columns.values()))) if self.columns else 0.0
        return {name: s for name, s in self.columns.items() if not 0.5 * middle <= s <= 2.0 * middle}


def measured_noise(runs: Sequence[Run], rig: Rig) -> list[NoiseLevel]:
    """Noise levels of every channel family of every sensor in runs, in the rig's order."""
    out: list[NoiseLevel] = []
    for sensor in rig.sensors:
        families = dict.fromkeys(CHANNELS[channel].family for channel in sensor.channels)
        for family in families:
            channels = [c for c in sensor.channels if CHANNELS[c].family == family]
            signals = {c: [run.signals[c] for run in runs if c in run.signals] for c in channels}
            if any(signals.values()):
                out.append(_level(sensor.name, family, rig.noise(channels[0]), signals))
    return out


def quietest(runs: Sequence[Sequence[NoiseLevel]]) -> tuple[NoiseLevel, ...]:
    """Noise of each family in the run where it is smallest.

    An instrument's noise is the same in all runs; what a rough road adds to it is not.
    """
    least: dict[tuple[str, str], NoiseLevel] = {}
    for level in (level for levels in runs for level in levels if level.sigma is not None):
        here = least.setdefault((level.sensor, level.family), level)
        if here.sigma is not None and level.sigma is not None and level.sigma < here.sigma:
            least[level.sensor, level.family] = level
    return tuple(least.values())


def as_measured(rig: Rig, levels: Sequence[NoiseLevel]) -> Rig:
    """The rig with the noise that was measured where it differs from the sheet's; tolerances stay as they are."""
    used = {(level.sensor, level.family): level.used for level in levels if level.corrects}
    if not used:
        return rig
    sensors = tuple(
        replace(
            sensor, noise={**sensor.noise, **{family: s for (name, family), s in used.items() if name == sensor.name}}
        )
        for sensor in rig.sensors
    )
    return replace(rig, sensors=sensors)


def _level(sensor: str, family: str, sheet: float, signals: dict[str, list[Signal]]) -> NoiseLevel:
    columns: dict[str, float] = {}
    errors: list[float] = []
    ratios: list[float] = []
    slow: float | None = None
    for channel, parts in signals.items():
        usable = [s for s in parts if np.count_nonzero(s.usable) >= 2 * _SEGMENT]
        if not usable:
            continue
        rate = float(np.median([sample_rate(s) for s in usable]))
        if _UPPER[0] * 0.5 * rate < MOTION:
            slow = rate
            continue
        upper, lower = ([_band(channel, s, band) for s in usable] for band in (_UPPER, _LOWER))
        for k, name in enumerate(CHANNELS[channel].columns):
            variance, error = _middle(np.concatenate(upper)[:, k])
            columns[name] = float(np.sqrt(variance))
            errors.append(error)
            beside = [_middle(part[:, k])[0] for part in lower]
            quiet = int(np.argmin(beside))  # a rough road enters the lower band of a ground laser
            if _LOWER[0] * 0.5 * rate >= MOTION and beside[quiet] > 0.0:
                ratios.append(float(np.sqrt(_middle(upper[quiet][:, k])[0] / beside[quiet])))
    if not columns:
        return NoiseLevel(sensor, family, None, 0.0, sheet, {}, None, slow)
    variances = np.square(list(columns.values()))
    sigma = float(np.sqrt(np.mean(variances)))
    # Columns are independent: standard error of their mean variance, converted to one of σ.
    error = float(np.sqrt(np.sum(np.square(errors)))) / len(errors)
    half = TWO_SIDED_95 * 0.5 * error / sigma if sigma > 0.0 else 0.0
    flatness = float(np.median(ratios)) if ratios else None
    return NoiseLevel(sensor, family, sigma, half, sheet, columns, flatness)


def _band(channel: str, signal: Signal, band: tuple[float, float]) -> Array:
    """Variance of white noise with the band's density, (segments, k), for stretches of `_SEGMENT` samples.

    Angles may come cut off at full turns, as a log holds them.
    """
    values = signal.values[signal.usable]
    if CHANNELS[channel].unit == "rad":
        values = ContinuousAngle().add(values)
    return _band_variance(values, band)


def white_noise(values: Array) -> Array:
    """(k,) σ of white noise with the density that series (N, k) have at the upper end of their spectra."""
    if len(values) < 2 * _SEGMENT:
        return np.zeros(len(values.T))
    variances: Array = _band_variance(values, _UPPER)
    out = np.zeros(len(values.T))
    for k in range(len(out)):
        out[k] = _middle(variances[:, k])[0] ** 0.5
    return out


def white_noise_spread(count: int) -> float:
    """1 σ of `white_noise` of a series of so many samples, ÷ itself; 0 where it is not measured."""
    segments = count // _SEGMENT
    return 0.5 * _middle(np.ones(segments))[1] / _middle(np.ones(segments))[0] if segments > 1 else 0.0


def _band_variance(values: Array, band: tuple[float, float]) -> Array:
    """Variance of white noise with the band's density, (segments, k), for stretches of `_SEGMENT` samples."""
    parts = sliding_window_view(values, _SEGMENT, axis=0)[::_SEGMENT]
    # The window keeps slow motion out of the upper part; ramps (wheel angles) are removed first.
    x = np.linspace(-1.0, 1.0, _SEGMENT)
    basis = np.linalg.qr(np.stack([np.ones(_SEGMENT), x, x**2], axis=1))[0]
    level = parts - (parts @ basis) @ basis.T
    window = np.blackman(_SEGMENT)
    spectrum = np.abs(np.fft.rfft(level * window, axis=-1)) ** 2 / np.sum(window**2)
    place = np.linspace(0.0, 1.0, spectrum.shape[-1])
    inside = (place >= band[0]) & (place < band[1])
    return np.asarray(spectrum[..., inside].mean(axis=-1), float)


def _middle(variances: Array) -> tuple[float, float]:
    """Median over the segments, robust to kerbs, scaled to the mean of a χ² variable; and its 1 σ."""
    bins = (_UPPER[1] - _UPPER[0]) * 0.5 * _SEGMENT
    freedom = 2.0 * bins / _ALIKE
    middle = float(np.median(variances)) / (1.0 - 2.0 / (9.0 * freedom)) ** 3
    return middle, 1.25 * middle * float(np.sqrt(2.0 / freedom / len(variances)))
