"""The stored results are what lacet computes now: some 40 minutes of processor time, so not with ``make test``."""

from __future__ import annotations

import pytest

from tests.results.__main__ import TRIAL_SETS, computed, stored
from tests.results.compare import differences
from tests.results.parts import PARTS, TRIALS_DRAWN, trials_drawn

SAME = 1e-5
"""Relative difference that another processor's arithmetic may make."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PARTS, *TRIAL_SETS])
def test_results_are_as_stored(name: str) -> None:
    found = list(differences(stored(name), computed(name), SAME))
    assert not found, "\n".join(found[:20])


def test_a_hundred_trials_are_drawn_over_all_sections() -> None:
    drawn = trials_drawn()
    assert len(set(drawn)) == 100
    assert sum(TRIALS_DRAWN.values()) == 100
    assert sum(len(record["steps"]) >= 2 for record in stored("trials").values()) >= 30


def test_differences_are_told_by_place() -> None:
    was = {"a": [1.0, 2.0], "b": "x", "gone": 1}
    now = {"a": [1.0, 2.0 + 1e-9], "b": "y", "new": 1}
    assert list(differences(was, was)) == []
    assert len(list(differences(was, now))) == 4
    assert [line.split(":")[0] for line in differences(was, now, 1e-6)] == ["/b", "/gone", "/new"]
