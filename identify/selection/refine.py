"""A candidate's shape constants between the values of its grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.partialling import GONE
from lacet.identify.selection.trials import TrialSpace
from lacet.identify.selection.unlisted import beside

BETWEEN = 3
"""Values tried on each side of the best, in each of `ROUNDS`."""
ROUNDS = 2
LEAST = 4.0
"""Fall of the weighted squares by which a value off the grid must be better."""


def refined(space: TrialSpace, c: Candidate) -> Candidate:
    """A candidate with the shape constants that fit best between those of its grid, and the values that go with them.

    p and gain stay those of the grid, which the simulated runs were searched over too.
    """
    if not c.shape or not c.tested:
        return c
    effect = next(e for e in space.effects if e.key == c.key)
    best, drop, found = dict(c.shape), -1.0, c
    for name, values in effect.grids.items():
        if len(values) < 2:
            continue
        low, high = _neighbours(values, best[name])
        for _ in range(ROUNDS):
            tried = np.unique(np.concatenate([np.linspace(low, best[name], BETWEEN + 2),
                                              np.linspace(best[name], high, BETWEEN + 2)]))  # fmt: skip
            falls, others = _falls(space, effect, [{**best, name: float(value)} for value in tried])
            top = int(np.argmax(falls))
            at = int(np.flatnonzero(tried == best[name])[0])
            if falls[top] > falls[at] + (LEAST if drop < 0.0 else 0.0):
                best[name], drop = float(tried[top]), falls[top]
                found = replace(c, shape=dict(best), values=others[top][0], interval=others[top][1])
            low, high = tried[max(0, top - 1)], tried[min(len(tried) - 1, top + 1)]
    return found


def _neighbours(values: tuple[float, ...], at: float) -> tuple[float, float]:
    ordered = sorted(values)
    i = min(range(len(ordered)), key=lambda k: abs(ordered[k] - at))
    return ordered[max(0, i - 1)], ordered[min(len(ordered) - 1, i + 1)]


def _falls(
    space: TrialSpace, effect: Effect, shapes: list[dict[str, float]]
) -> tuple[list[float], list[tuple[tuple[float, ...], tuple[float, ...]]]]:
    """For each set of shape constants the fall of the weighted squares, and parameters with half their intervals."""
    inside, trials = beside(space, [replace(effect, shape=shape) for shape in shapes], draws=False)
    none = np.zeros((inside.sums.layout.width, 1))
    # A gap that is never passed leaves nothing to compare.
    seen = [bool(np.all(inside.remaining(trial.place) > GONE)) for trial in trials]
    falls = [inside.scores(t.place, none)[0] if there else -1.0 for t, there in zip(trials, seen, strict=True)]
    nothing = np.zeros(len(effect.parameters))
    values = [inside.values(t.place) if there else (nothing, nothing) for t, there in zip(trials, seen, strict=True)]
    return falls, [(tuple(map(float, v)), tuple(float(1.96 * x) for x in s)) for v, s in values]
