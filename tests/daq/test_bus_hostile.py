"""Whatever arrives over the bus, worker and recorder live, take little memory, and the true run is whole."""

from __future__ import annotations

import os
import resource
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.blocks import Block
from lacet.daq.bus import publisher as bus_publisher
from lacet.daq.bus.listener import BusListener, Message
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import LARGEST, SEQUENCE, Keys, open_session, split_key
from lacet.daq.bus.spool import MOST_BLOCKS, Spool
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.wire import (
    Manifest,
    StartRecord,
    Tally,
    block_to_bytes,
    manifest_to_bytes,
    start_to_bytes,
)
from lacet.services.acquisition import claims
from lacet.services.acquisition.assembly import Assembly
from lacet.services.acquisition.worker import MOST_RUNS_OF_A_CAR, RunResult, Worker
from tests.daq.test_bus import BLOCKS, Bus, assert_whole, publish, wait_until
from tests.support.rig import T0, free_port, rig_text, samples

MEMORY = 500 << 20
"""Most further memory that anything received may take [bytes]."""

Attack = Callable[[zenoh.Session, Keys], list[Any]]
"""Sends what it sends beside a run with these keys; what it returns is kept up until the end."""
BLOCK = block_to_bytes(samples(CHANNELS["imu.accel"], 0.1, 100.0), 5, "sensor")
EMPTY = block_to_bytes(Block("imu.accel", np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.uint8)), 0, "sensor")
FALSE_MANIFEST = manifest_to_bytes(Manifest("run-1", {"imu.accel": Tally(1, 10, 7)}))
HUGE_MANIFEST = manifest_to_bytes(Manifest("run-1", {name: Tally(1 << 40, 1 << 40, 7) for name in CHANNELS}))


def put(*parts: str, payload: bytes = BLOCK, attachment: bytes | None = None) -> Attack:
    """An attack by one message under the true run's key."""

    def attack(session: zenoh.Session, keys: Keys) -> list[Any]:
        blocking = zenoh.CongestionControl.BLOCK
        session.put(keys.key(*parts), payload, attachment=attachment, congestion_control=blocking)
        return []

    return attack


def false_run(car: str, run: str, manifest: bytes, run_id: str | None = None) -> Attack:
    """An attack by a run with its own recorder, which holds no blocks; without a `car`, one of the true car."""

    def attack(session: zenoh.Session, keys: Keys) -> list[Any]:
        false = Keys(car or keys.car, run)
        start = start_to_bytes(StartRecord(run if run_id is None else run_id, T0, "", rig_text()))
        kept: list[Any] = [
            session.declare_queryable(
                false.key(name), lambda query, answer=payload: query.reply(str(query.key_expr), answer)
            )
            for name, payload in (("start", start), ("manifest", manifest))
        ]
        session.put(false.key("block", "imu.accel"), BLOCK, attachment=SEQUENCE.pack(5))
        session.put(false.key("manifest"), manifest)
        return [*kept, session.liveliness().declare_token(false.key("alive"))]

    return attack


def many_runs(session: zenoh.Session, keys: Keys) -> list[Any]:
    """An attack by runs without number."""
    for i in range(3000):
        session.put(Keys(keys.car, f"false-{i}").key("block", "imu.accel"), BLOCK, attachment=SEQUENCE.pack(5))
    return []


ATTACKS: dict[str, Attack] = {
    "a block with a high number": put("block", "imu.accel", attachment=SEQUENCE.pack(3_000_000_000)),
    "a block with the highest number": put("block", "imu.accel", attachment=b"\xff" * 8),
    "a block without samples": put("block", "imu.accel", payload=EMPTY, attachment=SEQUENCE.pack(0)),
    "a block that is none": put("block", "imu.accel", payload=b"\x00\xff" * 50, attachment=SEQUENCE.pack(1)),
    "a block of a channel that does not exist": put("block", "no.such", attachment=SEQUENCE.pack(5)),
    "a random attachment": put("block", "imu.accel", attachment=struct.pack("<Q", 0x9E3779B97F4A7C15)),
    "an attachment of a wrong length": put("block", "imu.accel", attachment=b"123"),
    "a message that is too large": put("block", "imu.accel", payload=bytes(LARGEST + 1), attachment=SEQUENCE.pack(2)),
    "a message of 200 MB": put("manifest", payload=bytes(200 << 20)),
    "a false start record": put("start", payload=start_to_bytes(StartRecord("run-1", 0, "", "no rig"))),
    "a false manifest in mid-run": put("manifest", payload=FALSE_MANIFEST),
    "a manifest of 2^40 blocks": put("manifest", payload=HUGE_MANIFEST),
    "a manifest that is none": put("manifest", payload=b"\xff" * 100),
    "a ledger that is none": put("ledger", payload=b"\xff{"),
    "a result that is none": put("result", "w", payload=b"\xff{"),
    "a key that is none": put("block", "imu.accel", "more", "parts"),
    "a false acknowledgement": put("ack", "w", payload=b'{"run_id": "run-1", "complete": true, "notes": []}'),
    "an acknowledgement with a false digest": put("ack", "w", payload=b'{"complete": true, "digest": "0"}'),
    "an acknowledgement that is no JSON": put("ack", "w", payload=b"\xff{"),
    "a false claim": lambda session, keys: [session.liveliness().declare_token(keys.key("claim", "a"))],
    "an acknowledgement of brackets": put("ack", "w", payload=b"[" * 60_000),
    "a run name of 300 letters": false_run("bench", "n" * 300, HUGE_MANIFEST),
    "a run named as the folder above": false_run("bench", "..", HUGE_MANIFEST),
    "a run of 2^40 blocks": false_run("bench", "huge", HUGE_MANIFEST),
    "a run of as many blocks as there may be": false_run(
        "bench", "long", manifest_to_bytes(Manifest("long", {name: Tally(MOST_BLOCKS, 1, 7) for name in CHANNELS}))
    ),
    "a run with another's start record": false_run("bench", "false", FALSE_MANIFEST, "run-1"),
    "runs without number": many_runs,
    "an older run's name": false_run("", "older", manifest_to_bytes(Manifest("older", {}))),
}


@pytest.fixture(scope="module")
def sessions() -> Iterator[tuple[zenoh.Session, zenoh.Session, zenoh.Session]]:
    """A router's session, a client's and an attacker's."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    opened = open_session(listen=(endpoint,)), open_session(connect=(endpoint,)), open_session(connect=(endpoint,))
    yield opened
    for session in reversed(opened):
        session.close()


@pytest.fixture
def bus(sessions: tuple[zenoh.Session, zenoh.Session, zenoh.Session], monkeypatch: pytest.MonkeyPatch) -> Iterator[Bus]:
    monkeypatch.setattr(bus_publisher, "OTHERS", 0.1)
    monkeypatch.setattr(claims, "SETTLE", 0.05)
    monkeypatch.setattr(claims, "TAKE_OVER", 0.3)
    spool = Spool()
    yield Bus(sessions[0], sessions[1], spool, "", f"run-{time.monotonic_ns()}")
    spool.close()


@contextmanager
def working(bus: Bus, folder: Path) -> Iterator[tuple[list[RunResult], threading.Thread]]:
    """A worker in a thread, ended at the latest with the block."""
    listener, stop = BusListener(bus.client), Event()
    results: list[RunResult] = []
    worker = Worker(listener, folder, "true", lambda path: {}, notify=print, patience=1.0, deadline=1.0)
    thread = threading.Thread(target=lambda: results.extend(worker.run(stop)))
    thread.start()
    yield results, thread
    stop.set()
    thread.join(10.0)
    listener.close()


@pytest.mark.parametrize("name", ATTACKS)
def test_the_true_run_is_whole(sessions: Any, bus: Bus, tmp_path: Path, name: str):
    older = tmp_path / "older.mcap"
    older.write_bytes(b"an older run")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    attacker, kept, acks = sessions[2], list[Any](), dict[str, Any]()
    publisher = bus.publisher()
    with working(bus, tmp_path) as (results, thread):
        time.sleep(0.1)
        kept += ATTACKS[name](attacker, publisher.keys)
        time.sleep(0.1)
        whole = publish(publisher)
        ATTACKS[name](attacker, publisher.keys)
        publisher.finish({}, {})
        ATTACKS[name](attacker, publisher.keys)
        acks.update(publisher.wait_for_ack(10.0))
        wait_until((tmp_path / f"{bus.run_id}.result.json").exists)
        assert thread.is_alive()
    assert set(acks) == {"true"}  # and by no false one
    (result,) = (found for found in results if found.run_id == bus.run_id)
    assert_whole(result, whole)
    assert older.read_bytes() == b"an older run"
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < MEMORY
    for item in (publisher, *kept):
        item.close() if item is publisher else item.undeclare()


def test_without_a_worker_a_false_acknowledgement_does_not_end_the_wait(bus: Bus):
    publisher = bus.publisher()
    publish(publisher)
    publisher.finish({}, {})
    for payload in (b'{"run_id": "run-1", "complete": true, "digest": "00"}', b"{", b"[]", b'{"complete": false}'):
        bus.client.put(publisher.keys.key("ack", "false"), payload)
    started = time.monotonic()
    assert publisher.wait_for_ack(0.5) == {}
    assert time.monotonic() - started >= 0.5
    publisher.close()


def test_one_car_opens_a_few_runs_only(bus: Bus, tmp_path: Path):
    lines: list[str] = []
    listener, stop = BusListener(bus.client), Event()
    worker = Worker(listener, tmp_path, "w", lambda path: {}, notify=lines.append)
    thread = threading.Thread(target=lambda: worker.run(stop))
    thread.start()
    spool = Spool()
    publishers = [
        RunPublisher(bus.router, "a", StartRecord(f"run-{i}", T0), spool) for i in range(MOST_RUNS_OF_A_CAR + 2)
    ]
    until = time.monotonic() + 5.0
    while not any("was not taken" in line for line in lines) and time.monotonic() < until:
        time.sleep(0.02)
    stop.set()
    thread.join(10.0)
    assert sum("listening" in line for line in lines) == MOST_RUNS_OF_A_CAR
    assert any(f"car a: a further run was not taken, {MOST_RUNS_OF_A_CAR} are open" in line for line in lines)
    for item in (listener, *publishers, spool):
        item.close()


def test_a_fault_in_one_run_is_not_the_end_of_the_worker(bus: Bus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    taken = Assembly.take

    def faulty(assembly: Assembly, message: Message) -> None:
        if assembly.keys.car == "b":
            raise ZeroDivisionError("nobody thought of that")
        taken(assembly, message)

    monkeypatch.setattr(Assembly, "take", faulty)
    spool = Spool()
    false = RunPublisher(bus.router, "b", StartRecord("run-2", T0), spool)
    publisher = bus.publisher()
    with working(bus, tmp_path) as (results, _):
        time.sleep(0.1)
        false.put_ledger({})
        whole = publish(publisher)
        publisher.finish({}, {})
        assert set(publisher.wait_for_ack(10.0)) == {"true"}
        wait_until((tmp_path / f"{bus.run_id}.result.json").exists)
    assert_whole(results[0], whole)
    for item in (publisher, false, spool):
        item.close()


KINDS = st.sampled_from(["block", "blocks", "manifest", "ledger", "alive", "gone", "answered"])
START = StartRecord("run-1", T0, "", rig_text())


@st.composite
def mutated(draw: st.DrawFn, true: bytes) -> bytes:
    """A true message with some bytes changed, or cut off."""
    data = bytearray(true[: draw(st.integers(0, len(true)))] if draw(st.booleans()) else true)
    for place, value in draw(
        st.lists(st.tuples(st.integers(0, max(0, len(data) - 1)), st.integers(0, 255)), max_size=8)
    ):
        if data:
            data[place] = value
    return bytes(data)


PAYLOADS = st.one_of(st.binary(max_size=200), mutated(BLOCK), mutated(FALSE_MANIFEST), mutated(start_to_bytes(START)))


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.tuples(KINDS, st.sampled_from([*CHANNELS][:3]), st.integers(0, 2**64 - 1), PAYLOADS, st.booleans()),
        max_size=12,
    )
)
def test_any_messages_leave_an_assembly_that_can_be_written(tmp_path_factory: pytest.TempPathFactory, messages):
    path = tmp_path_factory.getbasetemp() / f"any-{os.getpid()}.mcap"
    assembly = Assembly(Keys("car", "run-1"), START, path.parent)
    for kind, channel, number, payload, requested in messages:
        assembly.take(Message(assembly.keys, kind, channel, number, payload, requested))
    assembly.request()
    assembly.write(path, complete=False)
    assembly.close()
    path.unlink()


@given(st.text(max_size=120))
def test_any_key_is_one_of_a_run_or_none(text):
    found = split_key(f"lacet/car/{text}/block/imu.accel")
    assert found is None or (len(found[0].run.encode()) <= 80 and not found[0].run.startswith("."))


def test_a_true_block_passes_the_checks_that_false_ones_do_not(tmp_path: Path):
    assembly = Assembly(Keys("car", "run-1"), START, tmp_path)
    whole = samples(CHANNELS["imu.accel"], BLOCKS / 10, 100.0)
    for i in range(BLOCKS):
        part = slice(10 * i, 10 * i + 10)
        message = block_to_bytes(
            Block("imu.accel", whole.t_ns[part], whole.values[part], whole.flags[part]), i, "sensor"
        )
        assembly.take(Message(assembly.keys, "block", "imu.accel", i, message))
    assert assembly.notes == []
    assert assembly.missing() == {}
    assembly.close()


def test_a_wrong_bit_in_an_assembled_log_costs_a_tenth_of_a_second(tmp_path: Path):
    assembly = Assembly(Keys("car", "run-1"), START, tmp_path)
    whole = samples(CHANNELS["imu.accel"], 4.0, 100.0)
    for i in range(80):
        index = slice(5 * i, 5 * i + 5)
        part = Block("imu.accel", whole.t_ns[index], whole.values[index], whole.flags[index])
        message = block_to_bytes(part, i, "sensor")
        assembly.take(Message(assembly.keys, "block", "imu.accel", i, message))
    assembly.write(tmp_path / "run.mcap", complete=False)
    assembly.close()
    data = bytearray((tmp_path / "run.mcap").read_bytes())
    costs: list[int] = []
    for at in range(data.index(b"zstd") + 100, len(data) // 2, len(data) // 40):
        data[at] ^= 1
        (tmp_path / "flipped.mcap").write_bytes(data)
        data[at] ^= 1
        costs.append(len(whole) - len(LogReader(tmp_path / "flipped.mcap").blocks()["imu.accel"]))
    assert max(costs) <= 15  # samples of 10 ms: a chunk of 0.1 s, and the block that ends it
    assert max(costs) > 0
