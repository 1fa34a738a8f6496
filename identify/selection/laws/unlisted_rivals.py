"""Unlisted rivals: laws of no catalogue that are a better answer than a law found, where nothing remains.

A listed law, or several together, may do nearly all of the work of an unlisted cause. In the place of each law found,
with all others in the model, the law of the grammar that explains most is therefore its rival, too. It is the better
answer where it explains more than the law found, by more than chance if the laws found are the truth (Cox's test of
separate families, of the largest margin over the grammar and over the laws found: with six, one in seventeen would
else lose its name by chance at 1 %) and by more than laws in a model may be inexact, and the law found
explains no more than chance beside it. Laws found together need no test of their own: what explains more than a set of
laws explains more than each, too, beside the others.

All that is without the noise in the columns, which is not known of a grammar's laws, and a law with much of it explains
too little. So noise is drawn in the columns of the two, and with it taken off the rival must explain more, too.

Source: as of `encompassing`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np

from lacet.identify.effects.base import AXLES
from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.refits import Joint, less
from lacet.identify.selection.joint.shape_constants import fall_of
from lacet.identify.selection.laws.encompassing import Standing, beyond_chance_of, kinds_of
from lacet.identify.selection.laws.formulas import laws_at
from lacet.identify.selection.laws.names import catalogue_names, key_of, with_closer_constants
from lacet.identify.selection.laws.replacement import Best, Places, Replacement, Winner, family_wise
from lacet.identify.selection.laws.search import without_noise
from lacet.identify.selection.laws.settings import LAWS
from lacet.identify.selection.rest import AddedLaw, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


def with_unlisted_rivals(joint: Joint, seed: int = 0, progress: Progress = silent) -> frozenset[str]:
    """Keys of the laws found in whose place a law of no catalogue is a better answer."""
    space, stands = without_noise(joint.space), beyond_chance_of(joint.space)
    found = [law for law in added_laws(space) if law.key in joint.keys]
    where = {effect.key: effect.where for effect in joint.effects}
    best = [
        pair
        for (kind, place), laws in _by_place(found, where).items()
        for pair in _best_in_place(space, laws, laws_at(space, kind, place), progress)
    ]
    chances = family_wise([one for _, one in best])
    rivals = [
        (key, one.winner.law)
        for (key, one), p in zip(best, chances, strict=True)
        if one.winner is not None and p <= SELECTION.level(space.draws) and _is_better(one.winner, stands)
    ]
    names = catalogue_names(joint.first, [rival for _, rival in rivals]) if rivals else {}
    # One that is listed was a rival in the search.
    unlisted = [(key, rival) for key, rival in rivals if not names[key_of(rival)]]
    return frozenset(key for key, rival in unlisted if _is_better_without_noise(joint, key, rival, seed, progress))


def _is_better_without_noise(joint: Joint, key: str, rival: OneLine, seed: int, progress: Progress) -> bool:
    """Whether a law in the place of one found is a better answer with the noise in the columns of both taken off."""
    (found,) = (effect for effect in joint.effects if effect.key == key)
    known = joint.space.linearisation
    plain = replace(Linearisation.of(less(joint, {key}).fit, known.floor), latencies=known.latencies)
    space = ScoreTests.of(plain, [found, rival], seed, progress=progress)
    own = fall_of(space, [found])
    return _is_clearly_more(fall_of(space, [rival]) - own, own)


def _by_place(laws: Sequence[AddedLaw], where: Mapping[str, str]) -> dict[tuple[str, str], list[AddedLaw]]:
    """Kind of row and place → the laws that act there: a wheel if all act at it alone, else the axle."""
    axles = {corner: axle for axle, corners in AXLES.items() for corner in corners}
    out: dict[tuple[str, str], list[AddedLaw]] = {}
    for law in laws:
        place = axles.get(where[law.key], where[law.key])
        for kind in kinds_of(law.rows, place):
            out.setdefault(kind, []).append(law)
    return {
        (kind, where[laws[0].key] if place and len({where[law.key] for law in laws}) == 1 else place): laws
        for (kind, place), laws in out.items()
    }


def _best_in_place(
    space: ScoreTests, laws: Sequence[AddedLaw], pool: Sequence[OneLine], progress: Progress
) -> Iterator[tuple[str, Best]]:
    """Keys of the laws of a place, and the best of the pool in the place of each."""
    best = _over({law.key: Best(space.draws) for law in laws}, space, laws, pool, progress)
    # Between the values of its grid a rival may explain more.
    winners = [one.winner for one in best.values() if one.winner is not None]
    near = [one.law for one in winners if one.margin >= (SELECTION.rival_share - 1.0) * one.place.fall]
    closer = [shaped for law in {key_of(law): law for law in near}.values() for shaped in with_closer_constants(law)]
    yield from _over(best, space, laws, closer, progress).items()


def _over(
    best: Mapping[str, Best], space: ScoreTests, laws: Sequence[AddedLaw], pool: Sequence[OneLine], progress: Progress
) -> dict[str, Best]:  # fmt: skip
    """The best in the place of each of `laws`, by key, over a pool and those before."""
    ends = list(accumulate((len(law.places) for law in laws), initial=0))
    columns: list[Places] = [np.arange(a, b) for a, b in pairwise(ends)]
    out = dict(best)
    for start in range(0, len(pool), LAWS.together):
        progress(Step(Stage.ENCOMPASSING, start, len(pool), ", ".join(law.key for law in laws)))
        batch = pool[start : start + LAWS.together]
        place = Replacement.of(space, laws, batch)
        for law, own in zip(laws, columns, strict=True):
            out[law.key] = out[law.key].over(place.given(np.setdiff1d(np.arange(place.k), own)), batch)
    return out


def _is_better(one: Winner, stands: Standing) -> bool:
    """Whether a law whose margin is no chance is a better answer than the law that it is in the place of."""
    if not _is_clearly_more(one.margin, one.place.fall):
        return False
    beside = one.place.given(np.array([one.place.k]))
    return not stands(beside.fall, beside.null)


def _is_clearly_more(margin: float, fall: float) -> bool:
    """Whether a margin over a law's own fall is more than noise makes, and than a law in a model may be inexact."""
    return margin > max(SELECTION.least_refinement_fall, SELECTION.selected_inexactness**2 * fall)
