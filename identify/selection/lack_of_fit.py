"""Lack of fit: residuals by row compared with those of simulated runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.candidate_columns import CandidateColumns, solved
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.samples import RunSamples
from lacet.identify.selection.partial_regression import PartialRegression, beside
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.whiteness import whiteness


@dataclass(frozen=True)
class Remainder:
    """Residual after regression on a set of columns, and simulated runs after the same regression.

    Attributes
    ----------
    sums : products of all columns.
    measured, simulated : (w, 1) and (w, D) coefficients of the columns in the residual, and in simulated noise.
    """

    sums: CrossProducts
    measured: Array
    simulated: Array

    @classmethod
    def of(
        cls, sums: CrossProducts, total: Array, nuisance: NDArray[np.intp], prior: Array, prior_side: Array
    ) -> Remainder:
        """After regression on the columns at `nuisance`; parameters as of `residual_after`."""
        right, w = sums.layout.right, sums.layout.width
        noise = np.sum([products[nuisance] for products in sums.over_runs.null.values()], axis=0)
        sides = np.concatenate([(total[nuisance, right] + prior_side)[:, None], noise], axis=1)
        found = solved(total[np.ix_(nuisance, nuisance)] + prior, sides)
        measured, simulated = np.zeros((w, 1)), np.zeros((w, noise.shape[1]))
        measured[right], measured[nuisance], simulated[nuisance] = 1.0, -found[:, :1], -found[:, 1:]
        return cls(sums, measured, simulated)


@dataclass(frozen=True)
class LackOfFit:
    """Residual after regression on a set of columns, compared with simulated runs after the same regression.

    Attributes
    ----------
    ratios : row → RMS ÷ RMS of simulated runs.
    squares : row → weighted squares less the mean of simulated runs.
    p : row → probability that any row of a simulated run is as far above its mean; `family` the smallest of them.
    null : row → (D,) weighted squares of simulated runs less their mean.
    remainder : the residual and those of the simulated runs.
    """

    ratios: dict[Row, float]
    squares: dict[Row, float]
    p: dict[Row, float]
    family: float
    null: dict[Row, Array]
    remainder: Remainder

    @classmethod
    def of(cls, remainder: Remainder) -> LackOfFit:
        """The comparison of a residual with simulated ones."""
        rows = remainder.sums.over_runs.rows
        squares = {row: float(rows[row].squares_of(remainder.measured)[0]) for row in rows}
        null = {row: rows[row].squares_with_noise(remainder.simulated) for row in rows}
        means = {row: float(np.mean(each)) for row, each in null.items()}
        spread = {row: float(np.std(each)) for row, each in null.items()}
        worst: Array = np.max([(null[row] - means[row]) / spread[row] for row in rows], axis=0)
        p = {
            row: (1 + int(np.count_nonzero(worst >= (squares[row] - means[row]) / spread[row]))) / (1 + worst.size)
            for row in rows
        }
        return cls(
            ratios={row: float(np.sqrt(squares[row] / means[row])) for row in rows},
            squares={row: squares[row] - means[row] for row in rows},
            p=p,
            family=min(p.values()),
            null={row: null[row] - means[row] for row in rows},
            remainder=remainder,
        )

    def chance(self, rows: Sequence[Row]) -> float:
        """Probability that the sum of squares of these rows is as large in a simulated run."""
        drawn = np.sum([self.null[row] for row in rows], axis=0)
        return (1 + int(np.count_nonzero(drawn >= self.excess(rows)))) / (1 + drawn.size)

    def excess(self, rows: Iterable[Row]) -> float:
        """Weighted squares of these rows less the mean of simulated runs."""
        return sum(self.squares[row] for row in rows)

    @property
    def above(self) -> tuple[Row, ...]:
        """The rows above their floor by more than chance."""
        return tuple(
            row
            for row, ratio in self.ratios.items()
            if ratio > SELECTION.failing_ratio and self.p[row] <= SELECTION.failing_chance
        )


def residual_after(
    sums: CrossProducts, total: Array, nuisance: NDArray[np.intp], prior: Array, prior_side: Array
) -> LackOfFit:
    """Lack of fit after regression on the columns at `nuisance`.

    `prior` (a, a) and `prior_side` (a,) are normal matrix and right side of the priors of their parameters; `total`
    (w, w) the products of the columns of `sums`, less the noise in them where it is known.
    """
    return LackOfFit.of(Remainder.of(sums, total, nuisance, prior, prior_side))


def noise_ratios(sums: CrossProducts, nuisance: NDArray[np.intp], prior: Array, prior_side: Array) -> dict[Row, float]:
    """Noise ÷ noise by the sensor sheet of each row, from 1 to `most_noise_ratio`.

    The residual is that after regression on the columns at `nuisance` and on the physics of all candidates. It is noise
    or due to an unlisted cause; both make a fall of a given size less significant. Sensor faults are restricted to
    their tolerances: together and without bounds they could scale the measurement itself to zero.
    """
    there = set(nuisance.tolist())
    fresh = {
        i: q.prior
        for trial in sums.layout.trials
        for i, q in zip(range(trial.place.start, trial.place.stop), trial.effect.parameters, strict=True)
        if not trial.fault and i not in there
    }
    ratios = residual_after(sums, sums.total, *with_columns(nuisance, prior, prior_side, fresh)).ratios
    return {row: min(SELECTION.most_noise_ratio, max(1.0, ratio)) for row, ratio in ratios.items()}


def with_columns(
    nuisance: NDArray[np.intp], prior: Array, prior_side: Array, fresh: Mapping[int, float]
) -> tuple[NDArray[np.intp], Array, Array]:
    """Places, normal matrix and right side of priors, with further columns added: `fresh` place → 1 σ of its prior."""
    places = np.concatenate([nuisance, list(fresh)]).astype(np.intp)
    both = scipy.linalg.block_diag(prior, np.diag([sigma**-2.0 for sigma in fresh.values()]))
    return places, both, np.concatenate([prior_side, np.zeros(len(fresh))])


def residual_beside(
    columns: CandidateColumns,
    known: PartialRegression,
    added: Sequence[Effect] = (),
) -> LackOfFit:
    """Lack of fit after regression on model, zeros, sensor sheet and `added` effects."""
    if not added:
        return residual_after(known.sums, known.total, known.nuisance, known.prior, known.prior_side)
    inside, trials = beside(columns, known, added)
    fresh = {
        i: q.prior
        for trial in trials
        for i, q in zip(range(trial.place.start, trial.place.stop), trial.effect.parameters, strict=True)
    }
    return residual_after(
        inside.sums, inside.total, *with_columns(inside.nuisance, inside.prior, inside.prior_side, fresh)
    )


def residual_without_tolerance(known: PartialRegression, own: NDArray[np.intp]) -> LackOfFit:
    """Lack of fit after regression on model, zeros and sensor sheet, without the tolerances at positions `own`."""
    kept = np.setdiff1d(np.arange(len(known.nuisance)), own)
    prior = known.prior[np.ix_(kept, kept)]
    return residual_after(known.sums, known.total, known.nuisance[kept], prior, known.prior_side[kept])


def prior_stiffening(linearisation: Linearisation) -> float:
    """1 σ of the sensor sheet ÷ 1 σ of the nuisance parameters' priors: residual ÷ floor over all rows, at least 1.

    With a misfit of many floors the priors by the sheet have no influence: zeros and gains would absorb the missing
    effect. The factor is 1 when nothing is missing.
    """
    sums = linearisation.sums
    ratios = residual_after(sums, sums.total, *linearisation.nuisance_prior(linearisation.prior_side)).ratios
    return max(1.0, float(np.sqrt(np.mean(np.square(list(ratios.values()))))))


@dataclass(frozen=True)
class Colour:
    """Spectrum of a residual above that of the noise, summed over rows and runs.

    Attributes
    ----------
    smallest : smallest p of the Ljung-Box tests, of `count` tests.
    excess : power above the noise floor; `coloured` the part of it above any level of the noise.
    """

    smallest: float = 1.0
    count: int = 0
    excess: float = 0.0
    coloured: float = 0.0

    def __add__(self, other: Colour) -> Colour:
        return Colour(
            min(self.smallest, other.smallest), self.count + other.count, self.excess + other.excess,
            self.coloured + other.coloured,
        )  # fmt: skip

    @classmethod
    def of(cls, residual: Array, draws: Array) -> Colour:
        """Of one row of a run: residual (n,) and simulated ones (D, n)."""
        found = whiteness(residual, draws, np.arange(residual.size), 1.0)
        if found is None or found.frequency.size < 2:
            return cls()
        width = np.gradient(found.frequency)
        level = min(
            SELECTION.most_noise_ratio**2, float(np.quantile(found.spectrum / found.floor, SELECTION.quiet_bands))
        )
        above = found.spectrum - max(1.0, level) * found.floor
        return cls(
            found.ljung_box, 1, float(np.sum(width * (found.spectrum - found.floor))),
            float(np.sum(width * np.maximum(0.0, above))),
        )  # fmt: skip


@dataclass(frozen=True)
class ColourTask:
    """Colour of the residual in some rows, as a task for the samples of each run.

    Attributes
    ----------
    measured, simulated : (w, 1) and (w, D) coefficients of the columns in the residual, and in simulated noise.
    rows : the rows.
    """

    measured: Array
    simulated: Array
    rows: tuple[Row, ...]

    def of_run(self, run: RunSamples) -> Colour:
        """The colour in one run."""
        found = Colour()
        for row in self.rows:
            if (series := run.whole_series(self.measured, self.simulated, row)) is not None:
                found = found + Colour.of(*series)
        return found

    def merged(self, parts: Sequence[Colour]) -> Colour:
        """The colour in several runs."""
        return sum(parts, Colour())


def excess_is_coloured(lack: LackOfFit) -> bool:
    """Whether the spectrum of the excess above the floor differs from that of the noise, at any level of the noise.

    The level of the noise is that of the quietest bands of each row's spectrum: most of the excess must be above it.
    """
    if not lack.above:
        return False
    remainder = lack.remainder
    found = remainder.sums.samples.sum(ColourTask(remainder.measured, remainder.simulated, lack.above))
    likely = found.smallest * found.count <= SELECTION.failing_chance
    return likely and found.coloured > SELECTION.coloured_share * found.excess > 0.0
