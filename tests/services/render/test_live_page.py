"""Words of the live page: a channel's state, and what to do where no recording is heard."""

from __future__ import annotations

from pathlib import Path

import pytest

from lacet.daq.bus.session import ROUTER
from lacet.services.render.live_page import channel_state, first_steps


@pytest.mark.parametrize(
    ("of", "kind", "text"),
    [
        ((None, None, 500.0, 0, 0, True), "bad", "never heard"),
        ((1.1, 500.0, 500.0, 0, 0, True), "bad", "silent"),
        ((1.1, 1.0, 1.0, 0, 0, True), "good", "good"),  # five samples may be missed
        ((5.1, 1.0, 1.0, 0, 0, True), "bad", "silent"),
        ((0.1, 399.0, 500.0, 0, 0, True), "warn", "slow"),  # as the recorder says it, from 20 % on
        ((0.1, 401.0, 500.0, 0, 0, True), "good", "good"),
        ((0.1, 601.0, 500.0, 0, 0, True), "warn", "babbling"),
        ((0.1, None, 500.0, 0, 0, True), "good", "good"),
        ((0.1, 500.0, None, 3, 2, True), "warn", "flagged"),
        ((0.1, 500.0, 500.0, 0, 2, True), "warn", "losses"),
        ((99.0, 500.0, 500.0, 0, 0, False), "good", "was good"),
    ],
)
def test_the_state_of_a_channel(of: tuple[float, float, float, int, int, bool], kind: str, text: str):
    assert channel_state(*of) == {"kind": kind, "text": text}


def test_what_to_do_where_no_recording_is_heard():
    """The commands of a browser's test are followed there (tests/services/workbench/browser/test_live.py)."""
    capture = Path("sinus.mcap")
    here = [one for step in first_steps(ROUTER, capture, "nothing answers") for one in step["commands"]]
    assert [line.split()[1] for line in here] == ["record", "record", "ui", "replay", "record"]
    assert not any("nothing answers" in step["says"] for step in first_steps(ROUTER, capture, "nothing answers"))
    assert not any("127.0.0.1" in line for line in here)
    assert len(first_steps(ROUTER, None)) == 2
    there = first_steps("tls/10.0.0.7:7447", capture, "nothing answers")
    assert there[0]["says"] == "nothing answers"
    assert [len(step["commands"]) for step in there] == [0, 2]
