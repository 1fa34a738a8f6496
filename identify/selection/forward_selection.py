"""Effects that together take most off the residual, found one after the other; which are tied; their constants."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy.stats

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.partial_regression import GONE, Partialled
from lacet.identify.selection.score_tests import Candidate, TrialSpace

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


TIED = 0.05
"""Paired block losses that do not differ at this level (Wilcoxon's signed ranks) are a tie…"""
ALIKE = 0.5
"""… when the candidates are also at least this correlated: unlike effects that are both missing are no tie."""
SAME = 0.98
"""Candidates more correlated than this are one law on these runs (a rebound stop, a helper spring that pulls): tied."""


def with_ties(ranked: Sequence[Candidate], space: TrialSpace, standing_out: Collection[str]) -> list[Candidate]:
    """Each candidate that could be missing, with those `standing_out` that could be in its place.

    Their block losses do not differ from its own, or they are one law on these runs. A law that acts on many rows may
    take too little of each to be proposed, and still be the one that is missing.
    """
    rivals = [c for c in ranked if c.key in standing_out]
    out: list[Candidate] = []
    for c in ranked:
        ties: list[tuple[str, float]] = []
        for other in rivals if c.answer == "missing" else []:
            if other.key != c.key:
                correlation = space.correlation(c.key, other.key)
                alike = correlation >= ALIKE and same_losses(c.block_gain, other.block_gain)
                if alike or correlation >= SAME:
                    ties.append((other.key, correlation))
        out.append(replace(c, ties=tuple(ties)))
    return out


def same_losses(a: Array, b: Array) -> bool:
    """Whether two candidates' falls, block by block, do not differ."""
    difference = a - b
    active = np.abs(difference) > 1e-6 * float(np.max(np.abs(a) + np.abs(b)))
    return bool(np.count_nonzero(active) < 6 or scipy.stats.wilcoxon(difference[active]).pvalue > TIED)


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
    inside, trials = space.beside([replace(effect, shape=shape) for shape in shapes], draws=False)
    none = np.zeros((inside.sums.layout.width, 1))
    # A gap that is never passed leaves nothing to compare.
    seen = [bool(np.all(inside.remaining(trial.place) > GONE)) for trial in trials]
    falls = [inside.scores(t.place, none)[0] if there else -1.0 for t, there in zip(trials, seen, strict=True)]
    nothing = np.zeros(len(effect.parameters))
    values = [inside.values(t.place) if there else (nothing, nothing) for t, there in zip(trials, seen, strict=True)]
    return falls, [(tuple(map(float, v)), tuple(float(1.96 * x) for x in s)) for v, s in values]


def best_set(space: TrialSpace, keys: Sequence[str]) -> list[str]:
    """Up to three candidates, at their best shapes, that together take away most; at most one sensor fault."""
    tried = {key: space.tried[key].trial for key in keys}
    faults = [key for key, trial in tried.items() if trial.fault]
    return chosen_together(space.partialled, {key: trial.place for key, trial in tried.items()}, faults)
