"""Tests of sensor tolerances: a fault without its own, and how much of all of them the runs need.

The sheet's tolerances stand beside the model with priors, a fault's own among them. A fault that the runs show much
better than its tolerance would be explained by that, at a price that only the prior knows. So the columns that stand
for it (`own`) are no nuisance here; what is found is then compared with the tolerance. Noise in a fault's column (of a
late laser half is noise) makes its estimate too small, and is corrected for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.cross_products import CandidateColumns
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.settings import SELECTION


class FaultWithoutTolerance:
    """Score test of one sensor fault without its own tolerance, beside all other nuisance parameters.

    Parameters
    ----------
    space : partial regression on all nuisance parameters, the fault's own tolerance among them.
    place : of the fault's column.
    own : positions in `space.nuisance` of the columns that stand for it.
    """

    def __init__(self, space: PartialRegression, place: int, own: NDArray[np.intp]):
        self.space, self.place, self.own = space, place, own
        self._columns = np.array([place, space.sums.layout.right, *space.nuisance[own]], np.intp)
        # A tolerance counts from the rig file's value, where that is not what was removed from the runs.
        self._turn = np.zeros((len(self._columns), 2))
        self._turn[0, 0] = self._turn[1, 1] = 1.0
        self._turn[2:, 1] = -np.linalg.solve(space.prior[np.ix_(own, own)], space.prior_side[own])
        # Of the fault's column and the residual, less everything but what stands for it.
        self._gain, self._products = self._downdated(space.inverse, space.gain, space.reduced)
        both = self.coefficients()
        self.noise, self._shift = (both[:, 0] @ space.column_noise @ both).tolist()

    @property
    def energy(self) -> float:
        """Of the column [1/unit²], without that of its noise."""
        return float(self._products[0, 0])

    @property
    def noisy_part(self) -> float:
        """Part of the column's energy that is noise."""
        return self.noise / (self.energy + self.noise) if self.energy > 0.0 else 1.0

    @property
    def value(self) -> float:
        """The fault's size."""
        return float(self._products[0, 1]) / self.energy

    @property
    def spread(self) -> float:
        """1 σ of it, as if residuals were independent."""
        return float(np.sqrt(self.energy + self.noise)) / self.energy

    @property
    def drop(self) -> float:
        """Fall of the weighted squares when the fault is added, without its own tolerance.

        What `correction_doubt` of the shift by noise could explain is not counted.
        """
        sure = max(0.0, abs(self.value) - SELECTION.correction_doubt * abs(self._shift) / self.energy)
        return sure**2 * self.energy

    def null(self, null: Array) -> Array:
        """(D,) `drop` in simulated runs with products `null` (w, D)."""
        score = null[self.place] - self._gain[:, 0] @ null[self.space.nuisance]
        return score**2 / self.energy

    def fall(self) -> float:
        """The same in blocked cross-validation."""
        columns, nuisance, total = self._columns, self.space.nuisance, 0.0
        for (inverse, gain, remainder), inside in zip(self.space.outside, self.space.inside, strict=True):
            gain, train = self._downdated(inverse, gain, remainder)
            across = gain.T @ inside[np.ix_(nuisance, columns)] @ self._turn
            whole = self._turn.T @ inside[np.ix_(columns, columns)] @ self._turn
            test = whole - across - across.T + gain.T @ inside[np.ix_(nuisance, nuisance)] @ gain
            value = train[0, 1] / (train[0, 0] + (1.0 - 1.0 / SELECTION.folds) * self.noise)
            total += float(2.0 * value * test[0, 1] - value**2 * (test[0, 0] + self.noise / SELECTION.folds))
        return total

    def coefficients(self) -> Array:
        """(w, 2) for `CrossProducts.series`: one unit of the fault, and the residual, without its own tolerance."""
        out = np.zeros((self.space.sums.layout.width, 2))
        out[self._columns] = self._turn
        out[self.space.nuisance] -= self._gain
        return out

    def _downdated(self, inverse: Array, gain: Array, remainder: Array) -> tuple[Array, Array]:
        gain, products = downdated(inverse, gain, remainder, self._columns, self.own)
        return gain @ self._turn, self._turn.T @ products @ self._turn


def downdated(
    inverse: Array, gain: Array, remainder: Array, columns: NDArray[np.intp], own: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Gain (a, m) and products (m, m) of some columns when the columns at positions `own` are no nuisance.

    `inverse`, `gain`, `left` are of the regression on all nuisance columns, as `PartialRegression` has them.
    """
    gain = gain[:, columns]
    tolerance_use = gain[own]
    stiffness = np.linalg.inv(inverse[np.ix_(own, own)])
    out = gain - inverse[:, own] @ (stiffness @ tolerance_use)
    out[own] = 0.0
    return out, remainder[np.ix_(columns, columns)] + tolerance_use.T @ stiffness @ tolerance_use


def tolerances_like(space: PartialRegression, place: int, alike: NDArray[np.intp]) -> NDArray[np.intp]:
    """Positions in `space.nuisance`, among those `alike`, of the columns that a fault's column is made of."""
    if not alike.size:
        return alike
    total, places = space.sums.total, space.nuisance[alike]
    lengths = np.sqrt(np.diag(total)[places])
    normal = total[np.ix_(places, places)] / np.outer(lengths, lengths)
    parts = np.asarray(
        np.linalg.lstsq(normal, total[places, place] / lengths, rcond=SELECTION.tolerance_rank)[0], float
    )
    return alike[np.abs(parts) > SELECTION.tolerance_part * np.sqrt(total[place, place])]


@dataclass(frozen=True)
class ToleranceUse:
    """Sensor tolerances that the runs need, in units of the sheet, beside those that simulated runs need.

    Attributes
    ----------
    sizes : entry of the sheet → how many of its tolerances these runs would have it off.
    squares : sum of their squares. Latencies are not in it: clocks are judged by themselves.
    null : (D,) the same in simulated runs that lack nothing, their tolerances drawn.
    """

    sizes: Mapping[str, float]
    squares: float
    null: Array = field(repr=False)

    @property
    def excess(self) -> float:
        """Squares beyond those of simulated runs."""
        return self.squares - float(np.mean(self.null))

    @property
    def tolerance_exceeded(self) -> bool:
        """Whether such a sheet is not to be believed: more than in any simulated run, and than twice their mean."""
        return self.squares > max(
            float(np.max(self.null)), SELECTION.tolerance_squares_ratio * float(np.mean(self.null))
        )


def tolerance_use(columns: CandidateColumns, known: PartialRegression, null_runs: Array, found: Array) -> ToleranceUse:
    """Tolerances that the runs need where the nuisance parameters are `found` (a,); `null_runs` (w, D) simulated."""
    layout, linearisation = columns.sums.layout, columns.linearisation
    drawn = known.inverse @ null_runs[known.nuisance]
    sizes: dict[str, float] = {}
    squares, null = 0.0, np.zeros(drawn.shape[1])
    for position, place in enumerate(map(int, known.nuisance)):
        if place < layout.model:
            continue
        size, among = float(found[position]) / columns.sigma[place], place - layout.model
        entry = layout.sheet[among] if among < len(layout.sheet) else None
        name = columns.sheet[place] if entry is None else linearisation.fitted.entry_name(entry)
        if entry is not None and entry in linearisation.latency_tolerances:
            removed = linearisation.latencies.get(entry, 0.0) / linearisation.latency_tolerances[entry]
            sizes[name] = size + removed
            continue
        squares += size**2
        null += (drawn[position] / columns.sigma[place]) ** 2
        sizes[name] = size
    return ToleranceUse(sizes, squares, null)
