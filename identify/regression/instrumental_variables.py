"""Instrumental variables from the even and the odd samples of each channel, and the Durbin–Wu–Hausman test.

Noise in the regressors biases least squares: E[Wᵀ r] is not zero at the true parameters when W and r = Y − W θ come
from the same noisy channels. Every channel is sampled many times faster than the car moves, so its even and its odd raw
samples carry the same motion and, when the noise is white, independent noise. Each half goes through the whole pipeline
by itself, and each is the instrument of the other: E[W_evenᵀ r_odd] = 0 at the true parameters, whatever the noise's
size. The sensor sheet is not asked, so what the sheet says can be tested against it.

Sources: Young, *Recursive Estimation and Time-Series Analysis* (2011), ch. 6; Hausman, Econometrica 46 (1978) 1251;
Wooldridge, *Econometric Analysis of Cross Section and Panel Data* (2010), section 6.2 (the robust form of the test).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.daq.errors import NotIdentifiable
from lacet.daq.run import Run
from lacet.identify.car.rows import Row
from lacet.identify.car.sources.completion import with_sources_of
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.corrected_scores import NOISE_DRAWS
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.stacked_equations import Columns
from lacet.identify.regression.uncertainty import at_least, hac
from lacet.identify.regression.wls import Fit, corrected_run
from lacet.identify.signals.reconstruct import Recording, bring_together

WEAK = 0.5
"""Part of a direction's energy that is noise, above which its instruments are too weak to estimate it [share]."""

_FELT = 0.03
"""The joint test looks at directions in which halving the samples moves an estimate by this part of its own σ: in the
others noise can neither bias nor be seen."""

_LAGS = 3
"""The contrast is a product of two noises, each as short as the fit's filter: 0.2 s of correlation is all it has."""


@dataclass(frozen=True)
class Pair:
    """One run as two, on the same instants: from the even and from the odd samples of every channel."""

    even: PreparedRun
    odd: PreparedRun


@dataclass(frozen=True)
class Contrast:
    """Durbin–Wu–Hausman test of an estimate against the instrumental-variable estimate.

    Attributes
    ----------
    difference : (p,) θ of the estimate − θ of the instruments, every parameter of the model (grouped ones 0).
    covariance : (p, p) of it under the null that both mean the same, from their influence functions (HAC): neither
        homoscedastic residuals nor an efficient estimate is assumed.
    statistic : Hotelling's T² over the directions that noise influences.
    directions : number of those directions.
    p : probability of a larger statistic when the two estimates differ by chance only.
    """

    difference: Array
    covariance: Array
    statistic: float
    directions: int
    p: float

    @property
    def z(self) -> Array:
        """(p,) difference of each parameter ÷ its standard deviation; 0 where that is not known."""
        sd = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return np.divide(self.difference, sd, out=np.zeros_like(sd), where=sd > 0.0)


@dataclass(frozen=True)
class Instruments:
    """Instrumental-variable fit of a model, and its comparison with two least-squares fits.

    Attributes
    ----------
    fit : the fit with instruments: parameters, covariance and residuals are its own, weights those of `of`.
    of : the fit it was made from.
    plain : least squares without any correction against the instruments: the alarm.
    corrected : the fit `of`, which removes the bias of the sheet's noise, against the instruments: whether the noise
        in the runs is the sheet's.
    weak : number of directions of the parameters with too weak instruments; their values are those of `of`.
    """

    fit: Fit
    of: Fit
    plain: Contrast
    corrected: Contrast
    weak: int


def pair_of(run: Run, recording: Recording) -> Pair:
    """The two halves of a run on the instants of its recording, with the same samples left out.

    Raises NotIdentifiable when a channel has too few samples to be halved.
    """
    runs: list[PreparedRun] = []
    for first in (0, 1):
        signals = {
            name: replace(s, t=s.t[first::2], values=s.values[first::2], flags=s.flags[first::2])
            for name, s in run.signals.items()
            if name in recording.signals.value
        }
        half = bring_together(
            replace(run, signals=signals), recording.vehicle, recording.rig, recording.filters, recording.t
        )
        half = with_sources_of(half, recording)
        if absent := [name for name in recording.signals.value if name not in half.signals.value]:
            raise NotIdentifiable(
                f"{run.name}: {', '.join(absent)} {'has' if len(absent) == 1 else 'have'} too few usable samples to be "
                "halved; leave the channel out, or record longer"
            )
        runs.append(PreparedRun(replace(half, usable=recording.usable, rates=recording.rates)))
    return Pair(*runs)


def pairs_of(fitted: Fit, runs: Sequence[Run]) -> tuple[Pair, ...]:
    """The halves of a fit's runs, given as recorded and in the order of its drives, its sensor faults removed.

    Rows have the samples of the whole run: where the brakes act, a half alone may say one instant sooner or later.
    """
    out: list[Pair] = []
    for run, drive in zip(runs, fitted.runs, strict=True):
        pair = pair_of(run, drive.recording)
        halves = (corrected_run(half, fitted) for half in (pair.even, pair.odd))
        out.append(Pair(*(PreparedRun(half.recording, index=drive.index) for half in halves)))
    return tuple(out)


def fit_instruments(fitted: Fit, pairs: Sequence[Pair]) -> Instruments:
    """Fit a model again with instruments, from a fit of it and the halves of its runs (`pairs_of`).

    `fitted` is a least-squares fit, corrected for the sheet's noise or not; its row weights, grouping of parameters,
    priors and sensor zeros are kept.
    """
    return _Solver(fitted, pairs).solve()


class _Block(NamedTuple):
    """Whitened columns and residuals at the fit, of a run's row: from all samples, the even and the odd ones."""

    U: Array
    r: Array
    U_even: Array
    r_even: Array
    U_odd: Array
    r_odd: Array

    def crossed(self, x: Array) -> Array:
        """(n, q) scores of the instruments at x: the columns of each half times the residual of the other half."""
        r_even, r_odd = self.r_even - self.U_even @ x, self.r_odd - self.U_odd @ x
        return 0.5 * (self.U_even * r_odd[:, None] + self.U_odd * r_even[:, None])


class _Solver:
    """The fit's equations in coordinates x = R (θ − θ_fit), in which its normal matrix is the identity."""

    def __init__(self, fitted: Fit, pairs: Sequence[Pair]):
        self.fitted, self.pairs = fitted, pairs
        self.equations = Columns(fitted)
        self.inverse = self.equations.inverse

    def _block(self, d: int, row: Row) -> _Block:
        found: list[Array] = []
        for one in (self.fitted.runs[d], self.pairs[d].even, self.pairs[d].odd):
            W = self.equations.columns(d, row, one)
            found += [W @ self.inverse, one.measured[row] / self.fitted.sigma[row] - W @ self.equations.start]
        return _Block(*found)

    def solve(self) -> Instruments:
        """The estimate with instruments, and its contrasts."""
        blocks: list[dict[Row, _Block]] = [
            {row: self._block(d, row) for row in run.rows} for d, run in enumerate(self.fitted.runs)
        ]
        known = self.equations.known
        prior = known @ self.inverse
        matrix, right = prior.T @ prior, -prior.T @ (known @ self.equations.start)
        plain = right.copy()
        for b in (block for part in blocks for block in part.values()):
            plain += b.U.T @ b.r
            right += b.crossed(np.zeros(right.size)).sum(axis=0)
            matrix += 0.5 * (b.U_even.T @ b.U_odd + b.U_odd.T @ b.U_even)
        spectrum = np.linalg.eigh(matrix)
        size, sound = np.asarray(spectrum[0], float), np.asarray(spectrum[0]) > 1.0 - WEAK
        V = np.asarray(spectrum[1], float)[:, sound]
        inverse: Array = (V / size[sound]) @ V.T  # over the directions that have instruments; the others stay
        project: Array = V @ V.T
        x: Array = inverse @ right
        own, between = prior.T @ prior, np.zeros_like(matrix)
        instants = 0
        for d, part in enumerate(blocks):
            scores, contrast = self._scores(d, part, x, project, inverse)
            own += hac(scores)
            used = np.any(contrast != 0.0, axis=1)
            instants += int(np.count_nonzero(used))
            contrast[used] -= contrast[used].mean(axis=0)
            between += _spread(contrast)
        covariance = inverse @ own @ inverse + np.eye(x.size) - project
        residual = tuple({row: (b.r - b.U @ x) * self.fitted.sigma[row] for row, b in part.items()} for part in blocks)
        plain = project @ plain
        fit = self._fit(x, covariance, residual, x - plain)
        # The correction stands on some draws of noise, each of which scatters as the halves do.
        drawn = between * (1.0 + 1.0 / NOISE_DRAWS)
        against = self._contrast(plain - x, between, instants), self._contrast(-x, drawn, instants)
        return Instruments(fit, self.fitted, *against, int(np.count_nonzero(~sound)))

    def _scores(
        self, d: int, part: Mapping[Row, _Block], x: Array, project: Array, inverse: Array
    ) -> tuple[Array, Array]:
        """(instants, q) scores of the instruments, and the difference of the two estimates' influence functions."""
        run = self.fitted.runs[d]
        step = run.recording.filters.step
        scores = np.zeros((run.recording.t.size // step + 1, x.size))
        contrast = np.zeros_like(scores)
        for row, b in part.items():
            at, crossed = run.index[row] // step, b.crossed(x)
            scores[at] += crossed
            contrast[at] += (b.U * (b.r - b.U @ x)[:, None]) @ project - crossed @ inverse
        return scores, contrast

    @property
    def _places(self) -> NDArray[np.int64]:
        """Indices of the estimated parameters among all parameters of the model."""
        total = len(self.fitted.theta)
        faults = np.arange(total - len(self.fitted.model.faults), total)
        return np.concatenate([self.fitted.base.independent, faults]).astype(np.int64)

    def _fit(self, x: Array, covariance: Array, residual: tuple[dict[Row, Array], ...], correction: Array) -> Fit:
        fitted = self.fitted
        kept = self.equations.kept
        step = self.inverse @ x
        theta, shift = fitted.theta.copy(), np.zeros(len(fitted.theta))
        theta[self._places] += step[:kept]
        shift[self._places] = (self.inverse @ correction)[:kept]
        ends = np.cumsum([kept, *(len(values) for _, _, values in fitted.zeros)])
        zeros = [
            (names, sigma, values + step[a:b])
            for (names, sigma, values), a, b in zip(fitted.zeros, ends, ends[1:], strict=False)
        ]
        return replace(
            fitted, theta=theta, covariance=at_least(self._of_parameters(covariance), fitted.covariance_iid),
            residual=residual, zeros=tuple(zeros), correction=shift,
        )  # fmt: skip

    def _of_parameters(self, covariance: Array) -> Array:
        """Covariance of the model's parameters from that of x."""
        places = self._places
        slope = self.inverse[: len(places)]
        out = np.zeros((len(self.fitted.theta),) * 2)
        out[np.ix_(places, places)] = slope @ covariance @ slope.T
        return out

    def _contrast(self, x: Array, covariance: Array, instants: int) -> Contrast:
        places = self._places
        difference = np.zeros(len(self.fitted.theta))
        difference[places] = (self.inverse @ x)[: len(places)]
        return Contrast(difference, self._of_parameters(covariance), *_hotelling(x, covariance, instants))


def _spread(scores: Array) -> Array:
    """Covariance of the sum of scores with Bartlett weights over `_LAGS`."""
    out = scores.T @ scores
    for lag in range(1, _LAGS + 1):
        cross = scores[lag:].T @ scores[:-lag]
        out += (1.0 - lag / (_LAGS + 1.0)) * (cross + cross.T)
    return out


def _hotelling(x: Array, covariance: Array, instants: int) -> tuple[float, int, float]:
    """Hotelling's T² of x over the directions in which noise is felt, how many they are, and its p."""
    spectrum = np.linalg.eigh(0.5 * (covariance + covariance.T))
    size, V = np.asarray(spectrum[0], float), np.asarray(spectrum[1], float)
    felt = size > _FELT**2
    m = int(np.count_nonzero(felt))
    if m == 0 or instants <= m:
        return 0.0, 0, 1.0
    statistic = float(np.sum((V[:, felt].T @ x) ** 2 / size[felt]))
    # The covariance is itself estimated, from so many instants.
    F = statistic * (instants - m) / ((instants - 1.0) * m)
    return statistic, m, float(scipy.stats.f.sf(F, m, instants - m))
