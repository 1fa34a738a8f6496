"""Sensor zeros: constants each run's instruments are off by, known only to the sensor sheet's tolerance.

They are parameters of a run with the sheet's σ as prior: free zeros would swallow drag and cross-talk, none at all
would turn a laser's half millimetre into a hundred newtons of tyre load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq.channels import CHANNELS
from identify.drive import Drive
from identify.sensitivity import Sensitivity
from identify.vectors import Array


@dataclass(frozen=True)
class Zeros:
    """Zeros of one run.

    `names` are ``channel.component`` (or the channel), `sigma` (z,) their prior 1 σ, `columns` row → (n, z) the change
    of Y − W θ per unit, after the parallel filter, at the kept samples.
    """

    names: tuple[str, ...]
    sigma: Array
    columns: dict[str, Array]


def zeros_of(drive: Drive, sensitivity: Sensitivity, every: bool = False) -> Zeros:
    """The zeros of a run that its rows can see; or those of `every` channel, alike for all pieces of a run."""
    names: list[str] = []
    sigma: list[float] = []
    series: list[dict[str, Array]] = []
    seen = [(name, k) for name, k, order in sensitivity.slopes if order == 0]
    if every:
        seen = [(name, k) for name in drive.recording.signals.value for k in range(CHANNELS[name].width)]
    for channel, component in dict.fromkeys(seen):
        tolerance = drive.recording.rig.tolerance(channel, "zero")
        if tolerance > 0.0:
            names.append(CHANNELS[channel].columns[component])
            sigma.append(tolerance)
            series.append(sensitivity.zero(channel, component))
    columns: dict[str, Array] = {}
    n = drive.recording.t.size
    for row in drive.rows:
        stacked = np.stack([one.get(row, np.zeros(n)) for one in series]) if series else np.zeros((0, n))
        columns[row] = drive.decimated({row: stacked})[row].T
    return Zeros(tuple(names), np.asarray(sigma), columns)
