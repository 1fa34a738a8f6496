"""Recorder and worker as processes, with what can go wrong between them."""

from __future__ import annotations

import json
import re
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lacet.daq.formats.log import LogReader
from lacet.services.commands.__main__ import main
from tests.support.processes import ROOT, Command, commands
from tests.support.rig import free_port, make_capture, rig_text

VEHICLE = ROOT / "tests" / "data" / "car" / "vehicle.toml"


class Bench:
    """A rig file, a capture, free ports, and the commands of one live run."""

    def __init__(self, folder: Path, running: list[Command], seconds: float, scale: float = 0.2):
        self.folder, self.running = folder, running
        self.udp, self.router = free_port(), f"tcp/127.0.0.1:{free_port()}"
        make_capture(folder / "capture.mcap", seconds, self.udp, scale)
        (folder / "rig.toml").write_text(rig_text(self.udp))
        self.log = folder / "log.mcap"
        self.multicast = [f"can{i}=multicast:{free_port()}" for i in range(2)]

    def start(self, name: str, *args: object, cwd: Path | None = None, under: tuple[str, ...] = ()) -> Command:
        command = Command(name, *args, cwd=cwd or self.folder, under=under)
        self.running.append(command)
        return command

    def replay(self, *args: object) -> Command:
        to = [word for place in self.multicast for word in ("--to", place)]
        return self.start("replay", "capture.mcap", "--endpoints", "wires.json", "--wait", 15, *to, *args)

    def record(self, *args: object, under: tuple[str, ...] = ()) -> Command:
        fixed = ("--rig", "rig.toml", "--vehicle", VEHICLE, "-o", self.log, "--listen", self.router)
        return self.start("record", *fixed, "--endpoints", "wires.json", "--json", "record.json", *args, under=under)

    def worker(self, name: str, *args: object) -> tuple[Command, Path]:
        empty = self.folder / name
        empty.mkdir()
        # Nothing but the router's address; --no-fit because a second of synthetic driving identifies no car.
        fixed = ("--connect", self.router, "--once", "--no-fit", "--name", name)
        return self.start("worker", *fixed, *args, cwd=empty), empty


@pytest.fixture
def running():
    with commands() as found:
        yield found


def assembled(folder: Path) -> LogReader:
    (path,) = folder.glob("*.mcap")
    return LogReader(path)


def result_of(folder: Path) -> dict[str, Any]:
    (path,) = folder.glob("*.result.json")
    return json.loads(path.read_text(encoding="utf-8"))


def assert_same_run(ours: LogReader, recorded: LogReader) -> None:
    assert ours.damage == []
    assert ours.start == recorded.start
    a, b = ours.blocks(), recorded.blocks()
    assert a.keys() == b.keys()
    assert len(b) == 36
    for name in a:
        np.testing.assert_array_equal(a[name].t_ns, b[name].t_ns, err_msg=name)
        np.testing.assert_array_equal(a[name].values, b[name].values, err_msg=name)
        np.testing.assert_array_equal(a[name].flags, b[name].flags, err_msg=name)
    assert ours.manifest is not None
    assert recorded.manifest is not None
    assert ours.manifest.channels == recorded.manifest.channels  # the messages' very bytes


def test_a_worker_restarted_in_mid_run_in_an_empty_folder_has_the_whole_run_though_5_percent_never_came(
    tmp_path, running
):
    bench = Bench(tmp_path, running, seconds=3.0)
    bench.replay()
    record = bench.record("--until-idle", 0.7, "--drop-live", 0.05)
    first, _ = bench.worker("first")
    first.wait_for("listening")
    first.process.kill()
    worker, folder = bench.worker("second")
    assert record.wait() == 0, record.text()
    assert worker.wait() == 0, worker.text()
    recorded = LogReader(bench.log)
    assert recorded.damage == []
    assert_same_run(assembled(folder), recorded)
    assert recorded.start.vehicle_text == VEHICLE.read_text()
    assert set(recorded.start.documents) == {"igel.dbc", "lasers.dbc", "correvit.dbc"}
    text = worker.text()
    fetched = int(text.split("complete, ")[1].split(" blocks fetched")[0])
    assert fetched > 0  # otherwise nothing was dropped and nothing is proved
    capture = LogReader(tmp_path / "capture.mcap")
    for source in capture.sources():
        np.testing.assert_array_equal(recorded.frames(source).data, capture.frames(source).data)
    result = result_of(folder)
    assert result["complete"]
    assert result["missing"] == {}
    report = json.loads((tmp_path / "record.json").read_text())
    assert report["losses"] == {}
    assert report["acknowledged"]["second"]["complete"]


def test_a_killed_recorder_leaves_a_readable_log_and_a_worker_that_says_what_it_lacks(tmp_path, running):
    bench = Bench(tmp_path, running, seconds=10.0)
    bench.replay()
    record = bench.record("--drop-live", 0.2)
    worker, folder = bench.worker("orphan", "--wait", 10)  # the recorder was the router: nothing is reached any more
    worker.wait_for("listening")
    time.sleep(1.0)
    record.process.kill()
    assert worker.wait() == 3, worker.text()
    log = LogReader(bench.log)
    assert any("not closed" in line for line in log.damage)
    blocks = log.blocks()
    assert len(blocks) == 36
    assert len(blocks["wheel.fl.force"]) > 50
    assert log.frames("can0").t_ns[-1] - log.frames("can0").t_ns[0] > 0.5e9
    result = result_of(folder)
    assert not result["complete"]
    assert any("without a manifest" in note for note in result["notes"])
    assert result["missing"]
    ours = assembled(folder).blocks()
    assert set(ours) <= set(blocks)
    name = "wheel.fl.force"
    both = np.isin(ours[name].t_ns, blocks[name].t_ns)
    assert both.mean() > 0.5


def test_a_signal_ends_the_run_in_order_and_a_taken_port_is_only_reported(tmp_path, running):
    bench = Bench(tmp_path, running, seconds=10.0)
    bench.replay("--loop")
    host, port = bench.router.removeprefix("tcp/").split(":")
    with socket.create_server((host, int(port))):
        record = bench.record()
        record.wait_for(" s: can0")
        assert "RECORDING WITHOUT THE BUS" in record.text()
        record.process.send_signal(signal.SIGTERM)
        assert record.wait(5.0) == 0, record.text()
    log = LogReader(bench.log)
    assert log.damage == []
    assert log.stop is not None
    assert log.stop.reason == "stopped"
    assert len(log.blocks()) == 36


TERMINAL_THAT_GOES = """
import os, pty, sys
pid, terminal = pty.fork()
if pid == 0:
    os.execvp(sys.argv[1], sys.argv[1:])
seen = b""
while b"recording can0" not in seen:
    seen += os.read(terminal, 4096)
os.close(terminal)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""


def test_a_terminal_that_goes_does_not_end_a_recording(tmp_path, running):
    """As a dropped ssh does: a signal, and a terminal that cannot be written to."""
    bench = Bench(tmp_path, running, seconds=3.0)
    bench.replay()
    record = bench.record("--until-idle", 0.7, "--ack-wait", 0, under=(sys.executable, "-c", TERMINAL_THAT_GOES))
    assert record.wait() == 0, record.text()
    log = LogReader(bench.log)
    assert log.damage == []
    assert log.stop is not None
    assert len(log.blocks()["wheel.fl.force"]) == 300


def test_a_recording_to_which_nothing_came_is_no_success(tmp_path, capsys, monkeypatch):
    """The log is whole and empty; a script sees the exit code of losses."""
    monkeypatch.setattr("signal.signal", lambda *_: None)
    sensor = '[bus.can0]\n[[sensor]]\nname = "car"\nchannels = ["car.speed"]\n'
    (tmp_path / "rig.toml").write_text(f'format = "lacet-rig 1"\nname = "bare"\n{sensor}')
    words = ["record", "--rig", "rig.toml", "--vehicle", "peugeot-406", "-o", "run.mcap", "--no-bus"]
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--from", f"can0=multicast:{free_port()}", "--duration", "0.1"]) == 3
    assert "NOTHING CAME: the log has no frame of any bus" in capsys.readouterr().err
    assert LogReader(tmp_path / "run.mcap").damage == []


def test_a_full_disk_does_not_end_a_recording(tmp_path, running):
    bench = Bench(tmp_path, running, seconds=2.0)
    bench.replay()
    # No file of this process may grow beyond 64 KiB, neither the log nor what is kept for requests.
    record = bench.record(
        "--until-idle", 0.7, "--drop-live", 0.05, under=("bash", "-c", 'ulimit -f 64; exec "$@"', "-")
    )
    worker, folder = bench.worker("witness")
    assert record.wait() == 3, record.text()
    assert worker.wait() == 0, worker.text()
    assert "publishing goes on" in record.text()
    report = json.loads((tmp_path / "record.json").read_text())
    assert report["log_error"]
    assert report["losses"]["wheel.fl.force"]["disk"] > 0
    everything = assembled(folder).blocks()
    kept = LogReader(bench.log)
    assert any("not closed" in line for line in kept.damage)
    for name, block in kept.blocks().items():  # whole as far as it goes
        np.testing.assert_array_equal(block.values, everything[name].values[: len(block)])
    assert len(everything) == 36
    assert len(everything["wheel.fl.force"]) == 200
    assert 0 < len(kept.blocks()["wheel.fl.force"]) < 200


def test_the_remote_worker_page_delivers_a_run(tmp_path: Path, running: list[Command]) -> None:
    """docs/remote-worker.md, its computers' address being this one's; added are the capture's wires and an end."""
    bench = Bench(tmp_path, running, 1.0)
    address = bench.router.replace("tcp/", "tls/")
    page = (ROOT / "docs" / "remote-worker.md").read_text(encoding="utf-8")
    found = re.findall(r"^ *```sh\n(.*?)^ *```$", page, re.MULTILINE | re.DOTALL)
    lines = [line.split()[1:] for block in found for line in block.strip().splitlines()]
    assert [line[0] for line in lines] == ["keys", "record", "worker"]
    keys, record, worker = ([re.sub(r"tls/[\d.]+:7447", address, word) for word in line] for line in lines)
    assert bench.start(*keys).wait() == 0
    assert sum(address in line for line in (record, worker)) == 2
    ends = [bench.start(*worker, "--once", "--no-fit"), bench.replay()]
    ends.append(bench.start(*record, "--endpoints", "wires.json", "--until-idle", 1))
    assert [end.wait(60.0) for end in ends] == [0, 0, 0], "\n".join(end.text() for end in ends)
    assert_same_run(assembled(tmp_path / "runs"), LogReader(tmp_path / "run.mcap"))
