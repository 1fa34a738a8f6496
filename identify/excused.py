"""What the sensor sheet would have to be wrong by for a model to be right, and whether any sheet ever is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from daq.channels import CHANNELS
from identify.trials import TrialSpace
from identify.vectors import Array

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


def excused(space: TrialSpace, key: str = "") -> Excused:
    """What the sheet takes up beside the candidate `key` at its best shape, or beside none."""
    layout, columns, late = space.layout, space.columns, space.reading.late
    rig, known = space.fitted.drives[0].recording.rig, space.partialled
    drawn = known.inverse @ space.null[known.taken]
    found = _taken_up(space, key)
    sizes: dict[str, float] = {}
    squares, null = 0.0, np.zeros(drawn.shape[1])
    for position, place in enumerate(known.taken.tolist()):
        if place < layout.model:
            continue
        name, size = columns.sheet[place], float(found[position]) / columns.sigma[place]
        entry = layout.sheet[place - layout.model] if place < layout.model + len(layout.sheet) else None
        if entry and entry[0] == "latency":
            size += late.get(entry, 0.0) / rig.tolerance(entry[1], "latency")
            sensor = rig.sensor_of(entry[1])
            name = f"latency of {sensor.name if sensor else entry[1]}"
        else:
            squares += size**2
            null += (drawn[position] / columns.sigma[place]) ** 2
        if entry and entry[0] != "latency":
            name = f"{entry[0]} of {CHANNELS[entry[1]].columns[entry[2]]}"
        sizes[name] = size
    return Excused(sizes, squares, null)


def _taken_up(space: TrialSpace, key: str) -> Array:
    """(a,) what the columns partialled out explain of the residual, less a candidate."""
    known, right = space.partialled, space.layout.right
    if not key:
        return known.gain[:, right]
    one = space.tried[key]
    if one.freed is None:
        return known.gain[:, right] - known.gain[:, one.trial.place] @ one.values
    # A fault set free is excused by nothing that stands for it.
    fault, residual = one.freed.coefficients()[known.taken].T
    out = float(one.values[0]) * fault - residual
    out[one.freed.own] = 0.0
    return out
