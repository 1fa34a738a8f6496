"""Effects that together take most off the residual, found one after the other."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.partialling import Partialled

MOST_TOGETHER = 3
"""Effects that are tried together before a cause is called unlisted."""


def chosen_together(known: Partialled, places: Mapping[str, slice], faults: Collection[str]) -> list[str]:
    """Up to three by name, of columns at `places`, that together take away most; at most one of the sensor `faults`.

    Several gains set free together would scale the measurement away with whatever is in it.
    """
    left, right = known.whole, known.sums.layout.right
    left[:, right] = known.left[:, right]
    least = 1e-9 * np.diag(known.sums.total)
    open_, chosen = list(places), list[str]()
    for _ in range(MOST_TOGETHER):
        drops = {name: _drop(left, places[name], right, least) for name in open_}
        if not drops or max(drops.values()) <= 0.0:
            break
        best = max(drops, key=lambda name: drops[name])
        chosen.append(best)
        place = places[best]
        left = left - left[:, place] @ np.linalg.solve(left[place, place], left[place])
        open_ = [name for name in open_ if name != best and not (best in faults and name in faults)]
    return chosen


def _drop(left: Array, place: slice, right: int, least: Array) -> float:
    G, score = left[place, place], left[place, right]
    if np.any(np.diag(G) < least[place]) or np.linalg.cond(G) > 1e12:
        return 0.0
    return float(score @ np.linalg.solve(G, score))
