"""Whether what is left has a cause in the catalogue: candidates tried together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identify.effect import Effect
from identify.lack_of_fit import Left, left_after
from identify.layout import Layout, Trial
from identify.partialling import Partialled
from identify.trial_sums import TrialSums
from identify.trials import TrialSpace
from identify.vectors import Array

MOST_TOGETHER = 3
"""Effects that are tried together before a cause is called unlisted."""


def beside(space: TrialSpace, effects: Sequence[Effect]) -> Partialled:
    """Columns of some effects at their present shapes, less what model, zeros, gains and latencies explain."""
    start = space.layout.model + len(space.layout.sheet)
    trials: list[Trial] = []
    for effect in effects:
        stop = start + len(effect.parameters)
        trials.append(Trial(effect, slice(start, stop)))
        start = stop
    layout = Layout(space.layout.model, space.layout.sheet, tuple(trials))
    sums = TrialSums.of(space.fitted, space.floor, layout, space.sums.temper, {}, np.random.default_rng(0))
    places = np.arange(layout.model + len(layout.sheet))
    taken = places[np.diag(sums.total)[places] > 0.0].astype(np.intp)
    p = layout.model
    prior = np.diag(np.full(len(taken), sums.temper**2))
    prior[:p, :p] = sums.known
    return Partialled(sums, taken, prior)


def left_by(space: TrialSpace, added: Sequence[Effect]) -> Left:
    """The residual after model, zeros, sensor sheet and some effects, beside simulated runs treated alike."""
    if not added:
        return left_after(space.sums, space.partialled.taken, space.partialled.prior)
    inside = beside(space, added)
    fresh = [
        (i, q.prior)
        for trial in inside.sums.layout.trials
        for i, q in zip(range(trial.place.start, trial.place.stop), trial.effect.parameters, strict=True)
    ]
    taken = np.concatenate([inside.taken, [i for i, _ in fresh]]).astype(np.intp)
    prior = np.zeros((len(taken), len(taken)))
    n = len(inside.taken)
    prior[:n, :n] = inside.prior
    prior[range(n, len(taken)), range(n, len(taken))] = [sigma**-2.0 for _, sigma in fresh]
    return left_after(inside.sums, taken, prior)


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
