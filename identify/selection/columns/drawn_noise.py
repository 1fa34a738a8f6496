"""Noise in the columns as drawn for one fit, for other fits to the same runs.

The columns of a fit with further effects are columns that candidates had, and its residual is the first one less what
they explain: products of the same draws follow without drawing again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lacet.identify.effects.base import Effect, with_places
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.selection.columns.layout import Layout
from lacet.identify.selection.columns.ranked_runs import RankedRuns
from lacet.identify.selection.columns.regressor_noise import RegressorNoise, regressor_labels
from lacet.identify.selection.columns.weighted_columns import Weighting


@dataclass(frozen=True)
class DrawnNoise:
    """Noise in the columns, and what it was drawn for.

    Attributes
    ----------
    noise : the noise.
    runs : a fitted model, and its runs.
    weighting : of its columns.
    zero_gains : for each run (z, w) regression of each column on its zeros.
    """

    noise: RegressorNoise
    runs: RankedRuns
    weighting: Weighting
    zero_gains: tuple[Array, ...]

    def of(self, runs: RankedRuns, layout: Layout) -> RegressorNoise | None:
        """The noise of another fit to the same runs; None where it has columns that were not drawn, or other runs.

        Between the values of a grid columns are interpolated; beyond them none were drawn. Columns of the sensor sheet
        and of sensor faults, which depend on the fit's parameters, are those of the first fit.
        """
        old, new = self.runs.refittable, runs.refittable
        if old is None or new is None or len(old.runs) != len(new.runs):
            return None
        if any(a is not b for a, b in zip(old.runs, new.runs, strict=True)):
            return None
        weights = _weights(self.runs.fitted, self.weighting.layout, runs.fitted, layout)
        return None if weights is None else self._at_zeros.at(regressor_labels(runs.fitted, layout), weights)

    @cached_property
    def _at_zeros(self) -> RegressorNoise:
        """The noise, each run's zeros eliminated as in the first fit: their columns, too, depend on its parameters."""
        runs = tuple(run.at_zeros(self.weighting, self.zero_gains[run.run]) for run in self.noise.runs)
        return replace(self.noise, runs=runs)


def _weights(before: FittedModel, old: Layout, fitted: FittedModel, layout: Layout) -> Array | None:
    """(w', w) all columns of a fit as combinations of those of the one before; None where one of them is no such."""
    own = dict(_parameters(before))
    sheet = {entry: old.model + i for i, entry in enumerate(old.sheet)}
    out = np.zeros((layout.width, old.width))
    for i, (name, (effect, at)) in enumerate(_parameters(fitted)):
        if name in own and repr(own[name][0]) == repr(effect):
            out[i, before.columns.index(name)] = 1.0
        elif old.spans(effect):
            for place, weight in old.interpolation(effect):
                out[i, place.start + at] += weight
        else:
            return None
    for i, entry in enumerate(layout.sheet):
        if entry not in sheet:
            return None
        out[layout.model + i, sheet[entry]] = 1.0
    for trial in layout.trials:
        if not old.spans(trial.effect):
            return None
        for place, weight in old.interpolation(trial.effect):
            out[trial.place, place] += weight * np.eye(place.stop - place.start)
    # What is measured less what both models explain.
    out[layout.right, old.right] = 1.0
    out[layout.right, : old.model] += before.solution
    out[layout.right] -= fitted.solution @ out[: layout.model]
    return out


def _parameters(fitted: FittedModel) -> Iterator[tuple[str, tuple[Effect, int]]]:
    """Name of each parameter that has a column, in their order → its effect, and its place among the effect's."""
    names = fitted.model.names
    found = {
        names[at]: (effect, at - place.start)
        for effect, place in with_places((*fitted.model.physics, *fitted.model.faults))
        for at in range(place.start, place.stop)
    }
    return ((name, found[name]) for name in fitted.columns)
