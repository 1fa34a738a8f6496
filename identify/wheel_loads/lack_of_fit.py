"""What a study's runs say of its instruments, and what they leave beyond these: lack of fit, row by row."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.tolerances import SheetEntry, sheet_responses
from lacet.identify.regression.uncertainty import BLOCK
from lacet.identify.regression.wls import Fit, corrected_run
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import Comparison
from lacet.identify.wheel_loads.known_car import Instruments, KnownCar, parameter_errors

_FREE = 1e-6
"""Strength of the prior of the parameters' errors in what the runs say of instruments: nearly none, as a fit's residual
is orthogonal to its columns at the fit's own weights only."""


def known_car(fitted: Fit, knowledge: Knowledge, compared: Iterable[tuple[PreparedRun, Comparison]]) -> KnownCar:
    """The car of a fit with its lack of fit and with what runs say of the instruments' latencies.

    A late or wrongly scaled dynamometer leaves a residual in runs that have it, and none in wheel forces of a run
    without: such a residual is no lack of fit. Errors of the parameters and of the instruments, each with its σ as
    prior, are estimated from each run; what remains beyond its floor is lack of fit, the RMS over runs. With it in the
    weights, all runs together say how late instruments are compared with each other. Of gains they are not asked:
    noise of a measured force is in its residual as well, where it looks like a gain.

    `compared` : runs with the fit's prediction of each, of runs held out where there are any; of runs used the lack of
    fit is too small by what their own fit explains.
    """
    entries = tuple(fitted.sheet_moves)
    errors = parameter_errors(fitted, knowledge, apart=entries)
    runs = [_RunErrors.of(fitted, errors, entries, run, part) for run, part in compared]
    squares: dict[Row, list[float]] = {}
    for run in runs:
        for row, square in run.beyond().items():
            squares.setdefault(row, []).append(square)
    lack = {row: float(np.sqrt(np.mean(values))) for row, values in squares.items()}
    q, k = errors.shape[1], errors.shape[1] + len(entries)
    normal, right = np.zeros((k, k)), np.zeros(k)
    for run in runs:
        own, side = run.common(run.variance(lack))
        normal, right = normal + own, right + side
    late = [i for i, entry in enumerate(entries, q) if entry[0] == "latency"]
    others = [i for i in range(k) if i not in late]
    prior = np.diag(np.where(np.array(others) < q, _FREE, 1.0))
    between = normal[np.ix_(others, late)]
    beside = np.column_stack([between, right[others]])
    taken = np.asarray(np.linalg.solve(normal[np.ix_(others, others)] + prior, beside), float)
    instruments = Instruments(
        tuple(entry for entry in entries if entry[0] == "latency"),
        normal[np.ix_(late, late)] - between.T @ taken[:, :-1],
        right[late] - between.T @ taken[:, -1],
    )
    return KnownCar(fitted, lack, knowledge=knowledge, instruments=instruments)


@dataclass(frozen=True)
class _RunErrors:
    """Residual of a run with all constants that it depends on.

    Attributes
    ----------
    residual : row → (n,), the run's zeros not taken away.
    columns : row → (n, k) change of it for one σ of each error of the parameters and each entry of the sensor sheet,
        which moves the fit's parameters as well; `zeros` : row → (n, z) for one σ of each of the run's zeros.
    floor, rms : row → noise floor, and RMS of the residual without the zeros [unit].
    alike : number of samples in which errors other than noise stay the same.
    """

    residual: Mapping[Row, Array]
    columns: Mapping[Row, Array]
    zeros: Mapping[Row, Array]
    floor: Mapping[Row, float]
    rms: Mapping[Row, float]
    alike: float

    @classmethod
    def of(
        cls, fitted: Fit, errors: Array, entries: tuple[SheetEntry, ...], run: PreparedRun, part: Comparison
    ) -> _RunErrors:
        """Of a run with the fit's prediction of it; `errors` (p, q) of the parameters, one σ each."""
        (zeros, offsets), filters = part.zeros, run.recording.filters
        columns = _columns(fitted, errors, entries, corrected_run(run, fitted), part)
        return cls(
            {row: part.residual(row) + zeros.columns[row] @ offsets for row in part.scores},
            columns,
            {row: zeros.columns[row] * zeros.sigma for row in part.scores},
            {row: score.floor for row, score in part.scores.items()},
            {row: score.rms for row, score in part.scores.items()},
            BLOCK * filters.rate / filters.step,
        )

    def variance(self, lack: Mapping[Row, float]) -> dict[Row, float]:
        """Row → variance of a sample that counts as independent, the lack of fit as it lasts."""
        return {row: floor**2 + self.alike * lack.get(row, 0.0) ** 2 for row, floor in self.floor.items()}

    def common(self, variance: Mapping[Row, float]) -> tuple[Array, Array]:
        """(k, k) normal matrix and (k,) right side of the constants but the zeros, which are eliminated."""
        normal, right, k = self._equations(variance)
        taken = np.linalg.solve(normal[k:, k:], np.column_stack([normal[k:, :k], right[k:]]))
        return normal[:k, :k] - normal[:k, k:] @ taken[:, :-1], right[:k] - normal[:k, k:] @ taken[:, -1]

    def beyond(self) -> dict[Row, float]:
        """Row → mean square of the residual, without what the constants explain, beyond that of noise."""
        # As the zeros of a run are weighted: a row that the model fails in counts less.
        normal, right, k = self._equations({row: max(self.floor[row], rms) ** 2 for row, rms in self.rms.items()})
        normal[:k, :k] += np.eye(k)
        found = np.linalg.solve(normal, right)
        return {
            row: max(0.0, float(np.mean((one - self._all(row) @ found) ** 2)) - self.floor[row] ** 2)
            for row, one in self.residual.items()
        }

    def _equations(self, variance: Mapping[Row, float]) -> tuple[Array, Array, int]:
        """Normal matrix and right side of all constants, those of the zeros, from the k-th on, with their priors."""
        k, z = (next(iter(part.values())).shape[1] for part in (self.columns, self.zeros))
        normal = np.diag(np.concatenate([np.zeros(k), np.ones(z)]))
        right = np.zeros(k + z)
        for row, series in self.residual.items():
            both = self._all(row)
            normal += both.T @ both / variance[row]
            right += both.T @ series / variance[row]
        return normal, right, k

    def _all(self, row: Row) -> Array:
        return np.concatenate([self.columns[row], self.zeros[row]], axis=1)


def _columns(
    fitted: Fit, errors: Array, entries: tuple[SheetEntry, ...], run: PreparedRun, part: Comparison
) -> dict[Row, Array]:
    """Row → (n, k) change of a run's residual for one σ of each error of the parameters and each entry."""
    physics = fitted.model.physics
    size = fitted.model.physics_size
    moves = np.array([fitted.sheet_moves[entry][:size] for entry in entries]).reshape(len(entries), size)
    by_parameter = np.concatenate([errors, -moves.T], axis=1)
    out = {row: np.zeros((t.size, by_parameter.shape[1])) for row, t in part.t.items()}
    q = errors.shape[1]
    for piece, sensitivity in run.sensitive_pieces(physics, fitted.physics):
        responses: Mapping[SheetEntry, Mapping[Row, Array]] = sheet_responses(piece, sensitivity)
        for row in piece.rows:
            own = np.searchsorted(part.t[row], piece.recording.t[piece.index[row]] - 1e-6)
            out[row][own] = piece.matrix(physics, row) @ by_parameter
            for k, entry in enumerate(entries):
                if row in responses.get(entry, {}):
                    out[row][own, q + k] += responses[entry][row]
    return out
