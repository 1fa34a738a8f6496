"""The parallel filter at the instants that decimation keeps, without computing the samples between them.

Forward and backward through a filter H, a series is convolved with two-sided exponentials of the poles p of H:
H(z) H(1/z) = e + Σ c Σₙ p^|n| z⁻ⁿ with c the residue of H at p times H(1/p) (partial fractions; A. V. Oppenheim and
R. W. Schafer, Discrete-Time Signal Processing, 2010, 3.3). So a block of samples acts on the kept instants of other
blocks through one number for each pole and direction, and on its own by one product of matrices. The result is that of
`filters.zero_phase`, up to both ends of a series, but for rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from lacet.identify.signals.filters import VANISHED, Array, Filters, poles

Complex = NDArray[np.complex128]

_IN_BLOCK = 12
"""Kept instants in a block: as many multiplications for a sample's own block as for all others."""


def comb(size: int, filters: Filters) -> NDArray[np.intp]:
    """Indices of the instants that decimation keeps of `size` samples."""
    return np.arange(filters.step // 2, size, filters.step)


def decimated(x: Array, filters: Filters) -> Array:
    """A series (…, N) after the parallel filter, at the n instants of its `comb`, (…, n)."""
    places = comb(x.shape[-1], filters)
    out, moving = np.zeros((*x.shape[:-1], places.size)), np.any(x, axis=-1)
    if places.size and np.any(moving):  # what is zero stays zero
        out[moving] = _through(x[moving], filters, places)
    return out


def _through(series: Array, filters: Filters, places: NDArray[np.intp]) -> Array:
    """(k, n) series (k, N) after the parallel filter, at the instants of its comb."""
    out = _of(filters).through(series, places)
    # The filter leaves the line between a series' ends as it is; without it a series is odd about both, as assumed.
    slope = (series[:, -1:] - series[:, :1]) / max(1, series.shape[1] - 1)
    return out + np.concatenate([series[:, :1], slope], axis=1) @ _taken_from_lines(filters, series.shape[1])


def _of(filters: Filters) -> _Exponentials:
    return _Exponentials.of(filters.fit_cutoff, filters.rate, filters.order, filters.step)


@lru_cache(64)
def _taken_from_lines(filters: Filters, size: int) -> Array:
    """(2, n) what `_Exponentials.through` takes away from a series of ones and from 0, 1 … `size` − 1."""
    lines, places = np.stack([np.ones(size), np.arange(float(size))]), comb(size, filters)
    return lines[:, places] - _of(filters).through(lines, places)


@dataclass(frozen=True)
class _Exponentials:
    """A low-pass as a sum of exponentials, and what a block of samples gives to its kept instants and to other blocks.

    Of a pair of conjugate poles one stands for both, with twice its residue; the real part is taken of every sum.
    The kept instants are the last samples of the L ÷ `step` steps of a block.

    Attributes
    ----------
    step : samples from one kept instant to the next.
    both : (P,) what each pole's exponential is multiplied with.
    powers : (L + 1, P) p^n of each pole, its imaginary part not negative.
    fading : (m, P) p^n of the poles for n a multiple of `step`, until they have vanished.
    weights : (L, G + 4 P) a sample's part in the block's G kept instants; in Σ p^n x over samples past, seen from the
        block's last one, real and imaginary parts; and in the same over samples to come, seen from before its first.
    arriving : (4 P, G) parts of both sums, as they arrive at the block's ends, in its kept instants.
    """

    step: int
    both: Complex
    powers: Complex
    fading: Complex
    weights: Array
    arriving: Array

    @classmethod
    @cache
    def of(cls, cutoff: float, rate: float, order: int, step: int) -> _Exponentials:
        """Of the filter of `filters.zero_phase`."""
        every = poles(cutoff, rate, order)
        kept = every[every.imag >= 0.0]
        pair = np.where(kept.imag > 0.0, 2.0, 1.0)
        # One pass: all zeros at −1, and 1 at rest.
        gain = float(np.prod(1.0 - every).real) / 2.0**order
        below = np.prod(1.0 - every[:, None] / kept, axis=0, where=every[:, None] != kept)
        residues = pair * gain * (1.0 + 1.0 / kept) ** order / below
        both = residues * gain * (1.0 + kept) ** order / np.prod(1.0 - every[:, None] * kept, axis=0)
        direct = gain**2 * float(np.prod(-1.0 / every).real)
        sample = np.arange(_IN_BLOCK * step)[:, None]
        instant = step * np.arange(1, _IN_BLOCK + 1) - 1
        distance = np.abs(sample - instant)
        own = (kept ** distance[..., None] @ both).real + direct * (distance == 0)
        past, coming = kept ** sample[::-1], kept ** (sample + 1)
        from_past, from_coming = ((both * kept ** n[:, None]).T for n in (instant + 1, instant[::-1] + 1 - step))
        fades = math.ceil(math.log(VANISHED) / math.log(np.max(np.abs(kept))) / step) + 1
        return cls(
            step, both, kept ** np.arange(len(sample) + 1)[:, None], kept ** (step * np.arange(fades))[:, None],
            np.concatenate([own, past.real, past.imag, coming.real, coming.imag], axis=1),
            np.concatenate([from_past.real, -from_past.imag, from_coming.real, -from_coming.imag]),
        )  # fmt: skip

    def through(self, x: Array, places: NDArray[np.intp]) -> Array:
        """Series (k, N), each continued by turning it about both ends as if it were zero there, filtered: at `places`
        (n,), `step` samples apart."""
        length, count, size = self.weights.shape[0], self.both.size, x.shape[1]
        last = size - 1
        # Blocks are laid so that a step ends at each kept instant; zeros stand before the series and behind it.
        front = self.step - 1 - int(places[0])
        series = np.zeros((len(x), -(-(front + size) // length) * length))
        series[:, front : front + size] = x
        blocks = series.reshape(len(x), -1, length)
        given = (blocks.reshape(-1, length) @ self.weights).reshape(*blocks.shape[:2], -1)
        sums = given[..., _IN_BLOCK:].reshape(*blocks.shape[:2], 2, 2, count)
        sums = np.asarray(sums[..., 0, :] + 1j * sums[..., 1, :], complex)
        past, coming = self._summed(sums[:, :, 0]), self._summed(sums[:, ::-1, 1])[:, ::-1]
        parts = np.zeros((*blocks.shape[:2], 2, 2, count))
        parts[:, 1:, 0] = _two_parts(past[:, :-1])
        parts[:, :-1, 1] = _two_parts(coming[:, 1:])
        out = (given[..., :_IN_BLOCK] + parts.reshape(*blocks.shape[:2], -1) @ self.arriving).reshape(len(x), -1)
        # Sums over the series as seen from its first sample and from its last, and what lies turned beyond these.
        seen_first = coming[:, 0] / self.powers[front + 1]
        place = (front + last) % length
        own = np.asarray(blocks[:, -1, : place + 1] @ self.powers[place::-1], complex)
        seen_last = own if len(blocks[0]) == 1 else past[:, -2] * self.powers[place + 1] + own
        across = self.powers[1] ** last
        beyond_first = (across * seen_last - seen_first) / (1.0 - across**2) * self.powers[places[0]]
        beyond_last = (across * seen_first - seen_last) / (1.0 - across**2) * self.powers[last - places[-1]]
        fading = (self.both * self.fading[: places.size]).T
        out = out[:, : places.size].copy()
        out[:, : fading.shape[1]] += np.real(beyond_first @ fading)
        out[:, out.shape[1] - fading.shape[1] :] += np.real(beyond_last @ fading)[:, ::-1]
        return out

    def _summed(self, sums: Complex) -> Complex:
        """(k, b, P) sums over all blocks so far of what each gives, decaying by p^L from block to block."""
        decay = self.powers[-1]
        out = sums.copy()
        lags = min(sums.shape[1], 1 + math.ceil(math.log(VANISHED) / math.log(np.max(np.abs(decay)))))
        for lag in range(1, lags):
            out[:, lag:] += decay**lag * sums[:, :-lag]
        return out


def _two_parts(values: Complex) -> Array:
    """(…, 2, P) real and imaginary parts of (…, P)."""
    return np.stack([np.real(values), np.imag(values)], axis=-2)
