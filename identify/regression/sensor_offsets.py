"""Sensor zeros: constant offsets of the instruments in each run, known only to the sensor sheet's tolerance.

They are parameters of a run with the sheet's σ as prior: zeros without a prior would absorb drag and cross-talk;
without zeros half a millimetre of a laser would appear as a hundred newtons of tyre load. A payload of its own
may stand beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.set_aside import ArraysOnDisk, DiskSpace, JoinedOnDisk
from lacet.identify.car.rows import Row
from lacet.identify.effects.body.payload import Payload, middle
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity


@dataclass(frozen=True)
class Zeros:
    """Sensor zeros of one run.

    Attributes
    ----------
    names : ``channel.component``, or the channel where it has one component.
    sigma : (z,) 1 σ of their priors.
    columns : row → (n, z) change of Y − W θ per unit of each zero, after the parallel filter, at the kept samples.
    """

    names: tuple[str, ...]
    sigma: Array
    columns: Mapping[Row, Array]

    def set_aside(self, space: DiskSpace) -> Zeros:
        """These zeros with their columns on disk."""
        return replace(self, columns=space.put(self.columns))


def zeros_of(run: PreparedRun, sensitivity: Sensitivity, every: bool = False) -> Zeros:
    """Zeros of the channels that a run's rows depend on; with `every` those of all channels, for pieces of a run."""
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


def joined_zeros(pieces: Sequence[Zeros]) -> Zeros:
    """The zeros of a run from those of its pieces, which are alike."""
    first, parts = pieces[0], [piece.columns for piece in pieces]
    on_disk = [part for part in parts if isinstance(part, ArraysOnDisk)]
    if len(on_disk) == len(parts):
        return Zeros(first.names, first.sigma, JoinedOnDisk(on_disk, axis=0))
    rows = dict.fromkeys(row for piece in pieces for row in piece.columns)
    columns = {row: np.concatenate([p.columns[row] for p in pieces if row in p.columns]) for row in rows}
    return Zeros(first.names, first.sigma, columns)


@dataclass(frozen=True)
class PayloadSpread:
    """How payloads differ from run to run: 1 σ about the car that the runs have in common.

    `mass` [kg]; `arms` distance of the payload from the middle between the axles, along, across, up from the body's
    origin [m]: σ of a first moment about that is `mass` times its arm. Seats and a boot, or the bed of a pickup.
    """

    mass: float
    arms: tuple[float, float, float] = (1.2, 0.4, 0.5)

    @property
    def sigma(self) -> Array:
        """(4,) of the mass [kg] and of its first moments [kg·m]."""
        return self.mass * np.array([1.0, *self.arms])


def with_payload(zeros: Zeros | None, run: PreparedRun, spread: PayloadSpread) -> Zeros:
    """A run's zeros, and the mass of its payload and its first moments about the middle between the axles."""
    x = middle(run.kept_motion)
    effect = Payload(run.name)
    columns = run.columns(effect)
    count = len(effect.parameters)
    table: dict[Row, Array] = {}
    for row in run.rows:
        own = columns[row].T if row in columns else np.zeros((len(run.index[row]), count))
        own = np.column_stack([own[:, 0] + x * own[:, 1], own[:, 1:]])
        table[row] = own if zeros is None else np.column_stack([zeros.columns[row], own])
    names = tuple(q.name for q in effect.parameters)
    if zeros is None:
        return Zeros(names, spread.sigma, table)
    return Zeros((*zeros.names, *names), np.concatenate([zeros.sigma, spread.sigma]), table)
