"""Road profiles: height of each wheel track along x, for tyres and ground lasers alike.

The surface is given per track (left, right) and does not vary across a track: z = z_side(x). It is the *enveloped*
profile, the moving average over the length of the contact patch, for tyres and lasers alike, so that a model which
takes the ground lasers' road as that under the tyres makes no error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import UsageError, nearest

ROUGHNESS = {"A": 16e-6, "B": 64e-6, "C": 256e-6}
"""ISO 8608 Gd(n0) [m³] of the classes at n0 = 0.1 cycles/m, geometric means."""

SPACING = 0.01
"""Distance between profile points [m]."""


@dataclass(frozen=True)
class Road:
    """Two enveloped tracks on a common grid: `start` x of the first point [m], `left`, `right` (n,) heights [m].

    Outside the grid the road is flat at height 0 (the profiles are tapered to 0 at both ends).
    """

    name: str
    start: float
    left: NDArray[np.float64]
    right: NDArray[np.float64]

    @property
    def flat(self) -> bool:
        """Whether both tracks have height 0."""
        return len(self.left) == 0

    def height(self, x: NDArray[np.float64], side: str) -> NDArray[np.float64]:
        """Height [m] of the ``l`` or ``r`` track at `x` [m], linear between points."""
        if self.flat:
            return np.zeros_like(x)
        z = self.left if side == "l" else self.right
        grid = self.start + SPACING * np.arange(len(z))
        return np.interp(x, grid, z, left=0.0, right=0.0)


FLAT = Road("flat", 0.0, np.zeros(0), np.zeros(0))


def envelope(z: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Moving average over the contact `length` [m], zero phase."""
    n = max(1, 2 * round(length / SPACING / 2) + 1)
    return np.convolve(z, np.full(n, 1.0 / n), mode="same")


def _taper(n: int, ends: float) -> NDArray[np.float64]:
    m = min(n // 2, max(1, int(ends / SPACING)))
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(m) / m)
    out = np.ones(n)
    out[:m], out[n - m :] = ramp, ramp[::-1]
    return out


def rough_road(
    grade: str,
    start: float,
    length: float,
    seed: int,
    track: float,
    contact_length: float,
    band: tuple[float, float] = (0.02, 8.0),
    decay: float = 3.0,
) -> Road:
    """A random road of ISO 8608 class `grade` (A, B or C).

    Displacement spectrum Gd(n) = Gd(n0)·(n/n0)⁻², n0 = 0.1 cycles/m, between the wave numbers `band` [cycles/m].
    The tracks have the same spectrum and the coherence γ(n) = exp(-decay·track·n) (exponential in track × wave number,
    as Bogsjö 2008 models measured roads): right = γ·left + √(1 - γ²)·independent. Both axles run on the same tracks,
    the rear one wheelbase behind. Raises UsageError for an unknown class.
    """
    if grade not in ROUGHNESS:
        known = ", ".join(ROUGHNESS)
        raise UsageError(f"road class must be one of {known}, found '{grade}'{nearest(grade, ROUGHNESS)}")
    n = int(np.ceil(length / SPACING))
    wave = np.fft.rfftfreq(n, SPACING)
    density = np.zeros_like(wave)
    inside = (wave >= band[0]) & (wave <= band[1])
    density[inside] = ROUGHNESS[grade] * (wave[inside] / 0.1) ** -2
    rng = np.random.default_rng([seed, 8608])
    # One-sided spectrum: a bin of width 1/(n·dx) has variance G/(n·dx); a sine of amplitude a transforms to n·a/2.
    scale = np.sqrt(density / (n * SPACING)) * n / 2.0
    white = rng.standard_normal((2, 2, len(wave)))
    first, second = (white[:, 0] + 1j * white[:, 1]) * scale
    coherence = np.exp(-decay * track * wave)
    tracks = (first, coherence * first + np.sqrt(1.0 - coherence**2) * second)
    window = _taper(n, 20.0)
    left, right = (envelope(np.fft.irfft(z, n) * window, contact_length) for z in tracks)
    return Road(f"class-{grade}", start, left, right)


def kerb_road(
    start: float, length: float, height: float, bump: float, spacing: float, side: str, contact_length: float
) -> Road:
    """A road with cosine-shaped bumps on one, both or alternating tracks.

    Bumps are `height` high and `bump` long [m], every `spacing` [m], on the ``left``, ``right``, ``both`` tracks or
    ``alternate`` sides. Raises UsageError for another side.
    """
    if side not in ("left", "right", "both", "alternate"):
        raise UsageError(f"side must be left, right, both or alternate, found '{side}'")
    n = int(np.ceil(length / SPACING))
    left, right = np.zeros(n), np.zeros(n)
    m = round(bump / SPACING)
    shape = 0.5 * height * (1.0 - np.cos(2.0 * np.pi * np.arange(m) / m))
    for k, at in enumerate(np.arange(spacing, length - bump - 1.0, spacing)):
        i = int(at / SPACING)
        on_left = side in ("left", "both") or (side == "alternate" and k % 2 == 0)
        on_right = side in ("right", "both") or (side == "alternate" and k % 2 == 1)
        if on_left:
            left[i : i + m] = shape
        if on_right:
            right[i : i + m] = shape
    return Road("kerb", start, envelope(left, contact_length), envelope(right, contact_length))
