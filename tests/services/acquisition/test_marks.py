"""Markers: from the bus and the terminal into the log, and from there limits of a run."""

from __future__ import annotations

import json
import os
import pty
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from lacet.daq.bus.marks import MOST_TEXT, mark_text, set_mark
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import open_session
from lacet.daq.bus.spool import Spool
from lacet.daq.errors import RunError
from lacet.daq.formats.events import EventKind
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.run import Mark
from lacet.daq.run_limits import RunLimits
from lacet.services.acquisition.recorder import MOST_MARKS, Recorder
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.commands.__main__ import main
from lacet.services.workspace.decode import decode_log
from lacet.services.workspace.loading import load
from tests.identify import cars
from tests.support.correvit_wire import CorrevitWire
from tests.support.rig import free_port

from .test_log_medium import RIG, T0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 1.2 s with markers from the bus, from `lacet mark` and from its terminal."""
    folder = tmp_path_factory.mktemp("marks")
    endpoint, rig = f"tcp/127.0.0.1:{free_port()}", Rig.parse(RIG)
    router, spool = open_session(listen=(endpoint,)), Spool()
    client = open_session(connect=(endpoint,))
    start = StartRecord("r", T0, "", rig.text)
    publisher = RunPublisher(router, "bench", start, spool)
    log = LogWriter(folder / "run.mcap", start)
    told, stop = list[str](), threading.Event()

    def act(reads: int) -> None:
        if reads == 15:
            (answer,) = set_mark(client, "slalom\nbegins")
            assert (answer["run_id"], answer["text"]) == ("r", "slalom begins")
            assert 0.2 < answer["seconds"] < 60.0
        elif reads == 25:
            recorder.mark("")
        elif reads == 35:
            assert main(["mark", "slalom ends", "--connect", endpoint, "--json", str(folder / "mark.json")]) == 0
        elif reads == 50:
            stop.set()

    recorder = Recorder([CorrevitWire(act=act)], Decoder(rig), log, publisher, notify=told.append)
    try:
        recorder.run(stop, duration=60.0)
        assert set_mark(client, "after the end") == []
        assert main(["mark", "x", "--connect", endpoint]) == 2
    finally:
        client.close()
        publisher.close()
        router.close()
        spool.close()
    assert sum(line.startswith("marker ") for line in told) == 3
    assert json.loads((folder / "mark.json").read_text())["marks"][0]["text"] == "slalom ends"
    return folder / "run.mcap"


def test_markers_are_events_that_any_reader_of_mcap_reads(recorded: Path):
    with recorded.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = [json.loads(one.decoded_message.json) for one in reader.iter_decoded_messages(["/lacet/events"])]
    marks = [(one["text"], one["state"]) for one in found if one["kind"] == "mark"]
    assert marks == [("slalom begins", "bus"), ("mark 1", "terminal"), ("slalom ends", "bus")]


def test_markers_limit_a_run_and_its_decoding(recorded: Path, tmp_path: Path):
    run = open_run(recorded)
    begins, number, ends = run.marks
    assert (begins.text, number.text, ends.text) == ("slalom begins", "mark 1", "slalom ends")
    assert 0.0 < begins.t < number.t < ends.t < run.duration
    part = RunLimits("slalom begins", "slalom ends").of(run)
    whole, cut = run.signals["correvit.speed"], part.signals["correvit.speed"]
    inside = (whole.t >= begins.t) & (whole.t < ends.t)
    np.testing.assert_array_equal(cut.values, whole.values[inside])
    np.testing.assert_allclose(cut.t, whole.t[inside] - begins.t, atol=1e-12)
    assert part.marks[1] == (pytest.approx(number.t - begins.t), "mark 1")
    decode_log(recorded, tmp_path / "part.mcap", limits=RunLimits("slalom begins", "slalom ends"))
    log = LogReader(tmp_path / "part.mcap")
    assert log.damage == []
    between = [e.t_ns for e in LogReader(recorded).events() if e.text in ("slalom begins", "slalom ends")]
    frames = LogReader(recorded).frames("can0")
    expected = (frames.t_ns >= between[0]) & (frames.t_ns < between[1])
    np.testing.assert_array_equal(log.frames("can0").t_ns, frames.t_ns[expected])
    assert 10 < expected.sum() < len(frames) - 10
    assert [e.text for e in log.events() if e.kind == EventKind.MARK] == [m.text for m in run.marks]


def test_a_part_of_a_run_is_loaded_as_a_run_of_its_own():
    where = [cars.CAR / "sine.parquet"]
    given = cars.CAR / "rig.toml", cars.CAR / "vehicle.toml"
    whole, part = load(where, *given), load(where, *given, limits=RunLimits("2", "6.5s"))
    a, b = whole.prepared[0].recording, part.prepared[0].recording
    assert b.t[-1] - b.t[0] == pytest.approx(4.5, abs=0.1)
    assert len(b.t) < 0.8 * len(a.t)
    assert part.prepared[0].rows == whole.prepared[0].rows


MARKS = (Mark(1.0, "a"), Mark(2.0, "b"), Mark(3.0, "a"), Mark(4.0, "b"))


@pytest.mark.parametrize(
    ("limits", "seconds"),
    [
        (RunLimits("a", "b"), (1.0, 2.0)),
        (RunLimits("b", "a"), (2.0, 3.0)),  # the next one after the begin
        (RunLimits("a", "a"), (1.0, 3.0)),
        (RunLimits("", "b"), (0.0, 2.0)),
        (RunLimits("2.5", "b"), (2.5, 4.0)),
        (RunLimits("b", ""), (2.0, float("inf"))),
        (RunLimits("0.5s", "3"), (0.5, 3.0)),
    ],
)
def test_limits_are_markers_or_seconds(limits: RunLimits, seconds: tuple[float, float]):
    assert limits.seconds("run", MARKS) == seconds


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        (RunLimits("c"), "no marker 'c'.*its markers: a, b; or give seconds"),
        (RunLimits("4", "b"), "'b' .4 s. is not after '4'"),
        (RunLimits("5", "2"), "'2' .2 s. is not after '5'"),
    ],
)
def test_limits_that_are_none_are_told(limits: RunLimits, told: str):
    with pytest.raises(RunError, match=told):
        limits.seconds("run", MARKS)


def test_nothing_is_marked_that_a_terminal_would_obey():
    assert mark_text("\x1b[31mred\x07 \n two  lines ") == "[31mred two lines"
    assert len(mark_text("x" * 1000)) == MOST_TEXT


def test_markers_without_number_are_not_answered(tmp_path: Path):
    log = LogWriter(tmp_path / "run.mcap", StartRecord("r", T0, "", RIG))
    recorder = Recorder([CorrevitWire()], Decoder(Rig.parse(RIG)), log)
    found = [recorder.mark("again") for _ in range(MOST_MARKS + 3)]
    assert sum(one is not None for one in found) == MOST_MARKS
    log.close()


TYPING = """
import sys, threading
from lacet.services.commands.mark_key import marks_by_key
done = threading.Event()
def mark(text):
    print(f"<{text}>", flush=True)
    if text == "end":
        done.set()
with marks_by_key(mark) as keys:
    print("ready", keys, flush=True)
    done.wait(10.0)
"""


def test_the_enter_key_of_the_terminal_sets_a_marker():
    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, [sys.executable, "-c", TYPING])
    seen = b""
    while b"ready True" not in seen:
        seen += os.read(terminal, 4096)
    os.write(terminal, b"\ngravel road\nend\n")
    while b"<end>" not in seen:
        seen += os.read(terminal, 4096)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    os.close(terminal)
    assert [text for text in (b"<>", b"<gravel road>", b"<end>") if text in seen] == [
        b"<>",
        b"<gravel road>",
        b"<end>",
    ]


def test_without_a_terminal_nothing_is_read():
    from lacet.services.commands.mark_key import marks_by_key

    read, write = os.pipe()
    os.write(write, b"no marker\n")
    with marks_by_key(lambda text: pytest.fail(text), read) as keys:
        assert not keys
    assert os.read(read, 100) == b"no marker\n"
    os.close(read)
    os.close(write)
