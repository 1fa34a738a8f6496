"""One reader thread a device: reads, puts into the queue, and reconnects when the link goes down."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable

from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.frames import Frames
from lacet.services.acquisition.transports.base import Receiver

RETRY = 0.5
"""Pause between attempts to open a wire that is down [s]."""
_LAST_CALL = 0.5  # s; a sender that goes on does not keep the thread from ending
_TURN = 0.2  # s; how long a read waits before the thread looks whether it shall stop


class Reader:
    """Moves frames from one receiver into the queue until it is stopped; a dead link is never the end.

    Parameters
    ----------
    receiver : where frames come from.
    queue : where they go; what does not fit is dropped and counted there, under the bus name.
    notify : called with one plain sentence when the link is found, lost, or found again, and with each warning.
    """

    def __init__(self, receiver: Receiver, queue: BoundedQueue[Frames], notify: Callable[[str], None]):
        self.receiver = receiver
        self.received = 0
        """Frames received so far, those the queue dropped included."""
        self.up = threading.Event()
        """Set while the wire is open."""
        self.fault: BaseException | None = None
        """A bug that ended the thread; the recorder raises it again."""
        self._queue = queue
        self._notify = notify
        self._links_lost = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"reader-{receiver.source}", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the thread to end, after it has handed over what has already come."""
        self._stop.set()

    @property
    def stopping(self) -> bool:
        """Whether it was asked to end."""
        return self._stop.is_set()

    def join(self, timeout: float = 3.0) -> None:
        """Wait for the thread to end."""
        self._thread.join(timeout)

    def losses(self) -> dict[str, int]:
        """The receiver's losses, and ``link_down``: how often the link went down."""
        counts = Counter(self.receiver.losses())
        if self._links_lost:
            counts["link_down"] = self._links_lost
        return dict(counts)

    def _run(self) -> None:
        complained = False
        warned: set[str] = set()
        try:
            while True:
                try:
                    self.receiver.open()
                except OSError as error:
                    if not complained:
                        self._notify(f"{self.receiver.source} is not there ({error}); trying every {RETRY:g} s")
                        complained = True
                    if self._stop.wait(RETRY):
                        return
                    continue
                if complained:
                    self._notify(f"{self.receiver.source} is there")
                complained = False
                self.up.set()
                for warning in self.receiver.warnings:
                    if warning not in warned:
                        self._notify(f"{self.receiver.source}: {warning}")
                warned.update(self.receiver.warnings)
                try:
                    self._read()
                    return
                except OSError as error:
                    self._links_lost += 1
                    complained = True
                    self._notify(f"{self.receiver.source}: link lost ({error}); trying every {RETRY:g} s")
                finally:
                    self.up.clear()
                    self.receiver.close()
                if self._stop.wait(RETRY):
                    return
        except BaseException as error:
            self.fault = error
            raise

    def _read(self) -> None:
        while not self._stop.is_set():
            self._hand_over(self.receiver.read(_TURN))
        until = time.monotonic() + _LAST_CALL
        while self._hand_over(self.receiver.read(0.0)) and time.monotonic() < until:  # what the kernel still holds
            pass

    def _hand_over(self, frames: Frames) -> bool:
        if not len(frames):
            return False
        self.received += len(frames)
        self._queue.put(frames, self.receiver.source, len(frames))
        return True
