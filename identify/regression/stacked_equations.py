"""Weighted equations of a fit as full columns: of the parameters kept, the sensor faults and every run's zeros."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import triangle
from lacet.identify.regression.sensor_offsets import Zeros, with_payload, zeros_of
from lacet.identify.regression.wls import Fit


class Columns:
    """Equations of a fit as full columns, for other estimates that start from its solution.

    Attributes
    ----------
    fitted : the fit.
    kept : number of the model's parameters among the columns (those of sensor faults included); zeros follow.
    start : (q,) the fit's solution. Its sensor faults are removed from the runs: their remaining sizes start at 0.
    known : (k, q) prior information as equations with σ = 1 and right side 0: plausible sizes, left and right parts
        equal, fault bounds, the zeros' tolerances.
    """

    def __init__(self, fitted: Fit):
        self.fitted = fitted
        self._keep = fitted.base.independent
        faults = len(fitted.model.faults)
        self.kept = len(self._keep) + faults
        values = [part for _, _, part in fitted.zeros]
        self.start = np.concatenate([fitted.theta[self._keep], np.zeros(faults), *values])
        self._zeros = [self._zeros_of(d) for d in range(len(fitted.zeros))]
        tolerances = np.concatenate([np.zeros(0), *(sigma for _, sigma, _ in fitted.zeros)])
        self.known = np.asarray(scipy.linalg.block_diag(fitted.equations.known, np.diag(1.0 / tolerances)), float)

    def _zeros_of(self, d: int) -> Zeros:
        """Zeros of run `d` as the fit has them: of the channels its rows depend on, or of all where it is in pieces."""
        run, sensitivity = self.fitted.runs[d], self.fitted.sensitivities[d]
        payload = self.fitted.options.payload
        for every in (False, True):
            found = zeros_of(run, sensitivity, every)
            found = found if payload is None else with_payload(found, run, payload)
            if found.names == self.fitted.zeros[d][0]:
                break
        return found

    def columns(self, d: int, row: Row, drive: PreparedRun) -> Array:
        """(n, q) weighted columns of a row of run `d`; columns of parameters are computed on `drive`."""
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
