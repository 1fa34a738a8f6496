"""Errors of a fitted chain joint by joint, in units of what the noise of its instruments would leave."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from lacet.daq.errors import NotIdentifiable
from lacet.identify.chains.fit import ChainFit, refitted
from lacet.identify.chains.samples import JointSamples, Recorded
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.filters import Filters, zero_phase
from lacet.identify.signals.noise_level import white_noise

_DRAWS = 19
"""Simulated records behind a noise floor, whose own standard error is then small beside that of the record's error."""
_GAP = 2.0
"""Time left out on both sides of a part that is held out × cut-off of the fit: what the filter carries over."""


@dataclass(frozen=True)
class JointScore:
    """Error of one joint.

    Attributes
    ----------
    joint : its name.
    rms : RMS of measured less modelled torque [N·m, N].
    floor : RMS that the noise of positions and torques alone would leave [N·m, N].
    explained : variance accounted for [%].
    """

    joint: str
    rms: float
    floor: float
    explained: float

    @property
    def ratio(self) -> float:
        """Error ÷ noise floor."""
        return self.rms / self.floor if self.floor > 0.0 else float("inf")


def measured_noise(fitted: ChainFit, recorded: Recorded, filters: Filters) -> tuple[Array, Array]:
    """(f,) σ of the white noise of positions [rad, m] and torques [N·m, N], from the upper end of their spectra.

    Of torques less the model's, whose friction jumps at every turn and would count as noise.
    """
    samples = recorded.samples(replace(filters, rate=recorded.rate))
    return white_noise(recorded.q), white_noise(recorded.tau - fitted.model.torques(samples, fitted.standard))


def noise_floor(
    fitted: ChainFit, recorded: Recorded, filters: Filters, noise: tuple[Array, Array], slowest: Array
) -> Array:
    """(f,) RMS [N·m, N] that white noise (σ of positions, of torques) leaves, simulated through filters and equations.

    The noise is added to the record: what it adds to the error counts, where joints are faster than `slowest`.
    """

    def error(samples: JointSamples) -> Array:
        measured, modelled = predicted(fitted, samples)
        return measured - modelled

    samples = recorded.samples(filters)
    plain = error(samples)
    counts = np.abs(samples.qd[samples.kept]) >= slowest
    rng = np.random.default_rng(1)
    squares = np.zeros(plain.shape[1])
    for _ in range(_DRAWS):
        drawn = rng.standard_normal((2, *recorded.q.shape))
        moved = error(recorded.samples(filters, (drawn[0] * noise[0], drawn[1] * noise[1]))) - plain
        squares += np.mean(moved**2, axis=0, where=counts)
    return np.sqrt(squares / _DRAWS)


def predicted(fitted: ChainFit, samples: JointSamples) -> tuple[Array, Array]:
    """(m, f) measured torques of any samples, and the model's, after filter and decimation."""
    filters, kept = samples.filters, samples.kept
    both = np.concatenate([samples.tau, fitted.model.torques(samples, fitted.standard)], axis=1)
    through = zero_phase(np.ascontiguousarray(both.T), filters.fit_cutoff, filters.rate, filters.order)[:, kept].T
    count = samples.tau.shape[1]
    return through[:, :count], through[:, count:]


def scores_of(fitted: ChainFit, residual: Array, measured: Array, floor: Array) -> tuple[JointScore, ...]:
    """Scores of a residual (m, f), NaN where an equation does not count."""
    names = [fitted.model.chain.names[j - 1] for j in fitted.model.chain.coupling.free]
    out: list[JointScore] = []
    for k, name in enumerate(names):
        here = np.isfinite(residual[:, k])
        r, y = residual[here, k], measured[here, k]
        if not here.any():
            out.append(JointScore(name, float("nan"), float(floor[k]), float("nan")))
            continue
        variance = float(np.var(y))
        explained = 100.0 * (1.0 - float(np.var(r)) / variance) if variance else 0.0
        out.append(JointScore(name, float(np.linalg.norm(r)) / len(r) ** 0.5, float(floor[k]), explained))
    return tuple(out)


def held_out_residual(fitted: ChainFit, cutoff: float) -> Array:
    """(m, f) residuals of parts that were not fitted to: the record in as many parts as cross-validation has folds.

    The equations near a part's ends, which share samples with it, are in neither fit nor prediction. NaN where the
    others do not determine the model's parameters.
    """
    count = len(fitted.t)
    out = np.full(fitted.y.shape, np.nan)
    bounds = np.linspace(0, count, SELECTION.folds + 1).round().astype(int)
    for first, stop in pairwise(int(b) for b in bounds):
        inside = np.zeros(count, bool)
        inside[first:stop] = True
        gap = _GAP / cutoff
        near = (fitted.t > fitted.t[first] - gap) & (fitted.t < fitted.t[stop - 1] + gap)
        used = fitted.used & ~near[:, None]
        try:
            other = refitted(replace(fitted, used=used))
        except NotIdentifiable:
            continue
        if set(other.unseen) != set(fitted.unseen):
            continue
        out[inside] = np.where(fitted.used, fitted.y - fitted.W @ other.x, np.nan)[inside]
    return out
