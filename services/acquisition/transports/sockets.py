"""Base of the receivers on datagram sockets: kernel stamps, kernel drop counts, large receive buffers."""

from __future__ import annotations

import select
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Protocol

from lacet.daq.frames import Frames
from lacet.services.acquisition.system_calls import poller

SO_TIMESTAMPNS = 35  # linux/socket.h; the kernel's receipt stamp as a struct timespec
SO_RCVBUFFORCE = 33  # as SO_RCVBUF, not clipped by net.core.rmem_max; needs CAP_NET_ADMIN
SO_MEMINFO = 55  # counters of the socket; the last is the number of datagrams dropped because the buffer was full
_DROPS = 8  # index of SK_MEMINFO_DROPS
_TIMESPEC = struct.Struct("@qq")
_LARGEST = 65_536  # bytes; the largest datagram
RECEIVE_BUFFER = 8 << 20
"""Size requested for the receive buffer [bytes].

Small datagrams cost some 800 bytes each, so that it holds about 1.3 s of a full rig; the system's default loses frames
above 10,000 frames/s."""
GATHER = 0.005
"""Pause between the first frame of a batch and reading the batch [s].

The kernel has stamped the frames already, so that one wake-up for many costs no accuracy."""
_BATCH = 4096  # frames read before other threads get a turn

Unpack = Callable[[bytes], tuple[int, bytes] | None]
"""One datagram → (CAN id, payload); None for other than data frames, ValueError for no frame at all."""


def enlarge_buffer(sock: socket.socket, wanted: int = RECEIVE_BUFFER) -> str | None:
    """Enlarge the receive buffer to `wanted` [bytes], read it back, and return a warning where it was limited."""
    try:
        sock.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, wanted)
    except OSError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted)
    got = sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2  # the kernel doubles the size requested
    if got >= wanted:
        return None
    return (
        f"the receive buffer is {got >> 10} KiB instead of {wanted >> 10} KiB, so frames can be lost when the machine "
        f"is busy; remedy: sudo sysctl -w net.core.rmem_max={wanted}"
    )


def kernel_drops(sock: socket.socket) -> int:
    """Number of datagrams that the kernel dropped because this socket's receive buffer was full.

    The counter that SO_RXQ_OVFL attaches to frames, read directly: that option does not report frames lost after the
    last one received.
    """
    try:
        data = sock.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 64)
    except OSError:  # closed, or a kernel before 4.12
        return 0
    words = struct.unpack(f"@{len(data) // 4}I", data)
    return words[_DROPS] if len(words) > _DROPS else 0


@cache
def switch_stamps_on() -> socket.socket:
    """A socket that makes the kernel stamp datagrams on arrival, from now until this process ends.

    The kernel switches stamping on with the first socket that requests it, but with a delay: datagrams in between are
    stamped when they are read, tens of milliseconds late and after younger ones. A socket that receives nothing
    therefore requests it first.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    time.sleep(0.05)
    return sock


class OtherFrames(Protocol):
    """What becomes of frames that carry no data: counted by cause in `counts`; a call gives a sentence for the user."""

    counts: Counter[str]

    def __call__(self, data: bytes) -> str | None: ...


class Uncounted:
    """Other frames under one cause, ``not_data``."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()

    def __call__(self, data: bytes) -> str | None:
        """Count one."""
        self.counts["not_data"] += 1


class SocketReceiver:
    """Receiver on a datagram socket; `connect` opens the socket, `unpack` parses one datagram, `others` takes those
    that carry no data.

    Attributes
    ----------
    source, warnings : see `Receiver`.
    """

    def __init__(
        self, source: str, connect: Callable[[], socket.socket], unpack: Unpack, others: OtherFrames | None = None
    ):
        self.source = source
        self.warnings: list[str] = []
        self._connect = connect
        self._unpack = unpack
        self._others = others or Uncounted()
        self._socket: socket.socket | None = None
        self._poll = poller()
        self._losses: Counter[str] = Counter()
        self._failed: OSError | None = None

    def open(self) -> None:
        """Open the wire. Raises OSError when it is absent."""
        switch_stamps_on()
        sock = self._connect()
        try:
            warning = enlarge_buffer(sock)
            if warning and warning not in self.warnings:
                self.warnings.append(warning)
            sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            sock.setblocking(False)
            error = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if error:  # a CAN interface that exists but is down reports it here
                raise OSError(error, f"{self.source} is not up")
        except OSError:
            sock.close()
            raise
        self._socket, self._failed = sock, None
        self._poll = poller()
        self._poll.register(sock, select.POLLIN)

    def read(self, timeout: float) -> Frames:
        """Frames received, waiting up to `timeout` [s]. Raises OSError when the link is down."""
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
                    if (line := self._others(data)) is not None:
                        self.warnings.append(line)
                    continue
                rows.append((source, _stamp(ancillary), *content))
        except BlockingIOError:
            pass
        except OSError as error:
            self._failed = error  # frames received before the failure are returned; the next read raises
        return Frames.from_iter(source, rows)

    def losses(self) -> dict[str, int]:
        """``kernel`` (receive buffer full), ``malformed`` (no frame), ``not_data`` (remote frames), and error frames by
        class (`transports.can_errors.BusError`)."""
        counts = self._losses + self._others.counts
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
    """The kernel's receipt stamp, or the present time [ns since the Unix epoch]."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            return seconds * 1_000_000_000 + nanoseconds
    return time.time_ns()


def waiting_bytes(port: int) -> int | None:
    """Bytes waiting in the fullest receive buffer of this machine's IPv4 UDP sockets on `port`.

    None without such a socket, or where the system does not report it.
    """
    try:
        lines = Path("/proc/net/udp").read_text().splitlines()[1:]
    except OSError:
        return None
    wanted = f"{port:04X}"
    queues = [int(words[4].split(":")[1], 16) for words in map(str.split, lines) if words[1].split(":")[1] == wanted]
    return max(queues, default=None)
