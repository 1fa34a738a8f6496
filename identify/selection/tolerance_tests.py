"""Sensor faults against the sensor sheet: a fault without its own tolerance, and what the whole sheet takes up.

The sheet's tolerances stand beside the model with priors, a fault's own among them. A fault that the runs show much
better than its tolerance would be explained by that, at a price that only the prior knows. So the columns that stand
for it (`own`) are taken back into the residual; what is found is then compared with the tolerance. Noise in a fault's
column (of a late laser half is noise) makes its estimate too small, and is taken out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.selection.cross_products import FOLDS, Reading, TrialColumns
from lacet.identify.selection.partial_regression import Partialled

DOUBT = 0.1
"""Part of a shift by noise that its simulation may be wrong by: the sheet's noise is, and how loud a run was."""


class Freed:
    """One fault beside everything else that is known, its own tolerance apart.

    Parameters
    ----------
    space : everything partialled out, the fault's own tolerance too.
    place : of the fault's column.
    own : positions in `space.taken` of the columns that stand for it.
    """

    def __init__(self, space: Partialled, place: int, own: NDArray[np.intp]):
        self.space, self.place, self.own = space, place, own
        self._columns = np.array([place, space.sums.layout.right, *space.taken[own]], np.intp)
        # What is excused is told from the rig file's value, where that is not what the runs were read at.
        self._turn = np.zeros((len(self._columns), 2))
        self._turn[0, 0] = self._turn[1, 1] = 1.0
        self._turn[2:, 1] = -np.linalg.solve(space.prior[np.ix_(own, own)], space.pull[own])
        # Of the fault's column and the residual, less everything but what stands for it.
        self._gain, self._products = self._given_back(space.inverse, space.gain, space.left)
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
        """Fall of the weighted squares when the fault is added, where its own tolerance excuses none of it.

        What `DOUBT` of the shift by noise could explain is not counted.
        """
        sure = max(0.0, abs(self.value) - DOUBT * abs(self._shift) / self.energy)
        return sure**2 * self.energy

    def null(self, null: Array) -> Array:
        """(D,) `drop` in simulated runs with products `null` (w, D)."""
        score = null[self.place] - self._gain[:, 0] @ null[self.space.taken]
        return score**2 / self.energy

    def fall(self) -> float:
        """The same in blocked cross-validation."""
        columns, taken, total = self._columns, self.space.taken, 0.0
        for (inverse, gain, left), inside in zip(self.space.outside, self.space.inside, strict=True):
            gain, train = self._given_back(inverse, gain, left)
            across = gain.T @ inside[np.ix_(taken, columns)] @ self._turn
            whole = self._turn.T @ inside[np.ix_(columns, columns)] @ self._turn
            test = whole - across - across.T + gain.T @ inside[np.ix_(taken, taken)] @ gain
            value = train[0, 1] / (train[0, 0] + (1.0 - 1.0 / FOLDS) * self.noise)
            total += float(2.0 * value * test[0, 1] - value**2 * (test[0, 0] + self.noise / FOLDS))
        return total

    def coefficients(self) -> Array:
        """(w, 2) for `TrialSums.series`: one unit of the fault, and the residual, not excused by its own tolerance."""
        out = np.zeros((self.space.sums.layout.width, 2))
        out[self._columns] = self._turn
        out[self.space.taken] -= self._gain
        return out

    def _given_back(self, inverse: Array, gain: Array, left: Array) -> tuple[Array, Array]:
        gain, products = given_back(inverse, gain, left, self._columns, self.own)
        return gain @ self._turn, self._turn.T @ products @ self._turn


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


TWICE = 2.0
"""A sheet is strained from this many times the squares that it takes up in simulated runs on average."""


@dataclass(frozen=True)
class Excused:
    """What the sheet's tolerances take up.

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
    def strained(self) -> bool:
        """Whether such a sheet is not to be believed: more than in any simulated run, and than twice their mean."""
        return self.squares > max(float(np.max(self.null)), TWICE * float(np.mean(self.null)))


def excused(columns: TrialColumns, known: Partialled, null_runs: Array, found: Array) -> Excused:
    """What the sheet takes up where it explains `found` (a,) of the residual; `null_runs` (w, D) simulated."""
    layout = columns.sums.layout
    drawn = known.inverse @ null_runs[known.taken]
    sizes: dict[str, float] = {}
    squares, null = 0.0, np.zeros(drawn.shape[1])
    for position, place in enumerate(map(int, known.taken)):
        if place < layout.model:
            continue
        size, among = float(found[position]) / columns.sigma[place], place - layout.model
        entry = layout.sheet[among] if among < len(layout.sheet) else None
        if entry is not None and entry[0] == "latency":
            name, taken_out = _clock(columns.reading, entry)
            sizes[name] = size + taken_out
            continue
        squares += size**2
        null += (drawn[position] / columns.sigma[place]) ** 2
        name = columns.sheet[place] if entry is None else f"{entry[0]} of {CHANNELS[entry[1]].columns[entry[2]]}"
        sizes[name] = size
    return Excused(sizes, squares, null)


def _clock(reading: Reading, entry: SheetEntry) -> tuple[str, float]:
    """A latency's name, and how much of it was taken out of the runs before, in tolerances."""
    rig, channel = reading.fitted.runs[0].recording.rig, entry[1]
    sensor = rig.sensor_of(channel)
    taken_out = reading.late.get(entry, 0.0) / rig.tolerance(channel, "latency")
    return f"latency of {sensor.name if sensor else channel}", taken_out
