"""Linearisation: a fit with its noise floor, and the latencies of the runs at which its columns are linearised."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.ranked_runs import LocalRuns, RankedRuns
from lacet.identify.validation.noise_floor import NoiseFloor


@dataclass(frozen=True)
class Linearisation:
    """Fit with the latencies at which its columns are linearised.

    Attributes
    ----------
    runs : the fit and its runs.
    floor : its noise floor.
    latencies : entry of the sheet → latency removed from the runs [s]; empty for runs as recorded.
    sums : cross products of the columns of model and sensor sheet.
    """

    runs: RankedRuns
    floor: NoiseFloor
    latencies: Mapping[SheetEntry, float]
    sums: CrossProducts

    @classmethod
    def of(cls, fitted: Fit, floor: NoiseFloor) -> Linearisation:
        """Linearisation at the latencies of the rig file: runs as recorded."""
        return cls.of_runs(LocalRuns(fitted), floor)

    @classmethod
    def of_runs(cls, runs: RankedRuns, floor: NoiseFloor) -> Linearisation:
        """The same of runs wherever they are."""
        return cls(runs, floor, {}, sheet_products(runs, floor))

    @property
    def fitted(self) -> FittedModel:
        """The fitted model."""
        return self.runs.fitted

    @cached_property
    def latency_tolerances(self) -> dict[SheetEntry, float]:
        """Tolerances of latencies: entry of the sheet → [s]."""
        rig = self.runs.rig
        return {e: rig.tolerance(e[1], "latency") for e in self.sums.layout.sheet if e[0] == "latency"}

    @cached_property
    def prior_side(self) -> Array:
        """(model + sheet,) means of the priors in tolerances: latencies of the rig file less those removed."""
        off = [
            -self.latencies[e] / self.latency_tolerances[e] if e in self.latencies else 0.0
            for e in self.sums.layout.sheet
        ]
        return np.array([0.0] * self.sums.layout.model + off)

    @property
    def omega(self) -> float:
        """Angular frequency of the fit's cut-off [rad/s]."""
        return self.runs.omega

    def nuisance_prior(self, prior_side: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """Places (a,) of the model's and sheet's columns that act; normal matrix and right side of their priors."""
        sums, layout = self.sums, self.sums.layout
        places = np.arange(layout.right)
        nuisance = places[np.diag(sums.total)[places] > 0.0]
        prior = np.eye(layout.right)
        prior[: layout.model, : layout.model] = sums.prior
        return nuisance, prior[np.ix_(nuisance, nuisance)], prior_side[nuisance]


def sheet_products(runs: RankedRuns, floor: NoiseFloor) -> CrossProducts:
    """Cross products of a fit's columns and those of the sensor sheet."""
    return runs.products(floor, Layout.of(len(runs.fitted.place), runs.sheet_entries, ()), 1.0, {}, 0)
