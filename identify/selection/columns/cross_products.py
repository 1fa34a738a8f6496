"""Cross products of the columns of model, sensor sheet and all candidates, and of the measured rows.

All tests of a candidate follow from such sums of products: its columns without the part that the model explains, the
fall of the weighted squares, and that fall in parts of the runs that were not fitted to. So one pass over the samples
serves every candidate. Each run's zeros are eliminated in its sums; the model's columns are first made nearly
orthonormal, so that the sums lose few digits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from enum import Enum, auto
from functools import reduce
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sums.tree import summed
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.known_columns import KnownColumns
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.run_products import RowProducts, RunProducts, added
from lacet.identify.selection.columns.samples import Blocks, HeldSamples, RunSamples, Samples
from lacet.identify.selection.columns.weighted_columns import Block, Weighting, blocks_of
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor

V = TypeVar("V")


class Extent(Enum):
    """Which sums of products are made: the fewer, the sooner."""

    ALL = auto()
    """Over all samples, inside and outside folds, and by row, with simulated runs."""
    FOLDS = auto()
    """Over all samples, inside and outside folds, with simulated runs."""
    SIMULATED = auto()
    """Over all samples, with simulated runs."""
    TOTAL = auto()
    """Over all samples."""

    @property
    def folds(self) -> int:
        """Number of folds; 1 for none."""
        return SELECTION.folds if self in (Extent.ALL, Extent.FOLDS) else 1


@dataclass(frozen=True)
class SumsOfRuns:
    """Sums of products over several runs, each run's zeros eliminated.

    Attributes
    ----------
    total : (w, w) of all samples; `train`, `test` (folds, w, w) of those outside and inside a fold, `test` at the
        zeros found outside; no fold unless `Extent.ALL` or `FOLDS`.
    null : row → (w, D) products with the row's simulated noise; `null_sheet` (w, D) with simulated zeros and drifts.
    rows : row → sums over its samples alone; none unless `Extent.ALL`.
    acting : row → (w,) whether a column acts on it.
    zero_gains : for each run (z, w) regression of each column on its zeros.
    """

    total: Array
    train: Array
    test: Array
    null: Mapping[Row, Array]
    null_sheet: Array
    rows: Mapping[Row, RowProducts]
    acting: Mapping[Row, NDArray[np.bool_]]
    zero_gains: tuple[Array, ...]

    @classmethod
    def of(
        cls,
        products: RunProducts,
        samples: RunSamples,
        weighting: Weighting,
        drifts: Mapping[str, float],
        seed: Sequence[int],
        extent: Extent = Extent.ALL,
    ) -> SumsOfRuns:
        """The sums of one run.

        Parameters
        ----------
        products, samples : of the run.
        weighting : its weights.
        drifts : key → 1 σ of the sensor faults whose size is another in each run.
        seed : of its simulated zeros and drifts.
        extent : which sums.
        """
        width = weighting.layout.width
        folds = [products.fold(fold) for fold in range(extent.folds)] if extent.folds > 1 else []
        train, test = (
            (np.stack(part) for part in zip(*folds, strict=True)) if folds else [np.zeros((0, width, width))] * 2
        )
        acting = {row: np.zeros(width, bool) for row in products.by_row}
        for block in samples.blocks.held:
            acting[block.row][block.active] = True
        return cls(
            products.eliminated[1], train, test,
            {row: products.remaining(noise) for row, noise in products.noise.items()},
            np.sum(list(_sheet_draws(products, weighting, drifts, np.random.default_rng(seed))), axis=0),
            {row: products.row(row) for row in products.by_row if extent is Extent.ALL}, acting,
            (products.eliminated[0],),
        )  # fmt: skip

    @staticmethod
    def merged(parts: Sequence[SumsOfRuns]) -> SumsOfRuns:
        """Sums of several parts, in their order."""
        first, *others = parts
        return reduce(SumsOfRuns.added_to, others, deepcopy(first)) if others else first

    def added_to(self, other: SumsOfRuns) -> SumsOfRuns:
        """The sums of these and others, in the arrays of these: no third ones are made."""
        return SumsOfRuns(
            added(self.total, other.total), added(self.train, other.train), added(self.test, other.test),
            _both(self.null, other.null, added),
            added(self.null_sheet, other.null_sheet), _both(self.rows, other.rows, RowProducts.added_to),
            _both(self.acting, other.acting, np.logical_or),
            self.zero_gains + other.zero_gains,
        )  # fmt: skip


def _both(mine: Mapping[Row, V], theirs: Mapping[Row, V], add: Callable[[V, V], V]) -> dict[Row, V]:
    """Values by row of two parts, added where both have the row."""
    return {**mine, **{row: add(mine[row], value) if row in mine else value for row, value in theirs.items()}}


def _sheet_draws(
    products: RunProducts, weighting: Weighting, drifts: Mapping[str, float], rng: np.random.Generator
) -> Iterator[Array]:
    """(w, D) products of a run's columns with simulated zeros of its sensors, then with each simulated drift."""
    # Zeros are drawn from the sheet, whose σ the priors are `prior_stiffening` times stiffer than.
    draws = products.draws
    yield products.with_drawn_zeros(weighting.prior_stiffening * rng.standard_normal((products.zeros, draws)))
    for place, drift in weighting.layout.of_keys(drifts):
        yield products.eliminated[1][:, place] @ (drift * rng.standard_normal((1, draws)))


@dataclass(frozen=True)
class CrossProducts:
    """Sums of products of weighted columns over all runs, and the samples behind them.

    Attributes
    ----------
    weighting : order of the w columns, and their weights.
    prior : (p, p) normal matrix of the priors of the model's parameters, for the orthonormal columns.
    over_runs : sums over all runs.
    samples : of all runs.
    """

    weighting: Weighting
    prior: Array
    over_runs: SumsOfRuns
    samples: Samples

    @classmethod
    def of(
        cls, fitted: Fit, floor: NoiseFloor, layout: Layout, prior_stiffening: float,
        drifts: Mapping[str, float] | None = None, seed: int = 0, extent: Extent = Extent.ALL,
        known: CrossProducts | None = None,
    ) -> CrossProducts:  # fmt: skip
        """Cross products of all columns of a fit, from one pass over the samples of its runs.

        Parameters
        ----------
        fitted : the model, on its runs.
        floor : weights and simulated noise.
        layout : order of the columns.
        prior_stiffening : 1 σ of the sensor sheet ÷ 1 σ of the zeros' priors.
        drifts : key → 1 σ of the sensor faults whose size is another in each run.
        seed : of simulated zeros and drifts.
        extent : which sums.
        known : others of the same fit and weights; columns that they have are not computed again.
        """
        # Runs count from one: NumPy fills seeds up with zeros, and the tolerances of all runs are drawn from [seed, 6].
        weighting = Weighting(layout, fitted.orthonormaliser(floor.sigma), prior_stiffening)
        held: list[RunSamples] = []
        there = None if known is None else KnownColumns.of(layout, known.weighting, known.samples)

        def of_run(run: int) -> SumsOfRuns:
            made = None if there is None else there.blocks(fitted, floor, weighting, run)
            first = held[-1].first + held[-1].block_count if held else 0
            samples, products = samples_of(fitted, floor, weighting, run, first, extent, made)
            held.append(samples)
            return SumsOfRuns.of(products, samples, weighting, drifts or {}, [seed, 6, 1 + run], extent)

        sums = summed(map(of_run, range(len(fitted.runs))), SumsOfRuns.added_to)
        prior = model_prior(fitted.equations.known, fitted.solution, weighting.turn)
        return cls(weighting, prior, sums, HeldSamples(tuple(held)))

    @property
    def layout(self) -> Layout:
        """Order of the columns."""
        return self.weighting.layout

    @property
    def turn(self) -> Array:
        """(p, p) matrix T; the model's columns times T are nearly orthonormal and stand in place of them."""
        return self.weighting.turn

    @property
    def total(self) -> Array:
        """(w, w) products over all samples."""
        return self.over_runs.total


def samples_of(
    fitted: Fit, floor: NoiseFloor, weighting: Weighting, run: int, first: int = 0, extent: Extent = Extent.ALL,
    made: Iterator[Block] | None = None,
) -> tuple[RunSamples, RunProducts]:  # fmt: skip
    """Samples of one run of a fit and their sums of products.

    `first` is the number of the run's first block; `made` are its weighted samples where they are known.
    """
    blocks = Blocks.of(made or blocks_of(fitted, floor, weighting, run), fitted.runs[run].is_long)
    zeros, width = len(fitted.zeros[run][1]), weighting.layout.width
    products = RunProducts.of(blocks, zeros, width, floor.count, first, extent.folds)
    return RunSamples(blocks, products.eliminated[0], products.noise_zeros, first), products


def model_prior(equations: Array, solution: Array, turn: Array) -> Array:
    """(p, p) normal matrix of the priors of a model's parameters, for its orthonormal columns.

    `equations` (k, p) what is known beforehand; `solution` (p,) values of the fit.

    The priors are centred on the fit. Where the fit is many σ away from a prior (a late laser moves a wheel's moment by
    twelve), the prior is widened to that distance: else a candidate would gain by moving the parameter back.
    """
    widening = np.hypot(1.0, equations @ solution)
    prior = (equations / widening[:, None]) @ turn
    return prior.T @ prior
