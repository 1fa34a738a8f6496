"""Laws of an axle that lacks a bench table, where its wheels are found to move or turn with the travel.

A model without the table counts wheels as moving straight up. Once that is refuted, any law of the axle may stand for
a part of the table: it stands beside all terms of an unknown table, or it does not, and its size is the one beside
them. The terms have their plausible range as prior. While something unlisted remains at the axle, which may be what
the terms lack of its table, the size is open even so.

Source: omitted-variable bias, J. M. Wooldridge, Introductory Econometrics (2013), section 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import AXLES, Effect
from lacet.identify.effects.unknown_table import SLOPES, table_terms
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, silent
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.joint.wrong_tables import axles_without_tables
from lacet.identify.selection.rest import AddedLaw, Rest, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class LackingTables:
    """Axles without bench tables whose wheels, by the effects found, move or turn with the travel.

    Attributes
    ----------
    axles : all of them.
    unsure : those where only effects say so that are no names beside an unlisted cause: these may be a part of it.
    unlisted : those beside which something unlisted remains: the size of a law there is open.
    """

    axles: tuple[str, ...] = ()
    unsure: tuple[str, ...] = ()
    unlisted: tuple[str, ...] = ()

    @classmethod
    def of(cls, named: Sequence[Effect], left_out: Sequence[Effect], rest: Rest, vehicle: Vehicle) -> Self:
        """Of the effects found that are `named`, of those `left_out` of these, as they may be a part of an unlisted
        cause, and of the rest that the model with them leaves."""
        axles = axles_without_tables([*named, *left_out], vehicle)
        sure = axles_without_tables(named, vehicle)
        unlisted = [axle for axle in axles if _unlisted_at(axle, rest, left_out)]
        return cls(axles, tuple(axle for axle in axles if axle not in sure), tuple(unlisted))


def _unlisted_at(axle: str, rest: Rest, left_out: Iterable[Effect]) -> bool:
    """Whether something unlisted remains in a row that a table of the axle changes, or an effect of its suspensions
    was left out as a part of that."""
    slopes, sound = [cls(axle) for cls in SLOPES], rest.without_unlisted()
    failing = [row for row in rest.lack.ratios if row not in sound]
    return any(slope.acts_on(row) for slope in slopes for row in failing) or any(
        acts_at(effect, axle) for effect in left_out
    )


def acts_at(effect: Effect, axle: str) -> bool:
    """Whether an effect acts in the suspension rows of an axle."""
    return any(effect.acts_on(Row(f"suspension.{c}")) for c in AXLES[axle])


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


def with_open_sizes(found: Iterable[Candidate], effects: Iterable[Effect], axles: Sequence[str]) -> list[Candidate]:
    """The effects found, without the sizes of laws that act on the suspensions of `axles`; nor of a sum with one.

    `effects` : the effects in the fit. An unlisted cause at an axle without a table moves these sizes by more than any
    interval of the fit says.
    """
    laws = {effect.key: effect for effect in effects if effect.as_physics is not None}

    def without_size(c: Candidate) -> Candidate:
        keys = c.total.keys if c.total is not None else (c.key,)
        at = tuple(axle for axle in axles if any(key in laws and acts_at(laws[key], axle) for key in keys))
        if not at:
            return c
        total = None if c.total is None else replace(c.total, value=math.nan, half=math.nan, widest=math.nan)
        return replace(c, values=(), interval=(), total=total, open_at=at)

    return [without_size(c) for c in found]
