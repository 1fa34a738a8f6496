"""Runs that no worker has are offered while the next one is recorded, and do not disturb it."""

from __future__ import annotations

import json
import shutil
import threading
import time
from pathlib import Path
from threading import Event

import pytest

from lacet.daq.bus import publisher as bus_publisher
from lacet.daq.bus.link import Link
from lacet.daq.bus.listener import BusListener
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import open_session
from lacet.daq.bus.spool import Spool
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.rig import Rig
from lacet.services.acquisition import claims
from lacet.services.acquisition import worker as worker_module
from lacet.services.acquisition.delivery import (
    SHARE,
    EarlierRuns,
    delivery_file,
    note_delivery,
    undelivered,
)
from lacet.services.acquisition.log_medium import LogMedium
from lacet.services.acquisition.recorder import Recorder
from lacet.services.acquisition.run_log import Split
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.acquisition.worker import Worker
from tests.support.correvit_wire import CorrevitWire
from tests.support.rig import free_port

from .test_log_medium import RIG

rig = Rig.parse(RIG)


def recorded(path: Path, run_id: str, seconds: float = 0.5, split: Split | None = None) -> Path:
    log = LogWriter(path, StartRecord(run_id, time.time_ns(), "", rig.text))
    recorder = Recorder([CorrevitWire()], Decoder(rig), log, notify=lambda text: None, split=split)
    recorder.run(Event(), duration=seconds)
    return path


def test_what_counts_as_undelivered(tmp_path: Path):
    first = recorded(tmp_path / "first.mcap", "first")
    for name in ("taken", "never-offered", "live", "gone", "busy"):
        shutil.copy(first, tmp_path / f"{name}.mcap")
    note_delivery(first, "first")
    note_delivery(tmp_path / "taken.mcap", "taken", ["lab"])
    note_delivery(tmp_path / "live.mcap", "live")
    note_delivery(tmp_path / "gone.mcap", "gone")
    note_delivery(tmp_path / "busy.mcap", "busy")
    (tmp_path / "gone.mcap").unlink()
    (tmp_path / "odd.delivery.json").write_text("[]")
    (tmp_path / "half.delivery.json").write_text('{"format')
    medium = LogMedium(tmp_path / "busy.mcap")  # another recorder has it open
    medium.start()
    try:
        assert undelivered(tmp_path, "live") == [first]
    finally:
        medium.stop()


def test_an_earlier_run_is_delivered_while_the_next_is_recorded_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bus_publisher, "OTHERS", 0.1)
    monkeypatch.setattr(worker_module, "SIGN", 0.5)
    monkeypatch.setattr(claims, "SETTLE", 0.1)
    earlier = recorded(tmp_path / "earlier.mcap", "earlier", 0.8, Split(size=5_000.0))
    assert (tmp_path / "earlier-2.mcap").exists()
    note_delivery(earlier, "earlier")
    endpoint, told = f"tcp/127.0.0.1:{free_port()}", list[str]()
    link = Link(endpoint, True, None, told.append)
    client, spool, over = open_session(connect=(endpoint,)), Spool(), Event()
    start = StartRecord("live", time.time_ns(), "", rig.text)
    publisher = RunPublisher(link.session, "bench", start, spool)
    link.add(publisher)
    (tmp_path / "worker").mkdir()
    worker = Worker(BusListener(client), tmp_path / "worker", "lab", lambda path: {"mass": 1.0}, notify=told.append)
    thread = threading.Thread(target=worker.run, args=(over,))
    thread.start()
    wire, stop = CorrevitWire(), Event()

    def watch(_: object) -> None:
        if json.loads(delivery_file(earlier).read_text())["workers"]:
            stop.set()

    recorder = Recorder(
        [wire], Decoder(rig), LogWriter(tmp_path / "live.mcap", start), publisher, notify=told.append, report=watch
    )
    try:
        with EarlierRuns(tmp_path, link, None, "live", told.append):
            summary = recorder.run(stop, duration=20.0)
    finally:
        over.set()
        thread.join(20.0)
        publisher.close()
        link.close()
        client.close()
        spool.close()
    assert summary.reason == "stopped", told
    assert json.loads(delivery_file(earlier).read_text()) == {
        "format": "lacet-delivery 1",
        "run_id": "earlier",
        "workers": ["lab"],
    }
    assert undelivered(tmp_path) == []
    whole, (ours,) = LogReader(earlier), (tmp_path / "worker").glob("*earlier*.mcap")
    assert whole.manifest is not None
    assert (manifest := LogReader(ours).manifest) is not None
    assert manifest.channels == whole.manifest.channels
    # The run that was recorded meanwhile lacks nothing.
    assert summary.losses == {}
    assert len(LogReader(tmp_path / "live.mcap").frames("can0")) == wire.sent


def test_earlier_runs_are_read_with_a_tenth_of_a_processor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """What the thread works is followed by nine times as long a rest, by clocks of the test's own."""
    worked, rested = [0.0], [0.0]
    runs = EarlierRuns(tmp_path, None, None, "", print)  # type: ignore[arg-type]
    monkeypatch.setattr("lacet.services.acquisition.delivery.time.thread_time", lambda: worked[0])
    monkeypatch.setattr(runs._stop, "wait", lambda seconds: rested.__setitem__(0, rested[0] + seconds))
    rest = runs._pace()
    for _ in range(1000):
        worked[0] += 0.003
        rest()
    assert worked[0] / (worked[0] + rested[0]) == pytest.approx(SHARE, rel=0.02)
