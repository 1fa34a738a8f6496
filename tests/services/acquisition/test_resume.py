"""A recording that breaks off and goes on: one run, whose break is told and whose numbers go on."""

from __future__ import annotations

import shutil
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.blocks import Flag
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.formats.open_run import open_run
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.services.acquisition.recorder import Recorder, Summary
from lacet.services.acquisition.resume import RESUME_SECONDS, broken_run, is_being_recorded
from lacet.services.acquisition.run_log import Split
from lacet.services.acquisition.stream_decoder import Decoder
from tests.support.correvit_wire import CorrevitWire
from tests.support.processes import Command, commands

from .test_live_run import Bench, assembled
from .test_log_medium import RIG

rig = Rig.parse(RIG)


class Crash(CorrevitWire):
    """A bus whose driver has a bug: it shows at the 25th read."""

    def read(self, timeout: float) -> Frames:
        if self.reads == 25:
            raise ZeroDivisionError("a bug")
        return super().read(timeout)


def record(log: LogWriter, wire: CorrevitWire, stop: threading.Event | None = None, **how: object) -> Summary:
    """A recording until `stop`, or of 0.8 s."""
    recorder = Recorder([wire], Decoder(rig), log, notify=lambda text: None, **how)
    return recorder.run(stop or threading.Event(), duration=30.0 if stop else 0.8)


def killed(folder: Path) -> tuple[Path, CorrevitWire]:
    """The log that a killed recorder leaves, taken from under one that runs, and its bus."""
    log = LogWriter(folder / "whole.mcap", StartRecord("r", time.time_ns(), "", rig.text))
    stop = threading.Event()

    def act(reads: int) -> None:
        if reads == 35:
            shutil.copy(log.path, folder / "run.mcap")
            stop.set()

    wire = CorrevitWire(act=act)
    record(log, wire, stop)
    return folder / "run.mcap", wire


def crashed(folder: Path) -> tuple[Path, CorrevitWire]:
    """The log that a bug leaves, in its second file, and its bus."""
    log, wire = LogWriter(folder / "run.mcap", StartRecord("r", time.time_ns(), "", rig.text)), Crash()
    with pytest.raises(ZeroDivisionError):
        record(log, wire, threading.Event(), split=Split(size=5_000.0))
    assert (folder / "run-2.mcap").exists()
    return folder / "run.mcap", wire


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("broken", [killed, crashed])
def test_a_recording_that_broke_off_goes_on_as_the_same_run(
    tmp_path: Path, broken: Callable[[Path], tuple[Path, CorrevitWire]]
):
    first, _ = broken(tmp_path)
    before = LogReader(first)
    n = len(before.blocks()["correvit.speed"])
    found = broken_run(first, rig.text, time.time_ns())
    assert found is not None
    log = found.next_file({})
    summary = record(log, CorrevitWire(), resumed_ns=found.last_ns)
    whole = LogReader(first)
    assert list(whole.files.values()) == [*found.files, *summary.files]
    assert whole.start == before.start
    block = whole.blocks()["correvit.speed"]
    assert len(block) > n + 10
    assert np.flatnonzero(block.flags & int(Flag.GAP)).tolist() == [
        n
    ]  # samples are missing before this one, and only it
    assert not any("messages are missing" in line for line in whole.damage)  # the numbers go on
    assert any("broke off" in line for line in whole.damage) == (broken is killed)
    assert any("goes on here" in event.text for event in whole.events())
    assert whole.manifest is not None
    assert whole.manifest.channels == summary.tallies
    assert whole.manifest.channels["correvit.speed"].samples == len(block)
    assert open_run(first).duration > (block.t_ns[n] - block.t_ns[0]) / 1e9
    assert broken_run(first, rig.text, time.time_ns()) is None  # now it is closed in order


def test_what_does_not_go_on(tmp_path: Path):
    first, _ = killed(tmp_path)
    now = time.time_ns()
    assert broken_run(first, rig.text, now) is not None
    assert broken_run(first, rig.text, now + round((RESUME_SECONDS + 5) * 1e9)) is None  # another drive
    assert broken_run(first, rig.text + "\n", now) is None  # another rig
    assert broken_run(tmp_path / "whole.mcap", rig.text, now) is None  # closed in order
    assert broken_run(tmp_path / "nothing.mcap", rig.text, now) is None
    (tmp_path / "empty").mkdir()
    assert broken_run(tmp_path / "empty", rig.text, now) is None
    assert broken_run(tmp_path, rig.text, now) is None  # the run written last, which is the closed one
    body = bytearray(first.read_bytes())
    chunks = [at for at in range(len(body)) if body.startswith(b"\x04\0\0\0zstd", at)]
    body[chunks[1] + 40] ^= 0xFF  # the first samples are damaged: the numbers would not go on
    first.write_bytes(body)
    assert broken_run(first, rig.text, now) is None


def test_a_log_that_is_being_recorded_is_left_alone(tmp_path: Path):
    log = LogWriter(tmp_path / "run.mcap", StartRecord("r", time.time_ns(), "", rig.text))
    seen: list[tuple[bool, object]] = []

    def act(reads: int) -> None:
        if reads == 20:
            seen.append((is_being_recorded(log.path), broken_run(log.path, rig.text, time.time_ns())))
            stop.set()

    stop = threading.Event()
    record(log, CorrevitWire(act=act), stop)
    assert seen == [(True, None)]
    assert not is_being_recorded(log.path)


@pytest.fixture
def running():
    with commands() as found:
        yield found


def test_a_service_that_is_killed_goes_on_and_a_worker_has_the_whole_run(tmp_path: Path, running: list[Command]):
    bench = Bench(tmp_path, running, seconds=3.0)
    bench.log = tmp_path / "logs"
    bench.log.mkdir()
    bench.replay("--loop")
    record = bench.record("--resume")
    worker, folder = bench.worker("witness")
    worker.wait_for("listening")
    record.wait_for(" s: can0")
    record.process.send_signal(signal.SIGHUP)  # a terminal or a session that goes
    time.sleep(0.3)
    assert record.process.poll() is None
    record.process.kill()
    record.process.wait()
    again = bench.record("--resume")
    again.wait_for("goes on here")
    again.wait_for(" s: can0")
    again.process.send_signal(signal.SIGTERM)
    assert again.wait() in (0, 3), again.text()
    assert worker.wait() == 0, worker.text()
    first, second = sorted(bench.log.glob("*.mcap"), key=lambda file: len(file.name))
    whole, ours = LogReader(first), assembled(folder)
    assert list(whole.files.values()) == [first, second]
    assert ours.damage == []
    assert ours.start == whole.start
    assert ours.manifest is not None
    assert whole.manifest is not None
    assert ours.manifest.channels == whole.manifest.channels  # the messages' very bytes, of before and after
    assert len(ours.blocks()) == 36
