"""Sums of products of one run's columns: over all its samples, inside folds, and by row."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.weighted_columns import Block
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class RunProducts:
    """Sums of products of one run's columns, the columns of its z sensor zeros first.

    Attributes
    ----------
    zeros : z, the number of its sensor zeros.
    inside : (folds, z + w, z + w) products over the samples inside each fold.
    by_row : row → (z + w, z + w) products over the row's samples.
    noise : row → (z + w, D) products with the row's simulated noise; `noise_squares` (D,) its squares.
    """

    zeros: int
    inside: Array
    by_row: Mapping[Row, Array]
    noise: Mapping[Row, Array]
    noise_squares: Mapping[Row, Array]

    @classmethod
    def of(
        cls, blocks: Iterable[Block], z: int, w: int, draws: int, first: int = 0, folds: int = SELECTION.folds
    ) -> RunProducts:
        """Products of a run's samples.

        Parameters
        ----------
        blocks : the samples.
        z, w : number of zeros, and of columns.
        draws : number of simulated runs.
        first : number of the run's first block in the cross-validation of all runs.
        folds : number of folds of the cross-validation; 1 for none.
        """
        inside = np.zeros((folds, z + w, z + w))
        by_row: dict[Row, Array] = {}
        noise: dict[Row, Array] = {}
        squares: dict[Row, Array] = {}
        for block in blocks:
            if block.row not in by_row:
                by_row[block.row] = np.zeros((z + w, z + w))
                noise[block.row], squares[block.row] = np.zeros((z + w, draws)), np.zeros(draws)
            both = np.concatenate([block.zeros, block.columns], axis=1)
            place = np.concatenate([np.arange(z), z + block.active])
            # Indices of one dimension: NumPy adds at these three times as fast as at those of two.
            square, whole = np.add.outer((z + w) * place, place).ravel(), np.zeros(len(place) ** 2)
            for fold in range(folds):
                part = both[(first + block.number) % folds == fold] if folds > 1 else both
                products = (part.T @ part).ravel()
                inside[fold].reshape(-1)[square] += products
                whole += products
            by_row[block.row].reshape(-1)[square] += whole
            noise[block.row][place] += (both.T @ block.draws.T)[:, block.choice]
            squares[block.row] += np.sum(block.draws**2, axis=1)[block.choice]
        return cls(z, inside, by_row, noise, squares)

    @property
    def draws(self) -> int:
        """D, the number of simulated runs."""
        return next(iter(self.noise_squares.values())).size

    @cached_property
    def whole(self) -> Array:
        """(z + w, z + w) products over all samples."""
        return self.inside.sum(axis=0)

    @cached_property
    def eliminated(self) -> tuple[Array, Array]:
        """(z, w) regression of each column on the zeros, and (w, w) products of its remainders."""
        return without_zeros(self.whole, self.zeros)

    def fold(self, fold: int) -> tuple[Array, Array]:
        """(w, w) products of the samples outside a fold, and of those inside it at the zeros found outside."""
        gain, outside = without_zeros(self.whole - self.inside[fold], self.zeros)
        return outside, at_zeros(self.inside[fold], gain)

    def remaining(self, products: Array) -> Array:
        """(w, D) products of the columns less their regression on the zeros, from those of all columns (z + w, D)."""
        return products[self.zeros :] - self.eliminated[0].T @ products[: self.zeros]

    def with_drawn_zeros(self, drawn: Array) -> Array:
        """(w, D) products of the columns, less their regression on the zeros, with simulated zeros (z, D)."""
        z, whole = self.zeros, self.whole
        return whole[z:, :z] @ drawn - self.eliminated[0].T @ (whole[:z, :z] @ drawn)

    @cached_property
    def noise_zeros(self) -> Array:
        """(z, D) regression of the simulated noise on the zeros."""
        z = self.zeros
        pushed = np.sum([products[:z] for products in self.noise.values()], axis=0)
        return np.asarray(np.linalg.solve(self.whole[:z, :z] + np.eye(z), pushed), float)

    def row(self, row: Row) -> RowProducts:
        """Products over one row's samples, less the regression of columns and simulated noise on the zeros."""
        z, gain, drawn = self.zeros, self.eliminated[0], self.noise_zeros
        normal, noise = self.by_row[row], self.noise[row]
        remaining = noise - normal[:, :z] @ drawn
        squares = self.noise_squares[row] - np.einsum("zd,zd->d", drawn, noise[:z] + remaining[:z])
        return RowProducts(at_zeros(normal, gain), remaining[z:] - gain.T @ remaining[:z], squares)


@dataclass(frozen=True)
class RowProducts:
    """Sums of products over the samples of one row, every run's zeros eliminated.

    Attributes
    ----------
    columns : (w, w) products of the columns.
    noise : (w, D) products with the simulated noise; `squares` (D,) its squares.
    """

    columns: Array
    noise: Array
    squares: Array

    def added_to(self, other: RowProducts) -> RowProducts:
        """The sums of these and others, in the arrays of these."""
        return RowProducts(
            added(self.columns, other.columns), added(self.noise, other.noise), added(self.squares, other.squares)
        )

    def squares_of(self, coefficients: Array) -> Array:
        """(k,) sums of squares of the columns · coefficients (w, k)."""
        used = self._used
        return np.einsum("wk,wk->k", coefficients[used], self.columns[np.ix_(used, used)] @ coefficients[used])

    def squares_with_noise(self, coefficients: Array) -> Array:
        """(D,) sums of squares of the simulated noise plus columns · coefficients (w, D)."""
        across = np.einsum("wd,wd->d", self.noise, coefficients)
        return self.squares + 2.0 * across + self.squares_of(coefficients)

    @property
    def _used(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.diag(self.columns))


def added(sums: Array, further: Array) -> Array:
    """`sums`, with others added in place."""
    sums += further
    return sums


def without_zeros(normal: Array, z: int) -> tuple[Array, Array]:
    """(z, w) regression of the other columns on zeros of prior σ = 1, and (w, w) products of their remainders."""
    gain = np.asarray(np.linalg.solve(normal[:z, :z] + np.eye(z), normal[:z, z:]), float)
    return gain, normal[z:, z:] - normal[z:, :z] @ gain


def at_zeros(normal: Array, gain: Array) -> Array:
    """(w, w) products of the columns less their regression `gain` (z, w) on the zeros."""
    z = len(gain)
    # Half of the quadratic term in each of the two that are each other's transposes: one product of full size.
    across = gain.T @ (normal[:z, z:] - normal[:z, :z] @ gain / 2.0)
    out = normal[z:, z:] - across
    out -= across.T
    return out
