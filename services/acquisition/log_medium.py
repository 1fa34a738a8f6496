"""Storage medium of a log being written: forced writes in their own thread, stalls, free space, a removed file."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from lacet.services.acquisition.system_calls import force, lock

SYNC_SECONDS = 0.2
"""Period of forced writes [s]: with a chunk of 0.1 s a power cut loses about 0.3 s on a medium that keeps up."""

STALL_SECONDS = 0.5
"""Duration of a forced write from which the medium is said to stall [s]; what is received waits in the queue."""

RESERVE_BYTES = 200_000_000
"""Room that the recording leaves on the disk [bytes]: the system and its programs need some."""

ROOM_BYTES = 100_000_000
"""Room beyond the reserve from which the recording goes on in a new file [bytes]: some minutes of a full rig."""

RATE_SECONDS = 30.0
"""Time over which the log's growth is measured for the forecast [s]."""


class LogMedium:
    """Watcher of a log's file in its own thread, so that a stalled medium does not hold up the recorder.

    Parameters
    ----------
    path : the log, which exists.
    sync, clock : forces what is written to the medium, by file descriptor; monotonic time [s].
    """

    def __init__(
        self,
        path: Path,
        sync: Callable[[int], None] = force,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.path = path
        self.messages: deque[tuple[str, str]] = deque()
        """State in one word, and a sentence for the user; the recorder takes it from here."""
        self.failed = False
        """Whether the file is gone or the medium has reported an error: the log is not safe."""
        self.longest = 0.0
        """Longest time from one forced write's begin to the end of the next: what a power cut could have lost [s]."""
        self._sync, self._clock = sync, clock
        self._fd = os.open(path, os.O_RDONLY)
        lock(self._fd)  # others see that it is being recorded
        self._begun: float | None = None
        self._stall_said = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="log-medium", daemon=True)
        self._sizes = deque([(clock(), self.size())])

    def follow(self, before: LogMedium) -> None:
        """Continue the forecast of the run's file before this one."""
        self._sizes = before._sizes

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread after a last forced write and release the file, without waiting for a stalled medium."""
        if self._stop.is_set():
            return
        self._stop.set()
        self._thread.join(timeout=5.0)
        if not self._thread.is_alive():
            os.close(self._fd)

    def check(self) -> None:
        """Check whether the file is still there and the medium keeps up; call it every second or more often."""
        begun, now = self._begun, self._clock()
        if begun is not None and now - begun > STALL_SECONDS and not self._stall_said:
            self._stall_said = True
            self.messages.append(("stalled", f"the disk of {self.path} stalls; what comes in waits in memory"))
        if not self.failed and not self._is_there():
            self.failed = True
            self.messages.append((
                "gone",
                f"{self.path} WAS REMOVED OR REPLACED: what is recorded is lost when the recording ends. Save it, "
                f"with cp /proc/{os.getpid()}/fd/{self._fd} rescued.mcap, and start a new recording",
            ))  # fmt: skip

    def seconds_to_full(self, written: int) -> float:
        """Time until only `RESERVE_BYTES` are free at the present growth [s]; infinite while nothing grows.

        `written` : bytes that the recording has put on this disk so far, the log and what is kept for the bus.
        """
        now = self._clock()
        self._sizes.append((now, written))
        while now - self._sizes[0][0] > RATE_SECONDS:
            self._sizes.popleft()
        since, first = self._sizes[0]
        if now <= since or written <= first:
            return float("inf")
        return max(0.0, self.free() - RESERVE_BYTES) * (now - since) / (written - first)

    def free(self) -> int:
        """Room on the disk [bytes]."""
        found = os.fstatvfs(self._fd)
        return found.f_bavail * found.f_frsize

    def size(self) -> int:
        """Size of the log [bytes]."""
        return os.fstat(self._fd).st_size

    def _is_there(self) -> bool:
        try:
            found, own = os.stat(self.path), os.fstat(self._fd)
        except OSError:
            return False
        return (found.st_dev, found.st_ino) == (own.st_dev, own.st_ino)

    def _run(self) -> None:
        before = self._clock()
        while True:
            last = self._stop.wait(SYNC_SECONDS)
            self._begun = begun = self._clock()
            try:
                self._sync(self._fd)
            except OSError as error:
                if not self.failed:
                    self.failed = True
                    self.messages.append(
                        ("error", f"the disk of {self.path} reports an error: {error.strerror or error}")
                    )
            ended = self._clock()
            self._begun = None
            self.longest, before = max(self.longest, ended - before), begun
            if self._stall_said:
                self._stall_said = False
                self.messages.append(("running", f"the disk of {self.path} took {ended - begun:.1f} s to write"))
            if last:
                return


def remaining_text(seconds: float) -> str:
    """The forecast in words: ``41 min left``."""
    if seconds > 48 * 3600:
        return ""
    if seconds >= 2 * 3600:
        return f"{seconds / 3600:.0f} h left"
    return f"{seconds / 60:.0f} min left" if seconds >= 120 else f"{seconds:.0f} s left"
