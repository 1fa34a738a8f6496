"""Encompassing: whether laws found stand beside simple laws of no catalogue, where the cause of a rest is unlisted.

An unknown force looks like the listed law that is nearest to it. Where a rest is unlisted, every law found is therefore
compared with the laws of the grammar in its place. If one of these explains more than it would by chance where the law
found is the truth (Cox's test of separate families, of the largest margin over the grammar), it joins the model, and
the law found must stand beside it: explain more than chance, and more than laws in a model may be inexact.

Source: D. R. Cox, Further results on tests of separate families of hypotheses, Journal of the Royal Statistical Society
B 24 (1962); G. E. Mizon and J.-F. Richard, The encompassing principle and its application to testing non-nested
hypotheses, Econometrica 54 (1986).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.selection.joint.refits import Joint, less_a_part, not_part_of_the_rest, with_all_tested
from lacet.identify.selection.laws.formulas import laws_at
from lacet.identify.selection.laws.replacement import Best, Replacement
from lacet.identify.selection.laws.search import without_noise
from lacet.identify.selection.laws.settings import LAWS
from lacet.identify.selection.rest import AddedLaw, Rest, added_laws
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION

Standing = Callable[[float, Array], bool]
"""Whether a fall of the weighted squares is more than chance, by it and (D,) those in simulated runs."""


def beyond_chance_of(tried: ScoreTests) -> Standing:
    """Whether a fall is more than chance, family-wise over the candidates of these score tests."""

    def stands(fall: float, null: Array) -> bool:
        return tried.family_wise_of(fall, null) <= SELECTION.level(tried.draws)

    return stands


def only_encompassing(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same without the laws found that do not stand beside simple laws that are not listed.

    Rows of several wheels at once, of rigs without wheel loads, have no such laws: what acts in these alone stands.
    """
    before, stands = joint, beyond_chance_of(joint.space)
    doubted = {law.key for law in joint.laws if law.key in joint.keys}
    while doubted:
        space = without_noise(joint.space)
        laws = [law for law in added_laws(space) if law.key in doubted]
        places = {effect.key: effect.where for effect in joint.effects}
        failing = [law for law in laws if not encompasses(space, law, places[law.key], stands, progress)]
        if not failing:
            break
        weakest = min(failing, key=lambda law: law.force)
        joint = less_a_part(joint, weakest.key, seed, progress)
        doubted = {law.key for law in failing} - {weakest.key}
    return joint if joint is before else with_all_tested(joint, seed, progress)[0]


def standing_beside_rest(joint: Joint, rest: Rest, seed: int, progress: Progress = silent) -> tuple[Joint, Rest]:
    """The same without the effects found that may be parts of what remains, now that others do not stand beside laws
    of no catalogue, and what then remains: what these explained is in the rest again.
    """
    while True:
        others, rest = not_part_of_the_rest(joint, rest, seed, progress)
        if others is joint:
            return joint, rest
        joint = only_encompassing(others, seed, progress) if rest.unlisted else others
        rest = rest if joint is others else Rest.of(joint.space, joint.laws, rest.doubted)


def kinds_of(rows: Iterable[Row], where: str) -> list[tuple[str, str]]:
    """Kind and place of the grammar's laws in some rows, for a law that acts at `where`; combined rows have none."""
    return list(
        dict.fromkeys(
            (str(row), "") if row.kind == "chassis" else (row.kind, where) for row in sorted(rows) if not row.combined
        )
    )


def encompasses(
    space: ScoreTests, law: AddedLaw, where: str, stands: Standing, progress: Progress = silent
) -> bool:  # fmt: skip
    """Whether a law of the model stands beside the laws of the grammar that explain more in its place.

    `space` : score tests without the noise in the columns, which is not known of the grammar's; `where` the law acts.
    """
    pool = [one for kind, place in kinds_of(law.rows, where) for one in laws_at(space, kind, place)]
    beside: list[OneLine] = []
    for _ in range(LAWS.most_terms):
        better = _better(space, law, beside, pool, progress)
        if better is None:
            return True
        beside.append(better)
        both = Replacement.of(space, [law], beside)
        others = np.arange(both.k, len(both.right))
        alone, inexact = both.given(others), SELECTION.selected_inexactness**2 * both.force_at(others)
        if not stands(alone.fall, alone.null) or alone.fall <= inexact:
            return False
    return True


def _better(
    space: ScoreTests, law: AddedLaw, beside: Sequence[OneLine], pool: Sequence[OneLine], progress: Progress
) -> OneLine | None:
    """The law of the pool that explains most in the place of a law of the model, if that is not due to chance."""
    best = Best(space.draws)
    for start in range(0, len(pool), LAWS.together):
        progress(Step(Stage.ENCOMPASSING, start, len(pool), law.key))
        batch = pool[start : start + LAWS.together]
        place = Replacement.of(space, [law], [*beside, *batch])
        best = best.over(place.given(place.k + np.arange(len(beside))), batch)
    if best.winner is None or best.p > SELECTION.level(space.draws):
        return None
    return best.winner.law if best.winner.margin > SELECTION.least_refinement_fall else None
