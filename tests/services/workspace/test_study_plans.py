"""Plans of a ranking: a model that fails is expected to go through several rounds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from lacet.identify.progress import Stage
from lacet.services.workspace.kept.study_plans import StudyPlan
from lacet.services.workspace.study import Version


def planned(ratio: float) -> list[Any]:
    """Stretches of a ranking of a version whose worst row is so far above its floor; everything else is kept."""
    study = SimpleNamespace(used=["a", "b"], held=[], draws=199)
    values: Any = SimpleNamespace(
        runs=SimpleNamespace(study=study, present=(True, True)), has=lambda kind, *_: kind != "ranking"
    )
    version = Version(1, {}, "", {"rows": {"used": {"a": {"chassis.fz": {"ratio": ratio}}}}})
    return StudyPlan(values).want([("ranking", version)]).stretches


def test_a_model_that_fails_is_planned_with_the_rounds_of_a_search() -> None:
    """Fits with what was found, and floors beside it, twice; of one that holds, once, and that seldom."""
    fails, holds = planned(8.0), planned(1.0)
    count = {name: [one.stage for one in part].count(Stage.FIT_WITH_EFFECTS) for name, part in
             (("fails", fails), ("holds", holds))}  # fmt: skip
    assert count == {"fails": 2, "holds": 1}
    expected = [sum(one.likely * one.usual for one in part) for part in (fails, holds)]
    assert expected[0] > 3.0 * expected[1]
