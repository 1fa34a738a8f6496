"""What a fit leaves of runs beyond sensor noise, uncertain parameters and the sensor sheet's tolerances, row by row."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.tolerances import SheetEntry, sheet_entries, sheet_responses
from lacet.identify.regression.wls import Fit, corrected_run
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import Comparison
from lacet.identify.wheel_loads.known_car import parameter_errors


def lack_of_fit(
    fitted: Fit, knowledge: Knowledge, compared: Iterable[tuple[PreparedRun, Comparison]]
) -> dict[Row, float]:
    """Row → RMS over runs of what the residual has beyond its floor, parameter errors and tolerances [N or N·m].

    A late or wrongly scaled dynamometer leaves a residual in runs that have it, and none in wheel forces of a run
    without: such a residual is no lack of fit. Parameter errors and tolerances, each with its σ as prior, are
    estimated from each run.

    `compared` : runs with the fit's prediction of each, of runs held out where there are any; of runs used it is too
    small by what their own fit explains.
    """
    errors = parameter_errors(fitted, knowledge)
    squares: dict[Row, list[float]] = {}
    for run, part in compared:
        for row, square in _beyond(fitted, errors, run, part).items():
            squares.setdefault(row, []).append(square)
    return {row: float(np.sqrt(np.mean(values))) for row, values in squares.items()}


def _beyond(fitted: Fit, errors: Array, run: PreparedRun, part: Comparison) -> dict[Row, float]:
    """Row → mean square of a run's residual, without what errors and tolerances explain, beyond that of noise."""
    residual = {row: part.residual(row) for row in part.scores}
    # As the zeros of a run are weighted: a row that the model fails in counts less.
    sigma = {row: max(score.floor, score.rms) for row, score in part.scores.items()}
    columns = _columns(fitted, errors, corrected_run(run, fitted), part)
    q = next(iter(columns.values())).shape[1]
    normal, right = np.eye(q), np.zeros(q)
    for row, block in columns.items():
        normal += block.T @ block / sigma[row] ** 2
        right += block.T @ residual[row] / sigma[row] ** 2
    found = np.linalg.solve(normal, right)
    return {
        row: max(0.0, float(np.mean((residual[row] - block @ found) ** 2)) - part.scores[row].floor ** 2)
        for row, block in columns.items()
    }


def _columns(fitted: Fit, errors: Array, run: PreparedRun, part: Comparison) -> dict[Row, Array]:
    """Row → (n, q) change of a run's residual for one σ of each error of the parameters and each tolerance."""
    physics, recording = fitted.model.physics, run.recording
    entries: list[SheetEntry] = [*sheet_entries(recording.rig, recording.signals.value, recording.assumptions)]
    out = {row: np.zeros((t.size, errors.shape[1] + len(entries))) for row, t in part.t.items()}
    for piece, sensitivity in run.sensitive_pieces(physics, fitted.physics):
        responses: Mapping[SheetEntry, Mapping[Row, Array]] = sheet_responses(piece, sensitivity)
        for row in piece.rows:
            own = np.searchsorted(part.t[row], piece.recording.t[piece.index[row]] - 1e-6)
            out[row][own, : errors.shape[1]] = piece.matrix(physics, row) @ errors
            for k, entry in enumerate(entries):
                if row in responses.get(entry, {}):
                    out[row][own, errors.shape[1] + k] = responses[entry][row]
    return out
