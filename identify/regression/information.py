"""Information of a fit's equations and priors on its parameters, as one R factor, and on some of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.qr_accumulation import scaled_triangle
from lacet.identify.regression.wls import Fit


@dataclass(frozen=True)
class Information:
    """The weighted problem of a fit around its estimate.

    Attributes
    ----------
    names : (q,) unknowns: base parameters, then sensor faults; each run's sensor zeros follow freely.
    root : (q, q) upper triangle R: the weighted residual, priors included, rises by ‖R (x − x̂)‖² from its minimum x̂.
    loose : (q, q) what of RᵀR is only the plausible range of parameters and the likeness of left and right parts.
    """

    names: tuple[str, ...]
    root: Array
    loose: Array

    @classmethod
    def of(cls, fitted: Fit) -> Information:
        """The information of a fit, with the fit's weights."""
        q, known = len(fitted.place), fitted.equations.known
        return cls(fitted.columns, fitted.root[:q, :q], known.T @ known)

    def inverse(self) -> Array:
        """(q, q) inverse of `root`; its rows' lengths are each unknown's σ as if residuals were independent."""
        R, lengths = scaled_triangle(self.root)
        return np.asarray(scipy.linalg.solve_triangular(R, np.eye(len(lengths))), float) / lengths[:, None]

    def marginal(self, chosen: NDArray[np.intp]) -> tuple[Array, Array]:
        """What is known of some unknowns when all others follow freely.

        Returns the triangle (k, k) of the chosen ones, and the map (q, k) from their change to that of all unknowns
        which raises the residual least.
        """
        width = self.root.shape[0]
        free = np.ones(width, bool)
        free[chosen] = False
        others = np.flatnonzero(free)
        order, n = np.concatenate([others, chosen]), int(np.count_nonzero(free))
        R, lengths = scaled_triangle(self.root[:, order])
        turned = R * lengths
        out = np.zeros((width, len(chosen)))
        out[chosen] = np.eye(len(chosen))
        if n:
            follow = np.asarray(scipy.linalg.solve_triangular(R[:n, :n], turned[:n, n:]), float)
            out[others] = -follow / lengths[:n, None]
        return turned[n:, n:], out
