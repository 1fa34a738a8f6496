"""What the receivers on datagram sockets share: kernel stamps, kernel drop counts, large receive buffers."""

from __future__ import annotations

import socket
import struct
import time
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from select import POLLIN, poll

from lacet.daq.frames import Frames

SO_TIMESTAMPNS = 35  # linux/socket.h; the kernel's receipt stamp as a struct timespec
SO_RCVBUFFORCE = 33  # as SO_RCVBUF, not clipped by net.core.rmem_max; needs CAP_NET_ADMIN
SO_MEMINFO = 55  # counters of the socket; the last is the number of datagrams dropped because the buffer was full
_DROPS = 8  # index of SK_MEMINFO_DROPS
_TIMESPEC = struct.Struct("@qq")
_LARGEST = 65_536  # bytes; the largest datagram
RECEIVE_BUFFER = 8 << 20
"""Receive buffer asked for [bytes]. Small datagrams cost some 800 bytes each, so this holds about 1.3 s of a full rig;
the system's default loses frames from 10,000 frames/s on."""
GATHER = 0.005
"""Pause between the first frame of a batch and reading the batch [s]. The kernel has stamped the frames already, so
nothing is lost by waking once for many."""
_BATCH = 4096  # frames read before the loop gives the others a turn

Unpack = Callable[[bytes], tuple[int, bytes] | None]
"""One datagram → (CAN id, payload); None for what is no data frame, ValueError for what is no frame at all."""


def enlarge_buffer(sock: socket.socket, wanted: int = RECEIVE_BUFFER) -> str | None:
    """Raise the receive buffer to `wanted` [bytes], read it back, and return a warning when it was clipped."""
    try:
        sock.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, wanted)
    except OSError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted)
    got = sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2  # the kernel doubles what it is asked for
    if got >= wanted:
        return None
    return (
        f"the receive buffer is {got >> 10} KiB instead of {wanted >> 10} KiB, so frames can be lost when the machine "
        f"is busy; remedy: sudo sysctl -w net.core.rmem_max={wanted}"
    )


def kernel_drops(sock: socket.socket) -> int:
    """Datagrams the kernel dropped because this socket's receive buffer was full.

    The same counter that SO_RXQ_OVFL attaches to frames, read directly: that option says nothing of the frames lost
    after the last one that arrived.
    """
    try:
        data = sock.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 64)
    except OSError:  # closed, or a kernel before 4.12
        return 0
    words = struct.unpack(f"@{len(data) // 4}I", data)
    return words[_DROPS] if len(words) > _DROPS else 0


@cache
def switch_stamps_on() -> socket.socket:
    """Make the kernel stamp what arrives, from now until this process ends.

    The kernel switches stamping on with the first socket that asks, but a moment later: what arrives in between is
    stamped when it is read, tens of milliseconds late and after younger frames. A socket that receives nothing
    therefore asks first.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    time.sleep(0.05)
    return sock


class SocketReceiver:
    """A receiver on a datagram socket; `connect` makes the socket, `unpack` reads one datagram.

    Attributes
    ----------
    source, warnings : see `Receiver`.
    """

    def __init__(self, source: str, connect: Callable[[], socket.socket], unpack: Unpack):
        self.source = source
        self.warnings: list[str] = []
        self._connect = connect
        self._unpack = unpack
        self._socket: socket.socket | None = None
        self._poll = poll()
        self._losses: Counter[str] = Counter()
        self._failed: OSError | None = None

    def open(self) -> None:
        """Open the wire; OSError when it is not there."""
        switch_stamps_on()
        sock = self._connect()
        try:
            warning = enlarge_buffer(sock)
            if warning and warning not in self.warnings:
                self.warnings.append(warning)
            sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            sock.setblocking(False)
            error = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if error:  # a CAN interface that exists but is down says so here
                raise OSError(error, f"{self.source} is not up")
        except OSError:
            sock.close()
            raise
        self._socket, self._failed = sock, None
        self._poll = poll()
        self._poll.register(sock, POLLIN)

    def read(self, timeout: float) -> Frames:
        """Frames that came, waiting up to `timeout` [s]; OSError when the link went down."""
        sock = self._socket
        if sock is None:
            raise OSError(f"{self.source} is closed")
        if self._failed is not None:
            raise self._failed
        if not self._poll.poll(timeout * 1000.0):
            return Frames.empty(self.source)
        time.sleep(GATHER)
        rows: list[tuple[str, int, int, bytes]] = []
        source, unpack = self.source, self._unpack
        try:
            while len(rows) < _BATCH:
                data, ancillary, flags, _ = sock.recvmsg(_LARGEST, 64)
                if flags & socket.MSG_TRUNC:
                    self._losses["malformed"] += 1
                    continue
                try:
                    content = unpack(data)
                except ValueError:
                    self._losses["malformed"] += 1
                    continue
                if content is None:
                    self._losses["not_data"] += 1
                    continue
                rows.append((source, _stamp(ancillary), *content))
        except BlockingIOError:
            pass
        except OSError as error:
            self._failed = error  # hand over what came before the link went down; the next read raises
        return Frames.from_iter(source, rows)

    def losses(self) -> dict[str, int]:
        """``kernel`` (receive buffer full), ``malformed`` (no frame), ``not_data`` (error and remote frames)."""
        counts = Counter(self._losses)
        if self._socket is not None:
            counts["kernel"] += kernel_drops(self._socket)
        return {cause: n for cause, n in counts.items() if n}

    def close(self) -> None:
        """Release the socket; its drop count is kept."""
        if self._socket is not None:
            self._losses["kernel"] += kernel_drops(self._socket)
            self._socket.close()
            self._socket = None


def _stamp(ancillary: list[tuple[int, int, bytes]]) -> int:
    """The kernel's receipt stamp, or now [ns since the Unix epoch]."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            return seconds * 1_000_000_000 + nanoseconds
    return time.time_ns()


def waiting_bytes(port: int) -> int | None:
    """Bytes that wait in the fullest receive buffer among this machine's IPv4 UDP sockets on `port`.

    None when nobody listens or the system does not say.
    """
    try:
        lines = Path("/proc/net/udp").read_text().splitlines()[1:]
    except OSError:
        return None
    wanted = f"{port:04X}"
    queues = [int(words[4].split(":")[1], 16) for words in map(str.split, lines) if words[1].split(":")[1] == wanted]
    return max(queues, default=None)
