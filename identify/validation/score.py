"""Scores of a model's prediction of a run, row by row, relative to the noise floor; the run's zeros are estimated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lacet.daq.set_aside import DiskSpace
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import PhysicalEffect
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import triangle
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.sensor_offsets import PayloadSpread, Zeros, joined_zeros, with_payload, zeros_of
from lacet.identify.regression.wls import Fit, corrected_run
from lacet.identify.validation.noise_floor import SCORE_DRAWS, PiecesOfRun, simulate_floor
from lacet.identify.validation.prediction_uncertainty import Knowledge, OpenParameters, place_of
from lacet.identify.validation.whiteness import Colour, Whiteness, whiteness

FAILS = 1.2
"""Residual RMS ÷ noise floor above which a row fails."""


@dataclass(frozen=True)
class RowScore:
    """Score of one row on one run.

    `rms` of the residual [unit]; `nrmse` % of the measured span; `vaf` variance accounted for [%]; `floor` RMS that
    noise alone would leave [unit]; `ratio` residual ÷ floor.

    `colour` compares the residual's spectrum with the floor's (`validation.whiteness`; None: not compared); `p` is the
    probability that noise alone is as far above its floor in any band, `ljung_box` that of the whitened residual's
    autocorrelation, `peak` the frequency of the largest excess [Hz] (NaN without).

    `doubt` is the prediction's 1 σ from the uncertainty of the parameters ÷ floor (0 for a run used); where it explains
    the error the row is not `judged`, and `why` holds the parameters and the runs that would excite them. `samples` is
    the number of samples that `rms` is of.
    """

    row: Row
    unit: str
    rms: float
    nrmse: float
    vaf: float
    floor: float
    ratio: float
    colour: Colour | None = None
    p: float = float("nan")
    ljung_box: float = float("nan")
    peak: float = float("nan")
    doubt: float = 0.0
    judged: bool = True
    why: OpenParameters | None = None
    samples: int = 1


@dataclass(frozen=True, repr=False)
class Comparison:
    """A model's prediction of one run: measured and modelled rows after filter and decimation, with their scores.

    `t` row → (n,) s; `measured`, `modelled` row → (n,); `modelled` includes the run's sensor zeros, given in `zeros`.
    `used` says whether the model was fitted to this run; `whiteness` row → the residual's colour; `seconds` length of
    the run [s].
    """

    name: str
    t: Mapping[Row, Array]
    measured: Mapping[Row, Array]
    modelled: Mapping[Row, Array]
    scores: Mapping[Row, RowScore]
    zeros: tuple[Zeros, Array]
    used: bool
    whiteness: Mapping[Row, Whiteness]
    seconds: float

    def __repr__(self) -> str:
        ratios = ", ".join(f"{row} {score.ratio:.2f}" for row, score in self.scores.items())
        return f"Comparison(run {self.name}, error ÷ floor: {ratios})"

    def residual(self, row: Row | str) -> Array:
        """(n,) measured minus modelled of a row [N or N·m]. Raises UsageError where `row` is the name of none."""
        row = Row.parse(row)
        return self.measured[row] - self.modelled[row]


def compare(
    fitted: Fit, run: PreparedRun, draws: int = SCORE_DRAWS, seed: int = 1, knowledge: Knowledge | None = None
) -> Comparison:
    """The prediction of a run by a fitted model, with its scores.

    The run may be one that the fit used or one held out. Its sensor zeros are estimated with the sheet's σ as prior, as
    they belong to the run and not to the car. `knowledge` : that of the fit where it is computed already.
    """
    physics, payload, place = fitted.model.physics, fitted.options.payload, place_of(fitted, run)
    known = None if place is not None else knowledge or Knowledge.of(fitted)
    # The fit's own sensitivities serve again; sensor faults are removed from its runs but for the last small step.
    if place is not None and fitted.options.zeros and not fitted.model.faults:
        run, pieces = fitted.runs[place], fitted.sensitive_pieces(place)
    else:
        run, pieces = corrected_run(run, fitted), None
    return compare_values(physics, fitted.physics, run, draws, seed, known, payload, pieces)


def compare_values(
    effects: Sequence[PhysicalEffect], values: Array, run: PreparedRun, draws: int = SCORE_DRAWS, seed: int = 1,
    knowledge: Knowledge | None = None, payload: PayloadSpread | None = None, pieces: PiecesOfRun | None = None,
) -> Comparison:  # fmt: skip
    """The prediction of a run, sensor faults removed, by effects with these values (p,) of their parameters.

    `knowledge` : of the values, for a run that they were not fitted to; None for one that they were fitted to.
    `payload` : how much the runs' payloads differ, where each has its own. `pieces` of the run with its sensitivity,
    where they are known.
    """
    found: list[Zeros] = []
    space = DiskSpace()

    def sensitive(_: int) -> Iterator[tuple[PreparedRun, Sensitivity]]:
        """The run's pieces; the zeros of each are found where its sensitivity is at hand."""
        for piece, sensitivity in pieces or run.sensitive_pieces(effects, values):
            own = zeros_of(piece, sensitivity, every=run.is_long)
            found.append(own.set_aside(space) if run.is_long else own)
            yield piece, sensitivity

    noise = simulate_floor([run], sensitive, draws, seed)
    floor, zeros = noise.by_run[0], joined_zeros(found)
    if payload is not None:
        zeros = with_payload(zeros, run, payload)
    plain = {row: run.matrix(effects, row) @ values for row in run.rows}
    offsets = profile_zeros(run, zeros, {row: run.measured[row] - plain[row] for row in run.rows}, floor)
    modelled: dict[Row, Array] = {row: plain[row] + zeros.columns[row] @ offsets for row in run.rows}
    open_: Mapping[Row, tuple[float, OpenParameters | None]] = {}
    if knowledge is not None:
        open_ = knowledge.prediction(effects, run, zeros, floor)
    step, rate = run.recording.filters.step, run.recording.filters.rate
    scores: dict[Row, RowScore] = {}
    colours: dict[Row, Whiteness] = {}
    for row in run.rows:
        residual = run.measured[row] - modelled[row]
        score = score_row(row, run.measured[row], residual, floor[row])
        colour = whiteness(residual, noise.draws[0].whole(row), run.index[row] // step, step / rate)
        scores[row] = _judged(_coloured(score, colour), *open_.get(row, (0.0, None)))
        if colour is not None:
            colours[row] = colour
    t: dict[Row, Array] = {row: run.recording.t[run.index[row]] for row in run.rows}
    seconds = float(run.recording.t[-1] - run.recording.t[0])
    return Comparison(
        run.name, t, run.measured, modelled, scores, (zeros, offsets), knowledge is None, colours, seconds
    )


def _coloured(score: RowScore, colour: Whiteness | None) -> RowScore:
    if colour is None:
        return replace(score, colour=Colour.TOO_SHORT)
    return replace(score, colour=colour.colour, p=colour.p, ljung_box=colour.ljung_box, peak=colour.peak)


def _judged(score: RowScore, doubt: float, why: OpenParameters | None) -> RowScore:
    """The score of a row, not judged where its excess is within two σ of the prediction's uncertainty."""
    within = why is not None and FAILS < score.ratio <= float(np.hypot(FAILS, 2.0 * doubt))
    return replace(score, doubt=doubt, judged=not within, why=why)


def profile_zeros(run: PreparedRun, zeros: Zeros, residual: Mapping[Row, Array], floor: Mapping[Row, float]) -> Array:
    """(z,) sensor zeros of a run that explain its residual best, with the sheet's σ as prior.

    A row that the model fails in is weighted by its own error; otherwise the zeros would absorb that error and spoil
    the rows in which the model is right.
    """
    if not zeros.names:
        return np.zeros(0)
    sigma = {row: max(floor[row], float(np.std(residual[row]))) for row in run.rows}
    columns, right = dict[Row, Array](), dict[Row, Array]()
    for row in run.rows:
        columns[row], right[row] = zeros.columns[row], residual[row]
        if run.is_long:
            # The triangle of a row's equations has their least squares, and their sum of squares, in z + 1 lines.
            both = triangle(np.column_stack([columns[row], right[row]]))
            columns[row], right[row] = both[:, :-1], both[:, -1]
    counts = {row: len(residual[row]) for row in run.rows}
    return weighted_zeros(zeros.sigma, columns, right, counts, sigma, floor)


def weighted_zeros(
    priors: Array, columns: Mapping[Row, Array], right: Mapping[Row, Array], counts: Mapping[Row, int],
    sigma: Mapping[Row, float], floor: Mapping[Row, float],
) -> Array:  # fmt: skip
    """(z,) sensor zeros with 1 σ `priors` that explain a residual best, each row weighted by its own error.

    `columns` of the zeros and residual `right` by row, or the triangles of both, which have the sums of squares of
    `counts` samples; `sigma` : errors to begin with; `floor` : least of them.
    """
    values = np.zeros(len(priors))
    for _ in range(5):
        A = np.concatenate([columns[row] / sigma[row] for row in columns] + [np.diag(1.0 / priors)])
        b = np.concatenate([right[row] / sigma[row] for row in columns] + [np.zeros(len(priors))])
        values = np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], float)
        left = {row: right[row] - columns[row] @ values for row in columns}
        squares = {row: _mean(left[row] ** 2, counts[row]) for row in columns}
        sigma = {row: max(floor[row], float(np.sqrt(squares[row]))) for row in columns}
    return values


def _mean(values: Array, count: int) -> float:
    """The sum of values ÷ a number that may be larger than theirs."""
    return float(np.mean(values)) if len(values) == count else float(np.sum(values)) / count


def score_row(row: Row, measured: Array, residual: Array, floor: float) -> RowScore:
    """The score of a residual, without whiteness and prediction uncertainty."""
    rms = float(np.sqrt(np.mean(residual**2)))
    span, variance = float(np.ptp(measured)), float(np.var(measured))
    return RowScore(
        row=row,
        unit=row.unit,
        rms=rms,
        nrmse=100.0 * rms / span if span else 0.0,
        vaf=100.0 * (1.0 - float(np.var(residual)) / variance) if variance else 0.0,
        floor=floor,
        ratio=rms / floor if floor else 0.0,
        samples=int(residual.size),
    )


def fails(ratio: float) -> bool:
    """Whether a ratio of residual to noise floor is that of a row that fails."""
    return ratio > FAILS


# -- scores pooled over rows and runs, from plain data: run → row → {"rms", "floor", "ratio", "samples", …} ------------


@dataclass(frozen=True)
class RowError:
    """Error of one row over several runs.

    `rms` of the residual and `floor`, the RMS that noise alone would leave, both over the samples of all runs [unit];
    `ratio` one ÷ the other. `worst_run` is the run with the largest residual ÷ floor of its own, `worst` that ratio.
    """

    rms: float
    floor: float
    ratio: float
    worst_run: str
    worst: float


def row_errors(runs: Mapping[str, Mapping[str, Any]]) -> dict[str, RowError]:
    """Row → its error over runs.

    Scores of lacet versions that did not store `samples` count alike.
    """
    found: dict[str, list[tuple[str, Mapping[str, Any]]]] = {}
    for run, scores in runs.items():
        for row, score in scores.items():
            found.setdefault(row, []).append((run, score))
    out: dict[str, RowError] = {}
    for row, scores in found.items():
        counts = np.array([float(score.get("samples", 1)) for _, score in scores])
        rms, floor = (
            float(np.sqrt(counts @ np.square([float(score[key]) for _, score in scores]) / np.sum(counts)))
            for key in ("rms", "floor")
        )
        run, worst = max(scores, key=lambda one: one[1]["ratio"])
        out[row] = RowError(rms, floor, rms / floor if floor else 0.0, run, float(worst["ratio"]))
    return out


def row_ratios(runs: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Row → RMS residual ÷ RMS noise floor, each over the samples of all runs."""
    return {row: error.ratio for row, error in row_errors(runs).items()}


def pooled_ratio(runs: Mapping[str, Mapping[str, Any]]) -> float:
    """Root mean square over the rows of their residual ÷ floor (`row_ratios`): 1 is the floor; NaN without any."""
    ratios = list(row_ratios(runs).values())
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else float("nan")


def worst_row(runs: Mapping[str, Mapping[str, Any]]) -> tuple[str, float]:
    """The row farthest above its floor in a single run, as ``run: row``, and its ratio."""
    found = [(f"{run}: {row}", s["ratio"]) for run, part in runs.items() for row, s in part.items()]
    return max(found, key=lambda item: item[1], default=("none", 0.0))


def failing_rows(runs: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Rows that fail in any run, in alphabetical order."""
    return sorted({row for part in runs.values() for row, score in part.items() if fails(score["ratio"])})
