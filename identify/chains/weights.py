"""Weights of the joints' equations: the variance of each joint's residual beside the parameters that are fitted to it.

Each joint's variance is its sum of squares ÷ its own degrees of freedom, n − tr H, where tr H is the part of the fit's
projection that its equations hold (estimating equations of restricted maximum likelihood: Patterson and Thompson 1971;
as variance components in geodesy: Förstner 1979). With n in the divisor, a joint whose equations are few would be
fitted ever better, and weigh ever more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.huber import SECOND, THRESHOLD
from lacet.identify.regression.qr_accumulation import scaled_triangle, triangle
from lacet.identify.regression.uncertainty import bandwidth

_TAIL = 0.025
"""Probability on either side of a 95 % interval."""
_FIXED_B = (1.9600, 2.9694, 0.4160, -0.5324)
"""Coefficients of b⁰ to b³. Source: Kiefer and Vogelsang (2005), Econometric Theory 21, table 1, Bartlett, 97.5 %."""
_LEAST = 1e-12
"""σ of a joint's residual ÷ that of its torque that exact data are given [ratio]: numerical."""
_ROUNDS = 200
"""Most repetitions of the variances [count]: numerical."""
_SETTLED = 1e-4
"""Change of every σ ÷ itself at which they end [ratio]: numerical."""
ENOUGH = 50
"""Equations of a joint beyond the number of parameters with which its σ is known to 10 %, 1/√(2 · 50) [count]."""
FEW = 10.0
"""Degrees of freedom of a joint's residual below which a reader is warned: σ is known to 22 % or less [count]."""
ALONE = 1.0
"""The same below which its noise is unknown: the fit goes through its equations [count]."""


@dataclass(frozen=True)
class WeightedSolution:
    """Parameters and variances of f joints whose equations are solved together.

    Attributes
    ----------
    x : (b,) parameters.
    sigma : (f,) σ of each joint's equations: √(sum of squares ÷ `freedom`).
    freedom : (f,) degrees of freedom of each joint's residual, n − tr H.
    shares : (f, b, b) covariance of `x` by the noise of each joint's equations, as if it were independent.
    """

    x: Array
    sigma: Array
    freedom: Array
    shares: Array

    @property
    def covariance(self) -> Array:
        """(b, b) of `x` as if residuals were independent."""
        return np.sum(self.shares, axis=0)


def solved_together(W: Array, y: Array, used: NDArray[np.bool_], weights: Array) -> WeightedSolution:
    """Equations (m, f, b) and right sides (m, f), where they are `used`, solved with weights by joint.

    `weights` : (m, f) roots of the samples' own weights. A joint with less than `ALONE` degrees of freedom has no
    variance: the others leave its equations as many parameters as there are equations.
    """
    b, joints = W.shape[2], range(y.shape[1])
    lengths = np.linalg.norm(W[used] * weights[used][:, None], axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    parts: list[Array] = []
    for k in joints:
        here = used[:, k]
        stacked = np.column_stack([W[here, k] / lengths, y[here, k]]) * weights[here, k][:, None]
        parts.append(triangle(stacked))
    counts = np.count_nonzero(used, axis=0)
    size = np.array([float(np.std(y[used[:, k], k])) or 1.0 for k in joints])
    sigma, least = size, _LEAST * size
    number = 0
    while True:
        x, inverse = _solution(parts, sigma)
        squares = np.array([np.sum((part[:, :b] @ x - part[:, b]) ** 2) for part in parts])
        held = np.array([np.sum((part[:, :b] @ inverse) ** 2) for part in parts]) / sigma**2
        freedom = np.maximum(counts - held, _LEAST)
        after = np.maximum(np.sqrt(squares / freedom), least)
        number += 1
        if number > _ROUNDS or np.all(np.abs(after - sigma) < _SETTLED * after):
            break
        sigma = after
    inverse = inverse / lengths[:, None]
    bread = inverse @ inverse.T
    normal = [(part[:, :b] * lengths).T @ (part[:, :b] * lengths) for part in parts]
    shares = np.stack([bread @ (N / s**2) @ bread for N, s in zip(normal, sigma, strict=True)])
    return WeightedSolution(x / lengths, sigma, freedom, shares)


def _solution(parts: Sequence[Array], sigma: Array) -> tuple[Array, Array]:
    """(b,) solution of R factors (…, b + 1) with weights 1/σ², and a root (b, b) of its covariance."""
    R, lengths = scaled_triangle(np.concatenate([part / s for part, s in zip(parts, sigma, strict=True)]))
    b = R.shape[1] - 1
    x = np.asarray(scipy.linalg.solve_triangular(R[:b, :b], R[:b, b]), float) * lengths[b] / lengths[:b]
    return x, np.asarray(scipy.linalg.solve_triangular(R[:b, :b], np.eye(b)), float) / lengths[:b, None]


def second_weights(residual: Array, used: NDArray[np.bool_], t: Array) -> Array:
    """(m, f) roots of the samples' weights: a second whose RMS is large beside the joint's median counts less."""
    out = np.ones_like(residual)
    second = (t // SECOND).astype(int)
    for k in range(residual.shape[1]):
        here = used[:, k]
        counts = np.bincount(second[here], minlength=second[-1] + 1)
        squares = np.bincount(second[here], residual[here, k] ** 2, second[-1] + 1)
        rms = np.sqrt(squares / np.maximum(counts, 1))
        usual = float(np.median(rms[counts > 0]))
        out[:, k] = np.sqrt(np.minimum(1.0, THRESHOLD * usual / np.maximum(rms, 1e-300)))[second]
    return out


def student(variances: Array, freedom: Array) -> float:
    """Half of a 95 % interval ÷ σ of a value whose variance is the sum of `variances`, of so many degrees of freedom.

    Student's, with the degrees of freedom of the sum after Satterthwaite (1946).
    """
    total = float(np.sum(variances))
    together = total**2 / float(np.sum(variances**2 / freedom)) if total > 0.0 else np.inf
    return float(scipy.stats.t.isf(_TAIL, max(1.0, together)))


def serial_quantile(length: int) -> float:
    """Half of a 95 % interval ÷ σ of `hac` over so many instants: the σ is itself estimated, of few independent parts.

    By the share b of the instants that Bartlett's weights reach (fixed-b asymptotics: Kiefer and Vogelsang 2005,
    table 1, 97.5 %); 1.96 for b = 0.
    """
    b = (bandwidth(length) + 1.0) / length
    return float(np.polynomial.polynomial.polyval(b, _FIXED_B))
