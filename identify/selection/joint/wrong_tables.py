"""Wrong bench tables beside a law found: how much of its size could be a table that is off, for all the runs show.

A table that is off by a part p changes the law's estimate by its regression on the table's columns. Where the runs do
not exclude a p that changes it by much, the law is confounded with the table: its own interval, which is that of a
right table, does not say so.

Source: omitted-variable bias, J. M. Wooldridge, Introductory Econometrics (2013), section 3.3.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import AXLES, Effect
from lacet.identify.effects.suspension.bench_table import BenchTable
from lacet.identify.effects.unknown_table import SLOPES
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.candidate import Confounded
from lacet.identify.selection.columns.layout import Trial
from lacet.identify.selection.rest import AddedLaw
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


def axles_without_tables(found: Iterable[Effect], vehicle: Vehicle) -> tuple[str, ...]:
    """Axles of a car without bench tables whose wheels move or turn with the travel, by the effects `found`."""
    axles = dict.fromkeys(effect.where for effect in found if isinstance(effect, SLOPES))
    corners = {axle: [vehicle.corners[c] for c in AXLES[axle]] for axle in axles}
    return tuple(axle for axle, both in corners.items() if all(c.table is None and c.joints is None for c in both))


def confounded_with(space: ScoreTests, law: AddedLaw) -> tuple[Confounded, ...]:
    """The bench tables that the law is confounded with on the runs of a fit that has it, the worst first."""
    trials = [trial for trial in space.layout.trials if isinstance(trial.effect, BenchTable)]
    found = [one for trial in trials if (one := _of(space, law, trial)) is not None]
    return tuple(sorted(found, key=lambda one: -one.share))


def _of(space: ScoreTests, law: AddedLaw, trial: Trial) -> Confounded | None:
    known, at, model = space.regression, trial.place, space.layout.model
    if trial.effect.key in space.selected or np.any(known.remaining_energy(at) <= SELECTION.gone_share):
        return None
    rows = known.sums.turn[list(law.places)]
    inverse = rows @ known.inverse[:model]
    own = np.sqrt(np.maximum(0.0, np.diag(inverse[:, :model] @ rows.T)))
    across: Array = -(rows @ known.gain[:model, at])[:, 0]
    precision = float(known.reduced_noisy[at, at][0, 0]) + trial.effect.parameters[0].prior ** -2.0
    value = float(known.reduced[at, known.sums.layout.right][0]) / precision
    half = SELECTION.interval_quantile / np.sqrt(precision)
    low, high = np.clip([value - half, value + half], -SELECTION.table_error, SELECTION.table_error).tolist()
    change = np.abs(across) * max(abs(low), abs(high))
    size = np.maximum(np.abs(law.values), np.finfo(float).tiny)
    interval = SELECTION.interval_quantile * own
    much = change > np.maximum(SELECTION.confounded_share * size, SELECTION.confounded_interval * interval)
    if not np.any(much):
        return None
    return Confounded(trial.effect.key, low, high, float(np.max((change / size)[much])))
