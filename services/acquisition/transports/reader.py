"""Reader thread of one device: it reads, fills the queue, and reconnects after a failure of the link."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable

from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.formats.events import EventKind, RunEvent
from lacet.daq.frames import Frames
from lacet.services.acquisition.host_clock import HostClock
from lacet.services.acquisition.transports.base import Receiver

RETRY = 0.5
"""Pause between attempts to open a wire that is down [s]."""
_LAST_CALL = 0.5  # s; longest time to read on after a stop, while a sender continues
_TURN = 0.2  # s; timeout of a read, after which the thread checks for a stop


class Reader:
    """Thread that moves frames from a receiver into the queue until it is stopped; a dead link does not end it.

    Parameters
    ----------
    receiver : source of the frames.
    queue : the queue, which drops and counts frames beyond its capacity under the bus name.
    notify : called with a sentence when the link is up, lost, or up again, and with each warning.
    clock : the machine's clock, whose steps are kept out of the stamps.
    """

    def __init__(
        self,
        receiver: Receiver,
        queue: BoundedQueue[Frames],
        notify: Callable[[str], None],
        clock: HostClock | None = None,
    ):
        self.receiver = receiver
        self.received = 0
        """Number of frames received so far, including those that the queue dropped."""
        self.up = threading.Event()
        """Set while the wire is open."""
        self.fault: BaseException | None = None
        """Exception that ended the thread, which the recorder raises again."""
        self._queue = queue
        self._clock = clock or HostClock()
        self._notify = notify
        self.events: deque[RunEvent] = deque()
        """What happened to the wire, for the log; the recorder takes it from here."""
        self._links_lost = 0
        self._warned: set[str] = set()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"reader-{receiver.source}", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the thread to end, after frames already received are in the queue."""
        self._stop.set()

    @property
    def stopping(self) -> bool:
        """Whether it was asked to end."""
        return self._stop.is_set()

    def join(self, timeout: float = 3.0) -> None:
        """Wait for the thread to end."""
        self._thread.join(timeout)

    def losses(self) -> dict[str, int]:
        """The receiver's losses, and ``link_down``: number of failures of the link."""
        counts = Counter(self.receiver.losses())
        if self._links_lost:
            counts["link_down"] = self._links_lost
        return dict(counts)

    def _run(self) -> None:
        complained = False
        try:
            while True:
                try:
                    self.receiver.open()
                except OSError as error:
                    if not complained:
                        self._say("absent", f"{self.receiver.source} is not there ({error}); trying every {RETRY:g} s")
                        complained = True
                    if self._stop.wait(RETRY):
                        return
                    continue
                if complained:
                    self._say("up", f"{self.receiver.source} is there")
                complained = False
                self.up.set()
                self._warn()
                try:
                    self._read()
                    return
                except OSError as error:
                    self._links_lost += 1
                    complained = True
                    self._say("down", f"{self.receiver.source}: link lost ({error}); trying every {RETRY:g} s")
                finally:
                    self.up.clear()
                    self.receiver.close()
                if self._stop.wait(RETRY):
                    return
        except BaseException as error:
            self.fault = error
            raise

    def _warn(self) -> None:
        for warning in self.receiver.warnings:
            if warning not in self._warned:
                self._say("warning", f"{self.receiver.source}: {warning}")
                self._warned.add(warning)

    def _say(self, state: str, text: str) -> None:
        self._notify(text)
        self.events.append(RunEvent(self._clock.now_ns(), EventKind.BUS, self.receiver.source, state, text))

    def _read(self) -> None:
        while not self._stop.is_set():
            self._hand_over(self.receiver.read(_TURN))
            self._warn()
        until = time.monotonic() + _LAST_CALL
        while self._hand_over(self.receiver.read(0.0)) and time.monotonic() < until:  # frames still in the kernel
            pass

    def _hand_over(self, frames: Frames) -> bool:
        if not len(frames):
            return False
        self.received += len(frames)
        self._queue.put(self._clock.without_steps(frames), self.receiver.source, len(frames))
        return True
