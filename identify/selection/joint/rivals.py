"""Rivals of a selected effect: candidates that explain nearly as much, or more, in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.cross_products import Extent
from lacet.identify.selection.columns.layout import Trial
from lacet.identify.selection.joint.shape_constants import with_best_constants
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class Rival:
    """A candidate in the place of a selected effect, the other selected effects as they are.

    Attributes
    ----------
    effect : the rival, at the shape constants at which it explains most.
    margin : weighted squares that the selected effect explains more; below 0 the rival explains more.
    """

    effect: Effect
    margin: float


def rivals(free: ScoreTests, own: Candidate, tried: Sequence[Candidate]) -> list[Rival]:
    """Rivals of `own` that explain nearly as much, the best first.

    `free` : score tests with `own` among the candidates `tried`, beside the other selected effects.
    """
    effects = free.effects
    # A rival's constants lie between values of its grid, where it may explain more than on it.
    least = SELECTION.rival_share * own.drop
    near = [
        c for c in tried
        if c.tested and c.key != own.key and c.drop >= least
        and effects[c.key].implausible(c.values, c.interval) is None
    ]  # fmt: skip
    near = sorted(near, key=lambda c: -c.drop)[: SELECTION.most_rivals]
    if not near:
        return []
    mine = replace(effects[own.key], shape=own.shape)
    tuned = with_best_constants(free, [replace(effects[c.key], shape=c.shape) for c in near], groups=range(len(near)))
    inside, (first, *others) = free.beside([mine, *tuned], Extent.TOTAL)
    whole = _fall(inside, first)
    return sorted((Rival(t.effect, whole - _fall(inside, t)) for t in others), key=lambda rival: rival.margin)


def _fall(inside: PartialRegression, trial: Trial) -> float:
    """Fall of the weighted squares by one effect, corrected for the noise in its columns."""
    at = np.r_[trial.place]
    score = inside.reduced[at, inside.sums.layout.right]
    return float(score @ solved(inside.reduced[np.ix_(at, at)], score[:, None])[:, 0])
