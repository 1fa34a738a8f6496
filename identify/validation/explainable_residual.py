"""Explainable residual: the part of a model's residual that smooth functions of the measured states predict.

The residual of each row is predicted by a ridge regression on smooth functions of the row's states, cross-validated in
blocks of two seconds; then on those and the states' history. What is predicted comes from an effect that the model
lacks, whether the catalogue has it or not. The same regression on simulated residuals of a model that lacks nothing
gives the null distribution.

Not detected: a force that depends on something neither measured nor driven by what is measured (a gust), a step in
time, a law rougher than the broken lines used here, an event in one block only. A hidden state (a mass on a mount, a
liquid, a spring behind a damper) is no function of the present states: it shows as `history`.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.blocks import block_numbers
from lacet.identify.validation.cross_validation import FOLDS, FoldSums, best, missed
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.identify.validation.projected_noise import Draws, refitted_draws
from lacet.identify.validation.residual_samples import Samples
from lacet.identify.validation.smooth_regressors import SHARES, ColumnMaker
from lacet.identify.validation.states import ClearStates

SIGNIFICANCE = 0.05
MATTERS = 0.1
"""Part of the excess over the floor above which a dependence on history is reported."""
_LEAST_PART = 0.02
"""Lower bound of the 95 % level of chance by which rows are made comparable, as a part of the row's squares."""


@dataclass(frozen=True)
class ExplainableResidual:
    """The explainable residual of one row, over all runs.

    Attributes
    ----------
    row, unit : the row and its unit, N or N·m.
    rms, floor : RMS of the residual, and RMS that noise and the sensor sheet's tolerances leave after the same fit
        [unit].
    part : part of the residual's squares that smooth functions of the present states predict, cross-validated; `low`,
        `high` its 95 % interval by blocks; `usual` the 95 % quantile of the same part in simulated runs.
    p : probability that chance predicts as much in this row; `p_all` family-wise, in any row.
    part_rms : RMS of the part predicted [unit].
    history : part of the residual's squares that the states' history predicts in addition; `history_usual`,
        `history_p`, `history_p_all`, `history_rms` as above.
    of_excess : `part` relative to the part of the squares above the floor; NaN where nothing is above it.
    history_of_excess : the same for `history`.
    states : number of states with little enough noise to be used.
    """

    row: Row
    unit: str
    rms: float
    floor: float
    part: float
    low: float
    high: float
    usual: float
    p: float
    p_all: float
    part_rms: float
    history: float
    history_usual: float
    history_p: float
    history_p_all: float
    history_rms: float
    of_excess: float
    history_of_excess: float
    states: int

    @property
    def something(self) -> bool:
        """Whether smooth functions of the states explain more than chance does in any row (family-wise p ≤ 0.05)."""
        return self.p_all <= SIGNIFICANCE

    @property
    def depends_on_history(self) -> bool:
        """Whether the states' history explains more than chance, and at least `MATTERS` of the excess."""
        return self.history_p_all <= SIGNIFICANCE and self.history_of_excess >= MATTERS


def explainable_residual(
    fitted: Fit, floor: NoiseFloor, clear: ClearStates | None = None, draws: Draws | None = None,
    progress: Progress = silent,
) -> dict[Row, ExplainableResidual]:  # fmt: skip
    """The explainable residual of each row, on the runs a model was fitted to.

    `floor` : simulated draws, at least 19 for p = 0.05; `clear`, `draws` : those of this fit where they are computed
    already (`validation.states`, `validation.projected_noise`). Rows with fewer than two blocks for each fold are left
    out. `progress` receives the number of rows done.
    """
    clear = clear or ClearStates(fitted.runs)
    draws = draws or refitted_draws(fitted, floor)
    maker = ColumnMaker(clear)
    groups: dict[Hashable, list[Row]] = {}
    for row in fitted.rows:
        names = clear.names(row)
        if names and np.unique(block_numbers(fitted.runs, row)).size >= 2 * FOLDS:
            groups.setdefault(maker.group(row, names), []).append(row)
    found: dict[Row, tuple[Array, Array, Array, float, int]] = {}
    for rows in groups.values():
        progress(Step(Stage.EXPLAINABLE_RESIDUAL, len(found), sum(map(len, groups.values()))))
        # Rows with the same columns are predicted together: most of the work is in these.
        names = clear.names(rows[0])
        samples = Samples.of(fitted, draws, rows, maker.columns(rows[0], names))
        sums = FoldSums.of(samples)
        present = sums.ridges(np.arange(samples.columns.of.size))
        weights = np.ones((len(SHARES), samples.columns.stored.size))
        weights[:, samples.columns.of.size :] = np.array(SHARES)[:, None]
        every = np.arange(samples.columns.stored.size)
        more = best([present, *(sums.ridges(every, share) for share in weights)])
        losses = missed(samples, [best([present])[1], more[1]], samples.blocks)
        for row, place in samples.places.items():
            whole, least, beyond = (part[:, place] for part in losses)
            noise = float(
                np.sqrt(np.sum(sums.squares[:, place][:, 1:]) / (sums.counts.sum() * (place.stop - place.start - 1)))
            )
            found[row] = (whole, least, beyond, noise, len(names))
    parts = {row: 1.0 - least.sum(axis=0) / all_.sum(axis=0) for row, (all_, least, *_) in found.items()}
    histories = {row: 1.0 - more.sum(axis=0) / least.sum(axis=0) for row, (_, least, more, *_) in found.items()}
    wholes = {row: all_.sum(axis=0) for row, (all_, *_) in found.items()}
    p = _family_wise({row: parts[row] * wholes[row] for row in found}, wholes)
    beyond = {row: (least - more).sum(axis=0) for row, (_, least, more, *_) in found.items()}
    history_p = _family_wise(beyond, wholes)
    return {
        row: _of_row(fitted, row, *found[row], (parts[row], *p[row]), (histories[row], *history_p[row]))
        for row in fitted.rows
        if row in found
    }


def _family_wise(predicted: Mapping[Row, Array], wholes: Mapping[Row, Array]) -> dict[Row, tuple[float, float]]:
    """Row → p of its first value among its own draws, and family-wise among the largest of all rows in each draw.

    Rows are compared by the squares predicted, each in units of its draws' own 95 % level (max-score statistic), so
    that a row with a wide null distribution does not hide the others. Squares and not parts: a draw with a late sensor
    leaves a small residual, most of which is predicted. `wholes` : row → total squares, which bound that unit from
    below.
    """
    if not predicted:
        return {}
    sizes: dict[Row, Array] = {}
    for row, x in predicted.items():
        unit = max(_LEAST_PART * float(np.median(wholes[row][1:])), float(np.quantile(x[1:], 0.95)))
        sizes[row] = x / unit
    largest = np.max([x[1:] for x in sizes.values()], axis=0)

    def chance(value: float, draws: Array) -> float:
        return float((1 + np.count_nonzero(draws >= value)) / (1 + draws.size))

    return {row: (chance(float(x[0]), x[1:]), chance(float(x[0]), largest)) for row, x in sizes.items()}


def _of_row(
    fitted: Fit, row: Row, whole: Array, least: Array, more: Array, floor: float, states: int,
    present: tuple[Array, float, float], history: tuple[Array, float, float],
) -> ExplainableResidual:  # fmt: skip
    count = sum(len(part[row]) for part in fitted.residual if row in part)
    total = float(whole[:, 0].sum())
    rms = float(np.sqrt(total / count))
    part, usual = float(present[0][0]), float(np.quantile(present[0][1:], 0.95))
    beyond = float((least[:, 0] - more[:, 0]).sum()) / total
    half = TWO_SIDED_95 * _spread(whole[:, 0], least[:, 0])
    excess = 1.0 - floor**2 / rms**2
    above = excess > 0.0
    return ExplainableResidual(
        row=row, unit=row.unit, rms=rms, floor=floor,
        part=part, low=max(0.0, part - half), high=min(1.0, part + half), usual=usual,
        p=present[1], p_all=present[2], part_rms=rms * float(np.sqrt(max(0.0, part))),
        history=beyond, history_usual=float(np.quantile(history[0][1:], 0.95)) * (1.0 - part),
        history_p=history[1], history_p_all=history[2], history_rms=rms * float(np.sqrt(max(0.0, beyond))),
        of_excess=part / excess if above else float("nan"),
        history_of_excess=beyond / excess if above else float("nan"),
        states=states,
    )  # fmt: skip


def _spread(whole: Array, remaining: Array) -> float:
    """1 σ of 1 − Σ remaining ÷ Σ whole, by linearisation of the ratio over blocks."""
    ratio = float(remaining.sum() / whole.sum())
    count = whole.size
    return float(np.sqrt(count / (count - 1.0) * np.sum((remaining - ratio * whole) ** 2)) / whole.sum())
