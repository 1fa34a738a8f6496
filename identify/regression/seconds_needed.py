"""How much longer a run must go on until each parameter is known well enough.

Information of the samples grows with the time driven; what is known beforehand, the priors of sensor zeros and
parameters, does not, and neither do gains and latencies of the sensor sheet; and where a direction's columns are mostly
noise, they stay so. So an interval falls with one over the root of time only as far as noise makes it, and some never
become as narrow as is wished.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.corrected_scores import given_back
from lacet.identify.regression.qr_accumulation import orthonormaliser
from lacet.identify.regression.recursive_fit import GrownFit
from lacet.identify.regression.wls import Fit

ENDLESS = 1e4
"""Multiple of the run's information that counts as endless: noise makes a hundredth of the interval it does now."""
_TIMES = np.concatenate([np.geomspace(1.0, 64.0, 25), np.geomspace(64.0, ENDLESS, 8)[1:]])
"""Multiples of the run's information at which intervals are computed; in between they are interpolated."""


@dataclass(frozen=True)
class Enough:
    """Whether parameters are known well enough, in the order of the model's parameters.

    Attributes
    ----------
    half : (p,) half of the 95 % interval with the sensor sheet ÷ absolute value; infinite for a value of zero.
    least : (p,) the same after endless driving of the same kind.
    seconds : (p,) how much longer to drive until `half` is at most the target [s]; 0 where it is, infinite where it
        never will be.
    """

    half: Array
    least: Array
    seconds: Array


def seconds_needed(fitted: Fit | GrownFit, target: float, length: float) -> Enough:
    """Whether and when each parameter's half interval is at most `target` of its value.

    Parameters
    ----------
    fitted : a fit of one run.
    target : half of the 95 % interval with the sensor sheet ÷ value that is wished.
    length : of the run [s]. What comes is taken to be as rich as what was.

    Parameters that are not among those kept (`BaseParameters`) have NaN.
    """
    searched, sheet = fitted.covariances_searched
    place = fitted.place
    value = np.abs(fitted.theta[place])
    total, stays = np.diag(searched)[place], _mostly_noise(fitted)
    grown = _variances(fitted)
    variance = np.maximum(total - stays, 0.0) * (grown / grown[0]) + stays + np.diag(sheet)[place]
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(value > 0.0, TWO_SIDED_95 * np.sqrt(variance) / value, np.inf)
    # Rounding apart the intervals only fall.
    relative = np.minimum.accumulate(relative, axis=0)
    times = np.array([_first(column, target) for column in relative.T])
    p = len(fitted.theta)
    out = Enough(*(np.full(p, np.nan) for _ in range(3)))
    out.half[place], out.least[place], out.seconds[place] = relative[0], relative[-1], (times - 1.0) * length
    return out


def _first(relative: Array, target: float) -> float:
    """The multiple of the information at which an interval reaches the target; 1 if it has, infinite if never."""
    there = np.flatnonzero(relative <= target)
    if not there.size:
        return np.inf
    k = int(there[0])
    if k == 0:
        return 1.0
    return float(np.exp(np.interp(-target, -relative[k - 1 : k + 1], np.log(_TIMES[k - 1 : k + 1]))))


def _mostly_noise(fitted: Fit | GrownFit) -> Array:
    """(q,) variances of the directions whose columns are mostly noise, however long the run is."""
    inverse = orthonormaliser(fitted.root[:, : len(fitted.place)])
    priors = 1.0 / np.diag(fitted.equations.known)
    return np.diag(given_back(inverse, fitted.moments.slopes.mean(axis=0), priors))


def _variances(fitted: Fit | GrownFit) -> Array:
    """(T, q) variances as if residuals were independent, with the information of the samples multiplied by `_TIMES`."""
    run, known = fitted.equations.runs[0], fitted.equations.known
    z, q = len(run.zeros), fitted.equations.p
    normal = run.normal(fitted.sigma)[: z + q, : z + q]
    prior = np.zeros(z + q)
    prior[:z] = run.priors**-2.0
    samples = normal - np.diag(prior)
    beforehand = np.diag(prior)
    beforehand[z:, z:] += known.T @ known
    return np.stack([_inverse_diagonal(times * samples + beforehand)[z:] for times in _TIMES])


def _inverse_diagonal(normal: Array) -> Array:
    scale = np.sqrt(np.diag(normal))
    return np.diag(np.linalg.inv(normal / np.outer(scale, scale))) / scale**2
