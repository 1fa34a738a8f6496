"""Whether what is left has a cause in the catalogue: candidates tried together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identify.effect import Effect
from identify.lack_of_fit import Left, left_after, with_columns
from identify.layout import Layout, Trial
from identify.partialling import Partialled
from identify.trial_sums import TrialSums
from identify.trials import TrialSpace
from identify.vectors import Array

MOST_TOGETHER = 3
"""Effects that are tried together before a cause is called unlisted."""


def beside(space: TrialSpace, effects: Sequence[Effect], draws: bool = True) -> tuple[Partialled, tuple[Trial, ...]]:
    """Columns of some effects at their present shapes, less what model, zeros and sheet explain, as in `space`.

    `draws` : beside the simulated runs, too.
    """
    before, own = space.partialled, {trial.place.start: trial.effect for trial in space.layout.trials}
    faults = [place for place in before.taken.tolist() if place in own]
    layout = Layout.of(space.layout.model, space.layout.sheet, [*(own[place] for place in faults), *effects])
    floor = space.floor if draws else space.floor.without_draws()
    sums = TrialSums.of(space.fitted, floor, layout, space.sums.temper, {}, np.random.default_rng(0))
    # The sheet's faults now stand one behind the other; their priors stay those of the space.
    plain = before.taken[: len(before.taken) - len(faults)]
    moved = [trial.place.start for trial in layout.trials[: len(faults)]]
    taken = np.concatenate([plain, moved]).astype(np.intp)
    # Noise in a shape off the grid is nearly that of the best on it; shapes are compared by their own columns alone.
    pairs = [(t.place, space.tried[t.effect.key].trial.place) for t in layout.trials[len(faults) :]
             if draws and t.effect.key in space.tried]  # fmt: skip
    new = np.concatenate([taken, *(np.r_[place] for place, _ in pairs), [layout.right]]).astype(np.intp)
    old = np.concatenate([before.taken, *(np.r_[place] for _, place in pairs), [space.layout.right]]).astype(np.intp)
    noise = np.zeros_like(sums.total)
    noise[np.ix_(new, new)] = before.column_noise[np.ix_(old, old)]
    inside = Partialled(sums, taken, before.prior, noise, before.pull)
    return inside, layout.trials[len(faults) :]


def left_by(space: TrialSpace, added: Sequence[Effect]) -> Left:
    """The residual after model, zeros, sensor sheet and some effects, beside simulated runs treated alike."""
    if not added:
        known = space.partialled
        return left_after(space.sums, known.total, known.taken, known.prior, known.pull)
    inside, trials = beside(space, added)
    fresh = {
        i: q.prior
        for trial in trials
        for i, q in zip(range(trial.place.start, trial.place.stop), trial.effect.parameters, strict=True)
    }
    return left_after(inside.sums, inside.total, *with_columns(inside.taken, inside.prior, inside.pull, fresh))


def best_set(space: TrialSpace, keys: Sequence[str]) -> list[str]:
    """Up to three candidates that together take away most, found one after the other; at most one sensor fault.

    Several gains set free together would scale the measurement away with whatever is in it.
    """
    left, right = space.partialled.whole, space.layout.right
    left[:, right] = space.partialled.left[:, right]
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
