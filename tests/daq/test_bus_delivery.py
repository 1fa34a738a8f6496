"""A run that has ended arrives, once: links that are cut, workers that stall or are killed, disks that are full."""

from __future__ import annotations

import errno
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any

import pytest
import zenoh

from lacet.daq.blocks import Block
from lacet.daq.bus import link as bus_link
from lacet.daq.bus import publisher as bus_publisher
from lacet.daq.bus.link import Link
from lacet.daq.bus.listener import BusListener
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import open_session
from lacet.daq.bus.spool import Spool
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.log import LogReader, LogWriter, StopRecord
from lacet.daq.formats.wire import StartRecord
from lacet.services.acquisition import claims
from lacet.services.acquisition import worker as worker_module
from lacet.services.acquisition.assembly import Assembly
from lacet.services.acquisition.offer import offer
from lacet.services.acquisition.worker import RunResult, Worker
from lacet.services.commands.__main__ import main
from tests.daq.test_bus import BLOCKS, CHANNEL_NAMES, assert_whole, publish, wait_until
from tests.support.processes import Command, commands
from tests.support.rig import T0, free_port, rig_text, samples


@dataclass
class Net:
    """A router that can be switched off and on, and the sessions of a recorder and a worker at it."""

    endpoint: str
    router: zenoh.Session
    car: zenoh.Session
    client: zenoh.Session
    spool: Spool

    def off(self) -> None:
        """Switch the router off."""
        self.router.close()
        wait_until(lambda: not self.client.info.routers_zid() and not self.car.info.routers_zid())

    def on(self) -> None:
        """Switch the router on, and wait until both have found it."""
        self.router = open_session(listen=(self.endpoint,))
        wait_until(lambda: bool(self.client.info.routers_zid() and self.car.info.routers_zid()), 15.0)

    def publisher(self, session: zenoh.Session | None = None, **options: float) -> RunPublisher:
        """A publisher of a run, at the recorder's session."""
        start = StartRecord("run-1", T0, "", rig_text())
        return RunPublisher(session or self.car, "car", start, self.spool, **options)


@pytest.fixture
def net(monkeypatch: pytest.MonkeyPatch) -> Iterator[Net]:
    monkeypatch.setattr(bus_publisher, "OTHERS", 0.1)
    monkeypatch.setattr(worker_module, "SIGN", 0.5)
    monkeypatch.setattr(claims, "SETTLE", 0.1)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router, spool = open_session(listen=(endpoint,)), Spool()
    net = Net(endpoint, router, open_session(connect=(endpoint,)), open_session(connect=(endpoint,)), spool)
    yield net
    for session in (net.car, net.client, net.router):
        session.close()
    spool.close()


@dataclass
class Working:
    """A worker in a thread: what it has said, and its results when it has ended."""

    said: list[str] = field(default_factory=list[str])
    results: list[RunResult] = field(default_factory=list[RunResult])

    def has_said(self, text: str) -> bool:
        """Whether it has said something with that text."""
        return any(text in line for line in self.said)


@contextmanager
def working(
    session: zenoh.Session, folder: Path, on_run: Callable[[Path], dict[str, Any]] = lambda path: {}, **options: Any
) -> Iterator[Working]:
    """A worker at a session, ended with the block."""
    listener, stop, found = BusListener(session), Event(), Working()

    def notify(text: str) -> None:
        found.said.append(text)
        options.get("on_line", print)(text)

    numbers = {"patience": 0.3, "deadline": 0.5, **{k: v for k, v in options.items() if k not in ("on_line", "name")}}
    worker = Worker(listener, folder, options.get("name", "w"), on_run, notify=notify, **numbers)
    thread = threading.Thread(target=lambda: found.results.extend(worker.run(stop)))
    thread.start()
    yield found
    stop.set()
    thread.join(10.0)
    assert not thread.is_alive()
    listener.close()


def test_a_router_that_is_off_closes_no_run(net: Net, tmp_path: Path):
    publisher = net.publisher()
    with working(net.client, tmp_path) as worker:
        wait_until(lambda: worker.has_said("listening"))
        net.off()
        whole = publish(publisher)
        time.sleep(1.2)  # longer than its patience and the time for a sign of life
        assert not worker.has_said("NOT complete")
        net.on()
        publisher.finish({}, {})
        assert set(publisher.wait_for_ack(10.0)) == {"w"}
        wait_until(lambda: (tmp_path / "run-1.result.json").exists())
    assert_whole(worker.results[0], whole)
    publisher.close()


def test_a_worker_that_stalls_closes_no_run(net: Net, tmp_path: Path):
    def stall(text: str) -> None:
        if "listening" in text:
            time.sleep(1.2)

    publisher = net.publisher()
    with working(net.client, tmp_path, on_line=stall) as worker:
        wait_until(lambda: worker.has_said("listening"))
        whole = publish(publisher)
        publisher.finish({}, {})
        assert set(publisher.wait_for_ack(10.0)) == {"w"}
        wait_until(lambda: (tmp_path / "run-1.result.json").exists())
        assert not worker.has_said("NOT complete")
    assert_whole(worker.results[0], whole)
    publisher.close()


def test_a_run_whose_recorder_was_cut_off_goes_on_when_it_is_heard_again(net: Net, tmp_path: Path):
    publisher = net.publisher(drop_live=0.5)
    with working(net.client, tmp_path) as worker:
        wait_until(lambda: worker.has_said("listening"))
        whole = publish(publisher)
        net.car.close()  # the recorder's link is cut, the worker's is not
        publisher.close()
        wait_until(lambda: worker.has_said("NOT complete"))
        assert (tmp_path / "run-1.incomplete.mcap").exists()
        wait_until(lambda: (tmp_path / "run-1.result.json").exists())
        assert json.loads((tmp_path / "run-1.result.json").read_text())["complete"] is False
        net.car = open_session(connect=(net.endpoint,))
        net.spool = Spool()
        again = net.publisher()
        publish(again)
        again.finish({}, {})
        assert set(again.wait_for_ack(10.0)) == {"w"}
        wait_until(lambda: len(list(tmp_path.glob("*.mcap"))) == 1)
        wait_until(lambda: json.loads((tmp_path / "run-1.result.json").read_text())["complete"])
    assert worker.has_said("heard again")
    assert_whole(worker.results[-1], whole)
    again.close()


def test_an_acknowledgement_without_all_of_it_does_not_end_the_recorder_s_wait(net: Net):
    publisher = net.publisher()
    publish(publisher)
    publisher.finish({}, {})
    net.client.put(publisher.keys.key("ack", "w"), json.dumps({"run_id": "run-1", "complete": False, "notes": []}))
    assert publisher.wait_for_ack(0.4) == {}
    publisher.close()


def test_a_run_acknowledged_and_not_worked_on_is_worked_on_by_the_next(net: Net, tmp_path: Path):
    never, begun = Event(), Event()

    def killed(path: Path) -> dict[str, Any]:
        begun.set()
        never.wait(20.0)  # the process ends meanwhile
        return {}

    publisher = net.publisher()
    with working(net.client, tmp_path, killed):
        whole = publish(publisher)
        publisher.finish({}, {})
        assert set(publisher.wait_for_ack(10.0)) == {"w"}
        assert begun.wait(5.0)
    publisher.close()
    assert not (tmp_path / "run-1.result.json").exists()
    with working(net.client, tmp_path, lambda path: {"size": path.stat().st_size}) as worker:
        wait_until(lambda: (tmp_path / "run-1.result.json").exists())
    never.set()
    (result,) = worker.results
    assert_whole(result, whole)
    assert result.work["size"] > 0
    with working(net.client, tmp_path) as worker:  # and only once
        time.sleep(0.5)
    assert worker.results == []


def test_a_worker_started_again_acknowledges_what_it_has(net: Net, tmp_path: Path):
    publisher = net.publisher()
    publish(publisher)
    publisher.finish({}, {})
    with working(net.client, tmp_path):
        assert set(publisher.wait_for_ack(10.0)) == {"w"}
    publisher.close()
    again = net.publisher()  # an acknowledgement that was lost on the way: the recorder offers the run again
    publish(again)
    again.finish({}, {})
    with working(net.client, tmp_path) as worker:
        assert set(again.wait_for_ack(10.0)) == {"w"}
    assert len(list(tmp_path.glob("*.mcap"))) == 1
    assert not worker.has_said("listening")
    again.close()


def test_two_recorders_at_one_address_both_reach_the_worker_and_the_second_takes_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(bus_publisher, "OTHERS", 0.1)
    monkeypatch.setattr(bus_link, "AGAIN", 0.1)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    links = [Link(endpoint, True) for _ in range(2)]
    client = open_session(connect=(endpoint,))
    spools = [Spool(), Spool()]
    publishers = []
    for i, (link, spool) in enumerate(zip(links, spools, strict=True)):
        publishers.append(RunPublisher(link.session, "car", StartRecord(f"run-{i}", T0, "", rig_text()), spool))
        link.add(publishers[i])
    with working(client, tmp_path) as worker:
        wait_until(lambda: worker.has_said("run-0: listening") and worker.has_said("run-1: listening"))
        wholes = [publish(publishers[0])]
        publishers[0].finish({}, {})
        assert set(publishers[0].wait_for_ack(10.0)) == {"w"}
        publishers[0].close()
        links[0].close()  # the first was the router
        wholes.append(publish(publishers[1]))
        publishers[1].finish({}, {})
        assert set(publishers[1].wait_for_ack(15.0)) == {"w"}
        wait_until(lambda: len(list(tmp_path.glob("*.result.json"))) == 2)
    results = sorted(worker.results, key=lambda result: result.run_id)
    for result, whole in zip(results, wholes, strict=True):
        assert_whole(result, whole)
    publishers[1].close()
    links[1].close()
    client.close()
    for spool in spools:
        spool.close()


def test_a_link_that_cannot_be_made_is_made_later(net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bus_link, "AGAIN", 0.1)
    net.off()
    lines: list[str] = []
    link = Link(net.endpoint, False, notify=lines.append)
    publisher = net.publisher(link.session)
    link.add(publisher)
    assert "RECORDING WITHOUT THE BUS" in lines[0]
    whole = publish(publisher)
    with working(net.client, tmp_path) as worker:
        net.on()
        publisher.finish({}, {})
        assert set(publisher.wait_for_ack(15.0)) == {"w"}
        wait_until(lambda: (tmp_path / "run-1.result.json").exists())
    assert_whole(worker.results[0], whole)
    publisher.close()
    link.close()


def test_two_workers_fit_each_run_once_and_both_have_its_result(net: Net, tmp_path: Path):
    other = open_session(connect=(net.endpoint,))
    begun: list[tuple[str, str]] = []

    def work_of(name: str) -> Callable[[Path], dict[str, Any]]:
        def work(path: Path) -> dict[str, Any]:
            begun.append((name, path.stem))
            time.sleep(0.3)
            return {"by": name}

        return work

    for name in "ab":
        (tmp_path / name).mkdir()
    spools = [Spool() for _ in range(4)]
    with (
        working(net.client, tmp_path / "a", work_of("a"), name="a") as first,
        working(other, tmp_path / "b", work_of("b"), name="b") as second,
    ):
        publishers = [
            RunPublisher(net.car, "car", StartRecord(f"run-{i}", T0, "", rig_text()), spool)
            for i, spool in enumerate(spools)
        ]
        for publisher in publishers:
            publish(publisher)
            publisher.finish({}, {})
        for name in "ab":
            wait_until(lambda folder=tmp_path / name: len(list(folder.glob("*.result.json"))) == 4)
    assert sorted(run for _, run in begun) == [f"run-{i}" for i in range(4)]
    assert {name for name, _ in begun} == {"a", "b"}  # they share the work
    for worker in (first, second):
        assert {result.run_id: result.work["by"] for result in worker.results} == {run: name for name, run in begun}
    for item in (*publishers, *spools, other):
        item.close()


def test_a_run_whose_worker_dies_is_taken_over(net: Net, tmp_path: Path):
    never, begun = Event(), Event()

    def dies(path: Path) -> dict[str, Any]:
        begun.set()
        never.wait(20.0)
        return {}

    for name in "ab":
        (tmp_path / name).mkdir()
    other = open_session(connect=(net.endpoint,))
    publisher = net.publisher()
    with (
        working(net.client, tmp_path / "b", lambda path: {"by": "b"}, name="b") as survivor,
        working(other, tmp_path / "a", dies, name="a"),
    ):
        publish(publisher)
        publisher.finish({}, {})
        assert begun.wait(10.0)  # a, the first name, has it
        wait_until(lambda: survivor.has_said("run-1: complete"))
        time.sleep(1.0)
        assert survivor.results == []
        assert not (tmp_path / "b" / "run-1.result.json").exists()
        other.close()  # as when its process is killed
        wait_until(lambda: (tmp_path / "b" / "run-1.result.json").exists())
    never.set()
    assert survivor.results[0].work == {"by": "b"}
    publisher.close()


def test_a_result_of_nobody_who_has_the_run_does_not_keep_a_worker_from_it(net: Net, tmp_path: Path):
    publisher = net.publisher()
    publish(publisher)
    with working(net.client, tmp_path, lambda path: {"by": "w"}) as worker:
        publisher.finish({}, {})
        wait_until(lambda: worker.has_said("run-1: complete"))
        for payload in (b"{", b"[]", b'{"digest": "00", "result": {}}', b'{"digest": 1}'):
            net.car.put(publisher.keys.key("result", "a"), payload)
        wait_until(lambda: (tmp_path / "run-1.result.json").exists())
    assert worker.results[0].work == {"by": "w"}
    publisher.close()


def recorded(path: Path, run_id: str = "run-1") -> LogReader:
    """A log of two channels, 40 blocks of each."""
    with LogWriter(path, StartRecord(run_id, T0, "", rig_text())) as log:
        for name in CHANNEL_NAMES[:2]:
            whole = samples(CHANNELS[name], BLOCKS / 10, 100.0)
            for i in range(BLOCKS):
                part = slice(10 * i, 10 * i + 10)
                log.write_block(Block(name, whole.t_ns[part], whole.values[part], whole.flags[part]))
        log.close(StopRecord(T0 + 1, "stopped"))
    return LogReader(path)


def test_a_log_is_offered_to_a_worker_that_came_after_the_recorder_had_gone(net: Net, tmp_path: Path):
    log = recorded(tmp_path / "log.mcap")
    assert log.manifest is not None
    publisher = offer(net.car, "car", log, net.spool, print)
    (tmp_path / "worker").mkdir()
    with working(net.client, tmp_path / "worker"):
        assert set(publisher.wait_for_ack(10.0)) == {"w"}
    (path,) = (tmp_path / "worker").glob("*.mcap")
    found = LogReader(path)
    assert found.damage == []
    assert found.manifest is not None
    assert found.manifest.channels == log.manifest.channels  # the very messages
    publisher.close()


def test_what_a_cut_link_had_brought_is_not_fetched_again(net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The link is cut while blocks are fetched, and the log is offered by another process."""
    monkeypatch.setattr(bus_publisher, "REPLY", 3000)
    log = recorded(tmp_path / "log.mcap")
    publisher = offer(net.car, "car", log, net.spool, print)
    (tmp_path / "worker").mkdir()
    stored, add = list[int](), Spool.add

    def cut_after_20(spool: Spool, name: str, sequence: int, message: bytes) -> bool:
        if spool in (net.spool, second):
            return add(spool, name, sequence, message)
        if len(stored) == 20:
            net.car.close()
        stored.append(sequence)
        return len(stored) != 21 and add(spool, name, sequence, message)

    second = Spool()
    monkeypatch.setattr(Spool, "add", cut_after_20)
    monkeypatch.setattr(worker_module, "ROOM", 0.2)
    with working(net.client, tmp_path / "worker", deadline=60.0) as worker:
        wait_until(lambda: len(stored) > 20)
        publisher.close()
        net.car = open_session(connect=(net.endpoint,))
        again = offer(net.car, "car", log, second, print)
        assert set(again.wait_for_ack(10.0)) == {"w"}
        assert worker.has_said("run-1: complete")
    assert len(stored) == 2 * BLOCKS + 1  # each once, but for the one that was refused
    again.close()
    second.close()


def test_publish_offers_logs_until_they_are_at_a_worker(tmp_path: Path):
    logs = [recorded(tmp_path / f"log-{i}.mcap", f"run-{i}").path for i in range(2)]
    router = f"tcp/127.0.0.1:{free_port()}"
    with commands() as running:
        running.append(Command("publish", *logs, "--listen", router, "--json", "publish.json", cwd=tmp_path))
        (tmp_path / "worker").mkdir()
        running.append(Command("worker", "--connect", router, "--no-fit", "--name", "w", cwd=tmp_path / "worker"))
        assert running[0].wait() == 0, running[0].text()
        wait_until(lambda: len(list((tmp_path / "worker").glob("*.result.json"))) == 2)
    report = json.loads((tmp_path / "publish.json").read_text(encoding="utf-8"))
    assert [set(run["acknowledged"]) for run in report["runs"]] == [{"w"}, {"w"}]


def test_publish_without_a_worker_ends_with_3_and_a_log_without_channels_is_refused(tmp_path: Path, capsys):
    log = recorded(tmp_path / "log.mcap")
    place = ["--listen", f"tcp/127.0.0.1:{free_port()}"]
    assert main(["publish", str(log.path), *place, "--ack-wait", "0.1"]) == 3
    with LogWriter(tmp_path / "empty.mcap", log.start) as empty:
        empty.close(StopRecord(T0 + 1, "stopped"))
    assert main(["publish", str(tmp_path / "empty.mcap"), *place]) == 2
    assert "lacet decode" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["blocks", "log"])
def test_a_full_disk_is_said_and_nothing_acknowledged_until_there_is_room(
    net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
):
    full, add, write = Event(), Spool.add, Assembly.write
    full.set()

    def add_if_room(spool: Spool, name: str, sequence: int, message: bytes) -> bool:
        return not (full.is_set() and spool is not net.spool) and add(spool, name, sequence, message)

    def write_if_room(assembly: Assembly, path: Path, complete: bool) -> None:
        if full.is_set():
            raise OSError(errno.ENOSPC, "No space left on device")
        write(assembly, path, complete)

    monkeypatch.setattr(worker_module, "ROOM", 0.2)
    if what == "blocks":
        monkeypatch.setattr(Spool, "add", add_if_room)
    else:
        monkeypatch.setattr(Assembly, "write", write_if_room)
    publisher = net.publisher()
    with working(net.client, tmp_path) as worker:
        wait_until(lambda: worker.has_said("listening"))
        whole = publish(publisher)
        publisher.finish({}, {})
        until = time.monotonic() + 1.0  # twice its deadline
        assert publisher.wait_for_ack(10.0, lambda: time.monotonic() > until) == {}
        assert sum("THE DISK CANNOT BE WRITTEN" in line for line in worker.said) == 1
        full.clear()
        assert set(publisher.wait_for_ack(10.0)) == {"w"}
        wait_until(lambda: (tmp_path / "run-1.result.json").exists())
    assert_whole(worker.results[0], whole)
    publisher.close()
