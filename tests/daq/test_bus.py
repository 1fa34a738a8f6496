"""The bus within one process: whoever comes late, loses blocks, or gets wrong ones has the run all the same."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
import zenoh

from lacet.daq.blocks import Block
from lacet.daq.bus import listener as bus_listener
from lacet.daq.bus import publisher as bus_publisher
from lacet.daq.bus.listener import BusListener, Message, unpack_blocks
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import SEQUENCE, Keys, chunk, open_session
from lacet.daq.bus.spool import Spool
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import UsageError
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.wire import StartRecord, block_to_bytes
from lacet.services.acquisition.worker import RunResult, Worker
from tests.support.rig import T0, free_port, rig_text, samples

CHANNEL_NAMES = ("imu.accel", "wheel.fl.speed", "camera.rr.steer")
BLOCKS = 40


@dataclass
class Bus:
    """A router session with a run's publisher, and a client session."""

    router: zenoh.Session
    client: zenoh.Session
    spool: Spool
    endpoint: str
    run_id: str = "run-1"

    def publisher(self, **options: float) -> RunPublisher:
        return RunPublisher(self.router, "my rig", StartRecord(self.run_id, T0, "", rig_text()), self.spool, **options)


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bus]:
    monkeypatch.setattr(bus_publisher, "OTHERS", 0.1)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = open_session(listen=(endpoint,))
    client = open_session(connect=(endpoint,))
    spool = Spool()
    yield Bus(router, client, spool, endpoint)
    client.close()
    router.close()
    spool.close()


def publish(publisher: RunPublisher) -> dict[str, Block]:
    whole = {name: samples(CHANNELS[name], BLOCKS / 10, 100.0) for name in CHANNEL_NAMES}
    for i in range(BLOCKS):
        for name, block in whole.items():
            part = slice(10 * i, 10 * i + 10)
            piece = Block(name, block.t_ns[part], block.values[part], block.flags[part])
            publisher.put_block(name, block_to_bytes(piece, i, "sensor"), 10)
    return whole


def work(bus: Bus, folder: Path, capacity: int = 1 << 20, **options: Any) -> tuple[Worker, BusListener]:
    listener = BusListener(bus.client, capacity=capacity)
    options = {"notify": print, **options}
    return Worker(listener, folder, "w", lambda path: {"size": path.stat().st_size}, **options), listener


def wait_until(holds: Callable[[], bool], timeout: float = 10.0) -> None:
    """Wait until something holds; an error after `timeout` [s]."""
    until = time.monotonic() + timeout
    while not holds():
        assert time.monotonic() < until
        time.sleep(0.01)


def assert_whole(result: RunResult, whole: dict[str, Block]) -> None:
    assert result.complete, result.notes
    log = LogReader(result.path)
    assert log.damage == []
    blocks = log.blocks()
    for name, block in whole.items():
        np.testing.assert_array_equal(blocks[name].t_ns, block.t_ns)
        np.testing.assert_array_equal(blocks[name].values, block.values)


def test_a_late_worker_gets_all_of_it_from_the_recorder(bus, tmp_path):
    publisher = bus.publisher()
    whole = publish(publisher)
    publisher.finish({}, {})
    acks: dict[str, object] = {}
    waiting = threading.Thread(target=lambda: acks.update(publisher.wait_for_ack(10.0)))
    waiting.start()
    worker, listener = work(bus, tmp_path)
    (result,) = worker.run(Event(), once=True)
    waiting.join(5.0)
    assert_whole(result, whole)
    (ack,) = acks.values()
    assert set(acks) == {"w"}
    assert {"run_id": "run-1", "complete": True, "notes": []}.items() <= ack.items()
    other = BusListener(bus.router)  # who comes later still, a web page say, gets the result
    kinds = {}
    while (message := other.get(1.0)) is not None and "result" not in kinds:
        kinds[message.kind] = message
    assert kinds["result"].name == "w"
    assert b'"complete": true' in kinds["result"].payload
    for item in (listener, other, publisher):
        item.close()


def requested(listener: BusListener, keys: Keys, first: int, last: int) -> dict[int, bytes]:
    got: dict[int, bytes] = {}
    listener.ask_blocks(keys, "imu.accel", first, last)
    while (message := listener.get(5.0)) is not None and message.kind != "answered":
        if message.kind == "blocks":
            got.update(unpack_blocks(message))
    return got


def test_an_answer_in_many_replies_is_whole(bus, monkeypatch):
    monkeypatch.setattr(bus_publisher, "REPLY", 5000)
    publisher = bus.publisher(drop_live=1.0)
    publish(publisher)
    key = publisher.keys.key("block", "imu.accel")
    asked = f"{key}?first=3;last={BLOCKS - 1}"
    assert len(list(bus.client.get(asked, consolidation=zenoh.ConsolidationMode.NONE))) > 2
    listener = BusListener(bus.client)
    assert requested(listener, publisher.keys, 3, BLOCKS - 1) == {
        i: message for i, message in bus.spool.messages("imu.accel") if i >= 3
    }
    assert requested(listener, publisher.keys, BLOCKS, BLOCKS + 9) == {}
    listener.close()
    publisher.close()


def test_a_start_record_whose_answer_was_lost_is_asked_for_again(bus, monkeypatch):
    """A program that gets no processor for a while joins a run that is recorded."""
    listener, replies = BusListener(bus.client), BusListener._on_reply
    monkeypatch.setattr(BusListener, "_on_reply", lambda self, reply: None)
    publisher = bus.publisher()
    kinds: list[str] = []

    def heard(kind: str) -> bool:
        kinds.extend(message.kind for _ in range(100) if (message := listener.get(0.02)) is not None)
        return kind in kinds

    wait_until(lambda: heard("alive"))
    monkeypatch.setattr(BusListener, "_on_reply", replies)
    for _ in range(round(bus_listener.ANSWER)):
        publisher.put_ledger({})
    wait_until(lambda: heard("ledger") and kinds.count("ledger") == bus_listener.ANSWER)
    assert "start" not in kinds
    publisher.put_ledger({})
    wait_until(lambda: heard("start"))
    listener.close()
    publisher.close()


def test_recorders_without_number_do_not_fill_the_memory(bus, monkeypatch):
    """Of those that never answer, the last ones are waited for."""
    monkeypatch.setattr(bus_listener, "MOST_ASKED", 3)
    listener, asked = BusListener(bus.client), list[str]()
    monkeypatch.setattr(listener, "ask", lambda keys, *parts: asked.append(keys.run))
    runs = [Keys("car", f"run-{k}") for k in range(5)]
    for keys in runs:
        listener._queue.put(Message(keys, "alive", "", 0, b""), "alive", 1)
    for keys in runs:
        for _ in range(1 + round(bus_listener.ANSWER)):
            listener._queue.put(Message(keys, "ledger", "", 0, b"{}"), "ledger", 1)
    while listener.get(0.0) is not None:
        pass
    assert asked == [*(keys.run for keys in runs), "run-2", "run-3", "run-4"]
    listener.close()


@pytest.mark.parametrize(("drop", "capacity"), [(0.3, 1 << 20), (0.0, 2000)])
def test_blocks_lost_on_the_way_or_in_a_full_queue_are_asked_for(bus, tmp_path, drop, capacity):
    publisher = bus.publisher(drop_live=drop)
    worker, listener = work(bus, tmp_path, capacity)
    time.sleep(0.2)
    whole = publish(publisher)
    time.sleep(0.2)
    assert (listener.dropped > 0) == (capacity == 2000)
    publisher.finish({}, {})
    (result,) = worker.run(Event(), once=True)
    assert_whole(result, whole)
    listener.close()
    publisher.close()


def test_wrong_blocks_are_found_out_by_the_checksum_and_asked_for_again(bus, tmp_path):
    publisher = bus.publisher(drop_live=1.0)
    lines: list[str] = []
    worker, listener = work(bus, tmp_path, notify=lines.append)
    results: list[RunResult] = []
    thread = threading.Thread(target=lambda: results.extend(worker.run(Event(), once=True)))
    thread.start()
    wait_until(lambda: "run run-1: listening" in lines)
    forged = block_to_bytes(samples(CHANNELS["imu.accel"], 0.1, 100.0), 3, "sensor")
    bus.router.put(publisher.keys.key("block", "imu.accel"), forged, attachment=SEQUENCE.pack(3))
    time.sleep(0.2)
    whole = publish(publisher)
    publisher.finish({}, {})
    thread.join(10.0)
    (result,) = results
    assert_whole(result, whole)
    assert any("imu.accel" in note and "asked for again" in note for note in result.notes)
    listener.close()
    publisher.close()


def test_what_is_nowhere_any_more_is_named_and_the_rest_is_used(bus, tmp_path):
    publisher = bus.publisher(drop_live=1.0)
    whole = publish(publisher)
    bus.spool.discard("imu.accel")
    publisher.finish({}, {})
    worker, listener = work(bus, tmp_path, deadline=0.5)
    (result,) = worker.run(Event(), once=True)
    assert not result.complete
    assert result.missing == {"imu.accel": [(0, BLOCKS - 1)]}
    assert "imu.accel: missing blocks 0 to 39" in result.notes
    blocks = LogReader(result.path).blocks()
    assert set(blocks) == set(whole) - {"imu.accel"}
    assert result.work["size"] > 0  # a result is produced from what is there
    listener.close()
    publisher.close()


def test_a_recorder_that_is_only_silent_is_not_given_up(bus, tmp_path):
    publisher = bus.publisher()
    worker, listener = work(bus, tmp_path, patience=0.3)
    results: list[RunResult] = []
    thread = threading.Thread(target=lambda: results.extend(worker.run(Event(), once=True)))
    thread.start()
    time.sleep(1.2)
    assert not results
    whole = publish(publisher)
    publisher.finish({}, {})
    thread.join(10.0)
    assert_whole(results[0], whole)
    listener.close()
    publisher.close()


def test_the_wait_for_a_worker_ends_by_itself_or_when_cancelled(bus):
    publisher = bus.publisher()
    publisher.finish({}, {})
    started = time.monotonic()
    assert publisher.wait_for_ack(0.3) == {}
    assert 0.3 <= time.monotonic() - started < 1.0
    started = time.monotonic()
    assert publisher.wait_for_ack(30.0, lambda: True) == {}
    assert time.monotonic() - started < 1.0
    publisher.close()


def test_a_taken_address_and_an_absent_router_are_explained(bus):
    with pytest.raises(UsageError, match="--listen"):
        open_session(listen=(bus.endpoint,))
    with pytest.raises(UsageError, match="start the recorder"):
        open_session(connect=(f"tcp/127.0.0.1:{free_port()}",), wait=0.3)
    with pytest.raises(UsageError):
        open_session(connect=("nonsense",), wait=0.3)


def test_keys_hold_one_chunk_a_part():
    assert chunk("my rig/no. 1*?") == "my_rig_no._1__"
    assert Keys("rig", "run").key("block", "imu.accel") == "lacet/rig/run/block/imu.accel"


def test_the_sender_knows_whether_anybody_listens():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router, spool = open_session(listen=(endpoint,)), Spool()
    publisher = RunPublisher(router, "bench", StartRecord("run-1", T0, "", rig_text()), spool)
    client = open_session(connect=(endpoint,))
    try:
        assert publisher.listened is None
        publisher.put_block("imu.rate", b"a block", 1)
        wait_until(lambda: publisher.listened is False)
        listener = BusListener(client)
        wait_until(lambda: publisher.listened is True)
        listener.close()
        wait_until(lambda: publisher.listened is False)
    finally:
        client.close()
        publisher.close()
        router.close()
        spool.close()
