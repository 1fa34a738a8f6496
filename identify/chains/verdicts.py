"""Verdict on a fitted chain: whether laws are missing, and whether it fails for a cause that is in no law tried."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

from lacet.identify.chains.doubts import Doubts
from lacet.identify.chains.ranking import ChainRanking
from lacet.identify.chains.scores import JointScore


class ChainVerdict(StrEnum):
    """Verdict of a ranking of laws."""

    MISSING = "missing"
    """Laws that were tried are missing; something else may remain beside them."""
    NOTHING = "nothing missing"
    """No law is, and every joint's error is that of noise."""
    SMALL = "small rest"
    """No law is. Errors are above their noise floor by more than chance, and less than the user's effect size."""
    UNLISTED = "unlisted cause"
    """The model fails at a joint for a cause that is not among the laws tried."""
    UNSOUND = "unsound fit"
    """The fit that laws were tried on is in doubt (`Doubts`): what seems missing may only stand in for that."""
    UNTESTED = "not tested"
    """The record is too short for a law to be tested."""


def verdict_of(ranking: ChainRanking, scores: Sequence[JointScore], doubts: Doubts | None = None) -> ChainVerdict:
    """The verdict that follows from laws tried, the joints' errors on the samples fitted to, and doubts of the fit.

    Torques of opposite sign, late or clipped, exchanged columns, positions in degrees and times in milliseconds always
    make a fit unsound. Values that cannot be do, unless the model fails for a cause in no law, which may make them so;
    noise of the positions and few equations do where they might look like a law.
    """
    verdict = _without_doubts(ranking, scores)
    if doubts is None:
        return verdict
    named = verdict is ChainVerdict.MISSING
    wrong = doubts.wrong_signs and verdict is not ChainVerdict.UNLISTED
    units = doubts.in_degrees or doubts.in_milliseconds
    if doubts.turned or units or doubts.late or doubts.exchanged or doubts.clipped or wrong:
        return ChainVerdict.UNSOUND
    return ChainVerdict.UNSOUND if named and (doubts.biased or doubts.few) else verdict


def _without_doubts(ranking: ChainRanking, scores: Sequence[JointScore]) -> ChainVerdict:
    if ranking.missing:
        return ChainVerdict.MISSING
    if ranking.untested:
        return ChainVerdict.UNTESTED
    if ranking.unlisted:
        return ChainVerdict.UNLISTED
    failing = failing_joints(scores)
    if not failing:
        return ChainVerdict.NOTHING
    return ChainVerdict.SMALL if all(one.small for one in failing) else ChainVerdict.UNLISTED


def failing_joints(scores: Sequence[JointScore]) -> tuple[JointScore, ...]:
    """The joints whose errors are above their noise floor by more than chance, the worst first."""
    return tuple(sorted((one for one in scores if one.fails), key=lambda one: -one.ratio))
