"""Laws that errors of assumed channels may stand for are no names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.answers import answered
from lacet.identify.selection.candidate import Answer, Reason
from lacet.identify.selection.columns import ranked_runs
from lacet.identify.selection.diagnose import _as_found
from lacet.identify.selection.joint.assumed_errors import only_beyond_assumptions
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
    known = Fit.covariances_searched.fget
    assert known is not None

    def with_sheet(fitted: Fit) -> tuple[np.ndarray, ...]:
        noise, sheet = known(fitted)
        wide = np.zeros_like(sheet)
        if (name := f"{BAR}.k") in fitted.model.names:
            at = fitted.model.names.index(name)
            wide[at, at] = fitted.theta[at] ** 2
        return noise, sheet + wide

    monkeypatch.setattr(Fit, "covariances_searched", property(with_sheet))


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
