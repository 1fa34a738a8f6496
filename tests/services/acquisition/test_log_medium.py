"""A disk that stalls, fills up or fails, and a log that goes: told in time, and nothing is lost that need not be."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.formats.events import EventKind
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.rig import Rig
from lacet.services.acquisition.log_medium import RESERVE_BYTES, ROOM_BYTES, LogMedium, remaining_text
from lacet.services.acquisition.recorder import Health, Recorder, Summary
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.render.live_line import live_text
from tests.support.correvit_wire import CORREVIT, CorrevitWire

T0 = 1_700_000_000_000_000_000
RIG = (
    """
format = "lacet-rig 1"
name = "bench"
wheel_reference = "hub"
[bus.can0]
kind = "can"
"""
    + CORREVIT
)


class Recording:
    """A recording of some seconds, what it told, and its wire."""

    def __init__(self, path: Path, seconds: float, act: Callable[[int], None] = lambda reads: None, **how: object):
        self.told: list[str] = []
        self.seen: list[Health] = []
        self.wire, rig = CorrevitWire(act=act), Rig.parse(RIG)
        log = LogWriter(path, StartRecord("r", T0, "", rig.text))
        recorder = Recorder([self.wire], Decoder(rig), log, notify=self.told.append, report=self.seen.append, **how)
        self.summary: Summary = recorder.run(threading.Event(), duration=seconds)


def test_a_disk_that_stalls_for_two_seconds_loses_nothing_and_is_told(tmp_path: Path):
    calls: list[float] = []

    def sync(fd: int) -> None:
        calls.append(time.monotonic())
        if len(calls) == 3:
            time.sleep(2.0)
        os.fdatasync(fd)

    found = Recording(tmp_path / "run.mcap", 3.0, medium=lambda path: LogMedium(path, sync))
    assert any("stalls; what comes in waits in memory" in line for line in found.told)
    assert any("took 2." in line for line in found.told)
    reader = LogReader(tmp_path / "run.mcap")
    assert reader.damage == []
    assert len(reader.frames("can0")) == found.wire.sent
    assert found.summary.losses == {}
    assert [one.state for one in reader.events() if one.kind == EventKind.LOG] == ["stalled", "running", "stop"]


def test_a_write_that_stalls_for_two_seconds_loses_nothing_and_is_told(tmp_path: Path, monkeypatch):
    write, stalled = os.write, [False]

    def slow(fd: int, data: bytes) -> int:
        if len(data) > 200 and not stalled[0] and found_reads[0] > 20:
            stalled[0] = True
            time.sleep(2.0)
        return write(fd, data)

    found_reads = [0]
    monkeypatch.setattr("lacet.daq.formats.mcap_write.os.write", slow)
    found = Recording(tmp_path / "run.mcap", 3.5, lambda reads: found_reads.__setitem__(0, reads))
    assert stalled == [True]
    assert any(line.startswith("the recording was held up for 2.") for line in found.told)
    assert len(LogReader(tmp_path / "run.mcap").frames("can0")) == found.wire.sent
    assert found.summary.losses == {}


@pytest.mark.parametrize("how", ["removed", "replaced"])
def test_a_log_that_goes_is_told_within_a_second(tmp_path: Path, how: str):
    path, gone = tmp_path / "run.mcap", list[float]()

    def act(reads: int) -> None:
        if reads == 20:
            if how == "removed":
                path.unlink()
            else:
                other = tmp_path / "other"
                other.write_bytes(b"something else")
                other.replace(path)
            gone.append(time.monotonic())

    told: list[float] = []

    class Medium(LogMedium):
        def check(self) -> None:
            super().check()
            if self.failed and not told:
                told.append(time.monotonic())

    found = Recording(path, 1.5, act, medium=Medium)
    assert told[0] - gone[0] < 1.0
    assert any("WAS REMOVED OR REPLACED" in line for line in found.told)
    assert found.summary.log_error is not None
    assert "removed or replaced" in found.summary.log_error


def test_a_disk_that_reports_an_error_is_told(tmp_path: Path):
    def sync(fd: int) -> None:
        raise OSError(5, "Input/output error")

    found = Recording(tmp_path / "run.mcap", 0.8, medium=lambda path: LogMedium(path, sync))
    assert sum("reports an error: Input/output error" in line for line in found.told) == 1
    assert found.summary.log_error is not None


def test_little_room_closes_the_log_and_room_again_opens_the_next_of_the_same_run(tmp_path: Path):
    free = [RESERVE_BYTES + 1]

    class Medium(LogMedium):
        def free(self) -> int:
            return free[0]

    def act(reads: int) -> None:
        if reads == 25:
            free[0] = RESERVE_BYTES - 1
        elif reads == 50:  # not enough to begin again
            free[0] = RESERVE_BYTES + ROOM_BYTES // 2
        elif reads == 60:
            free[0] = RESERVE_BYTES + ROOM_BYTES + 1

    found = Recording(tmp_path / "run.mcap", 2.5, act, medium=Medium)
    whole = LogReader(tmp_path / "run.mcap")
    assert [file.name for file in found.summary.files] == ["run.mcap", "run-2.mcap"]
    assert list(whole.files.values()) == found.summary.files
    # What the disk could not take is missing in the numbers, and nothing else.
    assert [line.split(":")[0] for line in whole.damage] == ["/raw/can0, /decoded/correvit/speed"]
    assert "less than 200 MB were free on the disk" in [event.text for event in whole.events()]
    assert whole.start == StartRecord("r", T0, "", whole.start.rig_text)
    assert any("IS CLOSED; publishing goes on" in line for line in found.told)
    assert any("recording goes on in" in line and "run-2.mcap" in line for line in found.told)
    stored = len(whole.frames("can0"))
    assert whole.stop is not None
    assert whole.stop.counts["can0"] == stored
    lost = found.summary.losses["can0"]["disk"]
    assert lost > 50
    assert stored + lost == found.wire.sent
    samples = len(whole.blocks()["correvit.speed"])
    assert samples + found.summary.losses["correvit.speed"]["disk"] == found.wire.sent


def test_the_remaining_text_is_forecast_from_the_first_second(tmp_path: Path):
    now, path = [0.0], tmp_path / "log"
    path.write_bytes(bytes(5_000))

    class Medium(LogMedium):
        def free(self) -> int:
            return RESERVE_BYTES + 246_000_000

    medium = Medium(path, clock=lambda: now[0])
    assert medium.seconds_to_full(5_000) == float("inf")
    for second in range(1, 60):
        now[0] = float(second)
        rate = 100_000 if second <= 20 else 200_000  # the bus begins to be used
        written = 5_000 + 100_000 * min(second, 20) + 200_000 * max(0, second - 20)
        found = medium.seconds_to_full(written)
        assert second > 20 or remaining_text(found) == "41 min left"
    assert remaining_text(found) == "20 min left"
    assert rate == 200_000


def test_the_line_of_a_second_says_it(tmp_path: Path):
    found = Recording(tmp_path / "run.mcap", 1.3)
    assert np.isfinite(found.seen[0].disk_seconds)
    health = found.seen[0]
    health.disk_seconds = 41.4 * 60
    assert live_text(health).splitlines()[2].startswith("  41 min left; clock ")
    assert [remaining_text(s) for s in (1e9, 7.4 * 3600, 119.0)] == ["", "7 h left", "119 s left"]


def test_what_a_power_cut_can_cost_is_measured(tmp_path: Path):
    """From one forced write's begin to the end of the next: its period and what it takes."""
    media: list[LogMedium] = []

    def sync(fd: int) -> None:
        time.sleep(0.05)

    def medium(path: Path) -> LogMedium:
        media.append(LogMedium(path, sync))
        return media[0]

    Recording(tmp_path / "run.mcap", 1.2, medium=medium)
    assert 0.25 <= media[0].longest < 1.2
