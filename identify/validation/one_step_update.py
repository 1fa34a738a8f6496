"""One-step update of a fit: the estimate with one more effect, from the linearised equations of the present fit.

The equations of the present fit are kept, the effect's columns are added, and the row weights are iterated to their
fixed point again: a tenth of a second. A true fit also corrects the bias from noise in the new columns and linearises
the sensor zeros at the new parameters. On the runs used the residual differs from the true fit's by at most `CLOSE` of
the row's present residual (RMS, tested). On runs held out the difference is larger for an effect whose columns are
mostly noise or that the runs hardly determine: a third for a cubic spring that is absent in truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from lacet.identify.car.rows import Row, body_levers
from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import Equations, RunEquations
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.wls import Fit, corrected_run
from lacet.identify.validation.score import Comparison, profile_zeros

CLOSE = 0.05
"""Bound of the difference between one-step update and true fit, RMS ÷ RMS of the present residual, on the runs used."""


@dataclass(frozen=True)
class Preview:
    """Estimate of a fit with one more effect.

    `physics` (p,) updated parameters of the model's physics; `faults` (f,) increments of its sensor faults; `values`
    (k,) the added effect's own parameters [SI].
    """

    fitted: Fit
    effect: Effect
    physics: Array
    faults: Array
    values: Array

    def residual(self, run: PreparedRun, comparison: Comparison) -> dict[Row, Array]:
        """Row → (n,) measured minus modelled with the effect, on the run of `comparison`; its zeros are fitted anew."""
        zeros = comparison.zeros[0]
        floor = {row: score.floor for row, score in comparison.scores.items()}
        model = self.fitted.model
        run = corrected_run(run, self.fitted)
        plain: dict[Row, Array] = {
            row: run.measured[row] - run.matrix(model.physics, row) @ self.physics for row in run.rows
        }
        sensitivity = None
        if model.faults or self.effect.as_fault is not None:
            sensitivity = Sensitivity.of(run.recording, model.physics, self.fitted.physics)
        for fault, size in zip(model.faults, self.faults, strict=True):
            _subtract(plain, run.effect_columns(fault, sensitivity), np.array([size]))
        _subtract(plain, run.effect_columns(self.effect, sensitivity), self.values)
        values = profile_zeros(run, zeros, plain, floor)
        return {row: plain[row] - zeros.columns[row] @ values for row in run.rows}


def preview(fitted: Fit, effect: Effect) -> Preview:
    """The one-step update of a fit by one more effect, at the effect's present shape constants."""
    k, p = len(effect.parameters), fitted.equations.p
    runs: list[RunEquations | None] = [None] * len(fitted.runs)
    for piece in fitted.assembly.pieces():
        run = runs[piece.run]
        if run is None:
            names, priors = (piece.zeros.names, piece.zeros.sigma) if piece.zeros else ((), np.zeros(0))
            runs[piece.run] = run = RunEquations(names, priors)
        own = piece.prepared.effect_columns(effect, piece.sensitivity)
        for row, block in piece.blocks.items():
            columns = own[row].T if row in own else np.zeros((len(block), k))
            weights = None if piece.weights is None else piece.weights[row]
            run.add(row, np.concatenate([block, columns], axis=1), piece.right[row], weights)
    known = scipy.linalg.block_diag(fitted.equations.known, np.diag([1.0 / q.prior for q in effect.parameters]))
    equations = Equations([run for run in runs if run is not None], known, fitted.equations.rows)
    levers = body_levers(fitted.runs[0].recording.vehicle)
    x, _ = equations.iterate(fitted.sigma, {row: 1e-6 * s for row, s in fitted.sigma.items()}, levers)
    # The bias correction is kept: it depends on the columns, which are unchanged but for the new ones.
    x[:p] += fitted.correction[fitted.place]
    physics = np.zeros(len(fitted.physics))
    keep = fitted.base.independent
    physics[keep] = x[: len(keep)]
    return Preview(fitted, effect, physics, x[len(keep) : p], x[p:])


def _subtract(residual: dict[Row, Array], columns: Mapping[Row, Array], values: Array) -> None:
    for row, column in columns.items():
        if row in residual:
            residual[row] = residual[row] - values @ column
