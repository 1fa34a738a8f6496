"""Answers of a ranking to all candidates, given the effects that are found to be missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lacet.identify.selection.candidate import Answer, Candidate, Reason, judged
from lacet.identify.selection.joint.refits import Joint
from lacet.identify.selection.joint.subset_search import strength
from lacet.identify.selection.settings import SELECTION


def answered(
    joint: Joint, found: Sequence[Candidate], tied: Sequence[Candidate] = (), of_tables: Sequence[Candidate] = ()
) -> tuple[Candidate, ...]:
    """All candidates with their answers: those found first, then by what each takes away alone, untestable ones last.

    A candidate that stands out alone and not beside the effects found stands in for the one it is most like. `tied` :
    those of the set found that are not named, as others do as well beside an unlisted cause; `of_tables` those that do
    not stand beside a bench table that is lacking.
    """
    keys, first = {c.key for c in (*found, *tied, *of_tables)}, joint.first
    beside = {c.key: c for c in joint.beside}
    tested = sorted(
        (c for c in joint.alone if c.tested and c.key not in keys),
        key=lambda c: (c.p > SELECTION.level(first.draws), -strength(c)),
    )
    others = [_answered(c, joint, found, beside.get(c.key)) for c in tested]
    undecided = [replace(c, answer=Answer.UNDECIDED, reason=Reason.TIED) for c in tied]
    undecided += [replace(c, answer=Answer.UNDECIDED, reason=Reason.NO_TABLE) for c in of_tables]
    return (*found, *undecided, *others, *(c for c in joint.alone if not c.tested and c.key not in keys))


def _answered(c: Candidate, joint: Joint, found: Sequence[Candidate], beside: Candidate | None) -> Candidate:
    first = joint.first
    alone = judged(c, first.effects[c.key], first.draws)
    tied = next((one.key for one in found if c.key in dict(one.ties)), "")
    if tied:
        return replace(alone, answer=Answer.UNDECIDED, stands_for=tied)
    part = next((one.key for one in found if c.key in [table.key for table in one.confounded]), "")
    if part:
        return replace(alone, answer=Answer.UNDECIDED, reason=Reason.CONFOUNDED, stands_for=part)
    if c.key in joint.parts:
        return replace(alone, answer=Answer.UNDECIDED, reason=Reason.PART_OF_REST)
    if c.key in joint.assumed:
        return replace(alone, answer=Answer.UNDECIDED, reason=Reason.ASSUMED)
    if not found or not joint.effects or alone.reason is Reason.CHANCE:
        return replace(alone, answer=Answer.UNDECIDED) if alone.answer is Answer.MISSING else alone
    beside_them = (
        c if beside is None else judged(beside, first.effects[c.key], first.draws) if beside.tested else beside
    )
    if beside_them.answer is Answer.MISSING:  # as little as the laws found may be inexact
        return replace(alone, answer=Answer.SMALL, reason=Reason.INEXACT)
    if beside_them.reason is Reason.LITTLE and beside_them.p <= SELECTION.level(first.draws):
        return replace(alone, answer=Answer.SMALL, reason=Reason.LITTLE)
    like = max(found, key=lambda one: first.correlation(c.key, one.key)) if c.key in first.best_tests else found[0]
    return replace(alone, answer=Answer.STANDS_IN, reason=Reason.STANDS_IN, stands_for=like.key)
