"""Tests of sensor tolerances: score test of a sensor fault without its own tolerance, and use of all tolerances.

The sheet's tolerances are nuisance parameters with priors, the tolerance of a tested fault among them. It would explain
a fault that the runs determine much better than the sheet, against the prior only. So the columns equivalent to the
fault (`own`) are no nuisance in its test, and its size is then compared with the tolerance. Noise in a fault's column
(half of that of a late laser is noise) makes its estimate too small, and is corrected for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.columns.candidate_columns import CandidateColumns
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.settings import SELECTION


class FaultWithoutTolerance:
    """Score test of one sensor fault without its own tolerance, all other nuisance parameters removed.

    Parameters
    ----------
    space : partial regression on all nuisance parameters, the fault's own tolerance among them.
    place : place of the fault's column.
    own : positions in `space.nuisance` of the tolerances equivalent to the fault.
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
        """Energy of the fault's column, nuisance removed, less that of its noise [1/unit²]."""
        return float(self._products[0, 0])

    @property
    def noisy_part(self) -> float:
        """Share of noise in the energy of the fault's column."""
        return self.noise / (self.energy + self.noise) if self.energy > 0.0 else 1.0

    @property
    def value(self) -> float:
        """Estimate of the fault's size [unit of its parameter]."""
        return float(self._products[0, 1]) / self.energy

    @property
    def spread(self) -> float:
        """1 σ of the estimate for independent residuals."""
        return float(np.sqrt(self.energy + self.noise)) / self.energy

    @property
    def drop(self) -> float:
        """Fall of the weighted squares by the fault without its own tolerance.

        The estimate is first reduced by `correction_doubt` times its correction for noise.
        """
        sure = max(0.0, abs(self.value) - SELECTION.correction_doubt * abs(self._shift) / self.energy)
        return sure**2 * self.energy

    def null(self, null: Array) -> Array:
        """(D,) falls of the weighted squares in simulated runs with products `null` (w, D)."""
        score = null[self.place] - self._gain[:, 0] @ null[self.space.nuisance]
        return score**2 / self.energy

    def fall(self) -> float:
        """Fall of the weighted squares by the fault in blocked cross-validation."""
        columns, nuisance, total = self._columns, self.space.nuisance, 0.0
        for fold, outside in enumerate(self.space.outside):
            gain, train = self._downdated(*outside)
            across = gain.T @ self.space.inside(fold, nuisance, columns) @ self._turn
            whole = self._turn.T @ self.space.inside(fold, columns, columns) @ self._turn
            test = whole - across - across.T + gain.T @ self.space.inside(fold, nuisance, nuisance) @ gain
            value = train[0, 1] / (train[0, 0] + (1.0 - 1.0 / SELECTION.folds) * self.noise)
            total += float(2.0 * value * test[0, 1] - value**2 * (test[0, 0] + self.noise / SELECTION.folds))
        return total

    def coefficients(self) -> Array:
        """(w, 2) coefficients for `CrossProducts.series`, own tolerance removed: fault per unit, residual."""
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
    """Partial regression of m columns without the nuisance columns at `own`: gain (a, m) and products (m, m).

    It is downdated from `inverse`, `gain` and `remainder` (`reduced` of `PartialRegression`), those with all nuisance
    columns.
    """
    gain = gain[:, columns]
    tolerance_use = gain[own]
    stiffness = np.linalg.inv(inverse[np.ix_(own, own)])
    out = gain - inverse[:, own] @ (stiffness @ tolerance_use)
    out[own] = 0.0
    return out, remainder[np.ix_(columns, columns)] + tolerance_use.T @ stiffness @ tolerance_use


def chance_of_sizes(
    known: PartialRegression, tolerances: range, places: NDArray[np.intp], null_runs: Array
) -> Array:  # fmt: skip
    """(m,) probability that noise and errors within the sheet alone give faults at `places` the sizes that a fit with
    each of them has, in which no tolerance is estimated.

    `tolerances` : positions of the sheet's tolerances in `known.nuisance`; `null_runs` (w, D) products with simulated
    runs, whose instruments err within the sheet. Two-sided, normal.
    """
    kept = np.delete(np.arange(len(known.nuisance)), tolerances)
    there, right = known.nuisance[kept], known.sums.layout.right
    gain = np.linalg.solve(known.total[np.ix_(there, there)] + known.prior[np.ix_(kept, kept)], known.total[there])
    score = known.total[places, right] - gain[:, places].T @ known.total[there, right]
    drawn = null_runs[places] - gain[:, places].T @ null_runs[there]
    return np.asarray(scipy.special.chdtrc(1, score**2 / np.mean(drawn**2, axis=1)), float)


def tolerances_like(space: PartialRegression, place: int, alike: NDArray[np.intp]) -> NDArray[np.intp]:
    """Positions in `space.nuisance`, among `alike`, of the tolerances of which a fault's column is a combination."""
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
class FreeEntry:
    """One entry of the sensor sheet estimated without its tolerance, all others with theirs.

    Attributes
    ----------
    name : the entry.
    size, spread : its estimated error ÷ its tolerance, and 1 σ for independent residuals.
    squares : sum of the squares of the other entries, as `ToleranceUse.squares`.
    """

    name: str
    size: float
    spread: float
    squares: float

    @property
    def size_at_least(self) -> float:
        """The least magnitude in its 95 % interval."""
        return abs(self.size) - SELECTION.interval_quantile * self.spread


@dataclass(frozen=True)
class ToleranceUse:
    """Sensor tolerances that the runs need, in units of the sheet, compared with those of simulated runs.

    Attributes
    ----------
    sizes : entry of the sheet → its estimated error ÷ its tolerance.
    squares : sum of their squares without those of latencies, for which there are tests of their own.
    null : (D,) that sum in simulated runs of a complete model, their errors drawn from the tolerances.
    free : where the sheet is rejected, each entry of which the others are not when it is free, and that is then no
        larger than its fault can be, the one that leaves least first: it alone being wrong would do.
    """

    sizes: Mapping[str, float]
    squares: float
    null: Array = field(repr=False)
    free: Sequence[FreeEntry] = ()

    @property
    def excess(self) -> float:
        """`squares` less their mean in simulated runs."""
        return self.squares - float(np.mean(self.null))

    @property
    def tolerance_exceeded(self) -> bool:
        """Whether the sheet is rejected: `squares` above those of all simulated runs, and well above their mean."""
        return self.rejects(self.squares)

    def rejects(self, squares: float) -> bool:
        """Whether the sheet would be rejected with this sum of squares."""
        return squares > max(float(np.max(self.null)), SELECTION.tolerance_squares_ratio * float(np.mean(self.null)))


def tolerance_use(columns: CandidateColumns, known: PartialRegression, null_runs: Array) -> ToleranceUse:
    """The tolerances that the residual needs; `null_runs` (w, D) products with simulated runs."""
    layout, linearisation = columns.sums.layout, columns.linearisation
    found, drawn = known.gain[:, layout.right], known.inverse @ null_runs[known.nuisance]
    sizes: dict[str, float] = {}
    names: dict[int, str] = {}
    most, likely = _largest_faults(columns), dict[str, float]()
    for position, place in enumerate(map(int, known.nuisance)):
        if place not in columns.sigma:
            continue
        size, among = float(found[position]) / columns.sigma[place], place - layout.model
        entry = layout.sheet[among] if among < len(layout.sheet) else None
        name = columns.sheet[place] if entry is None else linearisation.runs.entry_name(entry)
        if entry is not None and entry in linearisation.latency_tolerances:
            removed = linearisation.latencies.get(entry, 0.0) / linearisation.latency_tolerances[entry]
            sizes[name] = size + removed
            continue
        names[position], sizes[name] = name, size
        likely[name] = most.get(name if entry is None else entry[:2], np.inf)
    counted = np.array([*names], np.intp)
    sigma = np.array([columns.sigma[place] for place in known.nuisance[counted].tolist()])
    squares = float(np.sum((found[counted] / sigma) ** 2))
    use = ToleranceUse(sizes, squares, np.sum((drawn[counted] / sigma[:, None]) ** 2, axis=0))
    if not use.tolerance_exceeded:
        return use
    free = [_free_entry(known, counted, sigma, i, name) for i, name in enumerate(names.values())]
    enough = [one for one in free if not use.rejects(one.squares) and one.size_at_least <= likely[one.name]]
    return replace(use, free=sorted(enough, key=lambda one: one.squares))


def _largest_faults(columns: CandidateColumns) -> dict[str | tuple[str, str], float]:
    """Entry of the sheet, or key of the fault that stands for one → its largest plausible size [tolerances]."""
    out: dict[str | tuple[str, str], float] = {}
    for effect in columns.effects:
        bound = effect.sheet_bound(columns.linearisation.runs.rig)
        if effect.as_fault is None or bound <= 0.0:
            continue
        largest = effect.parameters[0].largest / bound
        for entry in (effect.key, *effect.sheet_entries):
            out[entry] = max(largest, out.get(entry, 0.0))
    return out


def _free_entry(
    known: PartialRegression, counted: NDArray[np.intp], sigma: Array, i: int, name: str
) -> FreeEntry:  # fmt: skip
    """Entry `i` of the sheet without its prior, of those at positions `counted` with tolerances `sigma`."""
    at = counted[i]
    found, column, weight = known.gain[:, known.sums.layout.right], known.inverse[:, at], float(known.prior[at, at])
    # The normal matrix loses one number of its diagonal (Sherman and Morrison); only latencies have a prior mean.
    remaining = 1.0 - weight * float(column[at])
    estimates = (found + column * (weight * found[at] / remaining))[counted] / sigma
    spread = float(np.sqrt(max(0.0, float(column[at]) / remaining))) / float(sigma[i])
    return FreeEntry(name, float(estimates[i]), spread, float(np.sum(np.delete(estimates, i) ** 2)))
