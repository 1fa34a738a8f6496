"""Runs of a campaign as a fit asks for their sums: each made by a task, merged in the tree."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row, body_levers
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress
from lacet.identify.regression.corrected_scores import NoiseMoments
from lacet.identify.regression.huber import usual_sizes
from lacet.identify.regression.qr_accumulation import (
    RunEquations,
    WeightedEquations,
    Weights,
    added,
    known_normal,
    known_root,
    merged_squares,
    merged_triangles,
)
from lacet.identify.regression.sensitivity import ExpansionPoint
from lacet.identify.regression.uncertainty import Spread
from lacet.services.campaign.cluster import Cluster
from lacet.services.campaign.run_reference import RunReference, Settings
from lacet.services.campaign.tasks import (
    ColumnsAt,
    EquationsAt,
    NoiseAt,
    SecondsAt,
    SpreadAt,
    Turn,
    joined_counts,
    joined_seconds,
    reduced_normal,
    reduced_root,
    row_counts,
    row_squares,
)

if TYPE_CHECKING:
    from distributed import Future


@dataclass
class CampaignRuns:
    """The runs of a campaign; `removed` sizes of the model's sensor faults that are removed from them."""

    cluster: Cluster
    runs: Sequence[RunReference]
    settings: Settings
    removed: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def levers(self) -> Mapping[Row, float]:
        """Proportions of the residuals of the body's rows, by the car's geometry."""
        return body_levers(self.settings.car)

    def columns(self) -> RunEquations | None:
        """Equations of all runs in every parameter of the physics, without zeros."""
        return self.cluster.reduce(
            self.runs, self.settings, ColumnsAt(self.removed), RunEquations.merged, "what the parameters group into"
        )

    def absent_channels(self) -> Collection[str]:
        """None: a run without any row is broken, and left out before."""
        return ()

    def linearised(
        self, keep: NDArray[np.int64], at: ExpansionPoint | None, known: Array, rows: Sequence[Row]
    ) -> CampaignEquations:
        """Equations with sensitivities, held by the workers; parameters as in `RunSums.linearised`."""
        return CampaignEquations(self, EquationsAt(keep, at, known, tuple(rows), self.removed))

    def without_faults(self, values: Array) -> CampaignRuns:
        """The runs as recorded, the model's sensor faults removed at these sizes."""
        return replace(self, removed=values)


@dataclass
class CampaignEquations:
    """Equations of the runs with their sensitivities; `where` : at which values."""

    runs: CampaignRuns
    where: EquationsAt
    _held: HeldEquations | None = field(default=None, repr=False)

    @property
    def equations(self) -> HeldEquations:
        """The equations, as the workers hold them: one pass, when they are asked for first."""
        if self._held is None:
            runs = self.runs
            held = runs.cluster.hold(runs.runs, runs.settings, self.where, "sensitivities and equations")
            self._held = HeldEquations(runs.cluster, held, self.where.known, self.where.rows)
        return self._held

    def reweighted(self, x: Array, sigma: Weights) -> CampaignEquations:
        """The same with robust weights of the samples from the residual at `x`."""
        runs = self.runs
        state = SecondsAt(self.where, x, dict(sigma))
        seconds = runs.cluster.reduce(runs.runs, runs.settings, state, joined_seconds, "residual by seconds")
        turn = Turn(x, dict(sigma), usual_sizes(seconds))
        return CampaignEquations(runs, replace(self.where, turns=(*self.where.turns, turn)))

    def noise_moments(self, sigma: Weights, draws: int, progress: Progress) -> NoiseMoments:
        """What noise in the regressors does, of all runs; progress is that of the cluster."""
        del progress
        runs, state = self.runs, NoiseAt(self.where, dict(sigma), draws)
        return runs.cluster.reduce(runs.runs, runs.settings, state, NoiseMoments.merged, "noise in the regressors")

    def spread(self, x: Array, sigma: Weights) -> Spread:
        """Spread of the scores at the solution `x`."""
        runs, state = self.runs, SpreadAt(self.where, dict(sigma), x)
        return runs.cluster.reduce(runs.runs, runs.settings, state, Spread.merged, "spread of the scores")


@dataclass
class HeldEquations(WeightedEquations):
    """Equations that the workers hold, run by run."""

    cluster: Cluster
    held: Sequence[Future]
    known: Array
    rows: Sequence[Row]

    @cached_property
    def _counts(self) -> Mapping[Row, int]:
        return self.cluster.over(self.held, row_counts, (), joined_counts)

    def sample_counts(self) -> Mapping[Row, int]:
        """Number of samples of each row, over all runs."""
        return self._counts

    def root(self, sigma: Weights) -> Array:
        """(p + 1, p + 1) R factor of the weighted ``[W | Y]``, priors included, every run's zeros eliminated."""
        return self.cluster.over(
            self.held, reduced_root, (dict(sigma),), merged_triangles, first=known_root(self.known)
        )

    def reduced_normal(self, sigma: Weights) -> Array:
        """(p + 1, p + 1) normal matrix of the same."""
        return self.cluster.over(self.held, reduced_normal, (dict(sigma),), added, first=known_normal(self.known))

    def squares(self, x: Array, sigma: Weights, quick: bool) -> Mapping[Row, float]:
        """Row → sum of squares at parameters `x` and each run's zeros that belong to them."""
        return self.cluster.over(self.held, row_squares, (dict(sigma), x, quick), merged_squares)
