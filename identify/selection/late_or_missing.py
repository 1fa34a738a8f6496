"""Whether latencies that the sensor sheet takes up are late instruments, or do the work of an effect that is missing.

Where a model lacks an effect of many floors, clocks move by many tolerances to make up for some of it. Runs are read
again only where one stays far off when what takes most off is beside it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lacet.identify.effects.base import Effect, SensorFault
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Tell
from lacet.identify.selection.lack_of_fit import solved
from lacet.identify.selection.layout import Trial
from lacet.identify.selection.partialling import GONE, Partialled
from lacet.identify.selection.reading import STRAIGHT, Reading, read_again
from lacet.identify.selection.together import chosen_together
from lacet.identify.selection.trial_columns import TrialColumns


def columns_as_read(recorded: Reading, candidates: Sequence[Effect], seed: int, tell: Tell) -> TrialColumns:
    """Columns on the runs as recorded, or on runs read again where instruments are late."""
    columns = TrialColumns.of(recorded, candidates, seed, tell)
    tolerances = np.array(list(recorded.clocks.values()))

    def far(late: Array) -> bool:
        return bool(np.any(np.abs(recorded.omega * late * tolerances) >= STRAIGHT))

    if not far(recorded.remaining(np.zeros(len(tolerances)))) or not far(_beside_effects(columns)):
        return columns
    return TrialColumns.of(read_again(recorded, tell, STRAIGHT), candidates, seed, tell)


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
    return not (isinstance(trial.effect, SensorFault) and trial.effect.tolerance == "latency")
