"""Error frames of a CAN controller: counted by class, told with the remedy, and no data is lost beside them."""

from __future__ import annotations

import socket
import struct
import threading
import time

import can
import pytest
from can.interfaces.socketcan.socketcan import build_can_frame

from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.formats.events import EventKind
from lacet.daq.frames import Frames
from lacet.services.acquisition.transports.can import BusErrors, pack_socketcan, unpack_socketcan
from lacet.services.acquisition.transports.can_errors import MASK, SAYS, BusError, error_classes
from lacet.services.acquisition.transports.reader import Reader
from lacet.services.acquisition.transports.sockets import SocketReceiver

CLASSES = [
    (0x001, 0, BusError.TIMEOUT),
    (0x004, 0x01, BusError.OVERFLOW),
    (0x004, 0x04, BusError.WARNING),
    (0x004, 0x08, BusError.WARNING),
    (0x004, 0x10, BusError.PASSIVE),
    (0x004, 0x20, BusError.PASSIVE),
    (0x008, 0, BusError.PROTOCOL),
    (0x010, 0, BusError.TRANSCEIVER),
    (0x020, 0, BusError.NO_ACK),
    (0x040, 0, BusError.BUS_OFF),
    (0x080, 0, BusError.BUS_ERROR),
    (0x100, 0, BusError.RESTARTED),
]


def error(bits: int, status: int = 0) -> bytes:
    """An error frame as the kernel gives it."""
    return struct.pack("=IB3x8s", 0x2000_0000 | bits, 8, bytes([0, status, 0, 0, 0, 0, 0, 0]))


@pytest.mark.parametrize(("bits", "status", "name"), CLASSES)
def test_classes_are_those_of_the_kernel(bits, status, name):
    assert error_classes(error(bits, status)) == (name,)
    assert MASK & bits
    assert unpack_socketcan(error(bits, status)) is None


def test_several_at_once_and_none():
    assert error_classes(error(0x0CC, 0x14)) == (
        BusError.PROTOCOL, BusError.BUS_OFF, BusError.BUS_ERROR, BusError.WARNING, BusError.PASSIVE,
    )  # fmt: skip
    assert error_classes(error(0x202)) == ()  # lost arbitration, and error counters: no errors
    assert not MASK & 0x202
    remote = bytes(build_can_frame(can.Message(arbitration_id=0x1C8, is_remote_frame=True, dlc=4)))
    assert error_classes(remote) == error_classes(b"") == ()
    assert set(SAYS) == set(BusError)


def test_error_frames_between_data_are_counted_told_and_nothing_else_is_lost():
    """At the full rate of the bus: two error frames beside every data frame."""
    port: list[int] = []

    def connect() -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(("127.0.0.1", 0))
        port.append(sock.getsockname()[1])
        return sock

    queue: BoundedQueue[Frames] = BoundedQueue(100_000)
    told: list[str] = []
    receiver = SocketReceiver("can0", connect, unpack_socketcan, BusErrors("can0"))
    reader = Reader(receiver, queue, told.append)
    reader.start()
    assert reader.up.wait(5.0)
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.connect(("127.0.0.1", port[0]))
    for i in range(300):
        wire.send(error(0x008))
        wire.send(pack_socketcan(0x100 + i, i.to_bytes(2, "big")))
        wire.send(error(0x004, 0x10))
        if i % 50 == 0:
            time.sleep(0.002)
    wire.send(error(0x040))
    wire.send(error(0x100))
    wire.send(error(0x040))
    until = time.monotonic() + 5.0
    while receiver.losses().get("bus_off", 0) < 2 and time.monotonic() < until:
        threading.Event().wait(0.01)
    reader.stop()
    reader.join()
    frames = Frames.concat("can0", queue.drain())
    assert frames.ident.tolist() == [0x100 + i for i in range(300)]
    counts = {"protocol_error": 300, "error_passive": 300, "bus_off": 2, "restarted": 1}
    assert receiver.losses() == counts
    mine = [line.removeprefix("can0: ") for line in told if "receive buffer" not in line]
    assert [line.split(":")[0] for line in mine] == [
        "frames with errors on the bus", "too many errors on the bus (error passive)",
        "bus-off", "the controller was restarted (1)", "bus-off",
    ]  # fmt: skip
    assert "sudo ip link set can0 type can restart" in mine[2]
    assert [one.text.removeprefix("can0: ") for one in reader.events if "receive buffer" not in one.text] == mine
    assert {(one.kind, one.name) for one in reader.events} == {(EventKind.BUS, "can0")}
