"""Ranking on a campaign: which effect its model lacks, by the tests of `lacet diagnose`, a pass a task for each run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.regression.qr_accumulation import orthonormaliser
from lacet.identify.regression.sums.linear_fit import FitOptions, FittedModel
from lacet.identify.regression.tolerances import SheetEntry, entry_name
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.cross_products import CrossProducts, Extent, SumsOfRuns, model_prior
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.regressor_noise import (
    RegressorNoise,
    RunNoise,
    pairs_drawn,
    regressor_labels,
)
from lacet.identify.selection.columns.samples import SampleTask, T
from lacet.identify.selection.columns.weighted_columns import Weighting
from lacet.identify.selection.diagnose import diagnose_runs
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS, NoiseFloor, draws_of_piece
from lacet.identify.validation.score import row_ratios
from lacet.services.campaign.cluster import Cluster
from lacet.services.campaign.fitting import CampaignFit, fit_campaign
from lacet.services.campaign.ranking_tasks import (
    ColumnNoiseAt,
    Draws,
    FitAt,
    LacksAt,
    PlainEffect,
    PlainWeighting,
    ProductsAt,
    RunSurvey,
    SamplesAt,
    SurveyAt,
    added,
    of_the_first,
)
from lacet.services.campaign.run_reference import RunReference
from lacet.services.campaign.tasks import State


@dataclass(frozen=True)
class CampaignSamples:
    """Weighted samples of a campaign's runs, made by the workers anew for each task."""

    runs: CampaignRanking
    draws: Draws
    columns: PlainWeighting
    sigma: Mapping[Row, float]

    def sum(self, task: SampleTask[T]) -> T:
        """The result of a task over all runs."""
        state = SamplesAt(self.runs.plain, self.draws, self.columns, self.sigma, task)
        return self.runs.reduce(state, task.merged, "tests of candidates")


@dataclass(frozen=True)
class CampaignRanking:
    """A campaign's fit and its runs, as a ranking asks for them (`RankedRuns`).

    Attributes
    ----------
    cluster : the workers.
    found : the fit.
    draws : number of simulated campaigns.
    """

    cluster: Cluster
    found: CampaignFit
    draws: int = DEFAULT_DRAWS
    _lacks: dict[str, Unmeasured | None] = field(
        default_factory=dict[str, "Unmeasured | None"], init=False, repr=False, compare=False
    )

    @property
    def fitted(self) -> FittedModel:
        """The fitted model."""
        return self.found.fitted

    @property
    def refittable(self) -> Fit | None:
        """None: latencies and faults are not removed from a campaign's runs."""
        return None

    @property
    def names(self) -> Sequence[str]:
        """Names of the runs."""
        return [run.reference.name for run in self.found.campaign.runs]

    @property
    def seconds(self) -> Sequence[float]:
        """Lengths of the runs [s]."""
        return [run.seconds for run in self.found.campaign.runs]

    @property
    def rig(self) -> Rig:
        """The rig of the first run."""
        return Rig.parse(self.found.campaign.runs[0].rig)

    @property
    def vehicle(self) -> Vehicle:
        """The car."""
        return self.found.campaign.vehicle

    @property
    def wheel_reference(self) -> str:
        """``contact`` or ``hub``."""
        return self.found.campaign.settings.wheel_reference

    @property
    def sheet_entries(self) -> tuple[SheetEntry, ...]:
        """Gains and latencies of the sensor sheet that the rows depend on, without those in the model as faults."""
        return self.survey.sheet

    @property
    def omega(self) -> float:
        """Angular frequency of the fit's cut-off [rad/s]."""
        return 2.0 * np.pi * self.found.campaign.settings.filters.fit_cutoff

    def entry_name(self, entry: SheetEntry) -> str:
        """Name of an entry of the sensor sheet."""
        return entry_name(entry, self.rig)

    @cached_property
    def plain(self) -> FitAt:
        """The fit as plain values."""
        return FitAt.of(self.fitted, self.found.equations.where)

    @cached_property
    def simulated(self) -> Draws:
        """How often the noise is drawn."""
        return Draws(self.draws, draws_of_piece(self.draws, len(self.names)))

    @cached_property
    def candidates(self) -> dict[str, Effect]:
        """Key → effect of the catalogue that is not in the model."""
        known = self.found.campaign.settings.known_effects()
        return {key: effect for key, effect in known.items() if not effect.base and key not in self.fitted.model}

    @cached_property
    def survey(self) -> RunSurvey:
        """Noise of all runs, the sensor sheet's entries, and what cannot be computed."""
        state = SurveyAt(self.plain, self.simulated, tuple(self.candidates))
        return self.reduce(state, RunSurvey.merged, "noise floor of the ranking")

    @property
    def floor(self) -> NoiseFloor:
        """The noise floor's levels; the draws stay with the workers."""
        return NoiseFloor((), (), self.survey.sigma, self.draws)

    def row_ratios(self, floor: NoiseFloor) -> Mapping[Row, float]:
        """Row → RMS residual ÷ noise floor over all runs, as scored after the fit."""
        found = row_ratios(self.found.scores)
        return {row: found[str(row)] for row in floor.sigma if str(row) in found}

    def row_variations(self) -> Mapping[Row, float]:
        """Row → RMS variation of what is measured in it [N or N·m], from the scores of the runs."""
        rows = {name: score for scores in self.found.scores.values() for name, score in scores.items()}
        return {Row.parse(name): _variation(name, self.found.scores.values()) for name in rows}

    def unmeasured(self, effects: Sequence[Effect]) -> Mapping[str, Unmeasured]:
        """Key → what a run lacks, of the first such run, for effects that cannot be computed."""
        others = [one for one in effects if one.key not in self.candidates and one.key not in self._lacks]
        if others:
            state = LacksAt(self.plain, tuple(map(PlainEffect.of, others)))
            found = self.reduce(state, of_the_first, "what laws need")
            self._lacks.update({one.key: found.get(one.key) for one in others})
        known = {**self._lacks, **self.survey.lacks}
        return {effect.key: lack for effect in effects if (lack := known.get(effect.key)) is not None}

    def absent(self, effect: Effect) -> Unmeasured | None:
        """None: the runs are elsewhere."""
        del effect
        return None

    def scale(self) -> None:
        """None: the runs are elsewhere."""

    def assumed(self, rests: Mapping[Row, float]) -> Mapping[Row, tuple[str, ...]]:
        """Nothing: the runs are elsewhere."""
        del rests
        return {}

    def products(
        self, floor: NoiseFloor, layout: Layout, prior_stiffening: float, drifts: Mapping[str, float], seed: int,
        extent: Extent = Extent.ALL, known: CrossProducts | None = None,
    ) -> CrossProducts:  # fmt: skip
        """Cross products of the columns of a layout, from one pass over the samples."""
        del known  # its columns are where the runs are
        sigma, fitted = dict(floor.sigma), self.fitted
        equations = self.found.equations.equations
        root = equations.root({row: sigma.get(row, own) for row, own in fitted.sigma.items()})
        weighting = Weighting(layout, orthonormaliser(root[:, : len(fitted.place)]), prior_stiffening)
        plain, draws = PlainWeighting.of(weighting), self.simulated if floor.count else Draws(0, 0)
        state = ProductsAt(self.plain, draws, plain, sigma, dict(drifts), seed, extent)
        sums = self.reduce(state, SumsOfRuns.merged, "products of columns")
        prior = model_prior(equations.known, fitted.solution, weighting.turn)
        return CrossProducts(weighting, prior, sums, CampaignSamples(self, draws, plain, sigma))

    def regressor_noise(self, weighting: Weighting, sigma: Mapping[Row, float], progress: Progress) -> RegressorNoise:
        """Noise in the columns of all runs."""
        del progress  # that of the cluster
        return self._column_noise(list(range(len(self.names))), weighting, sigma, pairs_drawn(self.seconds))

    def regressor_noise_of(
        self, run: int, weighting: Weighting, sigma: Mapping[Row, float], pairs: int
    ) -> RegressorNoise:
        """Noise in the columns of one run, from so many pairs of draws."""
        return self._column_noise([run], weighting, sigma, pairs)

    def _column_noise(
        self, chosen: Sequence[int], weighting: Weighting, sigma: Mapping[Row, float], pairs: int
    ) -> RegressorNoise:
        state = ColumnNoiseAt(self.plain, Draws(0, 0), PlainWeighting.of(weighting), dict(sigma), pairs)
        totals = self.reduce(state, added, "noise in the columns", [self.references[run] for run in chosen])
        labels = regressor_labels(self.fitted, weighting.layout)
        return RegressorNoise(labels, (RunNoise.of_totals(totals),), dict(sigma))

    @property
    def references(self) -> list[RunReference]:
        """The runs as the workers find them."""
        return [run.reference for run in self.found.campaign.runs]

    def reduce(
        self, state: State, how: Callable[[Sequence[T]], T], what: str, runs: Sequence[RunReference] | None = None
    ) -> T:
        """The sums of all runs, or of some, merged; they are not kept: the products of one run are 20 MB."""
        settings = replace(self.found.campaign.settings, store="")
        return self.cluster.reduce(self.references if runs is None else runs, settings, state, how, what)


def _variation(row: str, runs: Iterable[Mapping[str, Mapping[str, Any]]]) -> float:
    """RMS variation of a row over runs; the variance accounted for is that of the residual, taken from one."""
    squares = [
        (score["rms"] ** 2, 1.0 - score["vaf"] / 100.0)
        for scores in runs
        if (score := scores.get(row)) is not None
    ]  # fmt: skip
    return float(np.sqrt(np.mean([rms / share for rms, share in squares if share > 0.0])))


def diagnose_campaign(cluster: Cluster, found: CampaignFit, draws: int = DEFAULT_DRAWS) -> Diagnosis:
    """Which effect a campaign's model lacks; what needs new fits with a latency or fault removed is passed over."""
    runs = CampaignRanking(cluster, found, draws)
    return diagnose_runs(runs, runs.floor, list(runs.candidates.values()))


@dataclass(frozen=True)
class DiagnosedFit:
    """A campaign's fit, and what its model lacks."""

    found: CampaignFit
    diagnosis: Diagnosis


def diagnosed(
    cluster: Cluster, found: CampaignFit, options: FitOptions, most: int, draws: int = DEFAULT_DRAWS
) -> Iterator[DiagnosedFit]:
    """The diagnosis of a campaign, and of its fits with up to `most` effects added, until nothing is missing."""
    for step in range(most + 1):
        diagnosis = diagnose_campaign(cluster, found, draws)
        yield DiagnosedFit(found, diagnosis)
        if diagnosis.best is None or step == most:
            return
        settings = found.campaign.settings
        extended = replace(settings, effects=(*settings.effects, diagnosis.best.key))
        found = fit_campaign(cluster, replace(found.campaign, settings=extended), options)
