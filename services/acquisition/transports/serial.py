"""Serial transports: a real line through pyserial, and a pseudo-terminal in its place for tests."""

from __future__ import annotations

import contextlib
import os
import select
import struct
import time
from collections import Counter
from pathlib import Path

import serial

from lacet.daq.frames import Frame, Frames
from lacet.services.acquisition.system_calls import poller

_TIOCGICOUNT = 0x545D  # linux: struct serial_icounter_struct, 20 ints
_COUNTERS = {"framing": 6, "overrun": 7, "parity": 8, "buffer_overrun": 10}  # indices in it
_PATIENCE = 1.0  # s; longest wait of a sender for a reader that does not read


class SerialReceiver:
    """Receiver on a serial line, 8N1; the bytes of one read are one frame, stamped when the read returned.

    Parameters
    ----------
    baud : symbol rate [1/s]; a pseudo-terminal ignores it.
    """

    def __init__(self, source: str, device: str, baud: int):
        self.source = source
        self.warnings: list[str] = []
        self._device = device
        self._baud = baud
        self._port: serial.Serial | None = None
        self._base: dict[str, int] = {}
        self._losses: Counter[str] = Counter()

    def open(self) -> None:
        """Open the line for exclusive use. Raises OSError (serial.SerialException) when it is absent."""
        port = serial.Serial(self._device, self._baud, timeout=0.0, exclusive=True)
        with contextlib.suppress(OSError, ValueError, NotImplementedError, AttributeError):
            port.set_low_latency_mode(True)  # USB converters: 1 ms instead of a 16 ms timer
        self._port = port
        self._base = _counters(port.fd)

    def read(self, timeout: float) -> Frames:
        """The bytes received, as one frame, waiting up to `timeout` [s]. Raises OSError when the line is unplugged."""
        port = self._port
        if port is None:
            raise OSError(f"{self._device} is closed")
        port.timeout = timeout
        first = port.read(1)
        t_ns = time.time_ns()
        if not first:
            return Frames.empty(self.source)
        waiting = port.in_waiting
        payload = first + port.read(waiting) if waiting else first
        return Frames.from_iter(self.source, [Frame(self.source, t_ns, 0, payload)])

    def losses(self) -> dict[str, int]:
        """``overrun``, ``buffer_overrun``, ``framing``, ``parity``, as counted by the kernel's driver of the line."""
        counts = Counter(self._losses)
        counts.update(self._since_open())
        return {cause: n for cause, n in counts.items() if n}

    def _since_open(self) -> dict[str, int]:
        if self._port is None:
            return {}
        now = _counters(self._port.fd)
        return {cause: n - self._base.get(cause, 0) for cause, n in now.items()}

    def close(self) -> None:
        """Release the line."""
        if self._port is not None:
            self._losses.update(self._since_open())
            with contextlib.suppress(OSError):
                self._port.close()
            self._port = None


def _counters(fd: int | None) -> dict[str, int]:
    """The kernel's error counters of a serial line; empty where the device has none (pseudo-terminals)."""
    try:
        import fcntl  # Linux and macOS have it

        words = struct.unpack("@20i", fcntl.ioctl(fd, _TIOCGICOUNT, bytes(80)))  # type: ignore[arg-type]
    except (ImportError, OSError, TypeError):
        return {}
    return {cause: words[place] for cause, place in _COUNTERS.items()}


class SerialSender:
    """Sender of payloads, end to end, on a real serial line, 8N1."""

    def __init__(self, source: str, device: str, baud: int):
        self.source = source
        self.unsent = 0
        self.sees_receivers = True
        self.endpoint = f"serial:{device}"
        self._device = device
        self._baud = baud
        self._port: serial.Serial | None = None

    def open(self) -> None:
        """Open the line."""
        self._port = serial.Serial(self._device, self._baud, write_timeout=_PATIENCE, exclusive=True)

    def send(self, frames: Frames) -> None:
        """Send the bytes, waiting for the line at its symbol rate."""
        assert self._port is not None
        try:
            self._port.write(frames.data.tobytes())
        except serial.SerialTimeoutException:
            self.unsent += len(frames)

    def has_room(self) -> bool:
        """True: `send` itself waits for the line."""
        return True

    def close(self) -> None:
        """Release the line."""
        if self._port is not None:
            self._port.close()
            self._port = None


class PtySender:
    """Sender on a pseudo-terminal, whose other end a receiver opens like a serial device.

    As on a real line, bytes sent while no receiver has the other end open are lost (`unsent`).

    Parameters
    ----------
    link : path of a symbolic link to the device, so that its name is known beforehand; none if None.

    Attributes
    ----------
    device : path of the receiver's end, e.g. ``/dev/pts/3``; known after `open`.
    """

    def __init__(self, source: str, link: str | None = None):
        self.source = source
        self.unsent = 0
        self.sees_receivers = True
        self.device = ""
        self.endpoint = "pty"
        self._link = Path(link) if link else None
        self._master = -1
        self._poll = poller()

    def open(self) -> None:
        """Create the pseudo-terminal and the link."""
        import tty  # Linux and macOS have it

        master, slave = os.openpty()
        tty.setraw(slave)
        self.device = os.ttyname(slave)
        os.close(slave)  # from now on POLLHUP means that no process has the other end open
        os.set_blocking(master, False)
        if self._link is not None:
            if self._link.is_symlink():
                self._link.unlink()
            self._link.symlink_to(self.device)
        self._master = master
        self._poll = poller()
        self._poll.register(master, select.POLLOUT)
        self.endpoint = f"serial:{self._link or self.device}"

    @property
    def has_reader(self) -> bool:
        """Whether a process has the other end open."""
        return not any(events & select.POLLHUP for _, events in self._poll.poll(0))

    def send(self, frames: Frames) -> None:
        """Send the bytes, waiting up to a second for a slow reader."""
        remaining = memoryview(frames.data.tobytes())
        until = time.monotonic() + _PATIENCE
        while remaining:
            if not self.has_reader:
                break
            try:
                remaining = remaining[os.write(self._master, remaining) :]
                continue
            except BlockingIOError:
                if time.monotonic() > until:
                    break
            self._poll.poll(50)
        if remaining:
            sent = frames.data.size - len(remaining)
            self.unsent += int((frames.offset[1:] > sent + frames.offset[0]).sum())

    def has_room(self) -> bool:
        """True: `send` itself waits for the reader."""
        return True

    def close(self) -> None:
        """Close the pseudo-terminal, and remove the link."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1
            if self._link is not None and self._link.is_symlink():
                self._link.unlink()
