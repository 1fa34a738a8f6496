"""Laws found that errors of assumed channels may stand for, of rigs that lack instruments.

A fit takes an assumption (a share of the longitudinal force, a motion ratio) as wrong by one factor within its
tolerance, in all runs. What a car does is no such factor: a share is another one in braking than in a bend, and what it
leaves looks like a law. So a law of which all sizes may be zero, by the assumptions' tolerances and all others of the
sensor sheet, must be there in rows that the assumptions hardly move.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.progress import Progress, silent
from lacet.identify.selection.joint.refits import Joint, is_significant, without_effects
from lacet.identify.selection.rest import AddedLaw, laws_on_rows
from lacet.identify.selection.settings import SELECTION


def only_beyond_assumptions(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same without the laws found that errors of assumed channels may stand for, the weakest first.

    Those alone that may be zero beside all that is found: without one of them the intervals of others are wider.
    """
    doubtful = _doubtful(joint, joint.keys)
    while doubtful:
        key = min(doubtful, key=lambda law: law.force).key
        joint = without_effects(replace(joint, assumed=joint.assumed | {key}), [key], seed, progress)
        doubtful = _doubtful(joint, [law.key for law in doubtful])
    return joint


def _doubtful(joint: Joint, keys: Collection[str]) -> list[AddedLaw]:
    """Of the laws found with these keys those of which all sizes may be zero, and that rows the assumptions hardly move
    do not show."""
    may_be_zero = [law for law in joint.laws if law.key in {*keys} & {*joint.keys} and _may_be_zero(joint, law)]
    moved = _moved_by_assumptions(joint) if may_be_zero else frozenset[Row]()
    if not moved:
        return []
    sound = [row for row in joint.space.floor.sigma if row not in moved]
    elsewhere = {law.key: law for law in (laws_on_rows(joint.space, sound) if sound else ())}
    return [
        law
        for law in may_be_zero
        if not law.rows.isdisjoint(moved) and (law.rows <= moved or not is_significant(elsewhere[law.key], joint.space))
    ]


def _may_be_zero(joint: Joint, law: AddedLaw) -> bool:
    """Whether the 95 % intervals of all its sizes hold zero, with all tolerances of the sensor sheet.

    At the shape constants found: sizes that other constants would change (a mount's damping, by its time constant) are
    not open for what is assumed.
    """
    fitted, effect = joint.space.fitted, next(one for one in joint.effects if one.key == law.key)
    at = [fitted.model.names.index(q.name) for q in effect.parameters]
    sigma = np.sqrt(np.diag(fitted.covariance + fitted.covariance_sheet))[at]
    return bool(np.all(np.abs(fitted.theta[at]) <= SELECTION.interval_quantile * sigma))


def _moved_by_assumptions(joint: Joint) -> frozenset[Row]:
    """Rows that the assumptions' tolerances may move by as much as the channels' noise does (95 %)."""
    return frozenset(joint.space.linearisation.runs.assumed(joint.space.floor.sigma))
