"""Words of the live page: a channel's state, and what to do where no recording is heard."""

from __future__ import annotations

from pathlib import Path

import pytest

from lacet.daq.bus.session import ROUTER
from lacet.services.acquisition.live_samples import channel_faults, sensor_states
from lacet.services.render.live_fit import screen
from lacet.services.render.live_page import channel_state, channels_text, first_steps
from lacet.services.workspace.live_follow import nothing_known


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


@pytest.mark.parametrize(
    ("fault", "recording", "kind", "text"),
    [
        ("silent", True, "bad", "silent"),  # the recorder says it 0.5 s before the page would
        ("silent", False, "bad", "silent at the end"),
        ("stuck", True, "warn", "stuck"),
        ("clock", False, "warn", "clock at the end"),
    ],
)
def test_a_fault_of_the_sensor_is_the_state_of_its_channel(fault: str, recording: bool, kind: str, text: str):
    assert channel_state(0.1, 500.0, 500.0, 0, 0, recording, fault) == {"kind": kind, "text": text}
    assert channel_state(None, None, 500.0, 0, 0, recording, fault)["text"] == text  # nothing came since it was opened
    assert channel_state(None, None, 500.0, 0, 0, recording)["text"] == "never heard"


def test_channels_and_sensors_agree_at_the_end_of_a_run():
    """One ledger gives the sensors, the channels and the terminal; a channel beside the faulty ones was good."""
    sensors = {
        "imu": {"state": "silent", "detail": "nothing for 1.2 s", "channels": ["imu.accel", "imu.rate"]},
        "lasers": {"state": "running", "detail": "", "channels": []},
        "cameras": {"state": "waiting", "detail": "", "channels": ["camera.fl"]},
        "broken": 7,
    }
    ledger = {"sensors": sensors}
    faults = channel_faults(ledger)
    assert faults == {"imu.accel": "silent", "imu.rate": "silent"}
    assert channel_faults({}) == channel_faults({"sensors": {"imu": {"state": "silent", "channels": 3}}}) == {}
    names = ("imu.accel", "imu.rate", "laser.fl.ground")
    states = [channel_state(3.0, 200.0, 200.0, 0, 0, False, faults.get(name, "")) for name in names]
    assert channels_text(states, False) == "3 channels, 2 silent at the end"
    assert channels_text(states[2:], False) == "1 channels, all were as they should be"
    assert channels_text(states[2:], True) == "1 channels, all as they should be"
    known = nothing_known(0.02, "") | {"line": "nothing more", "sensors": sensor_states(ledger)}
    assert "\n  at the end of the run: imu SILENT; lasers;" in screen(known)
    assert "\n  imu SILENT; lasers;" in screen(known | {"recording": True})


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
