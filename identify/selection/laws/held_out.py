"""How much of the excess of its rows a law explains in blocks that it, and all else, was not fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.layout import Trial
from lacet.identify.selection.columns.samples import RunSamples
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.settings import SELECTION


def squares_in_held_blocks(regression: PartialRegression, trials: Sequence[Trial]) -> dict[Row, Array]:
    """Row → (1 + m,) weighted squares left in held-out blocks without, and with each of m effects.

    Parameters of model, tolerances and effect are those of the samples outside each fold, summed over the folds.
    """
    right, w = regression.sums.layout.right, regression.sums.layout.width
    out: list[Array] = []
    for _, gain, train in regression.outside:
        coefficients = np.zeros((w, 1 + len(trials)))
        coefficients[right] = 1.0
        for i, trial in enumerate(trials, start=1):
            at = trial.place
            noise = (1.0 - 1.0 / SELECTION.folds) * regression.noise[at, at]
            coefficients[at, i] = -np.linalg.solve(train[at, at] + noise, train[at, right])
        coefficients[regression.nuisance] -= gain @ coefficients
        out.append(coefficients)
    return regression.sums.samples.sum(HeldBlocksTask(np.array(out)))


@dataclass(frozen=True)
class HeldBlocksTask:
    """Squares in the blocks of each fold, as a task for the samples of each run.

    Attributes
    ----------
    coefficients : (folds, w, m) coefficients of the columns in m residuals, found outside each fold.
    """

    coefficients: Array

    def of_run(self, run: RunSamples) -> dict[Row, Array]:
        """Row → (m,) squares in one run."""
        folds, w, m = (int(n) for n in self.coefficients.shape)
        every = self.coefficients.transpose(1, 0, 2).reshape(w, folds * m)
        out: dict[Row, Array] = {}
        for block, series in run.series(every):
            own = (run.first + block.number) % folds
            mine = np.take_along_axis(series.reshape(-1, folds, m), own[:, None, None], axis=1)[:, 0]
            out.setdefault(block.row, np.zeros(m))
            out[block.row] += np.sum(mine**2, axis=0)
        return out

    def merged(self, parts: Sequence[Mapping[Row, Array]]) -> dict[Row, Array]:
        """The squares of several runs."""
        rows = dict.fromkeys(row for part in parts for row in part)
        return {row: reduce(add, (part[row] for part in parts if row in part)) for row in rows}
