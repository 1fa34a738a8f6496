"""Parameter constancy across runs: a Chow test of one law against simulated runs.

A cause that is in no catalogue may resemble a listed law in one run and not in the next. The parameters of a law are
properties of the car and equal in all runs: the test compares how much more of the residual they explain when each run
has its own.

Source: G. C. Chow, Tests of equality between sets of coefficients in two linear regressions, Econometrica 28 (1960).
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.run_products import RunProducts
from lacet.identify.selection.columns.samples import RunSamples
from lacet.identify.selection.lack_of_fit import with_columns
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.rest import AddedLaw
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class ParameterConstancy:
    """Chow test of one law: its parameters estimated run by run.

    Attributes
    ----------
    values : name of a run → (k,) parameters estimated from that run, for the m runs that show the law.
    covariance : (m, k, m, k) of these for independent residuals. What runs have in common, as tolerances of the sensor
        sheet, moves the parameters of all of them together.
    common : fall of the weighted squares with the same parameters in all runs.
    apart : what the fall by differences would be, were they as large as the common parameters themselves.
    further : additional fall with parameters of their own for each run; `null` (D,) that in simulated runs.
    misfits : name of a run → misfit of the common parameters in it (weighted squares, less those by chance), ÷ the
        weighted squares of the law in it; 0 where chance explains the misfit.
    """

    values: Mapping[str, Array]
    covariance: Array = field(repr=False)
    common: float
    apart: float
    further: float
    null: Array = field(repr=False)
    misfits: Mapping[str, float]

    @property
    def p(self) -> float:
        """Probability of such a difference between runs by chance, from simulated runs."""
        return float((1 + np.count_nonzero(self.null >= self.further)) / (1 + self.null.size))

    @property
    def spread(self) -> Mapping[str, Array]:
        """Name of a run → (k,) 1 σ of its parameters."""
        of_runs = np.sqrt(np.maximum(0.0, np.einsum("mkmk->mk", self.covariance)))
        return dict(zip(self.values, of_runs, strict=True))

    def difference(self, k: int, a: str, b: str) -> tuple[float, float]:
        """Parameter k in run b less that in run a, and its 1 σ."""
        at = list(self.values)
        i, j = at.index(a), at.index(b)
        of_both = self.covariance[:, k, :, k][np.ix_([i, j], [i, j])]
        square = float(np.array([-1.0, 1.0]) @ of_both @ np.array([-1.0, 1.0]))
        return float(self.values[b][k] - self.values[a][k]), float(np.sqrt(max(0.0, square)))

    @property
    def farthest_apart(self) -> tuple[int, str, str]:
        """Index of the parameter that differs most between runs, in σ of the difference, and names of the two runs."""

        def off(place: tuple[int, str, str]) -> float:
            by, sigma = self.difference(*place)
            return abs(by) / sigma if sigma > 0.0 else 0.0

        pairs = itertools.combinations(self.values, 2)
        return max(((k, a, b) for a, b in pairs for k in range(len(self.values[a]))), key=off)

    def is_rejected(self, laws: int) -> bool:
        """Whether runs differ by more than chance, of so many laws tested: family-wise, by Bonferroni.

        With few simulated runs p has its least possible value.
        """
        return self.p <= max(SELECTION.failing_chance / laws, 1.0 / (1 + self.null.size))

    def differ_by_more_than(self, share: float, laws: int = 1) -> bool:
        """Whether runs differ by more than chance (`is_rejected`), and by this share of what the law explains.

        Beside nuisance parameters that runs have in common, what the law explains itself may be little while its
        differences between runs are seen well. These are compared with what differences as large as the law would be.
        """
        by_chance = float(np.mean(self.null))
        explained = max(self.common, self.apart)
        return self.is_rejected(laws) and self.further - by_chance > share * explained

    def fails_in_a_run(self, share: float, laws: int = 1) -> bool:
        """Whether runs differ by more than chance (`is_rejected`), and any run's misfit is more than this share of the
        law in it."""
        return self.is_rejected(laws) and max(self.misfits.values()) > share


def chow_test(space: ScoreTests, c: Candidate, others: Sequence[Candidate] = ()) -> ParameterConstancy | None:
    """Chow test of a candidate beside model, sensor tolerances and `others`; None where only one run shows it.

    Parameters of the model, of the sensor tolerances and of the others are the same in all runs; each run has its own
    sensor zeros. Shape constants are those of the candidates.
    """
    inside, trials = space.beside([replace(space.effects[one.key], shape=one.shape) for one in (c, *others)])
    own = space.best_tests[c.key].without_tolerance  # a fault is tested without its own tolerance
    fresh = {
        i: q.prior
        for trial in trials[1:]
        for i, q in zip(range(trial.place.start, trial.place.stop), trial.effect.parameters, strict=True)
    }
    mine, columns = np.r_[trials[0].place], np.eye(inside.sums.layout.width)
    return _tested(space, inside, _Law(mine, columns, own.own if own else np.zeros(0, np.intp), fresh))


def chow_test_in_model(space: ScoreTests, law: AddedLaw, without: Sequence[AddedLaw] = ()) -> ParameterConstancy | None:
    """Chow test of an effect that is in the fit of `space`; None where only one run shows it.

    The other effects of the fit are beside it, without those of `without`. Zeros and tolerances act through the law,
    too: an offset of a laser changes the stiffness of a spring that bends.
    """
    inside, _ = space.beside([])
    model, width = inside.sums.layout.model, inside.sums.layout.width
    columns = np.eye(width)  # the parameters' own columns in place of their combinations
    columns[:model, :model] = np.linalg.inv(inside.sums.turn)
    gone = [i for other in without for i in other.places]
    theta = np.zeros(width)
    fit = space.fitted.theta[space.fitted.place]
    for one in (law, *without):
        theta[list(one.places)] = fit[list(one.places)] + one.removed
    right = columns.copy()
    right[:, inside.sums.layout.right] += columns @ theta
    own = space.tolerances_of(law.sheet_entries)
    return _tested(space, inside, _Law(np.array(law.places), right, np.concatenate([gone, own]).astype(np.intp)))


@dataclass(frozen=True)
class _Law:
    """The columns of the law tested, and those beside it.

    Attributes
    ----------
    mine : (k,) places of its columns.
    columns : (w, w) coefficients of the columns that places refer to, the residual the last.
    left_out : positions among the nuisance columns of those that are not in the model.
    fresh : place → 1 σ of the prior of further columns with common parameters.
    """

    mine: NDArray[np.intp]
    columns: Array
    left_out: NDArray[np.intp]
    fresh: Mapping[int, float] = field(default_factory=dict[int, float])


def _tested(space: ScoreTests, inside: PartialRegression, law: _Law) -> ParameterConstancy | None:
    """Chow test of a law; None where only one run shows it."""
    if len(space.linearisation.runs.names) < 2:
        return None
    sums, mine, model = inside.sums, law.mine, inside.sums.layout.model
    nuisance, basis = inside.nuisance, law.columns[np.ix_(inside.nuisance, inside.nuisance)]
    prior, prior_side = basis.T @ inside.prior @ basis, basis.T @ inside.prior_side
    kept = np.setdiff1d(np.arange(len(nuisance)), [*law.left_out, *np.flatnonzero(np.isin(nuisance, mine))])
    sheet = kept[np.isin(kept, space.columns.tolerances)]  # selected effects stand behind them
    known = with_columns(nuisance[kept], prior[np.ix_(kept, kept)], prior_side[kept], law.fresh)
    names, groups, chance = _groups(space, sums, inside.column_noise, law)
    drawn = space.columns.drawn[sheet - model]
    chance = [noise + products[:, nuisance[sheet]] @ drawn for noise, products in zip(chance, groups, strict=True)]
    energy = [float(np.trace(one[np.ix_(mine, mine)])) for one in groups]
    shown = [i for i, own in enumerate(energy) if own > SELECTION.least_energy_of_run * sum(energy)]
    if len(shown) < 2:
        return None
    right = [products[:, [sums.layout.right]] for products in groups]
    return _compared([names[i] for i in shown], groups, right, chance, shown, mine, known)


def _compared(
    names: Sequence[str], groups: Sequence[Array], right: Sequence[Array], chance: Sequence[Array],
    shown: Sequence[int], mine: NDArray[np.intp], known: tuple[NDArray[np.intp], Array, Array],
) -> ParameterConstancy:  # fmt: skip
    """Chow test of the columns at `mine` over the `shown` groups of runs.

    Parameters
    ----------
    names : of the groups shown.
    groups : for each group of runs (w, w) products of all columns.
    right, chance : for each group (w, 1) products with the residual, and (w, D) with simulated ones.
    known : places, normal matrix and right side of the priors of the columns with common parameters.
    """
    nuisance, prior, prior_side = known
    k, m = len(mine), len(shown)
    across = np.concatenate([groups[i][np.ix_(nuisance, mine)] for i in shown], axis=1)
    gain = solved(np.sum([one[np.ix_(nuisance, nuisance)] for one in groups], axis=0) + prior, across)
    normal = -across.T @ gain
    for at, i in enumerate(shown):
        normal[at * k : (at + 1) * k, at * k : (at + 1) * k] += groups[i][np.ix_(mine, mine)]
    alike = np.tile(np.eye(k), (m, 1))
    covariance = solved(normal, np.eye(k * m)).reshape(m, k, m, k)
    of_runs = np.linalg.pinv(covariance[range(m), :, range(m)], hermitian=True)

    def falls(parts: Sequence[Array], beforehand: Array) -> tuple[Array, Array, Array, Array]:
        """Parameters of each run (m, k, D), common ones (k, D), the fall with these, and the further one (D,)."""
        score = np.concatenate([parts[i][mine] for i in shown])
        score = score - gain.T @ (np.sum([one[nuisance] for one in parts], axis=0) + beforehand)
        each, both = solved(normal, score), alike.T @ score
        common = solved(alike.T @ normal @ alike, both)
        fall = np.einsum("kd,kd->d", both, common)
        return each.reshape(m, k, -1), common, fall, np.einsum("kd,kd->d", score, each) - fall

    def squares(parameters: Array) -> Array:
        """(m, D) weighted squares of the law in each run with these parameters (m, k, D)."""
        return np.einsum("mkd,mkl,mld->md", parameters, of_runs, parameters)

    each, common, fall, further = falls(right, prior_side[:, None])
    drawn, drawn_common, _, null = falls(chance, np.zeros((len(nuisance), 1)))
    off, by_chance = squares(each - common)[:, 0], squares(drawn - drawn_common)
    usual, law = np.mean(by_chance, axis=1), squares(np.broadcast_to(common, each.shape))[:, 0]
    seen = usual > 0.0  # beside the other columns a run may show nothing of the law
    worst = np.max(by_chance[seen] / usual[seen, None], axis=0, initial=0.0)
    significant = seen & (off > np.quantile(worst, 1.0 - SELECTION.failing_chance) * usual)
    misfits = np.divide(off - usual, law, out=np.zeros(m), where=significant)
    return ParameterConstancy(
        dict(zip(names, each[:, :, 0], strict=True)), covariance, float(fall[0]), _apart(normal, common[:, 0]),
        float(further[0]), null, dict(zip(names, misfits.tolist(), strict=True)),
    )  # fmt: skip


def _apart(normal: Array, common: Array) -> float:
    """Expected fall by differences between runs whose parameters are `common` (k,) times independent factors.

    The factors have a variance of one between the m runs, as a sample has it (÷ m). Of runs that show a law alike and
    have no nuisance parameter in common this is what the law explains itself; of any that have none it is at most that.

    Parameters
    ----------
    normal : (m k, m k) normal matrix of the parameters of each run.
    """
    k = len(common)
    m = len(normal) // k
    across = normal @ np.tile(np.eye(k), (m, 1))
    alike = across.reshape(m, k, k).sum(axis=0)
    differences = normal - across @ solved(alike, across.T)
    of_runs = differences.reshape(m, k, m, k)[range(m), :, range(m)]
    return m / (m - 1) * float(np.einsum("k,mkl,l->", common, of_runs, common))


def _groups(
    space: ScoreTests, sums: CrossProducts, noise: Array, law: _Law
) -> tuple[list[str], list[Array], list[Array]]:
    """Groups of runs: names, products (w, w) less the noise in columns, and products (w, D) with simulated noise.

    Runs that show the law best are groups by themselves, up to `chow_seconds` of data; all others are one group. The
    noise in the columns is drawn for each run by itself; that of the last group is `noise` (w, w), of all runs, less
    those. All are products of the law's `columns`.
    """
    of_law = law.columns[:, law.mine]
    runs = space.linearisation.runs
    found = sums.samples.sum(SingleRunsTask(sums.layout.width, space.floor.count, space.noise_ratio))
    budget, single = SELECTION.chow_seconds, list[int]()
    seconds = runs.seconds
    for run in sorted(range(len(seconds)), key=lambda run: -float(np.trace(of_law.T @ found[run][0] @ of_law))):
        budget -= seconds[run]
        if budget >= 0.0 or not single:
            single.append(run)
    rest = [run for run in range(len(seconds)) if run not in single]
    names = _distinct_names(runs.names, single)
    products, chance = list[Array](), [found[run][1] for run in single]
    for run in single:
        drawn = runs.regressor_noise_of(run, sums.weighting, space.floor.sigma, SELECTION.chow_noise_pairs)
        own = drawn.products(sums, space.noise_ratio, space.floor.sigma)
        products.append(found[run][0] - own)
        noise = noise - own
    if rest:
        names.append("the other run" if len(rest) == 1 else f"the {len(rest)} other runs")
        products.append(np.sum([found[run][0] for run in rest], axis=0) - noise)
        chance.append(np.sum([found[run][1] for run in rest], axis=0))
    turned = [law.columns.T @ one @ law.columns for one in products]
    return names, turned, [law.columns.T @ one for one in chance]


def _distinct_names(names: Sequence[str], runs: Sequence[int]) -> list[str]:
    """Names of the runs with these indices, with a number where several runs have the same name."""
    often = Counter(names)
    return [names[run] if often[names[run]] == 1 else f"{names[run]} ({run + 1})" for run in runs]


@dataclass(frozen=True)
class SingleRunsTask:
    """Products of each run by itself, as a task for the samples of each run.

    Attributes
    ----------
    width, draws : number of columns w, and of simulated runs D.
    noise_ratio : row → noise ÷ noise by the sensor sheet.
    """

    width: int
    draws: int
    noise_ratio: Mapping[Row, float]

    def of_run(self, run: RunSamples) -> tuple[tuple[Array, Array], ...]:
        """(w, w) products of the columns, and (w, D) with the simulated noise, the run's zeros eliminated."""
        products = RunProducts.of(run.blocks, len(run.zero_gain), self.width, self.draws)
        noise = np.sum([self.noise_ratio[row] * drawn for row, drawn in products.noise.items()], axis=0)
        return ((products.eliminated[1], products.remaining(noise)),)

    def merged(self, parts: Sequence[tuple[tuple[Array, Array], ...]]) -> tuple[tuple[Array, Array], ...]:
        """Those of several runs, one after the other."""
        return tuple(one for part in parts for one in part)
