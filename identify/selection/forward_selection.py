"""Forward selection of the few effects that together explain most, for estimates beside them."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.settings import SELECTION


def select_forward(known: PartialRegression, places: Mapping[str, slice], faults: Collection[str]) -> list[str]:
    """Names of up to three effects, with columns at `places`, that together lower the squares most.

    At most one of the sensor `faults` is chosen: several free gains could together scale the measurement to zero.
    """
    remainder, right = known.reduced_noisy, known.sums.layout.right
    remainder[:, right] = known.reduced[:, right]
    least = SELECTION.set_energy * np.diag(known.sums.total)
    open_, chosen = list(places), list[str]()
    for _ in range(SELECTION.most_beside_latencies):
        drops = {name: _drop(remainder, places[name], right, least) for name in open_}
        if not drops or max(drops.values()) <= 0.0:
            break
        best = max(drops, key=lambda name: drops[name])
        chosen.append(best)
        place = places[best]
        remainder = remainder - remainder[:, place] @ np.linalg.solve(remainder[place, place], remainder[place])
        open_ = [name for name in open_ if name != best and not (best in faults and name in faults)]
    return chosen


def _drop(remainder: Array, place: slice, right: int, least: Array) -> float:
    G, score = remainder[place, place], remainder[place, right]
    if np.any(np.diag(G) < least[place]) or np.linalg.cond(G) > SELECTION.worst_condition:
        return 0.0
    return float(score @ np.linalg.solve(G, score))
