"""Frames over real wires of this machine: values and order come through, stamps are arrival times, losses count."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.frames import Frames
from lacet.services.acquisition.transports.base import Receiver, Sender
from lacet.services.acquisition.transports.can import GROUP, MulticastSender, multicast_receiver
from lacet.services.acquisition.transports.reader import Reader
from lacet.services.acquisition.transports.serial import PtySender, SerialReceiver
from lacet.services.acquisition.transports.udp import UdpSender, udp_receiver
from tests.support.rig import free_port


def some_frames(source: str, n: int, idents: bool) -> Frames:
    rng = np.random.default_rng(n)
    rows = [(source, i, int(rng.integers(1, 0x1FFF_FFFF)) if idents else 0, rng.bytes(1 + i % 8)) for i in range(n)]
    return Frames.from_iter(source, rows)


@contextlib.contextmanager
def pair(kind: str) -> Iterator[tuple[Sender, Receiver]]:
    port = free_port()
    if kind == "multicast":
        sender, receiver = MulticastSender("x", GROUP, port), multicast_receiver("x", GROUP, port)
    elif kind == "udp":
        sender, receiver = UdpSender("x", "127.0.0.1", port), udp_receiver("x", "127.0.0.1", port)
    else:
        sender = PtySender("x")
        sender.open()
        receiver = SerialReceiver("x", sender.device, 460_800)
    receiver.open()
    if kind != "pty":
        sender.open()
    try:
        yield sender, receiver
    finally:
        receiver.close()
        sender.close()


def collect(receiver: Receiver, done, timeout: float = 5.0) -> Frames:
    parts: list[Frames] = []
    until = time.monotonic() + timeout
    while time.monotonic() < until:
        parts.append(receiver.read(0.1))
        if done(parts):
            break
    return Frames.concat("x", parts)


@pytest.mark.parametrize("kind", ["multicast", "udp"])
def test_datagrams_come_through_as_they_are_with_arrival_stamps(kind):
    sent = some_frames("x", 500, kind == "multicast")
    with pair(kind) as (sender, receiver):
        before = time.time_ns()
        sender.send(sent)
        after = time.time_ns()
        time.sleep(0.1)
        got = collect(receiver, lambda parts: sum(map(len, parts)) >= 500)
        assert receiver.losses() == {}
        assert sender.unsent == 0
    np.testing.assert_array_equal(got.data, sent.data)
    np.testing.assert_array_equal(got.offset, sent.offset)
    np.testing.assert_array_equal(got.ident, sent.ident)
    assert got.t_ns.dtype == np.int64
    assert np.all(np.diff(got.t_ns) >= 0)
    # The kernel's stamps: they lie in the sending, not in the reading 0.1 s later.
    assert before <= got.t_ns[0]
    assert got.t_ns[-1] <= after


def test_serial_bytes_come_through_as_they_are():
    sent = some_frames("x", 3000, False)
    with pair("pty") as (sender, receiver):
        thread = threading.Thread(target=sender.send, args=(sent,))
        before = time.time_ns()
        thread.start()
        got = collect(receiver, lambda parts: sum(len(part.data) for part in parts) >= len(sent.data))
        thread.join()
        assert sender.unsent == 0
    np.testing.assert_array_equal(got.data, sent.data)
    assert np.all(got.ident == 0)
    assert before <= got.t_ns[0] <= got.t_ns[-1] <= time.time_ns()


def test_what_the_kernel_drops_is_counted_to_the_frame():
    with pair("udp") as (sender, receiver):
        receiver._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)  # type: ignore[attr-defined]
        sender.send(some_frames("x", 500, False))
        time.sleep(0.05)
        got = collect(receiver, lambda parts: not len(parts[-1]), timeout=1.0)
        dropped = receiver.losses()["kernel"]
    assert 0 < len(got) < 500
    assert len(got) + dropped == 500
    assert receiver.losses()["kernel"] == dropped  # closing keeps the count


def test_datagrams_that_are_no_can_frames_are_counted():
    with pair("multicast") as (sender, receiver):
        sender._socket.sendto(b"noise", sender._to)  # type: ignore[attr-defined]
        sender.send(some_frames("x", 1, True))
        assert len(collect(receiver, lambda parts: len(parts[-1]))) == 1
        assert receiver.losses() == {"malformed": 1}


def test_can_buses_on_two_ports_do_not_hear_each_other():
    with pair("multicast") as (sender, receiver), pair("multicast") as (_, other):
        sender.send(some_frames("x", 5, True))
        assert len(collect(receiver, lambda parts: len(parts[-1]))) == 5
        assert not len(other.read(0.1))


def test_bytes_for_nobody_are_counted_as_on_a_real_line():
    sender = PtySender("x")
    sender.open()
    try:
        sender.send(some_frames("x", 7, False))
        assert sender.unsent == 7
        fd = os.open(sender.device, os.O_RDWR | os.O_NOCTTY)
        sender.send(some_frames("x", 1, False))
        assert sender.unsent == 7
        assert os.read(fd, 100) == some_frames("x", 1, False).data.tobytes()
        os.close(fd)
    finally:
        sender.close()


def test_an_unplugged_line_is_flagged_and_found_again(tmp_path):
    link = tmp_path / "ttyUSB0"
    queue: BoundedQueue[Frames] = BoundedQueue(1000)
    told: list[str] = []
    reader = Reader(SerialReceiver("serial0", str(link), 460_800), queue, told.append)
    reader.start()
    try:
        for round_ in (b"before", b"after"):
            assert not reader.up.wait(0.1)
            sender = PtySender("serial0", str(link))
            sender.open()
            assert reader.up.wait(3.0)
            sender.send(Frames.from_iter("serial0", [("serial0", 0, 0, round_)]))
            got = b""
            while len(got) < len(round_) and (part := queue.get(2.0)) is not None:
                got += part.data.tobytes()
            assert got == round_
            sender.close()
            until = time.monotonic() + 3.0
            while reader.up.is_set() and time.monotonic() < until:
                time.sleep(0.01)
        assert reader.losses() == {"link_down": 2}
        assert "not there" in told[0]
        assert any("link lost" in line for line in told)
        assert any(line == "serial0 is there" for line in told)
    finally:
        reader.stop()
        reader.join()


def test_a_full_queue_is_counted_under_the_bus():
    port = free_port()
    queue: BoundedQueue[Frames] = BoundedQueue(100)
    reader = Reader(udp_receiver("udp0", "127.0.0.1", port), queue, lambda text: None)
    reader.start()
    assert reader.up.wait(2.0)
    sender = UdpSender("udp0", "127.0.0.1", port)
    sender.open()
    for _ in range(20):
        sender.send(some_frames("udp0", 50, False))
        time.sleep(0.01)
    until = time.monotonic() + 2.0
    while reader.received < 1000 and time.monotonic() < until:
        time.sleep(0.01)
    reader.stop()
    reader.join()
    sender.close()
    kept = sum(len(part) for part in queue.drain())
    assert reader.received == 1000
    assert 0 < kept < 1000
    assert kept + queue.dropped["udp0"] == 1000
