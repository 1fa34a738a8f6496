"""Sensor zeros: constant offsets of the instruments in each run, known only to the sensor sheet's tolerance.

They are parameters of a run with the sheet's σ as prior: free zeros would swallow drag and cross-talk, none at all
would turn a laser's half millimetre into a hundred newtons of tyre load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity


@dataclass(frozen=True)
class Zeros:
    """Zeros of one run.

    `names` are ``channel.component`` (or the channel), `sigma` (z,) their prior 1 σ, `columns` row → (n, z) the change
    of Y − W θ per unit, after the parallel filter, at the kept samples.
    """

    names: tuple[str, ...]
    sigma: Array
    columns: dict[Row, Array]


def zeros_of(run: PreparedRun, sensitivity: Sensitivity, every: bool = False) -> Zeros:
    """The zeros of a run that its rows can see; or those of `every` channel, alike for all pieces of a run."""
    names: list[str] = []
    sigma: list[float] = []
    series: list[dict[Row, Array]] = []
    seen = [(name, k) for name, k, order in sensitivity.taken.coarse if order == 0]
    if every:
        seen = [(name, k) for name in run.recording.signals.value for k in range(CHANNELS[name].width)]
    for channel, component in dict.fromkeys(seen):
        tolerance = run.recording.rig.tolerance(channel, "zero")
        if tolerance > 0.0:
            names.append(CHANNELS[channel].columns[component])
            sigma.append(tolerance)
            series.append(sensitivity.zero(channel, component))
    columns: dict[Row, Array] = {row: np.zeros((len(run.index[row]), len(series))) for row in run.rows}
    for row, table in columns.items():
        # The filter leaves a constant as it is, and most of these are constant.
        waving = [i for i, one in enumerate(series) if row in one and np.ptp(one[row]) > 0.0]
        for i, one in enumerate(series):
            if row in one and i not in waving:
                table[:, i] = one[row][0]
        if waving:
            table[:, waving] = run.decimated({row: np.stack([series[i][row] for i in waving])})[row].T
    return Zeros(tuple(names), np.asarray(sigma), columns)
