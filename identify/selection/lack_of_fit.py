"""What stays unexplained: rows against what simulated runs leave when they are treated alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.trial_sums import TrialSums

_SHARED = 1e-9
"""Part of the largest eigenvalue below which a direction is one that other columns have too."""


EXCESS = 1.05
"""Residual ÷ floor above which a row can be said to fail…"""
CHANCE = 0.05
"""… if in no more than this part of simulated runs any row stands as far above."""
LOUDEST = 3.0
"""No sensor is more times as noisy as its sheet says: what is above that is a cause."""


@dataclass(frozen=True)
class Left:
    """What a set of columns leaves of the residual.

    Attributes
    ----------
    ratios : row → RMS ÷ that of simulated runs treated alike.
    squares : row → weighted squares above those of simulated runs.
    p : row → probability that in a simulated run any row stands as far above; `family` the smallest of them.
    residual : run and row → (n,) what is left, weighted; `draws` (D, n) the same of simulated runs.
    null : row → (D,) weighted squares of simulated runs above their mean.
    """

    ratios: dict[str, float]
    squares: dict[str, float]
    p: dict[str, float]
    family: float
    residual: dict[tuple[int, str], Array]
    draws: dict[tuple[int, str], Array]
    null: dict[str, Array]

    def chance(self, rows: Sequence[str]) -> float:
        """Probability that some rows together stand as far above in a simulated run."""
        drawn = np.sum([self.null[row] for row in rows], axis=0)
        return (1 + int(np.count_nonzero(drawn >= self.excess(rows)))) / (1 + drawn.size)

    def excess(self, rows: Iterable[str]) -> float:
        """Weighted squares above those of simulated runs, over some rows."""
        return sum(self.squares[row] for row in rows)

    @property
    def above(self) -> tuple[str, ...]:
        """The rows above their floor by more than chance."""
        return tuple(row for row, ratio in self.ratios.items() if ratio > EXCESS and self.p[row] <= CHANCE)


def left_after(sums: TrialSums, total: Array, taken: NDArray[np.intp], prior: Array, pull: Array) -> Left:
    """The residual after the columns at `taken`.

    `prior` (a, a) and `pull` (a,) are normal matrix and right side of what is known of their parameters; `total` (w, w)
    the products of the columns of `sums`, without the noise in them as far as it is known.
    """
    right, w = sums.layout.right, sums.layout.width
    noise = np.sum([products[taken] for products in sums.null.values()], axis=0)
    sides = np.concatenate([(total[taken, right] + pull)[:, None], noise], axis=1)
    following = solved(total[np.ix_(taken, taken)] + prior, sides)
    own = np.zeros((w, 1))
    own[right], own[taken] = 1.0, -following[:, :1]
    drawn = np.zeros((w, noise.shape[1]))
    drawn[taken] = -following[:, 1:]
    residual: dict[tuple[int, str], list[Array]] = {(b.run, b.row): [] for b in sums.blocks}
    draws: dict[tuple[int, str], list[Array]] = {key: [] for key in residual}
    for block, series in sums.series(own):
        residual[block.run, block.row].append(series[:, 0])
    for block, series in sums.noise_series(drawn):
        draws[block.run, block.row].append(series.T)
    here = {key: np.concatenate(parts) for key, parts in residual.items()}
    there = {key: np.concatenate(parts, axis=1) for key, parts in draws.items()}
    runs: dict[str, list[tuple[int, str]]] = {}
    for key in here:
        runs.setdefault(key[1], []).append(key)
    squares = {row: sum(float(np.sum(here[key] ** 2)) for key in keys) for row, keys in runs.items()}
    null: dict[str, Array] = {
        row: np.sum([np.sum(there[key] ** 2, axis=1) for key in keys], axis=0) for row, keys in runs.items()
    }
    means = {row: float(np.mean(each)) for row, each in null.items()}
    spread = {row: float(np.std(each)) for row, each in null.items()}
    worst: Array = np.max([(null[row] - means[row]) / spread[row] for row in runs], axis=0)
    count = noise.shape[1]
    p = {
        row: (1 + int(np.count_nonzero(worst >= (squares[row] - means[row]) / spread[row]))) / (1 + count)
        for row in runs
    }
    return Left(
        ratios={row: float(np.sqrt(squares[row] / means[row])) for row in runs},
        squares={row: squares[row] - means[row] for row in runs},
        p=p,
        family=min(p.values()),
        residual=here,
        draws=there,
        null={row: null[row] - means[row] for row in runs},
    )


def solved(G: Array, sides: Array) -> Array:
    """G⁻¹ · sides; directions that columns share (two laws that are one on these runs) are taken once."""
    scale = np.sqrt(np.diag(G))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(G / np.outer(scale, scale))
    kept = values > _SHARED * values[-1]
    V = vectors[:, kept]
    return (V @ ((V.T @ (sides / scale[:, None])) / values[kept, None])) / scale[:, None]


def louder_rows(sums: TrialSums, taken: NDArray[np.intp], prior: Array, pull: Array) -> dict[str, float]:
    """Row → by how much its noise exceeds the sensor sheet's, from 1 to `LOUDEST`.

    Everything that the physics of any candidate could explain is taken out first, beside the columns at `taken`: what
    is left is noise, or a cause nobody has listed; both make a fall of the same size less remarkable. Sensor faults
    stay within their tolerances: set free together they would scale the measurement away.
    """
    there = set(taken.tolist())
    fresh = {
        i: q.prior
        for trial in sums.layout.trials
        for i, q in zip(range(trial.place.start, trial.place.stop), trial.effect.parameters, strict=True)
        if not trial.fault and i not in there
    }
    ratios = left_after(sums, sums.total, *with_columns(taken, prior, pull, fresh)).ratios
    return {row: min(LOUDEST, max(1.0, ratio)) for row, ratio in ratios.items()}


def with_columns(
    taken: NDArray[np.intp], prior: Array, pull: Array, fresh: Mapping[int, float]
) -> tuple[NDArray[np.intp], Array, Array]:
    """Places, normal matrix and right side of what is known beforehand, with further columns of 1 σ by place."""
    places = np.concatenate([taken, list(fresh)]).astype(np.intp)
    both = scipy.linalg.block_diag(prior, np.diag([sigma**-2.0 for sigma in fresh.values()]))
    return places, both, np.concatenate([pull, np.zeros(len(fresh))])
