"""The log against a killed process, a full disk and files that are none."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.errors import RunError, UsageError
from lacet.daq.formats.log import LogReader, LogWriteError, LogWriter, StartRecord, StopRecord, recover
from lacet.daq.frames import Frames
from tests.support.places import HOME

ROOT = HOME
T0 = 1_700_000_000 * 10**9
START = StartRecord("run-1", T0)


def batch(k: int, n: int = 50) -> Frames:
    rng = np.random.default_rng(k)
    t = T0 + k * 50_000_000 + np.arange(n) * 1_000_000
    return Frames("can0", t, np.arange(n, dtype=np.uint32), np.arange(n + 1) * 8, rng.integers(0, 256, 8 * n, np.uint8))


WRITE_FOR_EVER = """
    import sys, time
    sys.path[:0] = [{root!r}, {here!r}]
    from test_log_faults import batch, START
    from lacet.daq.formats.log import LogWriter
    writer = LogWriter({path!r}, START)
    for k in range(100000):
        writer.write_frames(batch(k))
        writer.tick(int(batch(k).t_ns[-1]))
        print(k, flush=True)
        time.sleep(0.002)
"""


def test_kill_9_costs_one_chunk_at_most(tmp_path: Path):
    path = tmp_path / "killed.mcap"
    code = textwrap.dedent(WRITE_FOR_EVER).format(root=str(ROOT), here=str(Path(__file__).parent), path=str(path))
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    last = 0
    for line in process.stdout:
        last = int(line)
        if last >= 60:
            break
    process.send_signal(signal.SIGKILL)
    last = max([last, *(int(line) for line in process.stdout)])
    process.wait(10)
    reader = LogReader(path)
    frames = reader.frames("can0")
    batches = len(frames) // 50
    assert batches >= last - 2  # 0.1 s a chunk, 0.05 s a batch
    np.testing.assert_array_equal(frames.data, np.concatenate([batch(k).data for k in range(batches)]))
    assert reader.stop is None
    assert any("no stop record" in line for line in reader.damage)
    out = tmp_path / "recovered.mcap"
    assert recover(path, out) == reader.damage
    assert len(LogReader(out).frames("can0")) == len(frames)


LIMITED = """
    import resource, signal, sys
    sys.path[:0] = [{root!r}, {here!r}]
    from test_log_faults import batch, START
    from lacet.daq.formats.log import LogWriter, LogWriteError
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
    writer = LogWriter({path!r}, START)
    written = failed = 0
    for k in range(100):
        try:
            writer.write_frames(batch(k))
            written += 1
        except LogWriteError as error:
            failed += 1
            text = str(error)
    stored, lost = writer.counts["can0"], writer.losses["can0"]["disk"]
    assert stored + lost == 5000, (stored, lost)
    try:
        writer.close()
    except LogWriteError:
        print(stored, text)
"""


def test_a_full_disk_keeps_what_was_recorded(tmp_path: Path):
    """A real refusal of the kernel: the file may not grow beyond 20,000 bytes."""
    path = tmp_path / "full.mcap"
    code = textwrap.dedent(LIMITED).format(root=str(ROOT), here=str(Path(__file__).parent), path=str(path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    stored, text = done.stdout.split(maxsplit=1)
    assert "readable" in text
    assert "Make room" in text
    reader = LogReader(path)
    assert path.stat().st_size <= 20000
    assert len(reader.frames("can0")) == int(stored) > 0
    assert [line for line in reader.damage if "cut off" in line] == []  # ends after a whole record


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO, errno.EDQUOT])
def test_failing_writes_are_counted_and_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int):
    path = tmp_path / "full.mcap"
    writer = LogWriter(path, START)
    for k in range(10):
        writer.write_frames(batch(k))
    real, calls = os.write, []

    def refuse(fd: int, data: bytes) -> int:
        calls.append(len(data))
        if len(calls) == 1:  # a part goes in before the disk refuses
            return real(fd, data[: len(data) // 2])
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "write", refuse)
    with pytest.raises(LogWriteError, match="writing failed"):
        [writer.write_frames(batch(k)) for k in range(10, 20)]
    with pytest.raises(LogWriteError):
        writer.write_frames(batch(20))
    with pytest.raises(LogWriteError):
        writer.flush()
    before = dict(writer.losses["can0"])
    monkeypatch.undo()
    with pytest.raises(LogWriteError):
        writer.close(StopRecord(T0, "stopped"))
    reader = LogReader(path)
    assert len(reader.frames("can0")) == writer.counts["can0"] == writer.manifest().sources["can0"].samples
    assert len(reader.frames("can0")) >= 400
    assert before["disk"] >= 100
    assert not any("cut off" in line for line in reader.damage)


def test_full_from_the_start():
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")
    with pytest.raises(LogWriteError, match="writing failed"):
        LogWriter("/dev/full", START, overwrite=True)


def test_an_exception_closes_the_log_with_its_reason(tmp_path: Path):
    def record() -> None:
        with LogWriter(tmp_path / "run.mcap", START) as writer:
            writer.write_frames(batch(0))
            raise ZeroDivisionError("of all things")

    with pytest.raises(ZeroDivisionError):
        record()
    reader = LogReader(tmp_path / "run.mcap")
    assert reader.damage == []
    assert reader.stop is not None
    assert reader.stop.reason == "ZeroDivisionError: of all things"
    assert len(reader.frames("can0")) == 50


def test_a_log_being_written_can_be_read(tmp_path: Path):
    writer = LogWriter(tmp_path / "run.mcap", START)
    assert LogReader(tmp_path / "run.mcap").start == START  # on the disk at once
    writer.write_frames(batch(0))
    writer.tick(T0 + 60_000_000)
    assert LogReader(tmp_path / "run.mcap").sources() == []  # younger than a chunk
    writer.tick(T0 + 150_000_000)
    assert len(LogReader(tmp_path / "run.mcap").frames("can0")) == 50
    writer.close()


def test_chunks_end_by_size_and_by_time(tmp_path: Path):
    def stored(**limits: float) -> int:
        writer = LogWriter(tmp_path / "run.mcap", START, overwrite=True, **limits)
        for k in range(20):
            writer.write_frames(batch(k))
        frames = LogReader(tmp_path / "run.mcap")
        count = len(frames.frames("can0")) if frames.sources() else 0
        writer.close()
        return count

    assert stored(chunk_bytes=1 << 30, chunk_seconds=1e6) == 0
    assert stored(chunk_bytes=3000, chunk_seconds=1e6) >= 850
    assert stored(chunk_bytes=1 << 30, chunk_seconds=0.2) >= 800


def test_fsync_is_called_as_often_as_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    calls: list[int] = []
    monkeypatch.setattr(os, "fsync", calls.append)
    with LogWriter(tmp_path / "run.mcap", START, fsync_seconds=0.5) as writer:
        for k in range(60):  # 3 s
            writer.write_frames(batch(k))
    assert 5 <= len(calls) <= 7


def test_nothing_is_overwritten_unasked(tmp_path: Path):
    path = tmp_path / "run.mcap"
    LogWriter(path, START).close()
    with pytest.raises(LogWriteError, match="exists"):
        LogWriter(path, START)
    with pytest.raises(UsageError, match="exists"):
        recover(path, path, overwrite=True)
    with pytest.raises(LogWriteError, match="folder"):
        LogWriter(tmp_path / "nowhere" / "run.mcap", START)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "empty"),
        (b"t,imu.accel.x\n0,1\n" * 50, "not an MCAP file"),
        (b"\x89MCAP0\r\n", "nothing can be read"),
        (b"\x89MCAP0\r\n" + bytes(100), "nothing can be read"),
        (bytes(1000), "not an MCAP file"),
    ],
)
def test_what_is_no_log_is_refused_with_a_remedy(tmp_path: Path, data: bytes, message: str):
    path = tmp_path / "odd.mcap"
    path.write_bytes(data)
    with pytest.raises(RunError, match=message):
        LogReader(path)


def test_a_missing_file_names_the_nearest(tmp_path: Path):
    LogWriter(tmp_path / "slalom.mcap", START).close()
    with pytest.raises(RunError, match=r"did you mean 'slalom\.mcap'"):
        LogReader(tmp_path / "slalon.mcap")


def test_an_mcap_file_of_others_is_refused(tmp_path: Path):
    from mcap.writer import Writer

    path = tmp_path / "ros.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("s", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/odom", "json", schema), 1, b"{}", 1)
        writer.finish()
    with pytest.raises(RunError, match="/odom"):
        LogReader(path)


def test_a_bad_beginning_does_not_hide_the_rest(tmp_path: Path):
    """Power cuts leave zeros: here over the magic, the header and the first chunk."""
    path = tmp_path / "run.mcap"
    with LogWriter(path, START) as writer:
        for k in range(20):
            writer.write_frames(batch(k))
    data = bytearray(path.read_bytes())
    data[:4200] = bytes(4200)
    path.write_bytes(data)
    reader = LogReader(path)
    assert len(reader.frames("can0")) >= 900
    text = "\n".join(reader.damage)
    assert "start record is lost" in text
    assert "bytes 0 to" in text


def test_an_unknown_source_names_the_nearest(tmp_path: Path):
    with LogWriter(tmp_path / "run.mcap", START) as writer:
        writer.write_frames(batch(0))
    with pytest.raises(UsageError, match="did you mean 'can0'"):
        LogReader(tmp_path / "run.mcap").frames("can9")
