"""CAN transports: SocketCAN where the kernel has it, else python-can's `udp_multicast` format on loopback.

The sockets are lacet's own and not python-can's: they have integer nanosecond stamps and the kernel's drop count, and
cost 8 µs a frame instead of 35. The bytes on the wire are the same, so that python-can's tools are compatible.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
import time
from collections import Counter
from functools import partial

import msgpack

from lacet.daq.frames import EXTENDED, STANDARD, Frames
from lacet.services.acquisition.transports import can_errors
from lacet.services.acquisition.transports.can_errors import BusError
from lacet.services.acquisition.transports.sockets import SocketReceiver, waiting_bytes

_FRAME = struct.Struct("=IB3x8s")  # struct can_frame: id and flags, length, padding, data
_FD_FRAME = struct.Struct("=IBB2x64s")  # struct canfd_frame: id and flags, length, FD flags, reserved, data
_FD = 0x04  # CANFD_FDF
_SOL_CAN_RAW, _ERROR_FILTER, _FD_FRAMES = 101, 2, 5  # linux/can/raw.h: without these no error and FD frames are seen
_REMOTE, _ERROR = 0x4000_0000, 0x2000_0000  # linux/can.h: CAN_{RTR,ERR}_FLAG; CAN_EFF_FLAG is EXTENDED
_ID = 0x1FFF_FFFF
_CAN_RAW = 1
_ROOM = 256 << 10  # bytes waiting at a receiver up to which a sender at full speed continues

GROUP = "239.74.163.2"
"""Default IPv4 multicast group of python-can."""
LOOPBACK = "127.0.0.1"


def has_socketcan(interface: str) -> bool:
    """Whether this kernel has SocketCAN and an interface of that name."""
    if not hasattr(socket, "AF_CAN"):
        return False
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, _CAN_RAW):
            socket.if_nametoindex(interface)
    except OSError:
        return False
    return True


def unpack_socketcan(data: bytes) -> tuple[int, bytes] | None:
    """One ``struct can_frame`` or ``canfd_frame`` → (id, payload); None for error and remote frames."""
    if len(data) == _FRAME.size:
        ident, length, payload = _FRAME.unpack(data)
    elif len(data) == _FD_FRAME.size:
        ident, length, _, payload = _FD_FRAME.unpack(data)
    else:
        raise ValueError("not a CAN frame")
    if ident & (_REMOTE | _ERROR):
        return None
    return _kept(ident & _ID, bool(ident & EXTENDED)), payload[:length]


def pack_socketcan(ident: int, payload: bytes) -> bytes:
    """One ``struct can_frame``, or ``canfd_frame`` where the payload has more than 8 bytes."""
    word = ident | EXTENDED if ident > STANDARD else ident
    if len(payload) <= 8:
        return _FRAME.pack(word, len(payload), payload)
    return _FD_FRAME.pack(word, len(payload), _FD, payload)


def _kept(ident: int, extended: bool) -> int:
    """An identifier as `Frames` have it."""
    return ident | EXTENDED if extended and ident <= STANDARD else ident


def unpack_multicast(data: bytes) -> tuple[int, bytes] | None:
    """One datagram of python-can's `udp_multicast` → (id, payload); None for error and remote frames."""
    try:
        fields = msgpack.unpackb(data)
        if fields["is_remote_frame"] or fields["is_error_frame"]:
            return None
        ident, payload = fields["arbitration_id"], fields["data"]
        if not (isinstance(ident, int) and 0 <= ident <= _ID and isinstance(payload, bytes) and len(payload) <= 64):
            raise ValueError
        ident = _kept(ident, fields["is_extended_id"] is True)
    except (ValueError, TypeError, LookupError, msgpack.exceptions.UnpackException) as error:
        raise ValueError("not a frame of python-can's udp_multicast") from error
    return ident, payload


def pack_multicast(ident: int, payload: bytes) -> bytes:
    """One frame in python-can's `udp_multicast` format; the receiver stamps it."""
    data = msgpack.packb(
        {
            "timestamp": 0.0,
            "arbitration_id": ident & _ID,
            "is_extended_id": ident > STANDARD,
            "is_remote_frame": False,
            "is_error_frame": False,
            "channel": None,
            "dlc": len(payload),
            "data": payload,
            "is_fd": len(payload) > 8,
            "bitrate_switch": False,
            "error_state_indicator": False,
        }
    )
    assert data is not None  # bytes, as no stream is given
    return data


def _open_socketcan(interface: str) -> socket.socket:
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, _CAN_RAW)
    with contextlib.suppress(OSError):  # kernels before 3.6
        sock.setsockopt(_SOL_CAN_RAW, _FD_FRAMES, 1)
    sock.setsockopt(_SOL_CAN_RAW, _ERROR_FILTER, can_errors.MASK)
    try:
        sock.bind((interface,))
    except OSError:
        sock.close()
        raise
    return sock


def socketcan_receiver(source: str, interface: str) -> SocketReceiver:
    """Receiver on a SocketCAN interface. Its `read` raises OSError when the link is down; `open` then waits for it."""
    return SocketReceiver(source, partial(_open_socketcan, interface), unpack_socketcan, BusErrors(interface))


class BusErrors:
    """Counts of the error frames of an interface by class, and sentences for the user: once for each class, for
    bus-off and restart each time."""

    def __init__(self, interface: str):
        self._interface = interface
        self.counts: Counter[str] = Counter()

    def __call__(self, data: bytes) -> str | None:
        """Count a datagram that is no data frame; what is to be said of it."""
        classes = can_errors.error_classes(data)
        lines = []
        for one in classes:
            self.counts[one] += 1
            number = self.counts[one]
            again = one in (BusError.BUS_OFF, BusError.RESTARTED)
            if number == 1 or again:
                lines.append(can_errors.SAYS[one].format(interface=self._interface) + (f" ({number})" if again else ""))
        if not classes:
            self.counts["not_data"] += 1
        return "; ".join(lines) or None


def _open_multicast(group: str, port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((group, port))  # the group's address, not any: another group on this port is another bus
        joined = False
        # Loopback, for lacet's senders, and the default route's interface, for python-can's.
        for interface in (LOOPBACK, "0.0.0.0"):
            try:
                request = socket.inet_aton(group) + socket.inet_aton(interface)
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)
                joined = True
            except OSError:
                continue
        if not joined:
            raise OSError(errno.ENODEV, no_multicast(group))
    except OSError:
        sock.close()
        raise
    return sock


def no_multicast(group: str) -> str:
    """Remedy for a machine without multicast."""
    return f"this machine has no route for multicast group {group}; remedy: sudo ip route add 239.0.0.0/8 dev lo"


def multicast_receiver(source: str, group: str, port: int) -> SocketReceiver:
    """Receiver of python-can's `udp_multicast` frames. Each bus needs a port of its own."""
    return SocketReceiver(source, partial(_open_multicast, group, port), unpack_multicast)


class SocketCanSender:
    """Sender on a SocketCAN interface; frames that it refuses for a second (those of CAN FD where it has
    none, at once) count as `unsent`."""

    def __init__(self, source: str, interface: str):
        self.source = source
        self.unsent = 0
        self.sees_receivers = False
        self.endpoint = f"socketcan:{interface}"
        self._interface = interface
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Open the interface."""
        self._socket = _open_socketcan(self._interface)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 0)  # it never receives

    def send(self, frames: Frames) -> None:
        """Send frames on the bus, in order, waiting for a full transmit queue."""
        assert self._socket is not None
        for ident, payload in _pairs(frames):
            self._send_one(self._socket, pack_socketcan(ident, payload))

    def _send_one(self, sock: socket.socket, data: bytes) -> None:
        until = time.monotonic() + 1.0
        while True:
            try:
                sock.send(data)
                return
            except OSError as error:
                if error.errno != errno.ENOBUFS or time.monotonic() > until:
                    self.unsent += 1
                    return
            time.sleep(0.001)

    def has_room(self) -> bool:
        """True: the receivers' queues of a CAN bus are unknown."""
        return True

    def close(self) -> None:
        """Release the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class MulticastSender:
    """Sender in python-can's `udp_multicast` format, confined to this machine (loopback interface, hop limit 0).

    Parameters
    ----------
    interface : IPv4 address of the sending interface; loopback needs no route and no network.
    """

    def __init__(self, source: str, group: str, port: int, interface: str = LOOPBACK):
        self.source = source
        self.unsent = 0
        self.sees_receivers = True
        self.endpoint = f"multicast:{group}:{port}"
        self._to = (group, port)
        self._interface = interface
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Open the socket, which is no member of the group and so does not receive its own frames."""
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self._interface))
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        except OSError as error:
            sock.close()
            raise OSError(error.errno, no_multicast(self._to[0])) from error
        self._socket = sock

    def send(self, frames: Frames) -> None:
        """Send frames, in order."""
        assert self._socket is not None
        for ident, payload in _pairs(frames):
            try:
                self._socket.sendto(pack_multicast(ident, payload), self._to)
            except OSError as error:
                if error.errno in (errno.ENETUNREACH, errno.EHOSTUNREACH):
                    raise OSError(error.errno, no_multicast(self._to[0])) from error
                self.unsent += 1

    def has_room(self) -> bool:
        """Whether the slowest receiver on this machine has read nearly everything so far."""
        return (waiting_bytes(self._to[1]) or 0) < _ROOM

    def close(self) -> None:
        """Release the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _pairs(frames: Frames) -> list[tuple[int, bytes]]:
    data, offset = frames.data.tobytes(), frames.offset.tolist()
    return [(ident, data[offset[i] : offset[i + 1]]) for i, ident in enumerate(frames.ident.tolist())]
