"""Two wheels whose loads, or whose travels, are exchanged: the equations hold with them the other way round."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import ROUGH, Sensitivity
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.validation.channels.evidence import EXPLAINS
from lacet.identify.validation.channels.fault_columns import FaultColumns, first_estimate, floor_of_rows, laws_of
from lacet.identify.validation.exchanged_wheels import DISTANCES, LOADS, Wires

_LEAST = 0.5
"""Weighted squares over the floor ÷ samples from which exchanges are tried. Source: a choice; of a calm slalom two rear
wheels' loads had 0.7."""
_KINDS = {Wires.LOADS: LOADS, Wires.DISTANCES: DISTANCES}


@dataclass(frozen=True)
class ExchangedPair:
    """Two wheels' instruments the other way round.

    `corners` : the wheels; `wires` : of which instruments; `misfit`, `remaining` : root of the weighted squares ÷
    samples (1 : noise alone) as it is, and with them exchanged; `runs` : run → the seconds looked at, from and to.
    """

    corners: tuple[str, str]
    wires: Wires
    misfit: float
    remaining: float
    runs: Mapping[str, tuple[float, float]]


def exchanged_pairs(each: Sequence[tuple[PreparedRun, FaultColumns]]) -> list[ExchangedPair]:
    """The wheels whose loads or travels are exchanged in runs, with the products of these.

    Wires are the same in all runs of a day: where the run with most excess shows none, no other is tried.
    """
    worst = max(each, key=lambda one: one[1].misfit, default=None)
    if worst is None or exchanged_pair(*worst) is None:
        return []
    return _in_common([pair for one in each if (pair := exchanged_pair(*one)) is not None])


def exchanged_pair(run: PreparedRun, products: FaultColumns) -> ExchangedPair | None:
    """The two wheels of a run whose loads or travels are exchanged; None where the equations do not say so.

    `products` : of the run.
    """
    excess = products.misfit - 1.0
    if excess < _LEAST:
        return None
    recording = run.recording
    laws = laws_of(recording)
    priors = np.array([q.prior for effect in laws for q in effect.parameters])
    floor = floor_of_rows(run, Sensitivity.of(recording, laws, first_estimate(run, laws, priors), ROUGH))

    def squares(one: PreparedRun) -> float:
        one.prepare(laws)
        table = [one.matrix(laws, row) / floor[row] for row in one.rows] + [np.diag(1.0 / priors)]
        right = [one.measured[row] / floor[row] for row in one.rows] + [np.zeros(priors.size)]
        normal, side = np.concatenate(table), np.concatenate(right)
        return float(np.sum((side - normal @ np.linalg.lstsq(normal, side, rcond=None)[0]) ** 2))

    tried = {
        (wires, pair): changed
        for wires, pair in itertools.product(_KINDS, itertools.combinations(CORNERS, 2))
        if (changed := _exchanged(recording, _KINDS[wires], pair)) is not None
    }
    best = min(tried, key=lambda key: squares(PreparedRun(tried[key], is_piece=True)), default=None)
    other = None if best is None else FaultColumns.of(PreparedRun(tried[best], is_piece=True))
    if best is None or other is None or products.misfit - other.misfit < EXPLAINS * excess:
        return None
    wires, pair = best
    seconds = float(recording.t[0]), float(recording.t[-1])
    return ExchangedPair(pair, wires, products.misfit**0.5, other.misfit**0.5, {run.name: seconds})


def _in_common(found: Sequence[ExchangedPair]) -> list[ExchangedPair]:
    """Those of runs with the same wheels exchanged as one: that of the first."""
    out: dict[object, ExchangedPair] = {}
    for one in found:
        key = one.corners, one.wires
        out[key] = replace(out[key], runs={**out[key].runs, **one.runs}) if key in out else one
    return list(out.values())


def _exchanged(recording: Recording, kinds: frozenset[str], pair: tuple[str, str]) -> Recording | None:
    """The recording with two wheels' instruments exchanged; None where it has none that both have."""
    values = recording.signals.value
    changed: dict[str, Array] = {}
    for one, other in (pair, pair[::-1]):
        for name in values:
            kind, corner, quantity = (*name.split("."), "", "")[:3]
            # A ground laser is on the body, and no wire of a wheel's.
            if kind in kinds and corner == one and quantity != "ground" and f"{kind}.{other}.{quantity}" in values:
                changed[name] = values[f"{kind}.{other}.{quantity}"]
    return recording.with_signals(recording.signals.changed(changed, recording.filters.rate)) if changed else None
