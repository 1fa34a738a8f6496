"""Whether what is left has a cause in the catalogue: candidates tried together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identify.lack_of_fit import Left, left_after
from identify.trials import TrialSpace, Tried
from identify.vectors import Array

MOST_TOGETHER = 3
"""Effects that are tried together before a cause is called unlisted."""


def left_by(space: TrialSpace, added: Sequence[Tried]) -> Left:
    """The residual after model, zeros, sensor sheet and some candidates, beside simulated runs treated alike.

    A sensor fault that is added is free of the sheet's tolerance.
    """
    base, prior = space.partialled.taken.tolist(), space.partialled.prior
    fresh = {i: q.prior for one in added for i, q in _columns(one)}
    taken = [*base, *(i for i in fresh if i not in set(base))]
    known = np.zeros((len(taken), len(taken)))
    known[: len(base), : len(base)] = prior
    for n, i in enumerate(taken):
        if i in fresh:
            known[n, n] = fresh[i] ** -2.0
    return left_after(space.sums, np.array(taken, np.intp), known)


def best_set(space: TrialSpace, keys: Sequence[str]) -> list[str]:
    """Up to three candidates that together take away most, found one after the other; at most one sensor fault.

    Several gains set free together would scale the measurement away with whatever is in it.
    """
    left, right = space.partialled.left.copy(), space.layout.right
    open_, chosen = list(keys), list[str]()
    for _ in range(MOST_TOGETHER):
        drops = {key: _drop(left, space.tried[key].trial.place, right, space) for key in open_}
        if not drops or max(drops.values()) <= 0.0:
            break
        best = max(drops, key=lambda key: drops[key])
        chosen.append(best)
        place = space.tried[best].trial.place
        left = left - left[:, place] @ np.linalg.solve(left[place, place], left[place])
        fault = space.tried[best].trial.fault
        open_ = [key for key in open_ if key != best and not (fault and space.tried[key].trial.fault)]
    return chosen


def _drop(left: Array, place: slice, right: int, space: TrialSpace) -> float:
    G, score = left[place, place], left[place, right]
    if np.any(np.diag(G) < 1e-9 * np.diag(space.sums.total)[place]) or np.linalg.cond(G) > 1e12:
        return 0.0
    return float(score @ np.linalg.solve(G, score))


def _columns(one: Tried):
    place = one.trial.place
    return zip(range(place.start, place.stop), one.trial.effect.parameters, strict=True)
