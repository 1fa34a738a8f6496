"""Spectrum of a residual beside its noise floor's, and its coherence with the states, by Welch's method.

States are blurred (`validation.states`), so that noise which a state and the residual share does not count.
Coherence detects what is linear in a state, however it is delayed: where a smooth function of the present state
explains little and coherence is high, the force depends on history. Sources: Welch 1967; Carter, Coherence and time
delay estimation, Proc. IEEE 75 (1987); Bendat and Piersol, Random Data, chapter 7 (multiple coherence).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.identify.validation.states import ClearStates

SEGMENT = 4.0
"""Length of a segment [s]: a resolution of about 0.4 Hz with its taper."""
SIGNIFICANCE = 0.05
_DRAWS_TOGETHER = 16
"""Number of simulated residuals whose segments are in memory at once."""
_OVERLAP = 1.0 / 36.0
"""Squared correlation of the power in Hann-tapered segments that overlap by half."""


@dataclass(frozen=True)
class RowSpectrum:
    """Spectrum of a row's residual over all runs, beside its noise floor's.

    Attributes
    ----------
    frequency : (F,) Hz, from the first line above zero to the fit's cut-off.
    residual, floor : (F,) power densities [unit²/Hz]; the floor's is the mean of its draws, `high` (F,) their 95 %
        quantile at each line.
    coherence : state → (F,) squared coherence with the residual.
    level : significance level of `coherence`: unrelated states exceed it at any line, for any of them, with
        probability `SIGNIFICANCE`.
    together, together_level : (F,) multiple squared coherence with the `together_of` states, and its significance
        level over all lines and choices of states.
    segments : effective number of segments averaged.
    """

    row: Row
    unit: str
    frequency: Array
    residual: Array
    floor: Array
    high: Array
    coherence: Mapping[str, Array]
    level: float
    together_of: tuple[str, ...]
    together: Array
    together_level: float
    segments: float

    @property
    def explained(self) -> dict[str, float]:
        """State → part of the residual's power that is linear in it: squared coherence weighted by the power.

        In descending order, with every state. A state that follows the residual at a line where there is little of it
        explains little.
        """
        total = max(float(np.sum(self.residual)), 1e-300)
        found = {name: float(np.sum(c * self.residual)) / total for name, c in self.coherence.items()}
        return dict(sorted(found.items(), key=lambda one: -one[1]))

    @property
    def strongest(self) -> list[tuple[str, float, float]]:
        """States above the significance level, in the order of `explained`.

        Of each its name, largest squared coherence and the frequency of that [Hz].
        """
        peaks = [(name, self.coherence[name]) for name in self.explained]
        return [
            (name, float(c.max()), float(self.frequency[int(c.argmax())]))
            for name, c in peaks
            if float(c.max()) > self.level
        ]


def row_spectrum(
    fitted: Fit, floor: NoiseFloor, row: Row, clear: ClearStates | None = None, segment: float = SEGMENT
) -> RowSpectrum | None:
    """Spectrum and coherence of a row; None where no run has three segments without a gap."""
    clear = clear or ClearStates(fitted.runs)
    names = clear.names(row)
    found: list[NDArray[np.complex128]] = []
    counts: list[int] = []
    noise: list[Array] = []
    spacing, length = 1.0, 8
    for i, run in enumerate(fitted.runs):
        if row not in run.index:
            continue
        filters = run.recording.filters
        spacing = filters.step / filters.rate
        length = max(8, 2 * round(segment / spacing / 2.0))
        series = np.concatenate([fitted.residual[i][row][None], clear.filtered(i, row, names)])
        lines = _segments(series, place := run.kept(row), length, spacing)
        found.append(lines)
        counts.append(lines.shape[0])
        each = floor.draws[i].some_at_once(row, _DRAWS_TOGETHER)
        powers = [np.sum(np.abs(_segments(some, place, length, spacing)) ** 2, axis=0) for some in each]
        noise.append(np.concatenate(powers))
    total = sum(counts)
    if total < 3:
        return None
    lines = np.concatenate(found)
    cutoff = fitted.runs[0].recording.filters.fit_cutoff
    frequency = np.asarray(np.fft.rfftfreq(length, spacing)[1:], float)
    keep = frequency <= cutoff
    frequency, lines = frequency[keep], lines[:, :, 1:][:, :, keep]
    draws = np.asarray(sum(noise), float)[:, 1:][:, keep] / total
    power = np.asarray(np.mean(np.abs(lines) ** 2, axis=0), float)
    own, states_ = lines[:, 0], lines[:, 1:]
    cross = np.mean(np.conj(own)[:, None] * states_, axis=0)
    coherence = np.asarray(np.abs(cross) ** 2, float) / np.maximum(power[0] * power[1:], 1e-300)
    segments = sum(n * n / (n + 2.0 * (n - 1) * _OVERLAP) for n in counts if n)
    tests = frequency.size * max(1, len(names))
    order = np.argsort(-(coherence @ power[0])) if names else np.zeros(0, np.intp)
    most = max(1, min(4, int(segments) // 4))
    chosen = _unlike(states_, order, most)
    return RowSpectrum(
        row, row.unit, frequency, power[0],
        np.asarray(draws.mean(axis=0), float), np.asarray(np.quantile(draws, 0.95, axis=0), float),
        {name: coherence[k] for k, name in enumerate(names)}, _level(segments, 1, tests),
        tuple(names[k] for k in chosen), _together(own, states_[:, chosen]),
        _level(segments, len(chosen), frequency.size * comb(len(names), len(chosen))), segments,
    )  # fmt: skip


def _segments(series: Array, place: NDArray[np.intp], length: int, spacing: float) -> NDArray[np.complex128]:
    """(S, k, F) Fourier lines of Hann-tapered, half-overlapping segments without a gap, scaled to power densities."""
    runs = np.split(np.arange(place.size), np.flatnonzero(np.diff(place) != 1) + 1)
    starts = [int(part[0]) + k for part in runs for k in range(0, part.size - length + 1, length // 2)]
    taper = np.asarray(np.hanning(length + 1)[:-1], float)
    scale = np.sqrt(2.0 * spacing / float(np.sum(taper**2)))
    if not starts:
        return np.zeros((0, len(series), length // 2 + 1), np.complex128)
    pieces = np.stack([series[:, start : start + length] for start in starts])
    tapered = np.asarray((pieces - pieces.mean(axis=2, keepdims=True)) * taper, float)
    return np.asarray(scale * np.fft.rfft(tapered, axis=2), np.complex128)


def _level(segments: float, states: int, tests: int) -> float:
    """Squared (multiple) coherence with `states` unrelated ones that chance exceeds in any of so many tests."""
    if segments <= states + 1.0 or not states:
        return 1.0
    each = -np.expm1(np.log1p(-SIGNIFICANCE) / tests)
    return float(np.asarray(scipy.special.betaincinv(states, segments - states, 1.0 - each), float))


def _unlike(states: NDArray[np.complex128], order: NDArray[np.intp], most: int) -> list[int]:
    """Up to `most` states in this order, none of which is nearly a linear function of another."""
    chosen: list[int] = []
    for k in order:
        x = states[:, int(k)]
        alike = 0.0
        for other in chosen:
            y = states[:, other]
            power = float(np.sum(np.abs(x) ** 2) * np.sum(np.abs(y) ** 2))
            alike = max(alike, float(np.abs(np.sum(np.conj(x) * y)) ** 2) / max(1e-300, power))
        if alike < 0.8 and len(chosen) < most:
            chosen.append(int(k))
    return chosen


def _together(own: NDArray[np.complex128], states: NDArray[np.complex128]) -> Array:
    """(F,) squared multiple coherence: part of the residual's power that is linear in all states together."""
    if not states.shape[1]:
        nothing: Array = np.zeros(int(own.shape[1]))
        return nothing
    scale = np.asarray(np.sqrt(np.maximum(np.mean(np.abs(states) ** 2, axis=0), 1e-300)), float)
    x = np.asarray(states / scale, np.complex128)
    S = np.einsum("sif,sjf->fij", np.conj(x), x) / len(x) + 1e-9 * np.eye(x.shape[1])
    c = np.einsum("sif,sf->fi", np.conj(x), own) / len(x)
    solved = np.asarray(np.linalg.solve(S, c[:, :, None])[:, :, 0], np.complex128)
    explained = np.asarray(np.einsum("fi,fi->f", np.conj(c), solved).real, float)
    power = np.asarray(np.mean(np.abs(own) ** 2, axis=0), float)
    part: Array = np.asarray(explained / np.maximum(power, 1e-300), float)
    return np.asarray(np.clip(part, 0.0, 1.0), float)


def spectra(
    fitted: Fit, floor: NoiseFloor, rows: Sequence[Row] | None = None, clear: ClearStates | None = None
) -> dict[Row, RowSpectrum]:
    """Spectrum and coherence of each row that has enough segments."""
    clear = clear or ClearStates(fitted.runs)
    found = {row: row_spectrum(fitted, floor, row, clear) for row in rows or fitted.rows}
    return {row: spectrum for row, spectrum in found.items() if spectrum is not None}
