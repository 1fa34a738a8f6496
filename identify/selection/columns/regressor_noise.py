"""Noise in the columns: its contribution to the cross products of a ranking.

A column made of noisy channels is correlated with the residual, which the same noise is in: without this, a law that
follows a rate sensor's noise looks like an effect, and so does the scale of a noisy sensor. One draw of noise added and
the same draw subtracted leave the products of errors and the mean shift of bent laws, as in
`regression.corrected_scores` for the fit. It depends on the motion and hardly on the noise of a run, so it is found
once and stored with the noise floor.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.weighted_columns import Weighting, columns_of
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class RowNoise:
    """Expected products of the noise in the columns on one row of a run.

    Attributes
    ----------
    places : (a,) places of the columns that act on the row, the residual last.
    products : (a, a) products.
    across : (z, a) products with the columns of the run's zeros.
    """

    places: NDArray[np.intp]
    products: Array
    across: Array

    def at(self, weights: Array) -> RowNoise:
        """The noise of other columns, which are combinations (v, w) of these."""
        part = weights[:, self.places]
        there = np.flatnonzero(np.any(part, axis=1))
        part = part[there]
        return RowNoise(there, combined(part, self.products), _combined(part, self.across.T).T)


@dataclass(frozen=True)
class RunNoise:
    """Expected products of the noise in the columns of one run, or of several whose zeros are eliminated already.

    Attributes
    ----------
    rows : row → its noise.
    run : number of the run, which has `priors` (z,), 1 σ of its zeros, and `values` (z,), which the residual is
        without; none where zeros are eliminated.
    regression : (z, w) regression of the columns on the zeros, in the zeros' units; None for that of the sums whose
        noise it is.
    """

    rows: Mapping[Row, RowNoise]
    run: int = 0
    priors: Array = field(default_factory=lambda: np.zeros(0))
    values: Array = field(default_factory=lambda: np.zeros(0))
    regression: Array | None = None

    @classmethod
    def of_totals(cls, totals: Mapping[Row, Array]) -> RunNoise:
        """That of products (w, w) by row, zeros eliminated."""
        return cls({
            row: RowNoise(np.arange(len(total)), total, np.zeros((0, len(total)))) for row, total in totals.items()
        })  # fmt: skip

    def at(self, weights: Array) -> RunNoise:
        """The noise of other columns, which are combinations (v, w) of these."""
        regression = None if self.regression is None else self.regression @ weights.T
        return replace(self, rows={row: one.at(weights) for row, one in self.rows.items()}, regression=regression)

    def at_zeros(self, weighting: Weighting, zero_gain: Array) -> RunNoise:
        """The noise with the regression on the zeros as `zero_gain` (z, w) has it, that of weighted zeros.

        Of the model the columns as they are, not turned.
        """
        if self.regression is not None or not len(self.priors):
            return self
        p, priors = weighting.layout.model, self.priors / weighting.prior_stiffening
        regression = priors[:, None] * zero_gain
        regression[:, :p] = np.linalg.solve(weighting.turn.T, regression[:, :p].T).T
        # The right side here is the residual, from which the zeros that were found are taken already.
        regression[:, weighting.layout.right] -= self.values
        return replace(self, regression=regression)

    def eliminated(self, weighting: Weighting, zero_gain: Array, scales: Mapping[Row, float]) -> Array:
        """(w, w) products of all rows, each times its scale, zeros eliminated; `zero_gain` as of `at_zeros`."""
        z, w = len(self.priors), weighting.layout.width
        out, across = np.zeros((w, w)), np.zeros((z, w))
        for row, one in self.rows.items():
            if scale := scales.get(row, 0.0):
                out[np.ix_(one.places, one.places)] += scale * one.products
                across[:, one.places] += scale * one.across
        if (regression := self.at_zeros(weighting, zero_gain).regression) is not None:
            explained = regression.T @ across
            out -= explained
            out -= explained.T
        return out


@dataclass(frozen=True)
class RegressorNoise:
    """Expected products of the noise in the columns: the errors-in-variables correction of the cross products.

    Attributes
    ----------
    labels : descriptions of the columns, by which stored noise is recognised as valid.
    runs : noise of each run, for the model's original columns.
    sigma : row → σ of the weights in it [N or N·m].
    """

    labels: tuple[str, ...]
    runs: tuple[RunNoise, ...]
    sigma: Mapping[Row, float]

    @classmethod
    def of(cls, fitted: Fit, layout: Layout, sigma: Mapping[Row, float], progress: Progress = silent) -> RegressorNoise:
        """Noise of all runs from simulated draws, weighted by the rows' `sigma`; `progress` receives the draws done."""
        pairs = pairs_drawn(float(np.ptp(drive.recording.t)) for drive in fitted.runs)
        done, total = itertools.count(1), pairs * sum(drive.piece_count for drive in fitted.runs)

        def drawn() -> None:
            progress(Step(Stage.REGRESSOR_NOISE, next(done), total))

        runs = tuple(noise_of_run(fitted, layout, sigma, run, pairs, drawn) for run in range(len(fitted.runs)))
        return cls(regressor_labels(fitted, layout), runs, dict(sigma))

    @classmethod
    def of_run(cls, fitted: Fit, layout: Layout, sigma: Mapping[Row, float], run: int, pairs: int) -> RegressorNoise:
        """Noise of one run."""
        found = noise_of_run(fitted, layout, sigma, run, pairs)
        return cls(regressor_labels(fitted, layout), (found,), {row: sigma[row] for row in found.rows})

    def matches(self, labels: tuple[str, ...], rows: Iterable[Row]) -> bool:
        """Whether it was computed for these columns and rows: stored noise may be that of others."""
        return labels == self.labels and set(rows) <= self.sigma.keys()

    def at(self, labels: tuple[str, ...], weights: Array) -> RegressorNoise:
        """The noise of other columns, described by `labels`: combinations (v, w) of these."""
        return replace(self, labels=labels, runs=tuple(run.at(weights) for run in self.runs))

    def products(
        self, sums: CrossProducts, noise_ratio: Mapping[Row, float], sigma: Mapping[Row, float],
        layout: Layout | None = None,
    ) -> Array:  # fmt: skip
        """(w, w) products of the noise in the columns of `sums`, rows `noise_ratio` times as noisy.

        `layout` : of the columns whose noise this is, if `sums` has more behind them.
        """
        layout = layout or sums.layout
        weighting, turn, p = replace(sums.weighting, layout=layout), sums.turn, layout.model
        places = np.append(np.arange(layout.right), sums.layout.right)
        scales = {row: (ratio * self.sigma[row] / sigma[row]) ** 2 for row, ratio in noise_ratio.items()
                  if row in self.sigma}  # fmt: skip
        gains = sums.over_runs.zero_gains
        out = np.zeros((layout.width,) * 2)
        for run in self.runs:
            out += run.eliminated(weighting, gains[run.run][:, places], scales)
        out[:p] = turn.T @ out[:p]
        out[:, :p] = out[:, :p] @ turn
        out[-1, -1] = 0.0
        return out

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The noise as plain arrays for storage."""
        out: dict[str, NDArray[Any]] = {"labels": np.array(self.labels)}
        out |= {f"sigma|{row}": np.array(sigma) for row, sigma in self.sigma.items()}
        for i, run in enumerate(self.runs):
            out |= {f"run|{i}": np.array(run.run), f"priors|{i}": run.priors, f"values|{i}": run.values}
            out |= {} if run.regression is None else {f"regression|{i}": run.regression}
            for row, one in run.rows.items():
                out |= {f"places|{i}|{row}": one.places, f"products|{i}|{row}": one.products}
                out[f"across|{i}|{row}"] = one.across
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> RegressorNoise:
        """The noise from stored arrays, the inverse of `arrays`."""
        rows: dict[str, dict[Row, RowNoise]] = {}
        for name in arrays:
            what, _, place = name.partition("|")
            if what == "places":
                i, _, row = place.partition("|")
                found = RowNoise(arrays[name].astype(np.intp), arrays[f"products|{place}"], arrays[f"across|{place}"])
                rows.setdefault(i, {})[Row.parse(row)] = found
        numbers = [name.partition("|")[2] for name in arrays if name.startswith("run|")]
        runs = (
            RunNoise(
                rows.get(i, {}), int(arrays[f"run|{i}"]), arrays[f"priors|{i}"], arrays[f"values|{i}"],
                arrays.get(f"regression|{i}"),
            )
            for i in numbers
        )  # fmt: skip
        sigma = {Row.parse(n.partition("|")[2]): float(arrays[n]) for n in arrays if n.startswith("sigma|")}
        return cls(tuple(str(label) for label in arrays["labels"]), tuple(runs), sigma)


def combined(weights: Array, products: Array) -> Array:
    """(v, v) products of combinations, by `weights` (v, w), of columns that have these symmetric products (w, w)."""
    return _combined(weights, _combined(weights, products).T)


def _combined(weights: Array, columns: Array) -> Array:
    """(v, n) `weights` (v, w) @ `columns` (w, n): most of these combinations are one column as it is, or none."""
    if not len(columns):
        return np.zeros((len(weights), columns.shape[1]))
    one = np.argmax(weights != 0.0, axis=1)
    out = columns[one] * weights[np.arange(len(weights)), one][:, None]
    several = np.count_nonzero(weights, axis=1) > 1
    out[several] = weights[several] @ columns
    return out


def regressor_labels(fitted: FittedModel, layout: Layout) -> tuple[str, ...]:
    """Descriptions of the columns of model and layout."""
    return (*fitted.columns, *layout.labels)


def pairs_drawn(seconds: Iterable[float]) -> int:
    """Number of pairs of draws of the noise in all columns of runs of these lengths [s].

    None of the data is left out: by how much noise shifts the mean of a bent law depends on how the car moves.
    """
    return SELECTION.noise_pairs if sum(seconds) <= SELECTION.noise_seconds else 1


def noise_of_run(
    fitted: Fit, layout: Layout, sigma: Mapping[Row, float], run: int, pairs: int,
    drawn: Callable[[], None] = lambda: None,
) -> RunNoise:  # fmt: skip
    """Noise in the columns of one run, from so many pairs of draws."""
    _, priors, values = fitted.zeros[run]
    whole: dict[Row, RowNoise] = {}

    def of_piece(piece: Piece) -> Mapping[Row, RowNoise]:
        return _piece_products(fitted, layout, sigma, piece, pairs, drawn)

    # Mapped, so that a piece's motion and slopes are gone before the next piece is made.
    for found in map(of_piece, fitted.assembly.pieces_of(run)):
        for row, one in found.items():
            whole[row] = _both(whole[row], one) if row in whole else one
    return RunNoise(whole, run, priors, values)


def _both(first: RowNoise, second: RowNoise) -> RowNoise:
    """The noise of two pieces of a run, added."""
    places = np.union1d(first.places, second.places)
    out = RowNoise(places, np.zeros((len(places),) * 2), np.zeros((len(first.across), len(places))))
    for one in (first, second):
        at = np.searchsorted(places, one.places)
        out.products[np.ix_(at, at)] += one.products
        out.across[:, at] += one.across
    return out


def _piece_products(
    fitted: Fit, layout: Layout, sigma: Mapping[Row, float], piece: Piece, pairs: int, drawn: Callable[[], None]
) -> dict[Row, RowNoise]:
    """Row → noise in a piece; the residual is without the zeros that the fit found."""
    values = fitted.zeros[piece.run][2]
    z, p = len(values), layout.model
    clean = dict(columns_of(fitted, layout, piece, sigma))
    zeros = {row: block[:, :z] / sigma[row] for row, block in piece.blocks.items()}
    # The right side is the fit's own residual, so that the mean shift of a bent law meets no static load.
    for row, (columns, _) in clean.items():
        columns[:, -1] -= columns[:, :p] @ fitted.solution + zeros[row] @ values
    place = (piece.seed,) if piece.number is None else (piece.seed, piece.number)
    out = {
        row: RowNoise(active, np.zeros((active.size, active.size)), np.zeros((z, active.size)))
        for row, (_, active) in clean.items()
    }
    for draw in range(pairs):
        for noisy in piece.noisy([2003, *place, draw]):
            for row, (columns, active) in columns_of(fitted, layout, piece, sigma, noisy):
                columns[:, -1] -= columns[:, :p] @ fitted.solution + zeros[row] @ values
                before, there = clean[row]
                # A column without any entry on this run may have some with more noise.
                columns, one = columns[:, np.isin(active, there)], out[row]
                one.products[...] += (columns.T @ columns - before.T @ before) / (2 * pairs)
                one.across[...] += zeros[row].T @ (columns - before) / (2 * pairs)
        drawn()
    return out
