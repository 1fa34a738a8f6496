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

from lacet.daq.bus import publisher as bus_publisher
from lacet.daq.bus.listener import BusListener
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import open_session
from lacet.daq.bus.spool import Spool
from lacet.daq.formats.wire import StartRecord
from lacet.services.acquisition import worker as worker_module
from lacet.services.acquisition.assembly import Assembly
from lacet.services.acquisition.worker import RunResult, Worker
from tests.daq.test_bus import assert_whole, publish, wait_until
from tests.support.rig import T0, free_port, rig_text


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

    numbers = {"patience": 0.3, "deadline": 0.5, **{k: v for k, v in options.items() if k != "on_line"}}
    worker = Worker(listener, folder, options.pop("name", "w"), on_run, notify=notify, **numbers)
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
        time.sleep(1.5)  # five times as long as its patience
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
            time.sleep(1.5)

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
        until = time.monotonic() + 1.5  # three times its deadline
        assert publisher.wait_for_ack(10.0, lambda: time.monotonic() > until) == {}
        assert sum("THE DISK CANNOT BE WRITTEN" in line for line in worker.said) == 1
        full.clear()
        assert set(publisher.wait_for_ack(10.0)) == {"w"}
        wait_until(lambda: (tmp_path / "run-1.result.json").exists())
    assert_whole(worker.results[0], whole)
    publisher.close()
