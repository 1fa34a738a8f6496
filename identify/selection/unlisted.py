"""Whether what is left has a cause in the catalogue: candidates tried together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.selection.lack_of_fit import Left, left_after, with_columns
from lacet.identify.selection.layout import Layout, Trial
from lacet.identify.selection.partialling import Partialled
from lacet.identify.selection.together import chosen_together
from lacet.identify.selection.trial_sums import TrialSums
from lacet.identify.selection.trials import TrialSpace


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


def left_unexcused(space: TrialSpace, key: str) -> Left:
    """The residual after model, zeros and sensor sheet, where nothing of a sensor fault is excused by its tolerance."""
    known, freed = space.partialled, space.tried[key].freed
    kept = np.setdiff1d(np.arange(len(known.taken)), freed.own if freed else [])
    prior = known.prior[np.ix_(kept, kept)]
    return left_after(space.sums, known.total, known.taken[kept], prior, known.pull[kept])


def best_set(space: TrialSpace, keys: Sequence[str]) -> list[str]:
    """Up to three candidates, at their best shapes, that together take away most; at most one sensor fault."""
    tried = {key: space.tried[key].trial for key in keys}
    faults = [key for key, trial in tried.items() if trial.fault]
    return chosen_together(space.partialled, {key: trial.place for key, trial in tried.items()}, faults)
