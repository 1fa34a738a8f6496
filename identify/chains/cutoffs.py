"""Cut-off of a fit where none is given: by the motion, the positions' noise, and the number of values sought."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.identify.chains.weights import ENOUGH
from lacet.identify.multibody.vectors import Array
from lacet.identify.signals.filters import derivative, two_pass_gain, zero_phase

PRE = 5.0
"""Cut-off of the pre-filter ÷ that of the fit, as in published identifications of robots (Gautier: 5 to 10)."""
EDGE = 4.5
"""Length left out at both ends × cut-off of the fit: the filters' transients, as in `Filters`."""
ORDER = 6
"""Order of the filters, one pass."""
_EQUATIONS = 2.2
"""Equations of a joint in a second ÷ cut-off of the fit: the decimation of `Filters`."""
_HELD = 0.999
"""Part of the squares of the joint rates that lies below the cut-off [share]; so much less than the rest may the
accelerations' noise be, for a cut-off above the motion's."""
_HIGHEST = 100.0
"""Frequency up to which motion is looked for [Hz], or a tenth of the sample rate."""
_SHORTEST = 4.0 * EDGE
"""Cut-off × length of a record, at least: the filters' transients then take half of it."""


def enough_seconds(values: int, cutoff: float) -> float:
    """Length of a record [s] in which every joint has `ENOUGH` equations beyond so many values, up to `cutoff` [Hz]."""
    return (2.0 * EDGE + (values + ENOUGH) / _EQUATIONS) / cutoff


@dataclass(frozen=True)
class FewEquations:
    """A record with few equations beside the values sought.

    `seconds` : its length; `equations` up to the `cutoff` [Hz]; `values` : sought of them.
    """

    seconds: float
    equations: int
    cutoff: float
    values: int

    def __str__(self) -> str:
        """What it is, and what a reader can do."""
        needed = enough_seconds(self.values, self.cutoff)
        return (
            f"a record of {self.seconds:.3g} s has {self.equations} equations up to {self.cutoff:.3g} Hz for "
            f"{self.values} values: record {needed:.0f} s or more, or fit to a higher cut-off (cutoff=…)"
        )


def default_cutoff(q: Array, rate: float, values: int, sigma: Array) -> float:
    """Cut-off [Hz] of a fit of so many values to positions (N, f) sampled at `rate` [Hz], with white noise σ (f,).

    It is that of the motion, and in a short record higher, until every joint has `ENOUGH` equations beyond the values;
    but above the motion's only as far as the accelerations' noise, after the pre-filter, is without weight at every
    joint.
    """
    seconds = len(q) / rate
    motion, acceleration = _motion(q, rate, sigma)
    enough = (2.0 * EDGE + (values + ENOUGH) / _EQUATIONS) / seconds
    lowest = max(motion, _SHORTEST / seconds)
    return min(max(lowest, min(enough, _quiet(rate, sigma, acceleration))), 0.4 * rate / PRE)


def _motion(q: Array, rate: float, sigma: Array) -> tuple[float, Array]:
    """Frequency [Hz] below which nearly all of the motion's rates lie, and (f,) its mean squared accelerations.

    Motion is what the periodogram P of the rates has beside the expected one N of the noise. It is added up to the
    frequency where least is lost: beyond it P − N is lost, below it N is let in, so that the sum of P − 2 N is largest
    (an unbiased estimate of the risk: Mallows 1973, Stein 1981).
    """
    highest = min(0.1 * rate, _HIGHEST)
    rates = derivative(zero_phase(np.ascontiguousarray(q.T), highest, rate, ORDER), rate)
    window = np.hanning(len(q)).astype(float)
    power = np.asarray(np.abs(np.fft.rfft(rates * window, axis=1)) ** 2, float)
    f = np.asarray(np.fft.rfftfreq(len(q), 1.0 / rate), float)
    squares = float(np.sum(window**2))
    gain = 2.0 * np.pi * f * two_pass_gain(f, highest, rate, ORDER)
    noise = squares * (sigma**2)[:, None] * gain**2
    risk: Array = np.cumsum(np.sum(power - 2.0 * noise, axis=0), dtype=float)
    top = int(np.argmax(risk)) + 1
    moved = (power - noise)[:, :top]
    share: Array = np.cumsum(np.sum(moved, axis=0), dtype=float)
    place = int(np.argmax(share >= _HELD * share[-1]))
    acceleration = 2.0 * np.sum(moved * (2.0 * np.pi * f[:top]) ** 2, axis=1) / (len(q) * squares)
    return float(f[place]), np.maximum(0.0, acceleration)


def _quiet(rate: float, sigma: Array, acceleration: Array) -> float:
    """Highest cut-off [Hz] at which the noise of every joint's acceleration is without weight beside its motion.

    White noise σ has the one-sided density 2 σ² ÷ rate, and (2πf)⁴ of it in the acceleration, up to the pre-filter's
    cut-off: (2π)⁴ 2 σ² f⁵ ÷ (5 rate) in all.
    """
    allowed = (1.0 - _HELD) * acceleration
    per = (2.0 * np.pi) ** 4 * 2.0 * sigma**2 / (5.0 * rate)
    noisy = per > 0.0
    return float(np.min((allowed[noisy] / per[noisy]) ** 0.2, initial=np.inf)) / PRE
