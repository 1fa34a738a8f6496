"""Why a candidate cannot be tested, in a few words."""

from __future__ import annotations

import pytest

from lacet.identify.selection.candidate import Answer, Candidate, Reason
from lacet.services.render.candidate_reasons import short_reason


@pytest.mark.parametrize(("by", "said"), [
    ((("M6", 0.9), ("MX6", 0.1)), "hidden by M6"),
    ((("sensor_crosstalk.fl.xz", 0.9), ("M6", 0.1)), "hidden by its own tolerance"),
    ((), "too small to stand out"),
])  # fmt: skip
def test_an_effect_that_is_too_small_is_told_with_what_hides_it(by: tuple[tuple[str, float], ...], said: str) -> None:
    c = Candidate("sensor_crosstalk.fl.xz", {}, Answer.NOT_TESTABLE, Reason.SMALL, absorbed=by)
    assert short_reason(c) == said
