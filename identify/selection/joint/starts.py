"""Effects that a further search may begin with, where what the first one found leaves the sensor sheet wrong."""

from __future__ import annotations

from lacet.identify.effects.base import Effect
from lacet.identify.properties.sums_of_places import same_law_elsewhere
from lacet.identify.selection.candidate import Reason
from lacet.identify.selection.joint.refits import Joint
from lacet.identify.selection.settings import SELECTION


def starts(joint: Joint) -> list[Effect]:
    """Effects of the car that are significant alone, without those tried, by what they explain; one of a law's places.

    An effect counts whose column is mostly noise beside the tolerances: without what these do, it need not be.
    """
    first, tried = joint.first, joint.dropped | {*joint.keys}
    laws = {
        c.key: c.drop for c in joint.alone
        if (c.tested or c.reason is Reason.NOISE) and c.key not in tried and first.effects[c.key].as_physics is not None
    }  # fmt: skip
    out: list[Effect] = []
    for key in sorted(laws, key=lambda key: -laws[key]):
        test = first.best_tests[key]
        if any(same_law_elsewhere(test.trial.effect, other) for other in out):
            continue
        if first.family_wise_of(test.drop, test.null) <= SELECTION.level(first.draws):
            out.append(test.trial.effect)
    return out[: SELECTION.most_starts - 1]
