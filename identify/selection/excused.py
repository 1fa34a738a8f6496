"""What the sensor sheet would have to be wrong by for a model to be right, and whether any sheet ever is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.selection.trials import TrialSpace

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
    layout, columns, known = space.layout, space.columns, space.partialled
    drawn = known.inverse @ space.null[known.taken]
    found = _taken_up(space, key)
    sizes: dict[str, float] = {}
    squares, null = 0.0, np.zeros(drawn.shape[1])
    for position, place in enumerate(map(int, known.taken)):
        if place < layout.model:
            continue
        size, among = float(found[position]) / columns.sigma[place], place - layout.model
        entry = layout.sheet[among] if among < len(layout.sheet) else None
        if entry is not None and entry[0] == "latency":
            name, taken_out = _clock(space, entry)
            sizes[name] = size + taken_out
            continue
        squares += size**2
        null += (drawn[position] / columns.sigma[place]) ** 2
        name = columns.sheet[place] if entry is None else f"{entry[0]} of {CHANNELS[entry[1]].columns[entry[2]]}"
        sizes[name] = size
    return Excused(sizes, squares, null)


def _clock(space: TrialSpace, entry: SheetEntry) -> tuple[str, float]:
    """A latency's name, and how much of it was taken out of the runs before, in tolerances."""
    rig, channel = space.fitted.drives[0].recording.rig, entry[1]
    sensor = rig.sensor_of(channel)
    taken_out = space.reading.late.get(entry, 0.0) / rig.tolerance(channel, "latency")
    return f"latency of {sensor.name if sensor else channel}", taken_out


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
