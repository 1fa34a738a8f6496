"""Spool: store of a run's numbered messages, from which any of them can be sent again while the run lasts."""

from __future__ import annotations

import os
import tempfile
import threading
from array import array
from collections.abc import Iterator
from pathlib import Path

from lacet.daq.formats.wire import Tally

MEMORY = 64 << 20
"""Largest size of messages held in memory when the disk is full [bytes]; about four minutes of a full rig."""


class Spool:
    """A store of messages by name and sequence number, in an anonymous temporary file (it vanishes with the process).

    Safe to use from several threads. When the disk is full, messages are kept in memory up to `MEMORY`; after that
    they are not kept, and `read` does not find them.

    Parameters
    ----------
    folder : folder of the temporary file; None for the system's.
    """

    def __init__(self, folder: Path | None = None):
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 (closed by `close`)
        self._end = 0
        self._offset: dict[str, array[int]] = {}
        self._length: dict[str, array[int]] = {}  # 0: not stored
        self._memory: dict[tuple[str, int], bytes] = {}
        self._memory_bytes = 0
        self._lock = threading.Lock()

    def add(self, name: str, sequence: int, message: bytes) -> None:
        """Store message number `sequence` of `name`; one that is stored already is kept unchanged."""
        with self._lock:
            offset = self._offset.setdefault(name, array("Q"))
            length = self._length.setdefault(name, array("Q"))
            if (sequence < len(length) and length[sequence]) or (name, sequence) in self._memory or not message:
                return
            try:
                written = os.pwrite(self._file.fileno(), message, self._end)
            except OSError:
                written = 0
            if written < len(message):
                self._remember(name, sequence, message)
                return
            missing = sequence + 1 - len(length)
            if missing > 0:
                offset.extend([0] * missing)
                length.extend([0] * missing)
            offset[sequence], length[sequence] = self._end, len(message)
            self._end += len(message)

    def _remember(self, name: str, sequence: int, message: bytes) -> None:
        if self._memory_bytes + len(message) <= MEMORY:
            self._memory[name, sequence] = message
            self._memory_bytes += len(message)

    def read(self, name: str, sequence: int) -> bytes | None:
        """The message, or None when it is not stored."""
        with self._lock:
            length = self._length.get(name, ())
            if not 0 <= sequence < len(length) or not length[sequence]:
                return self._memory.get((name, sequence))
            return os.pread(self._file.fileno(), length[sequence], self._offset[name][sequence])

    def names(self) -> list[str]:
        """Names with stored messages."""
        with self._lock:
            return sorted(self._length)

    def messages(self, name: str) -> Iterator[tuple[int, bytes]]:
        """(sequence number, message) of all stored messages of `name`, in sequence."""
        for sequence in range(self.end(name)):
            message = self.read(name, sequence)
            if message is not None:
                yield sequence, message

    def end(self, name: str) -> int:
        """One more than the highest sequence number stored, 0 when there is none."""
        with self._lock:
            remembered = [sequence for key, sequence in self._memory if key == name]
            return max(len(self._length.get(name, ())), max(remembered, default=-1) + 1)

    def gaps(self, name: str, end: int) -> list[tuple[int, int]]:
        """(first, last) of each stretch of sequence numbers below `end` that is not stored."""
        with self._lock:
            length = self._length.get(name, ())
            known = len(length)
            absent = [
                i for i in range(end) if not (i < known and length[i]) and (name, i) not in self._memory
            ]  # short in the ordinary case: blocks lost on the network
        out: list[tuple[int, int]] = []
        for i in absent:
            if out and out[-1][1] == i - 1:
                out[-1] = (out[-1][0], i)
            else:
                out.append((i, i))
        return out

    def checksum(self, name: str) -> int:
        """CRC-32 over the messages in sequence, as in a manifest."""
        tally = Tally()
        for _, message in self.messages(name):
            tally = tally.add(message, 0)
        return tally.checksum

    def discard(self, name: str) -> None:
        """Remove every message of `name`, to be fetched again after a wrong checksum."""
        with self._lock:
            self._offset.pop(name, None)
            self._length.pop(name, None)
            for key in [key for key in self._memory if key[0] == name]:
                self._memory_bytes -= len(self._memory.pop(key))

    def close(self) -> None:
        """Release memory and disk space."""
        with self._lock:
            self._file.close()
