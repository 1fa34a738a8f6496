"""The fit of a campaign: runs looked at, the model fitted to those that can be used, every run scored against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lacet.daq.errors import NotIdentifiable, UsageError
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import silent
from lacet.identify.regression.model import Model
from lacet.identify.regression.sums.linear_fit import FitOptions, FittedModel, solve_runs
from lacet.identify.validation.noise_floor import SCORE_DRAWS
from lacet.services.campaign.campaign_runs import CampaignEquations, CampaignRuns
from lacet.services.campaign.cluster import BrokenRuns, Cluster
from lacet.services.campaign.run_reference import Settings, references
from lacet.services.campaign.tasks import Broken, RunScores, ScoresAt, Survey, joined_scores


@dataclass(frozen=True)
class Campaign:
    """Runs that have been looked at.

    Attributes
    ----------
    settings : what all tasks have in common, the vehicle and the wheel reference of the runs included.
    runs : those that can be used, in the order given.
    broken : name → reason of those that cannot.
    """

    settings: Settings
    runs: tuple[Survey, ...]
    broken: Mapping[str, str] = field(default_factory=dict[str, str])

    @classmethod
    def of(cls, cluster: Cluster, places: Sequence[str], settings: Settings) -> Campaign:
        """Look at every run; the vehicle is the one given, else that of the first run.

        Raises UsageError when runs differ in wheel reference, NotIdentifiable when none can be used.
        """
        refs = references(places)
        found = cluster.survey(refs, settings)
        broken = {name: why for one in found if isinstance(one, Broken) for name, why in one.runs.items()}
        runs: list[Survey] = []
        seen: dict[str, str] = {}
        for one in found:
            if isinstance(one, Broken):
                continue
            name, digest = one.reference.name, one.reference.digest
            if digest in seen:
                broken[name] = f"the same content as {seen[digest]}, whose samples would count twice"
                continue
            seen[digest] = name
            runs.append(one)
        if not runs:
            raise NotIdentifiable("none of the runs can be used:\n" + _listed(broken))
        if len({run.wheel_reference for run in runs}) > 1:
            raise UsageError("the runs have different wheel references (contact and hub): identify them apart")
        settings = replace(settings, vehicle=runs[0].vehicle, wheel_reference=runs[0].wheel_reference)
        return cls(settings, tuple(runs), broken)

    def without(self, broken: Mapping[str, str]) -> Campaign:
        """The campaign without runs that turned out to be broken. Raises NotIdentifiable when none remains."""
        runs = tuple(run for run in self.runs if run.reference.name not in broken)
        if not runs or len(runs) == len(self.runs):
            raise NotIdentifiable("none of the runs can be used:\n" + _listed({**self.broken, **broken}))
        return replace(self, runs=runs, broken={**self.broken, **broken})

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle."""
        return self.settings.car

    @property
    def seconds(self) -> float:
        """Length of all runs together [s]."""
        return sum(run.seconds for run in self.runs)

    @property
    def warnings(self) -> tuple[str, ...]:
        """About the runs, and those left out, one line each."""
        first, others = self.runs[0], self.runs[1:]
        cars = [run.reference.name for run in others if run.vehicle != first.vehicle]
        lines = [line for run in self.runs for line in run.warnings]
        if cars:
            lines.append(f"{', '.join(cars)}: another vehicle file than that of {first.reference.name}, which was used")
        return (*lines, *(f"left out: {name}: {why}" for name, why in self.broken.items()))


def _listed(broken: Mapping[str, str], most: int = 20) -> str:
    lines = [f"  - {name}: {why}" for name, why in broken.items()]
    return "\n".join(lines[:most]) + ("\n  - …" if len(lines) > most else "")


@dataclass(frozen=True)
class CampaignFit:
    """A model fitted to a campaign, without the runs themselves.

    Attributes
    ----------
    campaign : the runs used, and those left out.
    fitted : the model.
    counts : row → number of samples.
    scores : run → row → score, as plain data.
    equations : of the last step, held by the workers.
    """

    campaign: Campaign
    fitted: FittedModel
    counts: Mapping[Row, int]
    scores: RunScores
    equations: CampaignEquations

    @property
    def faults(self) -> Array:
        """(f,) sizes of the model's sensor faults."""
        return self.fitted.theta[self.fitted.model.physics_size :]


def fit_campaign(
    cluster: Cluster, campaign: Campaign, options: FitOptions | None = None, draws: int = SCORE_DRAWS
) -> CampaignFit:
    """Fit the campaign's model to its runs; one that turns out to be broken is left out, and the fit begins anew.

    Raises NotIdentifiable when nothing is identifiable with these runs.
    """
    while True:
        try:
            return _fit(cluster, campaign, options or FitOptions(), draws)
        except BrokenRuns as error:
            campaign = campaign.without(error.runs)


def _fit(cluster: Cluster, campaign: Campaign, options: FitOptions, draws: int) -> CampaignFit:
    settings, model = campaign.settings, _model(campaign)
    refs = [run.reference for run in campaign.runs]
    runs = CampaignRuns(cluster, refs, settings, np.zeros(len(model.faults)))
    found = solve_runs(model, runs, options, progress=silent)
    fitted = FittedModel.of(model, options, found, found.runs.spread(found.x, found.sigma))
    counts = found.runs.equations.sample_counts()
    at = None if model.faults else found.runs.where.at
    scored = cluster.reduce(
        refs, settings, ScoresAt(fitted.physics, at, fitted.theta[model.physics_size :], draws), joined_scores,
        "noise floor and scores",
    )  # fmt: skip
    return CampaignFit(campaign, fitted, counts, scored, found.runs)


def _model(campaign: Campaign) -> Model:
    return campaign.settings.model()
