"""All columns a ranking needs, as sums of products: of the model, of every candidate, and of the measured rows.

A candidate is judged from sums alone: what the model leaves of it, how far the residual falls, how far it falls in
parts of the runs that were not fitted to. So one pass over the samples serves every candidate. Each run's zeros are
eliminated where its sums are made; the model's columns are first made nearly orthonormal, so that sums are safe.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.prepared_run import Drive
from lacet.identify.regression.qr_accumulation import scaled_triangle
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.layout import Layout, sensor_columns
from lacet.identify.validation.noise_floor import NoiseFloor

FOLDS = 5
BLOCK = 2.0
"""Length of a block of the cross-validation [s]."""


@dataclass(frozen=True)
class Block:
    """Samples of one row of one run, weighted.

    `zeros` (n, z), priors taken in; `columns` (n, a) those that are not empty, at places `active` of the layout;
    `number` (n,) of each sample's block of `BLOCK` seconds, counted over all runs; `draws` (D, n) the row's noise.
    """

    run: int
    row: str
    zeros: Array
    columns: Array
    active: NDArray[np.intp]
    number: NDArray[np.intp]
    draws: Array


@dataclass(frozen=True)
class TrialSums:
    """Sums of products of the columns of `layout`, every run's zeros eliminated.

    Attributes
    ----------
    turn : (p, p), the model's parameters from those of its orthonormal columns.
    known : (p, p) normal matrix of what is known of the model's parameters beforehand, for the orthonormal columns.
    blocks : the samples, run by run.
    total : (w, w) of all samples; `train`, `test` (FOLDS, w, w) of those outside and inside a fold, `test` at the zeros
        found outside.
    null : row → (w, D) products with the row's simulated noise; `null_sheet` (w, D) with simulated zeros and drifts.
    temper : the zeros' priors are stiffened by this factor.
    following : for each run (z, w): what its zeros take of each column.
    noise_zeros : for each run (z, D): what its zeros take of its noise.
    """

    layout: Layout
    turn: Array
    known: Array
    blocks: tuple[Block, ...]
    total: Array
    train: Array
    test: Array
    null: Mapping[str, Array]
    null_sheet: Array
    temper: float
    following: tuple[Array, ...]
    noise_zeros: tuple[Array, ...]

    @classmethod
    def of(
        cls, fitted: Fit, floor: NoiseFloor, layout: Layout, temper: float, drifts: Mapping[str, float],
        rng: np.random.Generator,
    ) -> TrialSums:  # fmt: skip
        """Go once over the samples.

        Parameters
        ----------
        fitted : the model, on its runs.
        floor : weights and simulated noise.
        temper : the zeros' priors are stiffened by this factor.
        drifts : 1 σ of the sensor faults that are another in each run, by key.
        rng : for simulated zeros and drifts.
        """
        turn = _orthonormal(fitted, floor.sigma)
        # Known equations are centred on the fit. One that the fit has left far behind (a late laser moves a wheel's
        # moment by twelve σ) is as wide as that, else a candidate would be praised for leading it back.
        beforehand = fitted.equations.known
        beyond = np.hypot(1.0, beforehand @ fitted.solution)
        known, w, draws = (beforehand / beyond[:, None]) @ turn, layout.width, floor.count
        total, train, test = np.zeros((w, w)), np.zeros((FOLDS, w, w)), np.zeros((FOLDS, w, w))
        null = {row: np.zeros((w, draws)) for row in floor.sigma}
        null_sheet = np.zeros((w, draws))
        blocks: list[Block] = []
        following: list[Array] = []
        noise_zeros: list[Array] = []
        first = 0
        for run in range(len(fitted.drives)):
            priors = fitted.zeros[run][1] / temper
            z = len(priors)
            mine = list(_blocks(fitted, floor, layout, turn, run, priors, first))
            first = 1 + max((int(b.number.max()) for b in mine), default=first)
            folds, noise = products_of(mine, z, w, draws)
            whole = folds.sum(axis=0)
            gain, left = without_zeros(whole, z)
            total += left
            for fold, inside in enumerate(folds):
                outside, rest = without_zeros(whole - inside, z)
                train[fold] += rest
                test[fold] += at_zeros(inside, outside)
            for row, products in noise.items():
                null[row] += products[z:] - gain.T @ products[:z]
            # Zeros are drawn from the sheet, whose σ the priors are `temper` times stiffer than.
            drawn = temper * rng.standard_normal((z, draws))
            null_sheet += whole[z:, :z] @ drawn - gain.T @ (whole[:z, :z] @ drawn)
            for trial in layout.trials:
                if trial.effect.key in drifts:
                    size = drifts[trial.effect.key] * rng.standard_normal((1, draws))
                    null_sheet += left[:, trial.place] @ size
            blocks += mine
            following.append(gain)
            pushed = np.sum([products[:z] for products in noise.values()], axis=0)
            noise_zeros.append(np.asarray(np.linalg.solve(whole[:z, :z] + np.eye(z), pushed), float))
        return cls(
            layout, turn, known.T @ known, tuple(blocks), total, train, test, null, null_sheet, temper,
            tuple(following), tuple(noise_zeros),
        )  # fmt: skip

    def series(self, coefficients: Array) -> Iterator[tuple[Block, Array]]:
        """(n, k) of each block: columns · coefficients (w, k), less what the run's zeros take of it."""
        for block in self.blocks:
            taken = self.following[block.run] @ coefficients
            yield block, block.columns @ coefficients[block.active] - block.zeros @ taken

    def noise_series(self, coefficients: Array) -> Iterator[tuple[Block, Array]]:
        """(n, D) of each block: its noise plus columns · coefficients (w, D), less what the run's zeros take of it."""
        for block, moved in self.series(coefficients):
            yield block, block.draws.T - block.zeros @ self.noise_zeros[block.run] + moved


def _blocks(
    fitted: Fit, floor: NoiseFloor, layout: Layout, turn: Array, run: int, priors: Array, first: int
) -> Iterator[Block]:
    """One run's samples; `first` is the number of its first block."""
    filters = fitted.drives[run].recording.filters
    seen: dict[str, int] = {}
    for piece in fitted.assembly.pieces_of(run):
        for row, (columns, active) in columns_of(fitted, layout, piece, floor.sigma):
            start = seen.get(row, 0)
            seen[row] = start + len(columns)
            time = piece.instants[row] * (filters.step / filters.rate)
            zeros = piece.blocks[row][:, : len(priors)] * (priors / floor.sigma[row])
            noise = floor.draws[run][row][:, start : seen[row]] / floor.sigma[row]
            model = columns[:, : layout.model]
            # The right side is what the fit leaves: priors then hold on to the fit, and do not pull at its scale.
            columns[:, -1] -= model @ fitted.solution
            columns[:, : layout.model] = model @ turn
            yield Block(run, row, zeros, columns, active, first + (time // BLOCK).astype(np.intp), noise)


def columns_of(
    fitted: Fit, layout: Layout, piece: Piece, sigma: Mapping[str, float], noisy: Drive | None = None
) -> Iterator[tuple[str, tuple[Array, NDArray[np.intp]]]]:
    """For each row of a piece, weighted columns (n, a), the measured side last, and their places in the layout.

    `noisy` : the same piece with more noise, whose columns are wanted instead.
    """
    p, keep, drive = layout.model, fitted.base.independent, noisy or piece.drive
    drive.prepare([*(fitted.model.physics if noisy else ()), *(t.effect for t in layout.trials if not t.fault)])
    sensors = sensor_columns(fitted, layout, piece, noisy)
    physics = [(trial.place, drive.columns(trial.effect)) for trial in layout.trials if not trial.fault]
    for row, block in piece.blocks.items():
        model, right = block[:, block.shape[1] - p :], piece.right[row]
        if noisy:
            model, right = model.copy(), noisy.measured[row]
            model[:, : len(keep)] = noisy.matrix(fitted.model.physics, row)[:, keep]
        own = [*sensors[row], *((place, found[row]) for place, found in physics if row in found)]
        parts = [model, *(columns.T for _, columns in own), right[:, None]]
        active = [*range(p), *(i for place, _ in own for i in range(place.start, place.stop)), layout.right]
        yield row, (np.concatenate(parts, axis=1) / sigma[row], np.array(active, np.intp))


def products_of(blocks: Sequence[Block], z: int, w: int, draws: int) -> tuple[Array, dict[str, Array]]:
    """(FOLDS, z + w, z + w) products of a run's columns, zeros first, and row → (z + w, D) those with its noise."""
    folds = np.zeros((FOLDS, z + w, z + w))
    noise = {block.row: np.zeros((z + w, draws)) for block in blocks}
    for block in blocks:
        both = np.concatenate([block.zeros, block.columns], axis=1)
        place = np.concatenate([np.arange(z), z + block.active])
        for fold in range(FOLDS):
            part = both[block.number % FOLDS == fold]
            folds[fold][np.ix_(place, place)] += part.T @ part
        noise[block.row][place] += both.T @ block.draws.T
    return folds, noise


def _orthonormal(fitted: Fit, sigma: Mapping[str, float]) -> Array:
    """(p, p) T: the model's columns, weighted and with zeros eliminated, are nearly orthonormal as W T."""
    root = fitted.equations.root({row: sigma.get(row, own) for row, own in fitted.sigma.items()})
    p = len(fitted.place)
    R, lengths = scaled_triangle(root[:, :p])
    return np.asarray(scipy.linalg.solve_triangular(R[:p], np.eye(p)), float) / lengths[:, None]


def without_zeros(normal: Array, z: int) -> tuple[Array, Array]:
    """(z, w) how zeros of prior σ = 1 follow the other columns, and (w, w) what is left of those."""
    gain = np.asarray(np.linalg.solve(normal[:z, :z] + np.eye(z), normal[:z, z:]), float)
    return gain, normal[z:, z:] - normal[z:, :z] @ gain


def at_zeros(normal: Array, gain: Array) -> Array:
    """(w, w) products of the columns less the zeros that follow them by `gain` (z, w)."""
    z = len(gain)
    across = gain.T @ normal[:z, z:]
    return normal[z:, z:] - across - across.T + gain.T @ normal[:z, :z] @ gain
