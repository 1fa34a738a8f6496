"""Effects that may be the cause and that the runs cannot test: of a rest, or in the place of an effect found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from lacet.identify.selection.candidate import Answer, Candidate, Reason
from lacet.identify.selection.diagnose import _maybe


def candidate(key: str, tested: bool) -> Candidate:
    """A candidate that the runs can test, or cannot."""
    answer = Answer.UNDECIDED if tested else Answer.NOT_TESTABLE
    return Candidate(key, {}, answer, None if tested else Reason.SMALL)


@pytest.mark.parametrize(("alone", "said"), [(True, ()), (False, ("spring.rear",))])
def test_a_tie_that_alone_can_be_tested_is_not_called_untestable(alone: bool, said: tuple[str, ...]):
    """Beside the effect found all that it does is explained: that is why they are tied."""
    found = Candidate("stop.rear", {}, Answer.MISSING, Reason.PASSES, ties=(("spring.rear", 0.99),))
    joint: Any = SimpleNamespace(
        space=None, beside=[candidate("spring.rear", False)], alone=[candidate("spring.rear", alone)]
    )
    assert _maybe(joint, [found], (), {}) == said
