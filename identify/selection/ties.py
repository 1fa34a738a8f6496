"""Candidates that these runs cannot tell apart."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
import scipy.stats

from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.trials import TrialSpace

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
