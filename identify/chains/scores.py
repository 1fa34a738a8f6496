"""Errors of a fitted chain joint by joint, compared with what the noise of its instruments leaves.

Noise is drawn as white as it was measured and goes through the same filters and the same regression as the record did.
Errors on parts that were not fitted to are compared with those of noise that was predicted from the same other parts:
in a short record these hold the errors of the parameters more than the noise itself.
"""

from __future__ import annotations

import zlib
from collections.abc import Generator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import NotIdentifiable
from lacet.identify.chains.fit import ChainFit, refitted
from lacet.identify.chains.samples import JointSamples, Recorded
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.decimation import decimated
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.noise_level import white_noise_spread

_DRAWS = 19
"""Simulated records behind a noise floor: as few as give a p of `SelectionSettings.failing_chance`, 5 %, and a floor
whose own standard error is small beside that of the record's error."""
_GAP = 2.0
"""Time left out on both sides of a part that is held out × cut-off of the fit: what the filter carries over."""


@dataclass(frozen=True)
class JointScore:
    """Error of one joint.

    Attributes
    ----------
    joint : its name.
    rms : RMS of measured less modelled torque [N·m, N].
    floor : RMS that the noise of positions and torques alone leaves [N·m, N].
    explained : variance accounted for [%].
    variation : RMS variation of the measured torque [N·m, N].
    p : probability that noise alone leaves any joint as far above its floor.
    """

    joint: str
    rms: float
    floor: float
    explained: float
    variation: float
    p: float

    @property
    def ratio(self) -> float:
        """Error ÷ noise floor."""
        return self.rms / self.floor if self.floor > 0.0 else float("inf")

    @property
    def fails(self) -> bool:
        """Whether the error is above its noise floor by more than chance, as a car's rows are judged."""
        return self.ratio > SELECTION.failing_ratio and self.p <= SELECTION.failing_chance

    @property
    def small(self) -> bool:
        """Whether what is above the floor is less than the user's effect size."""
        return self.rms**2 - self.floor**2 < (SELECTION.effect_size * self.variation) ** 2


def measured_noise(fitted: ChainFit, recorded: Recorded, filters: Filters) -> tuple[Array, Array]:
    """(f,) σ of the white noise of positions [rad, m] and torques [N·m, N], from the upper end of their spectra.

    Of torques less the model's, whose friction jumps at every turn and would count as noise.
    """
    samples = recorded.samples(replace(filters, rate=recorded.rate))
    torques = recorded.tau - fitted.model.torques(samples, fitted.standard)
    return recorded.noise_of(recorded.q, True), recorded.noise_of(torques, False)


def drawn_noise(
    fitted: ChainFit, recorded: Recorded, filters: Filters, noise: tuple[Array, Array], slowest: Array
) -> Array:
    """(D, m, f) errors [N·m, N] of D draws of white noise (σ of positions, of torques), through filters and equations.

    The noise is added to the record: what it adds to the error counts, where joints are faster than `slowest`; it is
    NaN elsewhere. The model's parameters stay as they are.
    """

    def error(samples: JointSamples) -> Array:
        measured, modelled = predicted(fitted, samples)
        return measured - modelled

    samples = recorded.samples(filters)
    plain = error(samples)
    counts = np.abs(samples.qd[samples.kept]) >= slowest
    # Draws of its own for each record: of the same ones, all records of a length would have a floor wrong alike.
    rng = np.random.default_rng([1, zlib.crc32(np.ascontiguousarray(recorded.tau).tobytes())])
    spread = white_noise_spread(len(recorded.q))
    out = np.empty((_DRAWS, *plain.shape))
    for number in range(_DRAWS):
        drawn = rng.standard_normal((2, *recorded.q.shape))
        # The level of the noise is itself an estimate: a draw has one that the record may have had.
        level = np.maximum(0.0, 1.0 + spread * rng.standard_normal((2, recorded.q.shape[1])))
        moved = error(recorded.samples(filters, (drawn[0] * noise[0] * level[0], drawn[1] * noise[1] * level[1])))
        out[number] = np.where(counts, moved - plain, np.nan)
    return out


def noise_after_fit(fitted: ChainFit, noise: Array) -> Array:
    """(D, m, f) what a fit leaves of drawn noise: parameters that are fitted to it take a part of it away."""
    return noise - _fitted_to(fitted, fitted.used, noise)


def _fitted_to(fitted: ChainFit, used: NDArray[np.bool_], noise: Array) -> Array:
    """(D, m, f) torques of parameters that are fitted to drawn noise, where equations are `used`, with its weights."""
    names = [fitted.base.names[int(k)] for k in fitted.base.independent]
    seen = [i for i, name in enumerate(names) if name not in fitted.unseen]
    scale = (fitted.weights / fitted.sigma)[used]
    W = fitted.W[:, :, seen]
    columns = W[used] * scale[:, None]
    lengths = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    fitted_to = np.asarray(np.linalg.lstsq(columns / lengths, (noise[:, used] * scale).T, rcond=None)[0], float)
    return np.moveaxis(np.asarray(W @ (fitted_to / lengths[:, None]), float), 2, 0)


def predicted(fitted: ChainFit, samples: JointSamples) -> tuple[Array, Array]:
    """(m, f) measured torques of any samples, and the model's, after filter and decimation."""
    filters = samples.filters
    both = np.concatenate([samples.tau, fitted.model.torques(samples, fitted.standard)], axis=1)
    through = decimated(both.T, filters)[:, samples.kept // filters.step].T
    count = samples.tau.shape[1]
    return through[:, :count], through[:, count:]


def scores_of(fitted: ChainFit, residual: Array, measured: Array, noise: Array) -> tuple[JointScore, ...]:
    """Scores of a residual (m, f), NaN where an equation does not count, beside drawn noise (D, m, f).

    The p of a joint is the rank of its error among the largest of every draw, each in units of the spread of all draws
    and the record together: were it noise, the record would be one draw more, and each of them as likely the largest.
    """
    chain = fitted.model.chain
    counted = np.isfinite(residual)
    squares = np.stack([_mean_squares(one, counted) for one in noise])
    here = _mean_squares(residual, counted)
    usual, every = np.mean(squares, axis=0), np.vstack([squares, here])
    units = (every - np.mean(every, axis=0)) / np.maximum(np.std(every, axis=0), 1e-300)
    largest = np.max(units[:-1], axis=1)
    out: list[JointScore] = []
    for k, j in enumerate(chain.coupling.free):
        if not counted[:, k].any():
            lost = float("nan")
            out.append(JointScore(chain.names[j - 1], lost, float(np.sqrt(usual[k])), lost, lost, lost))
            continue
        r, y = residual[counted[:, k], k], measured[counted[:, k], k]
        variance = float(np.var(y))
        explained = 100.0 * (1.0 - float(np.var(r)) / variance) if variance else 0.0
        p = (1 + np.count_nonzero(largest >= units[-1, k])) / (1 + len(noise))
        rms, floor = float(np.sqrt(here[k])), float(np.sqrt(usual[k]))
        out.append(JointScore(chain.names[j - 1], rms, floor, explained, variance**0.5, float(p)))
    return tuple(out)


def _mean_squares(error: Array, counted: NDArray[np.bool_]) -> Array:
    """(f,) mean squares of an error (m, f) where it is counted; 0 where nothing is."""
    total = np.sum(np.where(counted, error, 0.0) ** 2, axis=0)
    return np.asarray(total / np.maximum(1, np.count_nonzero(counted, axis=0)), float)


def held_out(fitted: ChainFit, cutoff: float, noise: Array) -> tuple[Array, Array]:
    """(m, f) residuals of parts that were not fitted to, and (D, m, f) those of drawn noise, predicted alike.

    The record is in as many parts as cross-validation has folds. NaN where the others do not determine the model's
    parameters.
    """
    residual, drawn = np.full(fitted.y.shape, np.nan), np.full(noise.shape, np.nan)
    for inside, used in _parts(fitted, cutoff):
        try:
            other = refitted(replace(fitted, used=used))
        except NotIdentifiable:
            continue
        if set(other.unseen) != set(fitted.unseen):
            continue
        residual[inside] = np.where(fitted.used, fitted.y - fitted.W @ other.x, np.nan)[inside]
        drawn[:, inside] = (noise - _fitted_to(other, used, noise))[:, inside]
    return residual, drawn


def _parts(fitted: ChainFit, cutoff: float) -> Generator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Each part (m,) that is held out, and the equations (m, f) fitted to meanwhile.

    The equations near a part's ends, which share samples with it, are in neither.
    """
    count = len(fitted.t)
    bounds = np.linspace(0, count, SELECTION.folds + 1).round().astype(int)
    for first, stop in pairwise(int(b) for b in bounds):
        inside = np.zeros(count, bool)
        inside[first:stop] = True
        gap = _GAP / cutoff
        near = (fitted.t > fitted.t[first] - gap) & (fitted.t < fitted.t[stop - 1] + gap)
        yield inside, fitted.used & ~near[:, None]
