"""The weighted equations of a fit, all columns side by side: parameters kept, sensor faults, every run's zeros."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.linalg

from identify.drive import Drive
from identify.effect import Parameter
from identify.fit import Fit
from identify.vectors import Array


class Equations:
    """The equations a fit solved, for estimates that start from it.

    Attributes
    ----------
    fitted : the fit.
    kept : number of the model's parameters among the columns (those of sensor faults included); zeros follow.
    start : (q,) the fit's solution. Sensor faults are taken out of its drives: what is left of them is a step from 0.
    known : (k, q) what is known beforehand, as equations with σ = 1 and right side 0: plausible sizes, twins, fault
        bounds, the zeros' tolerances.
    """

    def __init__(self, fitted: Fit):
        self.fitted = fitted
        self._keep = fitted.base.independent
        faults = len(fitted.model.faults)
        self.kept = len(self._keep) + faults
        self.start = np.concatenate([fitted.theta[self._keep], np.zeros(faults), *(v for _, v in fitted.zeros)])
        self.known = _known(fitted)

    def columns(self, d: int, row: str, drive: Drive) -> Array:
        """(n, q) weighted columns of a row of run `d`, the parameters' as `drive` has them."""
        fitted = self.fitted
        W = drive.matrix(fitted.model.physics, row)[:, self._keep]
        parts = [W]
        for fault in fitted.model.faults:
            found = fitted.drives[d].decimated(fitted.sensitivities[d].fault(fault))
            parts.append(found.get(row, np.zeros(len(W)))[:, None])
        for run, (zeros, _) in enumerate(fitted.zeros):
            parts.append(zeros.columns[row] if run == d else np.zeros((len(W), len(zeros.names))))
        return np.concatenate(parts, axis=1) / fitted.sigma[row]

    @cached_property
    def inverse(self) -> Array:
        """(q, q) R⁻¹, R the triangle of all columns and `known`: in x = R θ the normal matrix is the identity."""
        q = self.start.size
        stacked: list[Array] = [self.known]
        for d, drive in enumerate(self.fitted.drives):
            stacked += [_triangle(self.columns(d, row, drive)) for row in drive.rows]
        full = np.concatenate(stacked)
        lengths = np.linalg.norm(full, axis=0)
        inverse = np.asarray(scipy.linalg.solve_triangular(_triangle(full / lengths), np.eye(q)), float)
        return inverse / lengths[:, None]


def _triangle(W: Array) -> Array:
    return np.asarray(scipy.linalg.qr(W, mode="r")[0], float)[: W.shape[1]]


def _known(fitted: Fit) -> Array:
    every: list[Parameter] = [q for effect in fitted.model.physics for q in effect.parameters]
    kept = [every[int(i)] for i in fitted.base.independent]
    names = [q.name for q in kept]
    scales = [q.prior for q in kept] + [q.prior for fault in fitted.model.faults for q in fault.parameters]
    scales += [float(sigma) for zeros, _ in fitted.zeros for sigma in zeros.sigma]
    lines = [np.diag(1.0 / np.array(scales))]
    for i, q in enumerate(kept):
        if q.twin in names:
            line = np.zeros((1, len(scales)))
            line[0, i], line[0, names.index(q.twin)] = 1.0 / q.twin_sigma, -1.0 / q.twin_sigma
            lines.append(line)
    return np.concatenate(lines)
