"""Intake of a recording: one reader thread a device, and the one bounded queue that they fill."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.frames import Frames
from lacet.services.acquisition.host_clock import HostClock
from lacet.services.acquisition.transports.base import Receiver
from lacet.services.acquisition.transports.reader import Reader

QUEUE_FRAMES = 60_000
"""Capacity of the queue in frames: some eight seconds of a full rig."""

RESUME_FRAMES = 600_000
"""The same for a recording that goes on after it broke off: what it holds already is read meanwhile, ten minutes of a
full rig in some eight seconds."""


class Intake:
    """Readers of the buses, and the queue of what they have received.

    Parameters
    ----------
    receivers : one for each bus.
    notify : called with plain sentences for the user.
    clock : the machine's clock.
    capacity : of the queue [frames].
    """

    def __init__(
        self,
        receivers: Sequence[Receiver],
        notify: Callable[[str], None],
        clock: HostClock | None = None,
        capacity: int = QUEUE_FRAMES,
    ):
        self.clock = clock or HostClock()
        self.queue: BoundedQueue[Frames] = BoundedQueue(capacity)
        self.readers = [Reader(receiver, self.queue, notify, self.clock) for receiver in receivers]
        self._started = False

    def start(self) -> None:
        """Begin to receive; what comes waits in the queue. Starting again does nothing."""
        if not self._started:
            self._started = True
            for reader in self.readers:
                reader.start()

    def stop(self) -> None:
        """End the readers, after frames already received are in the queue."""
        for reader in self.readers:
            reader.stop()
        for reader in self.readers:
            reader.join()
