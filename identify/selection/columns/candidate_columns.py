"""Columns of all candidates beside those of a model and of the sensor sheet, with the priors of the latter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.selection.columns.cross_products import CrossProducts
from lacet.identify.selection.columns.layout import Layout, Trial
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.settings import SELECTION

WITHOUT_COLUMN = frozenset({"gain", "latency", "drift"})
"""Kinds of sensor faults that stand for no tolerance of their own: it is in the sheet by channel, or drawn by run."""


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
    seed : of simulated zeros and tolerances.
    own : trials behind those of the candidates, with shape constants between the values of the grids.
    selected : trials that are in the model beside the fit's own effects; their columns are nuisance to every test,
        behind those of the sheet.
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
    seed: int
    own: tuple[Trial, ...] = ()
    selected: tuple[Trial, ...] = ()

    @classmethod
    def of(
        cls,
        linearisation: Linearisation,
        candidates: Sequence[Effect],
        seed: int,
        prior_stiffening: float,
        progress: Progress = silent,
        selected: Sequence[Effect] = (),
        known: CrossProducts | None = None,
    ) -> CandidateColumns:
        """Columns of candidates beside a fit and the `selected` effects.

        `seed` of simulated zeros and tolerances; priors of zeros and tolerances with σ ÷ `prior_stiffening`; `known`
        other cross products of this linearisation, whose columns are not computed again.
        """
        runs, fitted, floor = linearisation.runs, linearisation.fitted, linearisation.floor
        fresh = [effect for effect in candidates if effect.key not in fitted.model]
        unmeasured = runs.unmeasured(fresh)
        effects = [effect for effect in fresh if effect.key not in unmeasured]
        bounds = {e.key: e.sheet_bound(runs.rig) for e in effects}
        kinds = {e.key: e.sheet_kind for e in effects}
        drifts = {key: bound for key, bound in bounds.items() if kinds[key] == "drift" and bound > 0.0}
        shapes = [one for effect in effects for one in effect.shapes()]
        layout = Layout.of(len(fitted.place), linearisation.sums.layout.sheet, [*shapes, *selected])
        chosen = layout.trials[len(shapes) :]
        progress(Step(Stage.TRIAL_COLUMNS, total=len(effects)))
        sums = runs.products(floor, layout, prior_stiffening, drifts, seed, known=known)
        # Gains and latencies stand in the sheet channel by channel; other faults stand for their own tolerance.
        sheet = {layout.model + i: f"{e[0]} of {e[1]}" for i, e in enumerate(layout.sheet)}
        sigma = dict.fromkeys(sheet, 1.0)
        for trial in layout.trials[: len(shapes)]:
            key = trial.effect.key
            if trial.fault and bounds[key] > 0.0 and kinds[key] not in WITHOUT_COLUMN:
                sheet[trial.place.start], sigma[trial.place.start] = key, bounds[key]
        there = [place for place in sheet if sums.total[place, place] > 0.0]
        one = np.array([sigma[place] for place in there])
        prior = scipy.linalg.block_diag(sums.prior, np.diag((prior_stiffening / one) ** 2))
        nuisance = np.concatenate([np.arange(layout.model), there]).astype(np.intp)
        means = np.zeros(layout.width)
        means[: len(linearisation.prior_side)] = linearisation.prior_side
        prior_side = np.concatenate([np.zeros(layout.model), (prior_stiffening / one) ** 2 * means[there]])
        rng = np.random.default_rng([seed, 6])
        drawn = one[:, None] * rng.standard_normal((len(there), floor.count))
        return cls(
            linearisation, tuple(effects), unmeasured, sums, sheet, sigma, nuisance, prior, prior_side, drawn, seed,
            chosen,
        ).given(chosen)  # fmt: skip

    @property
    def plain_layout(self) -> Layout:
        """Order of the columns of model, sheet and candidates alone, without those of the selected effects."""
        layout = self.sums.layout
        return replace(layout, trials=layout.trials[: len(layout.trials) - len(self.own)])

    @property
    def from_grid(self) -> Array:
        """(w, v) all columns as combinations of those of `plain_layout`: between two values of a grid interpolated."""
        plain, layout = self.plain_layout, self.sums.layout
        out = np.zeros((layout.width, plain.width))
        out[: plain.right, : plain.right] = np.eye(plain.right)
        out[layout.right, plain.right] = 1.0
        for trial in self.own:
            for place, weight in plain.interpolation(trial.effect):
                out[trial.place, place] += weight * np.eye(place.stop - place.start)
        return out

    @property
    def tolerances(self) -> range:
        """Positions among the nuisance columns of those that stand for the sheet's tolerances."""
        return range(self.sums.layout.model, self.sums.layout.model + len(self.drawn))

    def given(self, selected: Sequence[Trial]) -> CandidateColumns:
        """The columns with other trials of the layout selected, instead of those that are."""
        kept = self.tolerances.stop
        places = [np.r_[t.place] for t in selected]
        spread = np.array([q.prior for t in selected for q in t.effect.parameters])
        return replace(
            self, selected=tuple(selected), nuisance=np.concatenate([self.nuisance[:kept], *places]).astype(np.intp),
            prior=scipy.linalg.block_diag(self.prior[:kept, :kept], np.diag(spread**-2.0)),
            prior_side=np.concatenate([self.prior_side[:kept], np.zeros(spread.size)]),
        )  # fmt: skip


def solved(G: Array, sides: Array) -> Array:
    """Pseudo-inverse of G times `sides`: linearly dependent columns (two laws equal on these runs) count once."""
    # Less the noise in it, the energy of a column may be below nothing.
    scale = np.sqrt(np.maximum(0.0, np.diag(G)))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(G / np.outer(scale, scale))
    kept = values > SELECTION.shared_eigenvalue * np.max(values, initial=0.0)
    V = vectors[:, kept]
    return (V @ ((V.T @ (sides / scale[:, None])) / values[kept, None])) / scale[:, None]
