"""What stays unexplained: rows against what simulated runs leave when they are treated alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.cross_products import Reading, TrialColumns, TrialSums, solved
from lacet.identify.selection.partial_regression import Partialled, beside
from lacet.identify.validation.whiteness import whiteness

EXCESS = 1.05
"""Residual ÷ floor above which a row can be said to fail…"""
CHANCE = 0.05
"""… if in no more than this part of simulated runs any row stands as far above."""
LOUDEST = 3.0
"""No sensor is more times as noisy as its sheet says: what is above that is a cause."""


COLOURED = 0.5
"""Part of an excess that must stand above the noise's level to be no noise."""
QUIET = 0.25
"""Part of a spectrum's bands that is taken for noise alone."""
SIGNIFICANCE = 0.05
"""Family-wise error of a proposal."""


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


def left_by(
    columns: TrialColumns, known: Partialled, added: Sequence[Effect] = (), grid: Mapping[str, slice] | None = None
) -> Left:
    """The residual after model, zeros, sensor sheet and some effects, beside simulated runs treated alike."""
    if not added:
        return left_after(known.sums, known.total, known.taken, known.prior, known.pull)
    inside, trials = beside(columns, known, added, grid or {})
    fresh = {
        i: q.prior
        for trial in trials
        for i, q in zip(range(trial.place.start, trial.place.stop), trial.effect.parameters, strict=True)
    }
    return left_after(inside.sums, inside.total, *with_columns(inside.taken, inside.prior, inside.pull, fresh))


def left_unexcused(known: Partialled, own: NDArray[np.intp]) -> Left:
    """The residual after model, zeros and sensor sheet, without tolerances at positions `own` of a fault."""
    kept = np.setdiff1d(np.arange(len(known.taken)), own)
    prior = known.prior[np.ix_(kept, kept)]
    return left_after(known.sums, known.total, known.taken[kept], prior, known.pull[kept])


def prior_stiffening(reading: Reading) -> float:
    """Residual ÷ floor over all rows once zeros, gains and latencies have taken their share, never less than 1.

    Next to a misfit of many floors a prior of one σ is no bound at all: zeros and gains would soak the missing
    effect up. Priors are stiffened by this factor, which leaves them as they are when nothing is missing.
    """
    sums = reading.sums
    ratios = left_after(sums, sums.total, *reading.known(reading.pull)).ratios
    return max(1.0, float(np.sqrt(np.mean(np.square(list(ratios.values()))))))


def structured(left: Left) -> bool:
    """Whether what is above the floor has another colour than the noise; sensors louder than their sheet leave it.

    The noise's level is read from the quietest bands of each row's spectrum: most of the excess must stand above it.
    """
    smallest, count, excess, coloured = 1.0, 0, 0.0, 0.0
    for key, residual in left.residual.items():
        found = whiteness(residual, left.draws[key], np.arange(residual.size), 1.0) if key[1] in left.above else None
        if found is not None and found.frequency.size > 1:
            smallest, count = min(smallest, found.ljung_box), count + 1
            width = np.gradient(found.frequency)
            level = min(LOUDEST**2, float(np.quantile(found.spectrum / found.floor, QUIET)))
            excess += float(np.sum(width * (found.spectrum - found.floor)))
            coloured += float(np.sum(width * np.maximum(0.0, found.spectrum - max(1.0, level) * found.floor)))
    return smallest * count <= SIGNIFICANCE and coloured > COLOURED * excess > 0.0
