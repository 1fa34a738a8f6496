"""What a fit's equations and priors know of all its unknowns, as one triangle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from identify.fit import Fit
from identify.vectors import Array


@dataclass(frozen=True)
class Information:
    """The weighted problem of a fit around its estimate.

    Attributes
    ----------
    names : (q,) unknowns: base parameters, sensor faults, then each run's sensor zeros as ``run: channel``.
    root : (q, q) upper triangle R: the weighted residual rises by ‖R (x − x̂)‖² at any x, in σ².
    loose : (q, q) what of RᵀR is only the plausible range of parameters and the likeness of left and right parts.
    """

    names: tuple[str, ...]
    root: Array
    loose: Array

    @classmethod
    def of(cls, fitted: Fit) -> Information:
        """Gather it from the columns of a fit, with the fit's weights."""
        kept, faults = len(fitted.base.independent), len(fitted.model.faults)
        parameters = fitted.model.parameters
        chosen = [parameters[int(i)] for i in fitted.base.independent] + [
            q for f in fitted.model.faults for q in f.parameters
        ]
        names = [q.name for q in chosen]
        lengths = [len(zeros.names) for zeros, _ in fitted.zeros] or [0] * len(fitted.drives)
        width = kept + faults + sum(lengths)
        known = [np.eye(kept + faults, width) / np.array([[q.prior] for q in chosen])]
        for i, q in enumerate(chosen[:kept]):
            if q.twin in names[:kept]:
                line = np.zeros((1, width))
                line[0, i], line[0, names.index(q.twin)] = 1.0 / q.twin_sigma, -1.0 / q.twin_sigma
                known.append(line)
        loose = np.concatenate(known)
        blocks = [loose]
        for d, drive in enumerate(fitted.drives):
            start = kept + faults + sum(lengths[:d])
            if fitted.zeros:
                line = np.zeros((lengths[d], width))
                line[:, start : start + lengths[d]] = np.diag(1.0 / fitted.zeros[d][0].sigma)
                blocks.append(line)
                names += [f"{drive.name}: {name}" for name in fitted.zeros[d][0].names]
            for row in drive.rows:
                wide = np.zeros((len(drive.measured[row]), width))
                wide[:, : kept + faults] = columns(fitted, d, row)
                if fitted.zeros:
                    wide[:, start : start + lengths[d]] = fitted.zeros[d][0].columns[row]
                blocks.append(triangle(wide / fitted.sigma[row]))
        return cls(tuple(names), triangle(np.concatenate(blocks)), loose.T @ loose)

    def inverse(self) -> Array:
        """(q, q) inverse of `root`; its rows' lengths are each unknown's σ as if residuals were independent."""
        lengths = np.linalg.norm(self.root, axis=0)
        scaled = np.asarray(self.root / lengths, float)
        return np.asarray(scipy.linalg.solve_triangular(scaled, np.eye(len(lengths))), float) / lengths[:, None]

    def marginal(self, chosen: NDArray[np.intp]) -> tuple[Array, Array]:
        """What is known of some unknowns when all others follow freely.

        Returns the triangle (k, k) of the chosen ones, and the map (q, k) from their change to that of all unknowns
        which raises the residual least.
        """
        width = self.root.shape[0]
        free = np.ones(width, bool)
        free[chosen] = False
        others = np.flatnonzero(free)
        turned = triangle(self.root[:, np.concatenate([others, chosen])])
        n = len(others)
        lengths = np.linalg.norm(turned[:n, :n], axis=0)
        follow = -np.asarray(scipy.linalg.solve_triangular(turned[:n, :n] / lengths, turned[:n, n:]), float)
        out = np.zeros((width, len(chosen)))
        out[others], out[chosen] = follow / lengths[:, None], np.eye(len(chosen))
        return turned[n:, n:], out


def columns(fitted: Fit, d: int, row: str) -> Array:
    """(n, b + f) columns of a run's row: base parameters, then the model's sensor faults."""
    drive = fitted.drives[d]
    W = drive.matrix(fitted.model.physics, row)[:, fitted.base.independent]
    extra: list[Array] = []
    for fault in fitted.model.faults:
        found = drive.decimated(fitted.sensitivities[d].fault(fault))
        extra.append(found.get(row, np.zeros(len(W))))
    return np.column_stack([W, *extra])


def triangle(W: Array) -> Array:
    """The R factor, square even when there are fewer rows than columns."""
    out = np.asarray(scipy.linalg.qr(W, mode="r")[0], float)[: W.shape[1]]
    lacking = W.shape[1] - out.shape[0]
    return np.concatenate([out, np.zeros((lacking, W.shape[1]))]) if lacking else out
