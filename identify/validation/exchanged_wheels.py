"""Wheels of a run whose wires seem exchanged: their loads follow other wheels' tyres.

Loads and lasers are exchanged alike then. The chassis rows, which need no laser to hold, show which of them it is: they
hold better with the loads where they belong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import reduce
from itertools import permutations

import numpy as np

from lacet.daq.run import Run
from lacet.identify.car.rows import TYRE_ROWS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.signals.filters import decimate
from lacet.identify.validation.channels.fault_columns import FaultColumns

_CLEAR = 0.5
"""Part of the misfit that another assignment of wheels to corners may leave at most to be reported."""
_FOLLOWS = 0.25
"""Part of a wheel load's variance unexplained by its tyre deflection, above which exchanged wheels are not looked for.
"""


_BETTER = 0.8
"""Misfit of the chassis rows with the loads at one place ÷ that at the other, below which they belong there: exchanged
load cells leave their sum as it is. Source: a choice; 12 such runs of a car had 0.02 to 0.50."""
LOADS = frozenset({"wheel", "hub", "pushrod", "scale"})
DISTANCES = frozenset({"laser", "suspension", "damper"})
"""First words of the channels of instruments at a wheel."""


class Wires(Enum):
    """Instruments at a wheel whose wires are exchanged with another's."""

    LOADS = auto()
    DISTANCES = auto()
    EITHER = auto()


@dataclass(frozen=True)
class ExchangedWires:
    """Wheels whose loads follow the tyre deflections of other corners, as wheel → corner, and what is exchanged."""

    followed: Mapping[str, str]
    wires: Wires

    def left_out(self, channel: str) -> bool:
        """Whether a channel is one of the exchanged instruments'; loads where it may be either."""
        kind, _, rest = channel.partition(".")
        kinds = DISTANCES if self.wires is Wires.DISTANCES else LOADS
        return kind in kinds and rest.split(".")[0] in self.followed


def exchanged_wires(run: Run, prepared: PreparedRun) -> ExchangedWires | None:
    """The exchanged wires of a run, prepared from `run`; None where there are none."""
    followed, recording = exchanged_wheels(prepared), prepared.recording
    if not followed:
        return None
    signals = {_moved(name, followed): signal for name, signal in run.signals.items()}
    mended = PreparedRun.of(replace(run, signals=signals), recording.vehicle, recording.rig, recording.filters)
    own, other = (FaultColumns.of_kinds(one, ["chassis"]) for one in (prepared, mended))
    if own is None or other is None:
        return ExchangedWires(followed, Wires.EITHER)
    if other.misfit < _BETTER * own.misfit:
        return ExchangedWires(followed, Wires.LOADS)
    return ExchangedWires(followed, Wires.DISTANCES if own.misfit < _BETTER * other.misfit else Wires.EITHER)


def _moved(channel: str, followed: Mapping[str, str]) -> str:
    """The channel that a load's would have at the corner whose tyre it follows."""
    kind, _, rest = channel.partition(".")
    corner, _, quantity = rest.partition(".")
    return f"{kind}.{followed[corner]}.{quantity}" if kind in LOADS and corner in followed else channel


def exchanged_wheels(run: PreparedRun) -> Mapping[str, str]:
    """Wheels whose loads follow the tyre deflection of another corner, as wheel → corner; empty where there are none.

    A tyre's load follows its own deflection closely, whatever the car and the manoeuvre; where the loads of two wheels
    fit each other's deflections much better than their own, their wires were exchanged.
    """
    run = run.overview()
    outline = run.outline
    rows = [row for row in TYRE_ROWS if row in run.rows]
    corners = [row.place for row in rows]
    if len(rows) < 2:
        return {}
    keep = reduce(np.intersect1d, (run.index[row] for row in rows))
    if keep.size < 30:
        return {}
    if any(float(np.median(outline.tyres[row])) < 0.0 for row in rows):
        return {}  # of the other sign, which goes against its own deflection, too
    loads: list[Array] = list(decimate(np.stack([outline.tyres[row] for row in rows]), outline.filters, keep))
    deflections = decimate(np.stack([outline.corners[c].deflection for c in corners]), outline.filters, keep)
    cost = np.ones((len(corners), len(corners)))
    for i, load in enumerate(loads):
        for j, deflection in enumerate(deflections):
            centred: Array = np.asarray(deflection - np.mean(deflection), float)
            if not np.any(centred) or not float(np.var(load)):
                continue  # a dead sensor has no correlation
            slope = float(centred @ load / (centred @ centred))
            misfit = float(np.var(load - slope * centred) / np.var(load))
            cost[i, j] = misfit if slope > 0 else 1.0
    each = range(len(corners))
    places = min(permutations(each), key=lambda places: float(cost[each, places].sum()))
    own, best = float(np.trace(cost)), float(cost[each, places].sum())
    moved = {corners[i]: corners[j] for i, j in zip(each, places, strict=True) if i != j}
    if (
        not moved
        or best > _CLEAR * own
        or any(cost[corners.index(w), corners.index(c)] > _FOLLOWS for w, c in moved.items())
    ):
        return {}
    return moved
