"""Forward selection of the effects that together explain most, and ties of candidates."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.score_tests import Answer, Candidate, ScoreTests
from lacet.identify.selection.settings import SELECTION


def select_forward(known: PartialRegression, places: Mapping[str, slice], faults: Collection[str]) -> list[str]:
    """Names of up to three effects, with columns at `places`, that together lower the squares most.

    At most one of the sensor `faults` is chosen: several free gains could together scale the measurement to zero.
    """
    remainder, right = known.reduced_noisy, known.sums.layout.right
    remainder[:, right] = known.reduced[:, right]
    least = SELECTION.set_energy * np.diag(known.sums.total)
    open_, chosen = list(places), list[str]()
    for _ in range(SELECTION.most_together):
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


def with_ties(ranked: Sequence[Candidate], space: ScoreTests, standing_out: Collection[str]) -> list[Candidate]:
    """The candidates with ties: each missing one with those `standing_out` that could be missing in its place.

    Two candidates are tied when their losses do not differ block by block, or when their columns are nearly the same on
    these runs. A law that acts on many rows may explain too little of each to be proposed, and still be missing.
    """
    rivals = [c for c in ranked if c.key in standing_out]
    out: list[Candidate] = []
    for c in ranked:
        ties: list[tuple[str, float]] = []
        for other in rivals if c.answer is Answer.MISSING else []:
            if other.key != c.key:
                correlation = space.correlation(c.key, other.key)
                alike = correlation >= SELECTION.tied_correlation and same_losses(c.block_gain, other.block_gain)
                if alike or correlation >= SELECTION.same_correlation:
                    ties.append((other.key, correlation))
        out.append(replace(c, ties=tuple(ties)))
    return out


def same_losses(a: Array, b: Array) -> bool:
    """Whether the falls of two candidates do not differ significantly, block by block (Wilcoxon test)."""
    difference = a - b
    active = np.abs(difference) > SELECTION.same_loss * float(np.max(np.abs(a) + np.abs(b)))
    if np.count_nonzero(active) < SELECTION.least_tied_blocks:
        return True
    return bool(scipy.stats.wilcoxon(difference[active]).pvalue > SELECTION.tied_significance)


def best_set(space: ScoreTests, keys: Sequence[str]) -> list[str]:
    """Keys of up to three candidates, at their best shapes, that together explain most; at most one sensor fault."""
    tried = {key: space.best_tests[key].trial for key in keys}
    faults = [key for key, trial in tried.items() if trial.fault]
    return select_forward(space.regression, {key: trial.place for key, trial in tried.items()}, faults)
