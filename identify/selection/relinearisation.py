"""Runs read again where the sensor sheet's latencies would explain more than a first-order column can tell.

A latency's column is the rate of what is measured: right as long as ω τ is small up to the fit's cut-off. Beyond, what
it leaves of a late instrument (half of ω² τ² of every signal) looks like another effect. So latencies that the sheet's
tolerances take up are taken out of the runs themselves, and the columns stand for what remains. Their prior still is
the sheet's: it pulls back to the rig file's latency.


Whether latencies that the sensor sheet takes up are late instruments, or do the work of an effect that is missing.

Where a model lacks an effect of many floors, clocks move by many tolerances to make up for some of it. Runs are read
again only where one stays far off when what takes most off is beside it.


A sensor fault taken out of the runs before the cause of what is left beside it is called unlisted.

A fault's column is of first order, and beside other effects it knows nothing of them. A hub laser's scale of 3 % moves
its zero by 9 mm: for linear springs that is a zero, but a cubic spring beside it gets another stiffness. Of a scale of
9 % a part goes into the others' tolerances. Both leave more than any candidate explains, until the fault is taken out
as it is. What its own tolerance excuses is counted among what it must explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.effects.sensors.sensor_latency import SensorLatency
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Tell, silent
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, Stored, at_faults, extended, refitted
from lacet.identify.selection.cross_products import Reading, Trial, TrialColumns, solved
from lacet.identify.selection.forward_selection import chosen_together
from lacet.identify.selection.lack_of_fit import prior_stiffening
from lacet.identify.selection.partial_regression import GONE, Partialled
from lacet.identify.selection.score_tests import TrialSpace
from lacet.identify.validation.noise_floor import floor_of

STRAIGHT = 0.15
"""ω τ at the fit's cut-off up to which a first-order column is right…"""
STILL = 0.02
"""… and up to which runs are read again, once they are."""
FARTHEST = 1.0
"""ω τ of the longest step at once."""
READINGS = 5
"""Runs are read no more often."""


def remaining_latencies(reading: Reading, late: Array) -> Array:
    """(clocks,) what the runs still show of the latencies, when so much is taken out of them; both in tolerances.

    The sheet's priors pull to the rig file's.
    """
    sums, layout = reading.sums, reading.sums.layout
    ours = [layout.model + layout.sheet.index(entry) for entry in reading.clocks]
    pull = np.zeros(layout.right)
    pull[ours] = -late
    taken, prior, known = reading.known(pull)
    out = np.zeros(layout.right)
    right = sums.total[taken, layout.right] + known
    out[taken] = solved(sums.total[np.ix_(taken, taken)] + prior, right[:, None])[:, 0]
    return out[ours]


def read_again(recorded: Reading, tell: Tell = silent, straight: float = STRAIGHT) -> Reading:
    """Take latencies out of the runs, where ω τ of one is beyond `straight`, until what remains is small."""
    entries, first = list(recorded.clocks), recorded.fitted
    channels = [entry[1] for entry in entries]
    rig, tolerances = first.runs[0].recording.rig, np.array(list(recorded.clocks.values()))
    faults = [
        SensorLatency.of_sensor(sensor)
        if (sensor := rig.sensor_of(channel))
        else SensorLatency(channel, members=(channel,))
        for channel in channels
    ]
    late, now = np.zeros(len(entries)), recorded
    for reading in range(READINGS if entries else 0):
        step = remaining_latencies(now, late / tolerances) * tolerances
        if np.all(np.abs(now.omega * step) < (STILL if reading else straight)):
            break
        late = late + np.clip(step, -FARTHEST / now.omega, FARTHEST / now.omega)
        tell(f"the runs read again, latencies up to {1e3 * np.max(np.abs(late)):.1f} ms taken out ({reading + 1})")
        runs = [PreparedRun(at_faults(run.recording, faults, late)) for run in first.runs]
        now = Reading.of(refitted(first, runs, _stored(first)), recorded.floor.without_draws())
        assert list(now.clocks) == entries
    if now is recorded:
        return recorded
    fitted = refitted(first, now.fitted.runs)
    counted = ", ".join(f"{channel} {1e3 * x:+.1f} ms" for channel, x in zip(channels, late, strict=True))
    tell(f"the noise floor of the runs read with {counted}")
    floor = floor_of(fitted, recorded.floor.count)
    return replace(Reading.of(fitted, floor), late=dict(zip(entries, late.tolist(), strict=True)))


def _stored(fitted: Fit) -> Stored | None:
    try:
        return fitted.stored
    except ValueError:  # a long run, in pieces
        return None


def columns_as_read(recorded: Reading, candidates: Sequence[Effect], seed: int, tell: Tell) -> TrialColumns:
    """Columns on the runs as recorded, or on runs read again where instruments are late."""
    columns = TrialColumns.of(recorded, candidates, seed, prior_stiffening(recorded), tell)
    tolerances = np.array(list(recorded.clocks.values()))

    def far(late: Array) -> bool:
        return bool(np.any(np.abs(recorded.omega * late * tolerances) >= STRAIGHT))

    if not far(remaining_latencies(recorded, np.zeros(len(tolerances)))) or not far(_beside_effects(columns)):
        return columns
    closer = read_again(recorded, tell, STRAIGHT)
    return TrialColumns.of(closer, candidates, seed, prior_stiffening(closer), tell)


def _beside_effects(columns: TrialColumns) -> Array:
    """(clocks,) latencies in tolerances, beside up to three shapes of effects that together take most off."""
    known = Partialled(columns.sums, columns.taken, columns.prior, None, columns.pull)
    layout = columns.sums.layout
    tried = {str(n): trial for n, trial in enumerate(layout.trials) if _no_clock(trial)}
    places = {n: t.place for n, t in tried.items() if np.all(known.remaining(t.place) > GONE)}
    chosen = chosen_together(known, places, [n for n, trial in tried.items() if trial.fault])
    gain = known.gain[:, layout.right]
    if chosen:
        at = np.concatenate([np.r_[places[n]] for n in chosen])
        gain = (
            gain - known.gain[:, at] @ solved(known.whole[np.ix_(at, at)], known.left[at, layout.right][:, None])[:, 0]
        )
    found = dict(zip(columns.taken.tolist(), gain.tolist(), strict=True))
    entries = [layout.model + layout.sheet.index(entry) for entry in columns.reading.clocks]
    return np.array([found.get(place, 0.0) for place in entries])


def _no_clock(trial: Trial) -> bool:
    return trial.effect.sheet_kind != "latency"


def without_fault(space: TrialSpace, key: str, tell: Tell) -> Reading:
    """The runs with a sensor fault taken out, as a fit finds it; its floor is drawn anew."""
    tell(f"the runs read again with {key} taken out")
    fitted = extended(space.fitted, next(e for e in space.effects if e.key == key))
    tell(f"the noise floor beside {key}")
    floor = floor_of(fitted, space.floor.count)
    return replace(Reading.of(fitted, floor), late=space.reading.late)
