"""The parallel filter at the instants that decimation keeps, without computing the samples between them.

Forward and backward through a filter H, a series is convolved with two-sided exponentials of the poles p of H:
H(z) H(1/z) = e + Σ c Σₙ p^|n| z⁻ⁿ with c the residue of H at p times H(1/p) (partial fractions; A. V. Oppenheim and
R. W. Schafer, Discrete-Time Signal Processing, 2010, 3.3). So a block of samples acts on the kept instants of other
blocks through one number for each pole and direction, and on its own by one product of matrices. The result is that of
`filters.zero_phase`, its padding and its states at rest included, but for rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.signals.filters import Array, Filters, padding, two_pass_zeros

Complex = NDArray[np.complex128]

_IN_BLOCK = 12
"""Kept instants in a block: as many multiplications for a sample's own block as for all others."""

_VANISHED = 1e-18
"""Size below which a power of a pole adds nothing to a sum that begins with 1."""


def comb(size: int, filters: Filters) -> NDArray[np.intp]:
    """Indices of the instants that decimation keeps of `size` samples."""
    return np.arange(filters.step // 2, size, filters.step)


def decimated(x: Array, filters: Filters) -> Array:
    """A series (…, N) after the parallel filter, at the n instants of its `comb`, (…, n)."""
    places = comb(x.shape[-1], filters)
    if not places.size or not x.size:
        return np.zeros((*x.shape[:-1], places.size))
    low_pass = filters.fit_cutoff, filters.rate, filters.order
    exponentials = _Exponentials.of(*low_pass, filters.step)
    found = exponentials.through(x.reshape(-1, x.shape[-1]), padding(x.shape[-1], *low_pass), int(places[0]))
    return found[:, : places.size].reshape(*x.shape[:-1], places.size)


@dataclass(frozen=True)
class _Exponentials:
    """A low-pass as a sum of exponentials, and what a block of samples gives to its kept instants and to other blocks.

    Of a pair of conjugate poles one stands for both, with twice its residue; the real part is taken of every sum.
    The kept instants are the last samples of the L ÷ `step` steps of a block.

    Attributes
    ----------
    step : samples from one kept instant to the next.
    powers : (n, P) p^n of each pole, its imaginary part not negative, until they have vanished.
    residues : (P,) of one pass; `direct` what one pass gives of the present sample beside them.
    weights : (L, G + 4 P) a sample's part in the block's G kept instants; in Σ p^n x over samples past, seen from the
        block's last one, real and imaginary parts; and in the same over samples to come, seen from before its first.
    arriving : (4 P, G) parts of both sums, as they arrive at the block's ends, in its kept instants.
    """

    step: int
    powers: Complex
    residues: Complex
    direct: float
    weights: Array
    arriving: Array

    @classmethod
    @cache
    def of(cls, cutoff: float, rate: float, order: int, step: int) -> _Exponentials:
        """Of the filter `two_pass_sos`."""
        zeros, every, gain = two_pass_zeros(cutoff, rate, order)
        kept = every[every.imag >= 0.0]
        pair = np.where(kept.imag > 0.0, 2.0, 1.0)
        above = np.prod(1.0 - zeros[:, None] / kept, axis=0)
        below = np.prod(1.0 - every[:, None] / kept, axis=0, where=every[:, None] != kept)
        residues = pair * gain * above / below
        mirrored = gain * np.prod(1.0 - zeros[:, None] * kept, axis=0) / np.prod(1.0 - every[:, None] * kept, axis=0)
        direct = gain * float(np.prod(zeros / every).real)
        both = residues * mirrored
        sample = np.arange(_IN_BLOCK * step)[:, None]
        instant = step * np.arange(1, _IN_BLOCK + 1) - 1
        distance = np.abs(sample - instant)
        own = (kept ** distance[..., None] @ both).real + gain * direct * (distance == 0)
        past, coming = kept ** sample[::-1], kept ** (sample + 1)
        from_past, from_coming = ((both * kept ** n[:, None]).T for n in (instant + 1, instant[::-1] + 1 - step))
        last = max(len(sample), math.ceil(math.log(_VANISHED) / math.log(np.max(np.abs(kept)))))
        return cls(
            step, kept ** np.arange(last + 1)[:, None], residues, direct,
            np.concatenate([own, past.real, past.imag, coming.real, coming.imag], axis=1),
            np.concatenate([from_past.real, -from_past.imag, from_coming.real, -from_coming.imag]),
        )  # fmt: skip

    def through(self, x: Array, pad: int, first: int) -> Array:
        """Series (k, N) continued by `pad` samples and filtered, (k, n) at every `step`-th sample from `first`."""
        length, count = self.weights.shape[0], self.powers.shape[1]
        size = x.shape[1] + 2 * pad
        # Blocks are laid so that a step ends at each kept instant; zeros stand before the series and behind it.
        lead = (pad + first) // self.step
        front = self.step - 1 - (pad + first) % self.step
        level = 2.0 * x[:, :1] - x[:, pad : pad + 1]
        series = np.zeros((len(x), -(-(front + size) // length) * length))
        series[:, front : front + pad] = 2.0 * x[:, :1] - x[:, pad:0:-1]
        series[:, front + pad : front + size - pad] = x
        series[:, front + size - pad : front + size] = 2.0 * x[:, -1:] - x[:, -2 : -pad - 2 : -1]
        series[:, front : front + size] -= level
        blocks = series.reshape(len(x), -1, length)
        given = (blocks.reshape(-1, length) @ self.weights).reshape(*blocks.shape[:2], -1)
        sums = given[..., _IN_BLOCK:].reshape(*blocks.shape[:2], 2, 2, count)
        sums = sums[..., 0, :] + 1j * sums[..., 1, :]
        entering = np.zeros_like(sums)
        entering[:, 1:, 0] = self._summed(sums[:, :-1, 0])
        entering[:, :-1, 1] = self._summed(sums[:, :0:-1, 1])[:, ::-1]
        parts = np.stack([entering.real, entering.imag], axis=3).reshape(*blocks.shape[:2], -1)
        out = (given[..., :_IN_BLOCK] + parts @ self.arriving).reshape(len(x), -1)
        end = front + size - 1
        block, place = divmod(end, length)
        state = entering[:, block, 0] * self.powers[place + 1] + blocks[:, block, : place + 1] @ self.powers[place::-1]
        kept = np.arange(lead, (front + size) // self.step, dtype=np.intp)
        ahead = end - (self.step - 1) - self.step * kept
        out = out[:, lead : lead + ahead.size] + self._behind(state, series[:, end], ahead)
        return out + level

    def _summed(self, entering: Complex) -> Complex:
        """(k, b, P) sums over all blocks so far of what each gives, decaying by p^L from block to block."""
        kept = self.powers[len(self.weights)]
        parts = [scipy.signal.lfilter([1.0], [1.0, -q], entering[..., i], axis=1) for i, q in enumerate(kept)]
        return np.stack(parts, axis=-1)

    def _behind(self, state: Complex, last: Array, ahead: NDArray[np.intp]) -> Array:
        """(k, m) what the second pass adds because it begins at rest, `ahead` (m,) samples before the last one.

        `state` (k, P) sums of the first pass at the last sample `last` (k,). It begins as if the first pass had stayed
        at its last value, not as the first pass would have gone on: falling back to zero.
        """
        p, q = self.powers[1][:, None], self.powers[1]
        going_on = self.residues * state
        value = self.direct * last + np.sum(going_on.real, axis=1)
        falling = going_on @ (p * q / (1.0 - p * q)) + going_on.conj() @ (p.conj() * q / (1.0 - p.conj() * q))
        missing = value[:, None] * (q / (1.0 - q)) - 0.5 * falling
        return ((self.residues * missing) @ self.powers[np.minimum(ahead, len(self.powers) - 1)].T).real
