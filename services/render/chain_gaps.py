"""Gaps of a robot's record in words: times without samples, and positions that leap."""

from __future__ import annotations

import math

from lacet.identify.chains.doubts import Doubts
from lacet.identify.chains.fit import ChainFit

_TURN = 2.0 * math.pi
_NEAR = 0.1
"""Part of a turn by which a leap may differ from it: the joint moves on meanwhile."""


def gaps_text(fitted: ChainFit, doubts: Doubts) -> list[str]:
    """What of the record is not fitted, and why, in a sentence each."""
    out: list[str] = []
    if doubts.gaps:
        longest = max(doubts.gaps, key=lambda gap: gap.seconds)
        count = f"the longest of {len(doubts.gaps)} gaps" if len(doubts.gaps) > 1 else "a gap"
        out.append(
            f"no samples from {longest.start:.4g} s to {longest.start + longest.seconds:.4g} s, {count}: what the "
            "filters carry over from it is not fitted"
        )
    chain = fitted.model.chain
    for k, j in enumerate(chain.coupling.free):
        unit = "m" if chain.joints[j - 1].sigma == 1 else "rad"
        for lasts in (False, True):
            if not (leaps := [leap for leap in doubts.leaps if leap.joint == k and leap.lasts is lasts]):
                continue
            often = f" ({len(leaps)} times)" if len(leaps) > 1 else ""
            what = (
                f"the position of {chain.names[j - 1]} leaps at {leaps[0].start:.4g} s{often} by up to "
                f"{max(leap.size for leap in leaps):.3g} {unit}"
            )
            if not lasts:
                out.append(f"{what} and back: those samples are not fitted")
            elif unit == "rad" and all(abs(leap.size - _TURN) < _NEAR * _TURN for leap in leaps):
                out.append(f"{what}, a whole turn: its angle is wrapped. Give it as it goes on (numpy.unwrap)")
            else:
                out.append(
                    f"{what}, and goes on from there: a count was lost, or samples are missing (give their times, t=…)"
                )
    return out
