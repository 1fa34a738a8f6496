"""Contributions of a model's effects to the predicted side of each row: the terms of the sum W θ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import with_places
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, corrected_run
from lacet.identify.validation.score import Comparison


@dataclass(frozen=True)
class Shares:
    """The terms of one run's prediction, by row and effect, after filter and decimation.

    `effects` row → effect → (n,) of each effect that acts on the row [N or N·m]; `zeros` row → (n,) of the run's sensor
    zeros. They add up to `Comparison.modelled`. A sensor fault of the model has no term: it is removed from the
    measurement beforehand.
    """

    effects: Mapping[Row, Mapping[str, Array]]
    zeros: Mapping[Row, Array]


def shares_of(fitted: Fit, run: PreparedRun, comparison: Comparison) -> Shares:
    """The terms of a run's prediction, effect by effect; `comparison` is that of the same fit and run."""
    run = corrected_run(run, fitted)
    run.prepare(fitted.model.physics)
    zeros, values = comparison.zeros
    effects: dict[Row, dict[str, Array]] = {row: {} for row in run.rows}
    for effect, place in with_places(fitted.model.physics):
        theta = fitted.physics[place]
        for row, columns in run.columns(effect).items():
            if row in effects:
                effects[row][effect.key] = theta @ columns
    return Shares(effects, {row: zeros.columns[row] @ values for row in run.rows})
