"""Laws that errors of assumed channels may stand for are no names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.progress import silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.answers import answered
from lacet.identify.selection.candidate import Answer, Reason
from lacet.identify.selection.columns import ranked_runs
from lacet.identify.selection.diagnose import _as_found, _settled
from lacet.identify.selection.joint import assumed_errors
from lacet.identify.selection.joint.assumed_errors import _may_be_zero, only_beyond_assumptions
from lacet.identify.selection.joint.refits import Joint
from lacet.services.render.candidate_reasons import reason_text

BAR = "anti_roll_bar.front"


@pytest.fixture
def moved(monkeypatch: pytest.MonkeyPatch):
    """Sets the rows that assumptions move by as much as noise."""

    def set_rows(rows: set[Row]) -> None:
        def channels(fitted: Fit, least: Mapping[Row, float]) -> dict[Row, tuple[str, ...]]:
            assert all(least[row] > 0.0 for row in rows)
            return dict.fromkeys(rows, ("wheel.fl.force",))

        monkeypatch.setattr(ranked_runs, "assumed_channels", channels)

    return set_rows


@pytest.fixture
def uncertain(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bar's size may be zero by the sensor sheet."""
    monkeypatch.setattr(assumed_errors, "_may_be_zero", lambda joint, law: law.key == BAR)


def test_a_size_may_be_zero_by_the_sheet_and_not_by_shape_constants(subset: Joint) -> None:
    """The stop's gap was searched; how well its stiffness is known at that gap is what counts."""
    fitted = subset.space.fitted
    wide = {key: np.zeros_like(fitted.covariance_sheet) for key in (BAR, "")}
    at = fitted.model.names.index(f"{BAR}.k")
    wide[BAR][at, at] = fitted.theta[at] ** 2
    for key, sheet in wide.items():
        space = SimpleNamespace(fitted=replace(fitted, covariance_sheet=fitted.covariance_sheet + sheet))
        joint = cast(Joint, SimpleNamespace(space=space, effects=subset.effects))
        assert {law.key for law in subset.laws if _may_be_zero(joint, law)} == ({key} if key else set())


def test_a_size_that_is_known_stands_whatever_assumptions_move(subset: Joint, moved) -> None:
    moved({row for law in subset.laws for row in law.rows})
    assert only_beyond_assumptions(subset, 0) is subset


@pytest.mark.usefixtures("uncertain")
def test_a_size_that_may_be_zero_stands_where_rows_show_it_that_assumptions_hardly_move(subset: Joint, moved) -> None:
    (bar,) = (law for law in subset.laws if law.key == BAR)
    assert len(bar.rows) > 1
    moved({min(bar.rows)})
    assert only_beyond_assumptions(subset, 0) is subset
    moved({row for row in subset.space.floor.sigma if row not in bar.rows})
    assert only_beyond_assumptions(subset, 0) is subset


@pytest.mark.usefixtures("uncertain")
def test_where_all_its_rows_are_moved_it_is_undecided_and_said_to_be_that(subset: Joint, moved) -> None:
    (bar,) = (law for law in subset.laws if law.key == BAR)
    moved({*bar.rows})
    without = only_beyond_assumptions(subset, 0)
    assert {*without.keys} == {*subset.keys} - {BAR}
    assert without.assumed == {BAR}
    found = [_as_found(without, effect, subset.first.draws) for effect in without.effects]
    (answer,) = (c for c in answered(without, found, [], []) if c.key == BAR)
    assert (answer.answer, answer.reason) == (Answer.UNDECIDED, Reason.ASSUMED)
    said = reason_text(answer, subset.first.effects[BAR], subset.space.draws)
    assert "within the tolerances of assumed channels its size may be zero" in said


@pytest.mark.usefixtures("uncertain")
def test_a_search_ends_without_it(subset: Joint, moved) -> None:
    (bar,) = (law for law in subset.laws if law.key == BAR)
    moved({*bar.rows})
    settled, _ = _settled(subset, 0, silent)
    assert settled.assumed == {BAR}
    assert BAR not in settled.keys
