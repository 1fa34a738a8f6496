"""Laws of an axle that lacks a bench table, where its wheels are found to move or turn with the travel.

A model without the table counts wheels as moving straight up. Once that is refuted, any law of the axle may stand for
a part of the table: it stands beside all terms of an unknown table, or it does not, and its size is the one beside
them. The terms have their plausible range as prior.

Source: omitted-variable bias, J. M. Wooldridge, Introductory Econometrics (2013), section 3.3.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from lacet.identify.effects.base import AXLES
from lacet.identify.effects.unknown_table import SLOPES, table_terms
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, silent
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.rest import AddedLaw, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class BesideTable:
    """A law beside the terms of the tables that its axles lack.

    `values` (k,) : its parameters then; `added` (k,) : variance that the terms add to each; `stands` : whether one that
    was not 0 is not 0 still, in the same direction.
    """

    values: Array = field(repr=False)
    added: Array = field(repr=False)
    stands: bool


def beside_tables(
    space: ScoreTests, axles: Sequence[str], seed: int, progress: Progress = silent
) -> dict[str, BesideTable]:
    """The laws of the fit of `space` that act on the suspensions of these axles, but for slopes of their tables."""
    physics = space.fitted.model.physics
    slopes = {effect.key for effect in physics if isinstance(effect, SLOPES)}
    rows = {f"suspension.{c}" for axle in axles for c in AXLES[axle]}
    laws = [law for law in added_laws(space) if law.key not in slopes and rows & {str(row) for row in law.rows}]
    if not laws:
        return {}
    known = {effect.key for effect in physics}
    terms = [term for axle in axles for term in table_terms(axle) if term.key not in known]
    tests = ScoreTests.of(space.linearisation, terms, seed, progress=progress)
    return {law.key: _of(tests, law) for law in laws}


def _of(tests: ScoreTests, law: AddedLaw) -> BesideTable:
    known, model = tests.regression, tests.layout.model
    trials = [one for one in tests.layout.trials if np.all(known.remaining_energy(one.place) > SELECTION.gone_share)]
    at = np.concatenate([np.r_[one.place] for one in trials])
    prior = np.concatenate([[q.prior for q in one.effect.parameters] for one in trials])
    normal = known.reduced_noisy[np.ix_(at, at)] + np.diag(prior**-2.0)
    rows = known.sums.turn[list(law.places)]
    inverse = rows @ known.inverse[:model]
    own = np.diag(inverse[:, :model] @ rows.T)
    across: Array = -(rows @ known.gain[:model, at])
    right: Array = np.column_stack([known.reduced[at, known.sums.layout.right], across.T])
    change: Array = across @ scipy.linalg.solve(normal, right, assume_a="pos")
    values, spread = law.values + change[:, 0], np.diag(change[:, 1:])
    was, half = _halves(own), _halves(own + spread)
    shown = np.abs(law.values) > was
    stands = shown & (values * np.sign(law.values) > half)
    return BesideTable(values, spread, bool(np.any(stands)) or not np.any(shown))


def _halves(variance: Array) -> Array:
    return SELECTION.interval_quantile * np.sqrt(np.maximum(0.0, variance))


def with_sizes_beside(
    found: Collection[Candidate], beside: dict[str, BesideTable]
) -> tuple[list[Candidate], list[Candidate]]:
    """The effects found that stand, with their sizes beside the terms, and those that do not."""
    out: list[Candidate] = []
    for c in found:
        one = beside.get(c.key)
        if one is None or c.total is not None:  # of a sum the size is that of all its places
            out.append(c)
            continue
        half = np.hypot(c.interval, _halves(one.added))
        out.append(replace(c, values=tuple(one.values.tolist()), interval=tuple(half.tolist())))
    hidden = [c for c in out if c.key in beside and not beside[c.key].stands]
    return [c for c in out if c not in hidden], hidden
