"""A sensor fault set free of its tolerance: what the sensor sheet excuses of it is given back first.

The sheet's tolerances stand beside the model with priors, the fault's own among them. A fault that the runs show much
better than its tolerance would be explained by that, at a price that only the prior knows. So the columns that stand
for it (`own`) are taken back into the residual; what is found is then compared with the tolerance. Noise in a fault's
column (of a late laser half is noise) makes its estimate too small, and is taken out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identify.partialling import Partialled
from identify.trial_sums import FOLDS
from identify.vectors import Array

DOUBT = 0.1
"""Part of a shift by noise that its simulation may be wrong by: the sheet's noise is, and how loud a run was."""


class Freed:
    """One fault beside everything else that is known, its own tolerance apart.

    Parameters
    ----------
    space : everything partialled out, the fault's own tolerance too.
    place : of the fault's column.
    own : positions in `space.taken` of the columns that stand for it.

    Attributes
    ----------
    noise, shift : what noise in the column adds to its energy, and to its product with the residual.
    """

    def __init__(self, space: Partialled, place: int, own: NDArray[np.intp]):
        self.space, self.place, self.own = space, place, own
        self.noise = self.shift = 0.0
        self._columns = np.array([place, space.sums.layout.right], np.intp)
        # Of the fault's column and the residual, less everything but what stands for it.
        self._gain, self._products = given_back(space.inverse, space.gain, space.left, self._columns, own)
        total, taken = space.sums.total, space.taken
        # What one unit of each column of `own` is of the fault.
        self._in_its_unit = total[place, taken[own]] / total[place, place]

    @property
    def energy(self) -> float:
        """Of the column [1/unit²], without that of its noise."""
        return float(self._products[0, 0]) - self.noise

    @property
    def noisy_part(self) -> float:
        """Part of the column's energy that is noise."""
        return self.noise / float(self._products[0, 0])

    @property
    def value(self) -> float:
        """The fault's size."""
        return (float(self._products[0, 1]) - self.shift) / self.energy

    @property
    def spread(self) -> float:
        """1 σ of it, as if residuals were independent."""
        return float(np.sqrt(self._products[0, 0])) / self.energy

    @property
    def drop(self) -> float:
        """Fall of the weighted squares when the fault is added, where its own tolerance excuses none of it.

        What `DOUBT` of the shift could explain is not counted.
        """
        sure = max(0.0, abs(self.value) - DOUBT * abs(self.shift) / self.energy)
        return sure**2 * self.energy

    def null(self, null: Array, drawn: Array) -> Array:
        """(D,) `drop` in simulated runs with products `null` (w, D), `drawn` (e, D) the own tolerances in them."""
        score = null[self.place] - self._gain[:, 0] @ null[self.space.taken]
        # A simulated fault acts through the true channel, a column has the channel's noise as well.
        score -= self.noise * (self._in_its_unit @ drawn)
        return score**2 / self.energy

    def fall(self) -> float:
        """The same in blocked cross-validation."""
        columns, taken, total = self._columns, self.space.taken, 0.0
        for (inverse, gain, left), inside in zip(self.space.outside, self.space.sums.test, strict=True):
            gain, train = given_back(inverse, gain, left, columns, self.own)
            across = gain.T @ inside[np.ix_(taken, columns)]
            test = inside[np.ix_(columns, columns)] - across - across.T + gain.T @ inside[np.ix_(taken, taken)] @ gain
            value = (train[0, 1] - (1.0 - 1.0 / FOLDS) * self.shift) / train[0, 0]
            total += float(2.0 * value * (test[0, 1] - self.shift / FOLDS) - value**2 * test[0, 0])
        return total

    def coefficients(self) -> Array:
        """(w, 2) for `TrialSums.series`: one unit of the fault, and the residual, not excused by its own tolerance."""
        out = np.zeros((self.space.sums.layout.width, 2))
        out[self._columns, [0, 1]] = 1.0
        out[self.space.taken] -= self._gain
        return out


def given_back(
    inverse: Array, gain: Array, left: Array, columns: NDArray[np.intp], own: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Gain (a, m) and products (m, m) of some columns when the columns at positions `own` are not partialled out.

    `inverse`, `gain`, `left` are of everything partialled out, as `Partialled` has them.
    """
    gain = gain[:, columns]
    excused = gain[own]
    stiffness = np.linalg.inv(inverse[np.ix_(own, own)])
    out = gain - inverse[:, own] @ (stiffness @ excused)
    out[own] = 0.0
    return out, left[np.ix_(columns, columns)] + excused.T @ stiffness @ excused


def own_columns(space: Partialled, place: int, alike: NDArray[np.intp]) -> NDArray[np.intp]:
    """Positions in `space.taken`, among those `alike`, of the columns that a fault's column is made of."""
    if not alike.size:
        return alike
    total, places = space.sums.total, space.taken[alike]
    lengths = np.sqrt(np.diag(total)[places])
    normal = total[np.ix_(places, places)] / np.outer(lengths, lengths)
    parts = np.asarray(np.linalg.lstsq(normal, total[places, place] / lengths, rcond=1e-9)[0], float)
    return alike[np.abs(parts) > 1e-3 * np.sqrt(total[place, place])]
