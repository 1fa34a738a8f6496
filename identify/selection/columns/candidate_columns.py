"""Columns of all candidates beside those of a model and of the sensor sheet, with the priors of the latter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class CandidateColumns:
    """Cross products of the columns of candidates, of a model and of the sensor sheet, with the priors.

    Attributes
    ----------
    linearisation : the fit and its floor, at the latencies removed from the runs.
    effects : candidates that can be computed on these runs; those of the model are passed over.
    unmeasured : key → what a run lacks for a candidate that cannot be computed.
    sums : cross products of all columns.
    sheet : place → name of the columns that stand for the sensor sheet's tolerances; `sigma` one tolerance, in the
        column's own unit.
    nuisance : (a,) places of the columns of model and sheet that act: their parameters are nuisance to every test.
    prior, prior_side : (a, a) normal matrix and (a,) right side of the priors of their parameters.
    drawn : (s, D) tolerances of the sheet drawn for every simulated run.
    """

    linearisation: Linearisation
    effects: tuple[Effect, ...]
    unmeasured: Mapping[str, Unmeasured]
    sums: CrossProducts
    sheet: Mapping[int, str]
    sigma: Mapping[int, float]
    nuisance: NDArray[np.intp]
    prior: Array
    prior_side: Array
    drawn: Array

    @classmethod
    def of(
        cls,
        linearisation: Linearisation,
        candidates: Sequence[Effect],
        seed: int,
        prior_stiffening: float,
        progress: Progress = silent,
    ) -> CandidateColumns:
        """Columns of these candidates; `seed` of simulated zeros and tolerances; priors with σ ÷ `prior_stiffening`."""
        runs, fitted, floor = linearisation.runs, linearisation.fitted, linearisation.floor
        fresh = [effect for effect in candidates if effect.key not in fitted.model]
        unmeasured = runs.unmeasured(fresh)
        effects = [effect for effect in fresh if effect.key not in unmeasured]
        bounds = {e.key: e.sheet_bound(runs.rig) for e in effects}
        kinds = {e.key: e.sheet_kind for e in effects}
        drifts = {key: bound for key, bound in bounds.items() if kinds[key] == "drift" and bound > 0.0}
        shapes = [one for effect in effects for one in effect.shapes()]
        layout = Layout.of(len(fitted.place), linearisation.sums.layout.sheet, shapes)
        progress(Step(Stage.TRIAL_COLUMNS, total=len(effects)))
        sums = runs.products(floor, layout, prior_stiffening, drifts, seed)
        # Gains and latencies stand in the sheet channel by channel; other faults stand for their own tolerance.
        sheet = {layout.model + i: f"{e[0]} of {e[1]}" for i, e in enumerate(layout.sheet)}
        sigma = dict.fromkeys(sheet, 1.0)
        for trial in layout.trials:
            key = trial.effect.key
            if trial.fault and bounds[key] > 0.0 and kinds[key] not in ("gain", "latency", "drift"):
                sheet[trial.place.start], sigma[trial.place.start] = key, bounds[key]
        there = [place for place in sheet if sums.total[place, place] > 0.0]
        one = np.array([sigma[place] for place in there])
        prior = scipy.linalg.block_diag(sums.prior, np.diag((prior_stiffening / one) ** 2))
        nuisance = np.concatenate([np.arange(layout.model), there]).astype(np.intp)
        known = np.zeros(layout.width)
        known[: len(linearisation.prior_side)] = linearisation.prior_side
        prior_side = np.concatenate([np.zeros(layout.model), (prior_stiffening / one) ** 2 * known[there]])
        rng = np.random.default_rng([seed, 6])
        drawn = one[:, None] * rng.standard_normal((len(there), floor.count))
        return cls(linearisation, tuple(effects), unmeasured, sums, sheet, sigma, nuisance, prior, prior_side, drawn)


def solved(G: Array, sides: Array) -> Array:
    """Pseudo-inverse of G times `sides`: linearly dependent columns (two laws equal on these runs) count once."""
    scale = np.sqrt(np.diag(G))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(G / np.outer(scale, scale))
    kept = values > SELECTION.shared_eigenvalue * values[-1]
    V = vectors[:, kept]
    return (V @ ((V.T @ (sides / scale[:, None])) / values[kept, None])) / scale[:, None]
