"""The weighted equations of a fit, all columns side by side: parameters kept, sensor faults, every run's zeros."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.linalg

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import triangle
from lacet.identify.regression.sensor_offsets import Zeros, zeros_of
from lacet.identify.regression.wls import Fit


class Columns:
    """The equations a fit solved as full columns, for estimates that start from it.

    Attributes
    ----------
    fitted : the fit.
    kept : number of the model's parameters among the columns (those of sensor faults included); zeros follow.
    start : (q,) the fit's solution. Sensor faults are removed from its drives: what remains of them is a step from 0.
    known : (k, q) what is known beforehand, as equations with σ = 1 and right side 0: plausible sizes, twins, fault
        bounds, the zeros' tolerances.
    """

    def __init__(self, fitted: Fit):
        self.fitted = fitted
        self._keep = fitted.base.independent
        faults = len(fitted.model.faults)
        self.kept = len(self._keep) + faults
        values = [part for _, _, part in fitted.zeros]
        self.start = np.concatenate([fitted.theta[self._keep], np.zeros(faults), *values])
        self._zeros = [self._of(d) for d in range(len(fitted.zeros))]
        tolerances = np.concatenate([np.zeros(0), *(sigma for _, sigma, _ in fitted.zeros)])
        self.known = np.asarray(scipy.linalg.block_diag(fitted.equations.known, np.diag(1.0 / tolerances)), float)

    def _of(self, d: int) -> Zeros:
        """The zeros of a run as the fit has them: those its rows see, or every channel's where it came in pieces."""
        run, sensitivity = self.fitted.runs[d], self.fitted.sensitivities[d]
        found = zeros_of(run, sensitivity)
        return found if found.names == self.fitted.zeros[d][0] else zeros_of(run, sensitivity, every=True)

    def columns(self, d: int, row: Row, drive: PreparedRun) -> Array:
        """(n, q) weighted columns of a row of run `d`, the parameters' as `drive` has them."""
        fitted = self.fitted
        W = drive.matrix(fitted.model.physics, row)[:, self._keep]
        parts = [W]
        for fault in fitted.model.faults:
            found = fitted.runs[d].decimated(fitted.sensitivities[d].fault(fault))
            parts.append(found.get(row, np.zeros(len(W)))[:, None])
        for run, zeros in enumerate(self._zeros):
            parts.append(zeros.columns[row] if run == d else np.zeros((len(W), len(zeros.names))))
        return np.concatenate(parts, axis=1) / fitted.sigma[row]

    @cached_property
    def inverse(self) -> Array:
        """(q, q) R⁻¹, R the triangle of all columns and `known`: in x = R θ the normal matrix is the identity."""
        q = self.start.size
        stacked: list[Array] = [self.known]
        for d, run in enumerate(self.fitted.runs):
            stacked += [triangle(self.columns(d, row, run)) for row in run.rows]
        full = np.concatenate(stacked)
        lengths = np.linalg.norm(full, axis=0)
        inverse = np.asarray(scipy.linalg.solve_triangular(triangle(full / lengths), np.eye(q)), float)
        return inverse / lengths[:, None]
