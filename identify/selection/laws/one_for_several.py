"""One law for several: laws found that a single simple law of no catalogue does the work of, where nothing remains.

Several listed laws together may explain all that an unlisted cause does, or one of them nearly all of it. The law of
the grammar that explains most in the place of them all is then the simpler and the better answer: by more than chance
where they are the truth (Cox's test of separate families, of the largest margin over the grammar), and by more than
laws in a model may be inexact. Beside it none of them explains more than chance does.

Source: as of `encompassing`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np

from lacet.identify.effects.base import AXLES
from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.selection.joint.refits import Joint
from lacet.identify.selection.laws.encompassing import Standing, beyond_chance_of
from lacet.identify.selection.laws.formulas import laws_at
from lacet.identify.selection.laws.names import catalogue_names, key_of
from lacet.identify.selection.laws.replacement import Best, Places, Replacement
from lacet.identify.selection.laws.search import without_noise
from lacet.identify.selection.laws.settings import LAWS
from lacet.identify.selection.rest import AddedLaw, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


def explained_by_one(joint: Joint, progress: Progress = silent) -> frozenset[str]:
    """Keys of the laws found that a law of no catalogue explains more than, alone or several of a place together."""
    space, stands = without_noise(joint.space), beyond_chance_of(joint.space)
    found = [law for law in added_laws(space) if law.key in joint.keys]
    where = {effect.key: effect.where for effect in joint.effects}
    out: set[str] = set()
    for (kind, place), laws in _by_place(found, where).items():
        for keys, law in _explained(space, laws, laws_at(space, kind, place), stands, progress):
            # One that is listed was a rival of theirs in the search.
            if not keys <= out and not catalogue_names(joint.first, [law])[key_of(law)]:
                out |= keys
    return frozenset(out)


def _by_place(laws: Sequence[AddedLaw], where: dict[str, str]) -> dict[tuple[str, str], list[AddedLaw]]:
    """Kind of row and place → the laws that act there: a wheel if all act at it alone, else the axle."""
    axles = {corner: axle for axle, corners in AXLES.items() for corner in corners}
    out: dict[tuple[str, str], list[AddedLaw]] = {}
    for law in laws:
        place = axles.get(where[law.key], where[law.key])
        for kind in dict.fromkeys((str(row), "") if row.kind == "chassis" else (row.kind, place) for row in law.rows):
            out.setdefault(kind, []).append(law)
    alone = {key: {where[law.key] for law in acting} for key, acting in out.items()}
    return {
        (kind, alone[kind, place].pop() if place and len(alone[kind, place]) == 1 else place): acting
        for (kind, place), acting in out.items()
    }


def _explained(
    space: ScoreTests, laws: Sequence[AddedLaw], pool: Sequence[OneLine], stands: Standing, progress: Progress
) -> Iterator[tuple[frozenset[str], OneLine]]:
    """Sets of the laws of a place that a law of the pool is a better answer than, and that law."""
    columns = _columns([len(law.places) for law in laws])
    best = dict.fromkeys(_sets(len(laws)), Best(space.draws))
    for start in range(0, len(pool), LAWS.together):
        progress(Step(Stage.ENCOMPASSING, start, len(pool), ", ".join(law.key for law in laws)))
        batch = pool[start : start + LAWS.together]
        place = Replacement.of(space, laws, batch)
        for some, before in best.items():
            beside = [columns[i] for i in range(len(laws)) if i not in some]
            best[some] = before.over(place.given(np.concatenate(beside)) if beside else place, batch)
    for some, one in best.items():
        if one.law is not None and _is_better(one, [len(laws[i].places) for i in some], space, stands):
            yield frozenset(laws[i].key for i in some), one.law


def _sets(count: int) -> list[tuple[int, ...]]:
    """Sets of so many laws: up to `most_replaced` of them, and all."""
    sizes = {*range(1, min(count, LAWS.most_replaced) + 1), count}
    return [some for size in sorted(sizes) for some in combinations(range(count), size)]


def _columns(sizes: Sequence[int]) -> list[Places]:
    """Places of the columns of each of some laws, of so many columns."""
    return [np.arange(a, b) for a, b in pairwise(np.cumsum([0, *sizes]).tolist())]


def _is_better(one: Best, sizes: Sequence[int], space: ScoreTests, stands: Standing) -> bool:
    """Whether a law is a better answer than the laws it is in the place of, of so many columns each."""
    place = one.place
    assert place is not None
    inexact = SELECTION.selected_inexactness**2 * place.fall
    if one.margin <= max(SELECTION.least_refinement_fall, inexact) or one.p > SELECTION.level(space.draws):
        return False
    beside = [place.only(np.r_[at, place.k]) for at in (*_columns(sizes), np.arange(place.k))]
    return not any(stands(own.fall, own.null) for own in (both.given(np.array([both.k])) for both in beside))
