"""Score tests of candidate effects for a fitted model, all rows of all runs weighted by the noise floor."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.selection.candidate import Answer, Candidate, Reason
from lacet.identify.selection.columns.candidate_columns import CandidateColumns
from lacet.identify.selection.columns.cross_products import Extent
from lacet.identify.selection.columns.drawn_noise import DrawnNoise
from lacet.identify.selection.columns.layout import Trial
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.regressor_noise import RegressorNoise, combined, regressor_labels
from lacet.identify.selection.lack_of_fit import (
    LackOfFit,
    noise_ratios,
    prior_stiffening,
    residual_beside,
    residual_without_tolerance,
)
from lacet.identify.selection.partial_regression import BlockGains, EnergyTask, GainsTask, PartialRegression, beside
from lacet.identify.selection.settings import SELECTION
from lacet.identify.selection.tolerance_tests import (
    FaultWithoutTolerance,
    ToleranceUse,
    chance_of_sizes,
    tolerance_use,
    tolerances_like,
)


@dataclass(frozen=True)
class ScoreTest:
    """Score test of an effect at one set of shape constants.

    A sensor fault that has a tolerance in the sensor sheet is tested without it.

    Attributes
    ----------
    trial : the effect with its columns.
    drop : fall of the weighted squares on all data.
    null : (D,) fall in each simulated run, for the best shape the largest over all shapes.
    values, spread : (k,) estimates of its parameters [SI], and their 1 σ for independent residuals.
    without_tolerance : test of a sensor fault without its own tolerance; None for physics and faults that have none.
    gain_test : test that gives the gain of such a fault: of a latency without the tolerances of all latencies, as runs
        show differences of clocks and not their common time; of other faults `without_tolerance`.
    """

    trial: Trial
    drop: float
    null: Array
    values: Array
    spread: Array
    without_tolerance: FaultWithoutTolerance | None = None
    gain_test: FaultWithoutTolerance | None = None

    @property
    def key(self) -> str:
        """The effect's key."""
        return self.trial.effect.key

    @property
    def colouring(self) -> float:
        """σ of the estimates in simulated runs ÷ that for independent residuals, at least 1."""
        return max(1.0, float(np.sqrt(np.mean(self.null) / len(self.values)))) if self.null.size else 1.0


class ScoreTests:
    """Score tests of all candidates for a fitted model; model, zeros and sensor tolerances are nuisance parameters.

    Parameters
    ----------
    columns : columns of model, sensor sheet and candidates.
    noise : noise in the columns; None to compute it.
    progress : receives each step.
    noise_ratio : row → noise ÷ noise by the sensor sheet; None to estimate it.
    drawn : noise drawn for other fits, to be used instead of new draws where it is of the same runs and columns.

    Attributes
    ----------
    columns, noise : the columns, and the noise in them.
    drawn : that noise as it was drawn, here or for another fit.
    effects : key → effect of the candidates that can be computed.
    regression : partial regression of all columns on those of model, zeros and sensor tolerances.
    without_tolerance : place → test of a sensor fault without its own tolerance, where the sheet has one.
    null : (w, D) products of all columns with simulated runs of a complete model.
    noise_ratio : row → noise ÷ noise by the sensor sheet, at least 1; the simulated runs have this noise.
    """

    def __init__(
        self, columns: CandidateColumns, noise: RegressorNoise | None = None, progress: Progress = silent,
        noise_ratio: Mapping[Row, float] | None = None, drawn: Sequence[DrawnNoise] = (),
    ):  # fmt: skip
        self.columns, self.sums, self.layout = columns, columns.sums, columns.sums.layout
        self.linearisation = columns.linearisation
        self.effects: Mapping[str, Effect] = {effect.key: effect for effect in columns.effects}
        self.fitted, self.floor = columns.linearisation.fitted, columns.linearisation.floor
        self.noise, self.drawn = self._noise(noise, drawn, progress)
        self.noise_ratio = noise_ratio or noise_ratios(self.sums, columns.nuisance, columns.prior, columns.prior_side)
        self.column_noise = self._noise_products(self.noise_ratio)
        self.regression = self.regression_without(())
        self.without_tolerance = {
            trial.place.start: FaultWithoutTolerance(self.regression, trial.place.start, own)
            for trial in self.layout.trials
            if trial.fault
            and (own := self._own_tolerances(trial)).size
            and np.all(self.regression.remaining_energy(trial.place) > SELECTION.gone_share)
        }
        over_runs = self.sums.over_runs
        loud = [self.noise_ratio[row] * products for row, products in over_runs.null.items()]
        there = columns.nuisance[columns.tolerances]
        # What is drawn acts through the true channels, the columns have the channels' noise as well.
        self.null = (
            self.sums.over_runs.null_sheet + self.regression.total[:, there] @ columns.drawn + np.sum(loud, axis=0)
        )

    @classmethod
    def of(
        cls, linearisation: Linearisation, candidates: Sequence[Effect], seed: int, noise: RegressorNoise | None = None,
        progress: Progress = silent, drawn: Sequence[DrawnNoise] = (),
    ) -> ScoreTests:  # fmt: skip
        """Score tests of these candidates at a linearisation of the runs."""
        columns = CandidateColumns.of(linearisation, candidates, seed, prior_stiffening(linearisation), progress)
        return cls(columns, noise, progress, drawn=drawn)

    def _noise(
        self, noise: RegressorNoise | None, drawn: Sequence[DrawnNoise], progress: Progress
    ) -> tuple[RegressorNoise, DrawnNoise]:
        """Noise in the columns without the selected effects, and what it was drawn for."""
        runs, layout, rows = self.linearisation.runs, self.columns.plain_layout, self.floor.sigma
        places = np.append(np.arange(layout.right), self.layout.right)
        weighting = replace(self.sums.weighting, layout=layout)
        gains = tuple(gain[:, places] for gain in self.sums.over_runs.zero_gains)
        if noise is not None and noise.matches(regressor_labels(self.fitted, layout), rows):
            return noise, next(iter(drawn), DrawnNoise(noise, runs, weighting, gains))
        for one in drawn:
            if (known := one.of(runs, layout)) is not None and rows.keys() <= known.sigma.keys():
                return known, one
        progress(Step(Stage.REGRESSOR_NOISE))
        noise = runs.regressor_noise(weighting, rows, progress)
        return noise, DrawnNoise(noise, runs, weighting, gains)

    def _noise_products(self, noise_ratio: Mapping[Row, float]) -> Array:
        """(w, w) products of the noise in all columns, rows so many times as noisy."""
        products = self.noise.products(self.sums, noise_ratio, self.floor.sigma, self.columns.plain_layout)
        return combined(self.columns.from_grid, products) if self.columns.own else products

    @property
    def draws(self) -> int:
        """Number of simulated runs."""
        return self.floor.count

    @property
    def selected(self) -> frozenset[str]:
        """Keys of the effects that are in the model beside the fit's own."""
        return frozenset(trial.effect.key for trial in self.columns.selected)

    def given(self, selected: Sequence[Effect], progress: Progress = silent) -> ScoreTests:
        """Score tests beside other selected effects, with the shape constants that these have."""
        ratios = np.array(list(self.residual_beside(selected).ratios.values()))
        stiffening = max(1.0, float(np.sqrt(np.mean(ratios**2))))
        columns = CandidateColumns.of(
            self.linearisation, self.columns.effects, self.columns.seed, stiffening, progress, selected, self.sums
        )
        return ScoreTests(columns, self.noise, progress, drawn=[self.drawn])

    def releasing(self, keys: Collection[str]) -> ScoreTests:
        """Score tests beside the selected effects without those of `keys`, which are candidates again."""
        kept = [trial for trial in self.columns.selected if trial.effect.key not in keys]
        columns = self.columns.given(kept)
        return ScoreTests(columns, self.noise, noise_ratio=self.noise_ratio, drawn=[self.drawn])

    def regression_without(self, keys: Collection[str]) -> PartialRegression:
        """Partial regression of all columns without the selected effects of `keys` among the nuisance columns."""
        columns = self.columns.given([t for t in self.columns.selected if t.effect.key not in keys])
        return PartialRegression(self.sums, columns.nuisance, columns.prior, self.column_noise, columns.prior_side)

    def on_rows(self, rows: Collection[Row]) -> tuple[PartialRegression, Array]:
        """Partial regression of all columns on the samples of some rows alone, and `null` (w, D) there.

        Each run's zeros are those of all rows, and drifts are left out.
        """
        over_runs, columns = self.sums.over_runs, self.columns
        others = [products.columns for row, products in over_runs.rows.items() if row not in rows]
        sums = replace(self.sums, over_runs=replace(over_runs, total=over_runs.total - np.sum(others, axis=0)))
        ratios = {row: ratio for row, ratio in self.noise_ratio.items() if row in rows}
        noise = self._noise_products(ratios)
        known = PartialRegression(sums, columns.nuisance, columns.prior, noise, columns.prior_side)
        drawn = known.total[:, columns.nuisance[columns.tolerances]] @ columns.drawn
        return known, drawn + np.sum([ratio * over_runs.null[row] for row, ratio in ratios.items()], axis=0)

    # -- one candidate ------------------------------------------------------------------------------------------------

    @cached_property
    def best_tests(self) -> Mapping[str, ScoreTest]:
        """Tests of the effects at their best shapes, by key, without effects that the model explains completely."""
        by_key: dict[str, list[ScoreTest]] = {key: [] for key in self.effects}
        for one in self._tests:
            if one.key in by_key:
                by_key[one.key].append(one)
        out: dict[str, ScoreTest] = {}
        for key, tests in by_key.items():
            # A gap passed once by a hair leaves a column of nothing, in which noise taken off looks like a fall.
            shown = [one for one in tests if self._shows(one)] or tests
            if shown:
                null = np.max([one.null for one in shown], axis=0)
                out[key] = replace(max(shown, key=lambda one: one.drop), null=null)
        return out

    def try_all(self) -> list[Candidate]:
        """All candidates at their best shapes: whether these runs can show them, and their gains."""
        absent = [
            Candidate(key, {}, Answer.NOT_TESTABLE, Reason.NOT_COMPUTABLE, lacks=lack)
            for key, lack in self.columns.unmeasured.items()
        ]
        there = [
            self._candidate(self.best_tests[key]) if key in self.best_tests else self._untestable(effect)
            for key, effect in self.effects.items()
        ]
        return self._with_gains([*absent, *there])

    @cached_property
    def _tests(self) -> list[ScoreTest]:
        """Tests of all trials, without those whose columns the nuisance parameters explain completely."""
        return [
            self._test(trial)
            for trial in self.layout.trials
            if trial.effect.key not in self.selected
            and np.all(self.regression.remaining_energy(trial.place) > SELECTION.gone_share)
        ]

    @cached_property
    def _coverage(self) -> Mapping[int, float]:
        """Effective number of blocks in which a trial acts, by the first place of its columns."""
        places = (one.trial.place.start for one in self._tests)
        return dict(zip(places, self._block_energy(self._tests), strict=True))

    def _shows(self, one: ScoreTest) -> bool:
        """Whether the trial is large enough, in enough blocks, to be seen in these runs."""
        covered = self._coverage[one.trial.place.start]
        return self._size(one) >= SELECTION.least_size and covered >= SELECTION.least_coverage

    def _test(self, trial: Trial) -> ScoreTest:
        if (
            without_tolerance := self.without_tolerance.get(trial.place.start)
        ) is not None and without_tolerance.noisy_part < SELECTION.most_noise_in_fault:
            value, spread = np.array([without_tolerance.value]), np.array([without_tolerance.spread])
            gain_test = without_tolerance
            if trial.effect.sheet_kind == "latency":
                gain_test = FaultWithoutTolerance(self.regression, trial.place.start, self._latency_positions)
            return ScoreTest(
                trial,
                without_tolerance.drop,
                without_tolerance.null(self.null),
                value,
                spread,
                without_tolerance,
                gain_test,
            )
        drop, null = self.regression.scores(trial.place, self.null)
        return ScoreTest(trial, drop, null, *self.regression.values(trial.place))

    def _own_tolerances(self, trial: Trial) -> NDArray[np.intp]:
        """Positions among the nuisance columns of the tolerances that are equivalent to a fault."""
        alike = self.tolerances_of(trial.effect.sheet_entries)
        return tolerances_like(self.regression, trial.place.start, alike)

    def tolerances_of(self, entries: frozenset[tuple[str, str]]) -> NDArray[np.intp]:
        """Positions among the nuisance columns of the tolerances for these entries of the sensor sheet."""
        return np.array([i for i, own in self._entries_of_tolerances.items() if entries & own], np.intp)

    @cached_property
    def _entries_of_tolerances(self) -> Mapping[int, frozenset[tuple[str, str]]]:
        """Position among the nuisance columns of each tolerance → its entries of the sensor sheet."""
        faults = {other.place.start: other.effect for other in self.layout.trials if other.fault}
        first, model = self.layout.model + len(self.layout.sheet), self.layout.model
        out: dict[int, frozenset[tuple[str, str]]] = {}
        for position in self.columns.tolerances:
            place = int(self.regression.nuisance[position])
            out[position] = (
                frozenset((self.layout.sheet[place - model][:2],)) if place < first else faults[place].sheet_entries
            )
        return out

    @cached_property
    def _latency_positions(self) -> NDArray[np.intp]:
        """Positions among the nuisance columns of all latencies of the sheet."""
        latencies = [self.layout.model + i for i, entry in enumerate(self.layout.sheet) if entry[0] == "latency"]
        return np.flatnonzero(np.isin(self.regression.nuisance, latencies))

    def _untestable(self, effect: Effect) -> Candidate:
        """Candidate that never acts on these runs, with what these lack, or that the model explains completely."""
        places = [trial.place for trial in self.layout.trials if trial.effect.key == effect.key]
        found = Candidate(effect.key, {}, Answer.NOT_TESTABLE, Reason.NEVER_ACTS)
        energies = [np.diag(self.sums.total)[place] for place in places]
        lacks = self.linearisation.runs.absent(effect)
        # A parameter that acts in none of the rows, as a yaw moment without wheel loads, is not in the model.
        if any(np.all(own) or (lacks is None and np.any(own)) for own in energies):
            return replace(found, reason=Reason.IN_THE_MODEL)
        if lacks is None:
            return found
        return replace(found, reason=Reason.NOT_RECORDED if effect.as_fault else Reason.ROWS_ABSENT, lacks=lacks)

    def _block_energy(self, tried: Sequence[ScoreTest]) -> list[float]:
        """Effective number of blocks (Σe)²/Σe² in which each trial acts."""
        if not tried:
            return []
        parts: list[Array] = []
        owner: list[int] = []
        for i, one in enumerate(tried):
            scales = [q.largest for q in one.trial.effect.parameters]
            places = np.zeros((self.layout.width, len(scales)))
            places[one.trial.place] = np.diag(scales)
            parts.append(self.regression.coefficients(places))
            owner += [i] * len(scales)
        columns = np.concatenate(parts, axis=1)
        total, squares = self.sums.samples.sum(EnergyTask(columns, np.array(owner), len(tried)))
        return [float(x) for x in np.divide(total**2, squares, out=np.zeros_like(total), where=squares > 0)]

    def _size(self, one: ScoreTest) -> float:
        """√λ of the effect at its largest plausible size [noise σ]."""
        largest = np.array([q.largest for q in one.trial.effect.parameters])
        energy = (
            np.array([one.without_tolerance.energy])
            if one.without_tolerance
            else np.diag(self.regression.reduced)[one.trial.place]
        )
        return float(np.sqrt(max(0.0, np.max(energy * largest**2))))

    def _candidate(self, one: ScoreTest) -> Candidate:
        """Candidate with the results of its test, or with the reason why these runs cannot test it."""
        effect, place, size = one.trial.effect, one.trial.place, self._size(one)
        coverage = self._coverage[place.start]
        found = Candidate(
            effect.key, dict(effect.shape), rows=self._rows(place), coverage=coverage, size=size, drop=one.drop,
            values=tuple(float(x) for x in one.values),
            interval=tuple(float(SELECTION.interval_quantile * one.colouring * x) for x in one.spread),
        )  # fmt: skip
        if coverage < SELECTION.least_coverage:
            return replace(found, answer=Answer.NOT_TESTABLE, reason=Reason.FEW_BLOCKS)
        if size < SELECTION.least_size:
            return replace(found, answer=Answer.NOT_TESTABLE, reason=Reason.SMALL, absorbed=self._absorbed(one))
        if one.gain_test is not None:
            return replace(found, total_gain=one.gain_test.fall())
        # Noise of the nuisance columns in what they leave of the candidate's is there with the candidate in the model.
        part = self.regression.noisy_part(place)
        loud = part > SELECTION.most_noise_in_candidate
        if loud and self.regression.own_noisy_part(place) > SELECTION.most_noise_in_candidate:
            return replace(found, answer=Answer.NOT_TESTABLE, reason=Reason.NOISE, noise_part=part)
        return replace(found, total_gain=self.regression.fall(place, above_noise=loud))

    def _absorbed(self, one: ScoreTest) -> tuple[tuple[str, float], ...]:
        """Shares of a candidate's columns that effects of the model and sensor tolerances explain, largest first.

        Empty for columns of zeros: a channel that reads 0 throughout.
        """
        place, total = one.trial.place, self.sums.total
        k = place.start + int(np.argmax(np.diag(self.regression.reduced)[place]))
        whole = float(total[k, k])
        if whole == 0.0:
            return ()
        # Shares of a regression, as products of coefficient and covariance, in the model's own parameters.
        p = self.layout.model
        gain = self.regression.gain[:, k]
        parts = (self.sums.turn @ gain[:p]) * np.linalg.solve(self.sums.turn.T, total[:p, k])
        shares: dict[str, float] = {}
        selected = {i: t.effect.key for t in self.columns.selected for i in range(t.place.start, t.place.stop)}
        names = [name.rsplit(".", 1)[0] for name in self.fitted.columns]
        for name, part in zip(names, parts, strict=True):
            shares[name] = shares.get(name, 0.0) + float(part) / whole
        for other, part in zip(
            self.regression.nuisance[p:].tolist(), gain[p:] * total[self.regression.nuisance[p:], k], strict=True
        ):
            name = self.columns.sheet.get(other) or selected[other]
            shares[name] = shares.get(name, 0.0) + float(part) / whole
        ranked = sorted(
            ((key, share) for key, share in shares.items() if share > SELECTION.absorbed_share),
            key=lambda item: -item[1],
        )
        return tuple(ranked)

    def _rows(self, place: slice) -> tuple[Row, ...]:
        return tuple(row for row, acting in self.sums.over_runs.acting.items() if np.any(acting[place]))

    def _with_gains(self, found: Sequence[Candidate]) -> list[Candidate]:
        """The candidates with their gains, by block and as shares of the residual of the rows acted on."""
        tested = [c.key for c in found if c.tested]
        if not tested:
            return list(found)
        gains = self.sums.samples.sum(GainsTask(*self._gain_coefficients(tested)))
        # In cross-validation the model alone leaves more than on all data.
        right = self.layout.right
        more = max(0.0, sum(float(test[right, right]) for _, test in self.regression.folds) - gains.whole)
        place = {key: i for i, key in enumerate(tested)}
        return [self._with_gain(c, gains, place[c.key], more) if c.tested else c for c in found]

    def _gain_coefficients(self, tested: Sequence[str]) -> tuple[Array, Array]:
        """Coefficients for `GainsTask`: (w, m + 1) of effects and residual, (w, m) of the residual before.

        For a sensor fault with a tolerance the residual before is that without this tolerance.
        """
        m = len(tested)
        places = np.zeros((self.layout.width, m + 1))
        places[self.layout.right, -1] = 1.0
        for i, key in enumerate(tested):
            places[self.best_tests[key].trial.place, i] = self.best_tests[key].values
        effects = self.regression.coefficients(places)
        before = np.repeat(effects[:, -1:], m, axis=1)
        for i, key in enumerate(tested):
            if (gain_test := self.best_tests[key].gain_test) is not None:
                effects[:, i], before[:, i] = (gain_test.coefficients() * np.array([gain_test.value, 1.0])).T
        return effects, before

    def _with_gain(self, c: Candidate, gains: BlockGains, i: int, more: float) -> Candidate:
        """Candidate `i` with its gains; `more` : squares of the residual in cross-validation less those on all data."""
        here = more + sum(float(gains.before[row][i]) for row in c.rows)
        alike = self.floor.of_one_unit(c.rows)
        scale = float(np.sqrt(np.mean([self.floor.sigma[row] ** 2 for row in alike])))
        rms = scale * float(np.sqrt(max(0.0, c.total_gain) / max(1, sum(gains.counts[row] for row in alike))))
        # Rows it does not act on gain too, where it frees the parameters they share.
        gain = min(1.0, c.total_gain / here) if here else 0.0
        parts = (float(gains.taken[row][i] / gains.before[row][i]) for row in c.rows if gains.before[row][i])
        return replace(c, gain=gain, most=max(parts, default=0.0), gain_rms=rms, block_gain=gains.blocks[:, i])

    @property
    def tolerated_parameters(self) -> Array:
        """(p,) parameters of the physics estimated with sensor tolerances and no candidate."""
        out, model = self.fitted.theta.copy(), self.layout.model
        out[self.fitted.place] += self.sums.turn @ self.regression.gain[:model, self.layout.right]
        return out[: len(self.fitted.physics)]

    # -- effects added, at shapes of their own -------------------------------------------------------------------------

    def beside(
        self, effects: Sequence[Effect], extent: Extent = Extent.ALL
    ) -> tuple[PartialRegression, tuple[Trial, ...]]:
        """Partial regression of effects at their present shapes on model, zeros and sheet, and their trials.

        `extent` : which sums it has.
        """
        return beside(self.columns, self.regression, effects, extent)

    def residual_beside(self, added: Sequence[Effect]) -> LackOfFit:
        """Lack of fit with model, zeros, sensor sheet and the `added` effects."""
        return residual_beside(self.columns, self.regression, added)

    def residual_without_tolerance(self, key: str) -> LackOfFit:
        """Lack of fit with model, zeros and sheet, without the own tolerance of the sensor fault `key`."""
        without_tolerance = self.best_tests[key].without_tolerance
        return residual_without_tolerance(
            self.regression, without_tolerance.own if without_tolerance else np.zeros(0, np.intp)
        )

    def tolerance_use(self) -> ToleranceUse:
        """Sensor tolerances that the runs need."""
        return tolerance_use(self.columns, self.regression, self.null)

    # -- all of them --------------------------------------------------------------------------------------------------

    def family_wise(self, found: Sequence[Candidate]) -> list[Candidate]:
        """The candidates with family-wise p: their falls compared with the max-score statistic of simulated runs.

        Falls are in units of their own mean over simulated and measured runs: with a misfit, where the sheet's priors
        are stiffened, a fault with a wide tolerance would else exceed all physics.
        """
        falls = {c.key: (self.best_tests[c.key].drop, self.best_tests[c.key].null) for c in found if c.tested}
        if not falls:
            return list(found)
        # Simulated and measured runs alike: exchangeable when nothing is missing, so that p is exact for any number.
        means = {key: _mean(*fall) for key, fall in falls.items()}
        worst = np.max([null / means[key] for key, (_, null) in falls.items()], axis=0)
        return [replace(c, p=_p_above(c.drop / means[c.key], worst)) if c.tested else c for c in found]

    def family_wise_of(self, fall: float, null: Array) -> float:
        """Family-wise p of what is in the model already, by its fall and (D,) that in simulated runs."""
        others = [one.null / _mean(one.drop, one.null) for one in self.best_tests.values()]
        mean = _mean(fall, null)
        return _p_above(fall / mean, np.max([null / mean, *others], axis=0))

    @cached_property
    def chance_of_faults(self) -> Mapping[str, float]:
        """Sensor fault → probability that noise and errors within the sheet alone give it the size it has in a fit.

        A fit estimates no tolerances. All of the sheet counts here, in a fit (`joint.refits.fitted_with`) gains,
        latencies and assumptions alone.
        """
        faults = [one for one in self.best_tests.values() if one.trial.fault]
        places = np.array([one.trial.place.start for one in faults], np.intp)
        p = chance_of_sizes(self.regression, self.columns.tolerances, places, self.null)
        return {one.key: float(x) for one, x in zip(faults, p, strict=True)}

    def correlation(self, a: str, b: str) -> float:
        """Largest canonical correlation of two candidates, nuisance parameters removed."""
        first, second = self.best_tests[a].trial.place, self.best_tests[b].trial.place
        # A touch more on the diagonal: of a law's parameters one may be all but another's double on these runs.
        A, B = (
            np.linalg.cholesky(G + SELECTION.correlation_ridge * np.diag(np.diag(G)))
            for G in (self.regression.reduced_noisy[first, first], self.regression.reduced_noisy[second, second])
        )
        across = np.linalg.solve(A, self.regression.reduced_noisy[first, second])
        return min(1.0, float(np.linalg.svd(np.linalg.solve(B, across.T), compute_uv=False)[0]))


def _mean(fall: float, null: Array) -> float:
    """Mean fall over the simulated runs and the measured one."""
    return float((np.sum(null) + fall) / (1 + null.size))


def _p_above(fall: float, worst: Array) -> float:
    return float((1 + np.count_nonzero(worst >= fall)) / (1 + worst.size))
