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
from dataclasses import dataclass, replace
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
from lacet.identify.selection.columns.run_products import at_zeros
from lacet.identify.selection.columns.weighted_columns import Weighting, columns_of
from lacet.identify.selection.settings import SELECTION

_Products = dict[Row, tuple[NDArray[np.intp], Array]]


@dataclass(frozen=True)
class RegressorNoise:
    """Expected products of the noise in the columns: the errors-in-variables correction of the cross products.

    Attributes
    ----------
    labels : descriptions of the columns, by which stored noise is recognised as valid.
    totals : row → (w, w) products of the noise, for the model's original columns, every run's zeros eliminated.
    sigma : row → σ of the weights in them [N or N·m].
    """

    labels: tuple[str, ...]
    totals: Mapping[Row, Array]
    sigma: Mapping[Row, float]

    @classmethod
    def of(
        cls, fitted: Fit, sums: CrossProducts, sigma: Mapping[Row, float], progress: Progress = silent
    ) -> RegressorNoise:
        """Noise of all runs from simulated draws, weighted by the rows' `sigma`; `progress` receives the draws done."""
        totals = {row: np.zeros((sums.layout.width,) * 2) for row in sigma}
        pairs = pairs_drawn(float(np.ptp(drive.recording.t)) for drive in fitted.runs)
        done, total = itertools.count(1), pairs * sum(drive.piece_count for drive in fitted.runs)

        def drawn() -> None:
            progress(Step(Stage.REGRESSOR_NOISE, next(done), total))

        for run, gain in enumerate(sums.over_runs.zero_gains):
            for row, products in noise_of_run(fitted, sums.weighting, gain, sigma, run, pairs, drawn).items():
                totals[row] += products
        return cls(regressor_labels(fitted, sums.layout), totals, dict(sigma))

    @classmethod
    def of_run(
        cls, fitted: Fit, sums: CrossProducts, sigma: Mapping[Row, float], run: int, pairs: int
    ) -> RegressorNoise:
        """Noise of one run."""
        totals = noise_of_run(fitted, sums.weighting, sums.over_runs.zero_gains[run], sigma, run, pairs)
        return cls(regressor_labels(fitted, sums.layout), totals, {row: sigma[row] for row in totals})

    def matches(self, labels: tuple[str, ...], rows: Iterable[Row]) -> bool:
        """Whether it was computed for these columns and rows: stored noise may be that of others."""
        return labels == self.labels and set(rows) <= self.totals.keys()

    def at(self, labels: tuple[str, ...], weights: Array) -> RegressorNoise:
        """The noise of other columns, described by `labels`: combinations (v, w) of these."""
        totals: dict[Row, Array] = {}
        for row, total in self.totals.items():
            there = np.flatnonzero(np.any(total, axis=0))  # of a row, few columns hold noise
            part = weights[:, there]
            totals[row] = combined(part, total[np.ix_(there, there)])
        return replace(self, labels=labels, totals=totals)

    def products(self, sums: CrossProducts, noise_ratio: Mapping[Row, float], sigma: Mapping[Row, float]) -> Array:
        """(w, w) products of the noise in the columns of `sums`, rows `noise_ratio` times as noisy."""
        turn = np.eye(sums.layout.width)
        turn[: sums.layout.model, : sums.layout.model] = sums.turn
        scaled = {row: noise_ratio[row] * self.sigma[row] / sigma[row] for row in noise_ratio if row in self.totals}
        out = turn.T @ np.sum([scale**2 * self.totals[row] for row, scale in scaled.items()], axis=0) @ turn
        out[-1, -1] = 0.0
        return out

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The noise as plain arrays for storage: for each row the columns that contain noise."""
        out: dict[str, NDArray[Any]] = {"labels": np.array(self.labels)}
        for row, total in self.totals.items():
            there = np.flatnonzero(np.any(total, axis=0))
            out |= {
                f"width|{row}": np.array(len(total)),
                f"places|{row}": there,
                f"sigma|{row}": np.array(self.sigma[row]),
            }
            out[f"total|{row}"] = total[np.ix_(there, there)]
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> RegressorNoise:
        """The noise from stored arrays, the inverse of `arrays`."""
        totals: dict[Row, Array] = {}
        sigma: dict[Row, float] = {}
        for row in [Row.parse(name.partition("|")[2]) for name in arrays if name.startswith("total|")]:
            width, there = int(arrays[f"width|{row}"]), arrays[f"places|{row}"].astype(int)
            totals[row], sigma[row] = np.zeros((width, width)), float(arrays[f"sigma|{row}"])
            totals[row][np.ix_(there, there)] = arrays[f"total|{row}"]
        return cls(tuple(str(label) for label in arrays["labels"]), totals, sigma)


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
    fitted: Fit, weighting: Weighting, zero_gain: Array, sigma: Mapping[Row, float], run: int, pairs: int,
    drawn: Callable[[], None] = lambda: None,
) -> dict[Row, Array]:  # fmt: skip
    """Row → (w, w) products of the noise in the columns of one run, its zeros eliminated by `zero_gain` (z, w)."""
    layout, (_, priors, values) = weighting.layout, fitted.zeros[run]
    z, w, p = len(priors), layout.width, layout.model
    side = np.concatenate([priors / weighting.prior_stiffening, np.ones(w)])
    # The right side here is the residual, from which the zeros that were found are taken already.
    further = zero_gain.copy()
    further[:, :p] = np.linalg.solve(weighting.turn.T, further[:, :p].T).T
    further[:, layout.right] -= values * weighting.prior_stiffening / priors
    whole: dict[Row, Array] = {}

    def of_piece(piece: Piece) -> _Products:
        return _piece_products(fitted, layout, sigma, piece, pairs, drawn)

    # Mapped, so that a piece's motion and slopes are gone before the next piece is made.
    for found in map(of_piece, fitted.assembly.pieces_of(run)):
        for row, (places, products) in found.items():
            there = whole.setdefault(row, np.zeros((z + w, z + w)))
            there[np.ix_(places, places)] += products
    return {row: at_zeros(side[:, None] * products * side, further) for row, products in whole.items()}


def _piece_products(
    fitted: Fit, layout: Layout, sigma: Mapping[Row, float], piece: Piece, pairs: int, drawn: Callable[[], None]
) -> _Products:
    """Noise in a piece: row → places (a,) of the columns that act and products (a, a), zeros first, residual last."""
    values = fitted.zeros[piece.run][2]
    z, p = len(values), layout.model
    clean = dict(columns_of(fitted, layout, piece, sigma))
    zeros = {row: block[:, :z] / sigma[row] for row, block in piece.blocks.items()}
    # The right side is the fit's own residual, so that the mean shift of a bent law meets no static load.
    for row, (columns, _) in clean.items():
        columns[:, -1] -= columns[:, :p] @ fitted.solution + zeros[row] @ values
    place = (piece.seed,) if piece.number is None else (piece.seed, piece.number)
    out: _Products = {}
    for row, (_, active) in clean.items():
        places = np.concatenate([np.arange(z), z + active]).astype(np.intp)
        out[row] = places, np.zeros((len(places), len(places)))
    for draw in range(pairs):
        for noisy in piece.noisy([2003, *place, draw]):
            for row, (columns, active) in columns_of(fitted, layout, piece, sigma, noisy):
                columns[:, -1] -= columns[:, :p] @ fitted.solution + zeros[row] @ values
                before, there = clean[row]
                # A column without any entry on this run may have some with more noise.
                columns = columns[:, np.isin(active, there)]
                products = out[row][1]
                products[z:, z:] += (columns.T @ columns - before.T @ before) / (2 * pairs)
                across = zeros[row].T @ (columns - before) / (2 * pairs)
                products[:z, z:] += across
                products[z:, :z] += across.T
        drawn()
    return out
