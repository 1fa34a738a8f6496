"""Fisher information of a fit on its parameters, priors included, as one R factor; marginal information on a part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.qr_accumulation import scaled_triangle
from lacet.identify.regression.wls import Fit


@dataclass(frozen=True)
class Information:
    """Fisher information of a fit at its estimate, as a factor R with RᵀR the information matrix.

    Attributes
    ----------
    names : (q,) unknowns: base parameters, then sensor faults; the runs' sensor zeros are eliminated.
    root : (q, q) upper triangle R: the weighted sum of squares, priors included, is ‖R (x − x̂)‖² above its minimum.
    loose : (q, q) part of RᵀR that comes from priors: plausible ranges, and equality of left and right parts.
    """

    names: tuple[str, ...]
    root: Array
    loose: Array

    @classmethod
    def of(cls, fitted: Fit) -> Information:
        """The information of a fit, with its weights."""
        q, known = len(fitted.place), fitted.equations.known
        return cls(fitted.columns, fitted.root[:q, :q], known.T @ known)

    def inverse(self) -> Array:
        """(q, q) inverse of `root`; the length of a row is the σ of that unknown for independent residuals."""
        R, lengths = scaled_triangle(self.root)
        return np.asarray(scipy.linalg.solve_triangular(R, np.eye(len(lengths))), float) / lengths[:, None]

    def marginal(self, chosen: NDArray[np.intp]) -> tuple[Array, Array]:
        """Marginal information on the unknowns with indices `chosen`, all others estimated along with them.

        Returns its triangle (k, k), and the matrix (q, k) from a change of the chosen unknowns to the change of all
        unknowns with the least rise of the weighted sum of squares.
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
