"""Runs read again where the sensor sheet's latencies would explain more than a first-order column can tell.

A latency's column is the rate of what is measured: right as long as ω τ is small up to the fit's cut-off. Beyond, what
it leaves of a late instrument (half of ω² τ² of every signal) looks like another effect. So latencies that the sheet's
tolerances take up are taken out of the runs themselves, and the columns stand for what remains. Their prior still is
the sheet's: it pulls back to the rig file's latency.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.identify.effects.sensors.sensor_latency import SensorLatency
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Tell, silent
from lacet.identify.regression.prepared_run import Drive
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.regression.wls import Fit, Stored, at_faults, refitted
from lacet.identify.selection.lack_of_fit import left_after, solved
from lacet.identify.selection.layout import Layout, sheet_of
from lacet.identify.selection.trial_sums import TrialSums
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of

STRAIGHT = 0.15
"""ω τ at the fit's cut-off up to which a first-order column is right…"""
STILL = 0.02
"""… and up to which runs are read again, once they are."""
FARTHEST = 1.0
"""ω τ of the longest step at once."""
READINGS = 5
"""Runs are read no more often."""


@dataclass(frozen=True)
class Reading:
    """A fit to runs as they were read.

    Attributes
    ----------
    fitted, floor : fit and noise floor.
    late : entry of the sheet → latency that was taken out of the runs [s]; empty where none was.
    sums : of the model and the sheet on them.
    """

    fitted: Fit
    floor: NoiseFloor
    late: Mapping[SheetEntry, float]
    sums: TrialSums

    @classmethod
    def of(cls, fitted: Fit, floor: NoiseFloor) -> Reading:
        """Of runs as they were recorded."""
        return cls(fitted, floor, {}, sheet_sums(fitted, floor))

    @cached_property
    def clocks(self) -> dict[SheetEntry, float]:
        """Latencies among the sheet's entries → tolerance [s]."""
        rig = self.fitted.drives[0].recording.rig
        return {e: rig.tolerance(e[1], "latency") for e in self.sums.layout.sheet if e[0] == "latency"}

    @cached_property
    def pull(self) -> Array:
        """(model and sheet,) where the rig file's latencies are, in tolerances from those the runs were read at."""
        off = [-self.late[e] / self.clocks[e] if e in self.late else 0.0 for e in self.sums.layout.sheet]
        return np.array([0.0] * self.sums.layout.model + off)

    @property
    def omega(self) -> float:
        """Of the fit's cut-off [rad/s]."""
        return 2.0 * np.pi * self.fitted.drives[0].recording.filters.fit_cutoff

    def misfit(self) -> float:
        """Residual ÷ floor over all rows once zeros, gains and latencies have taken their share, never less than 1.

        Next to a misfit of many floors a prior of one σ is no bound at all: zeros and gains would soak the missing
        effect up. Priors are stiffened by this factor, which leaves them as they are when nothing is missing.
        """
        ratios = left_after(self.sums, self.sums.total, *_sheet_known(self.sums, self.pull)).ratios
        return max(1.0, float(np.sqrt(np.mean(np.square(list(ratios.values()))))))

    def remaining(self, late: Array) -> Array:
        """(clocks,) what the runs still show of the latencies, when so much is taken out of them; both in tolerances.

        The sheet's priors pull to the rig file's.
        """
        layout = self.sums.layout
        ours = [layout.model + layout.sheet.index(entry) for entry in self.clocks]
        pull = np.zeros(layout.right)
        pull[ours] = -late
        taken, prior, known = _sheet_known(self.sums, pull)
        out = np.zeros(layout.right)
        right = self.sums.total[taken, layout.right] + known
        out[taken] = solved(self.sums.total[np.ix_(taken, taken)] + prior, right[:, None])[:, 0]
        return out[ours]


def read_again(recorded: Reading, tell: Tell = silent, straight: float = STRAIGHT) -> Reading:
    """Take latencies out of the runs, where ω τ of one is beyond `straight`, until what remains is small."""
    entries, first = list(recorded.clocks), recorded.fitted
    channels = [entry[1] for entry in entries]
    rig, tolerances = first.drives[0].recording.rig, np.array(list(recorded.clocks.values()))
    faults = [
        SensorLatency.of_sensor(sensor)
        if (sensor := rig.sensor_of(channel))
        else SensorLatency(channel, members=(channel,))
        for channel in channels
    ]
    late, now = np.zeros(len(entries)), recorded
    for reading in range(READINGS if entries else 0):
        step = now.remaining(late / tolerances) * tolerances
        if np.all(np.abs(now.omega * step) < (STILL if reading else straight)):
            break
        late = late + np.clip(step, -FARTHEST / now.omega, FARTHEST / now.omega)
        tell(f"the runs read again, latencies up to {1e3 * np.max(np.abs(late)):.1f} ms taken out ({reading + 1})")
        drives = [Drive(at_faults(drive.recording, faults, late)) for drive in first.drives]
        now = Reading.of(refitted(first, drives, _stored(first)), recorded.floor.without_draws())
        assert list(now.clocks) == entries
    if now is recorded:
        return recorded
    fitted = refitted(first, now.fitted.drives)
    counted = ", ".join(f"{channel} {1e3 * x:+.1f} ms" for channel, x in zip(channels, late, strict=True))
    tell(f"the noise floor of the runs read with {counted}")
    floor = floor_of(fitted, recorded.floor.count)
    return replace(Reading.of(fitted, floor), late=dict(zip(entries, late.tolist(), strict=True)))


def _stored(fitted: Fit) -> Stored | None:
    try:
        return fitted.stored
    except ValueError:  # a long run, in pieces
        return None


def sheet_sums(fitted: Fit, floor: NoiseFloor) -> TrialSums:
    """Of a fit's columns and those of the sensor sheet."""
    layout = Layout.of(len(fitted.place), sheet_of(fitted), ())
    return TrialSums.of(fitted, floor, layout, 1.0, {}, np.random.default_rng(0))


def _sheet_known(sums: TrialSums, pull: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Places of the columns of model and sheet that act; normal matrix and right side of what is known of them."""
    layout = sums.layout
    places = np.arange(layout.right)
    taken = places[np.diag(sums.total)[places] > 0.0]
    prior = np.eye(layout.right)
    prior[: layout.model, : layout.model] = sums.known
    return taken, prior[np.ix_(taken, taken)], pull[taken]
