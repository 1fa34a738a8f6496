"""How well a fitted model predicts a run: by row, after that run's own sensor zeros, in units of the noise floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from identify.drive import Drive
from identify.fit import Fit, corrected_drive
from identify.floor import simulate_floor
from identify.rows import row_unit
from identify.sensitivity import Sensitivity
from identify.vectors import Array
from identify.zeros import Zeros, zeros_of


@dataclass(frozen=True)
class RowScore:
    """One row of one run.

    `rms` of the residual [unit]; `nrmse` % of the measured span; `vaf` % of the measured variance; `floor` RMS that
    noise alone would leave [unit]; `ratio` residual ÷ floor.
    """

    row: str
    unit: str
    rms: float
    nrmse: float
    vaf: float
    floor: float
    ratio: float


@dataclass(frozen=True)
class Comparison:
    """A model against one run: measured and modelled rows after filter and decimation, with scores.

    `t` row → (n,) s; `measured`, `modelled` row → (n,); `modelled` includes the run's sensor zeros, given in `zeros`.
    """

    name: str
    t: Mapping[str, Array]
    measured: Mapping[str, Array]
    modelled: Mapping[str, Array]
    scores: Mapping[str, RowScore]
    zeros: tuple[Zeros, Array]

    def residual(self, row: str) -> Array:
        """(n,) measured minus modelled."""
        return self.measured[row] - self.modelled[row]


def compare(fitted: Fit, drive: Drive, draws: int = 20, seed: int = 1) -> Comparison:
    """Predict a run with a fitted model and score it.

    The run may be one of those used or one held out. Its sensor zeros are estimated with the sheet's σ as prior, as
    they belong to the run and not to the car.
    """
    drive = corrected_drive(drive, fitted)
    sensitivity = Sensitivity.of(drive.recording, fitted.model.physics, fitted.physics)
    floor = simulate_floor([drive], [sensitivity], draws, seed).by_drive[0]
    zeros = zeros_of(drive, sensitivity)
    plain = {row: drive.matrix(fitted.model.physics, row) @ fitted.physics for row in drive.rows}
    values = profile_zeros(drive, zeros, {row: drive.measured[row] - plain[row] for row in drive.rows}, floor)
    modelled = {row: plain[row] + zeros.columns[row] @ values for row in drive.rows}
    scores = {
        row: score_row(row, drive.measured[row], drive.measured[row] - modelled[row], floor[row]) for row in drive.rows
    }
    t = {row: drive.motion.t[drive.index[row]] for row in drive.rows}
    return Comparison(drive.name, t, drive.measured, modelled, scores, (zeros, values))


def profile_zeros(drive: Drive, zeros: Zeros, residual: Mapping[str, Array], floor: Mapping[str, float]) -> Array:
    """(z,) the run's zeros that explain its residual best, under the sheet's prior.

    A row that the model fails in is weighted by its own error, else the zeros would soak that error up and spoil the
    rows in which the model is right.
    """
    values = np.zeros(len(zeros.names))
    if not zeros.names:
        return values
    sigma = {row: max(floor[row], float(np.std(residual[row]))) for row in drive.rows}
    for _ in range(5):
        A = np.concatenate([zeros.columns[row] / sigma[row] for row in drive.rows] + [np.diag(1.0 / zeros.sigma)])
        b = np.concatenate([residual[row] / sigma[row] for row in drive.rows] + [np.zeros(len(zeros.names))])
        values = np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], float)
        left = {row: residual[row] - zeros.columns[row] @ values for row in drive.rows}
        sigma = {row: max(floor[row], float(np.sqrt(np.mean(left[row] ** 2)))) for row in drive.rows}
    return values


def score_row(row: str, measured: Array, residual: Array, floor: float) -> RowScore:
    """Score a residual."""
    rms = float(np.sqrt(np.mean(residual**2)))
    span, variance = float(np.ptp(measured)), float(np.var(measured))
    return RowScore(
        row=row,
        unit=row_unit(row),
        rms=rms,
        nrmse=100.0 * rms / span if span else 0.0,
        vaf=100.0 * (1.0 - float(np.var(residual)) / variance) if variance else 0.0,
        floor=floor,
        ratio=rms / floor if floor else 0.0,
    )
