"""Spool: store of a run's numbered messages, from which any of them can be sent again while the run lasts."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.file_places import read_at, write_at
from lacet.daq.formats.wire import Tally

MEMORY = 64 << 20
"""Largest size of messages held in memory when the disk is full [bytes]; about four minutes of a full rig."""
LONGEST_RUN = 24 * 3600.0
"""Duration of the longest run [s]."""
BLOCK_RATE = 40.0
"""Most blocks a second of one channel [1/s]: twice what a recorder makes (`BATCH`)."""
MOST_BLOCKS = round(LONGEST_RUN * BLOCK_RATE)
"""Most blocks of one channel in a run: numbers from here on are not stored, whoever sends them."""
MOST_GAPS = 1000
"""Most stretches of missing blocks that are named at once."""

_ENTRY = np.dtype([("offset", "<u8"), ("length", "<u4")])


class Spool:
    """A store of messages by name and sequence number, in anonymous temporary files (they vanish with the process).

    Safe to use from several threads. Where each message is stands in a sparse file too, so that neither many messages
    nor high numbers take memory. When the disk is full, messages are kept in memory up to `memory`; after that they
    are not kept, and `read` does not find them.

    Parameters
    ----------
    folder : folder of the temporary files; None for the system's.
    memory : largest size of messages in memory [bytes].
    """

    def __init__(self, folder: Path | None = None, memory: int = MEMORY):
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 (closed by `close`)
        self._index = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 (closed by `close`)
        self._end = 0
        self._table: dict[str, int] = {}  # name → its place in the index
        self._tables = 0
        self._ends: dict[str, int] = {}
        self._most_memory = memory
        self._memory: dict[tuple[str, int], bytes] = {}
        self._memory_bytes = 0
        self._lock = threading.Lock()

    def add(self, name: str, sequence: int, message: bytes) -> bool:
        """Store message number `sequence` of `name`; one that is stored already is kept unchanged.

        Returns False when it could not be stored: there is no room, or no run has that many blocks.
        """
        if not 0 <= sequence < MOST_BLOCKS or not message:
            return False
        with self._lock:
            if name not in self._table:
                self._table[name], self._tables = self._tables, self._tables + 1
            if (name, sequence) in self._memory or self._entries(name, sequence, sequence + 1)["length"][0]:
                return True
            entry = np.array([(self._end, len(message))], _ENTRY).tobytes()
            if not (_write(self._file, message, self._end) and _write(self._index, entry, self._at(name, sequence))):
                return self._remember(name, sequence, message)
            self._end += len(message)
            self._ends[name] = max(self._ends.get(name, 0), sequence + 1)
            return True

    def _remember(self, name: str, sequence: int, message: bytes) -> bool:
        if self._memory_bytes + len(message) > self._most_memory:
            return False
        self._memory[name, sequence] = message
        self._memory_bytes += len(message)
        self._ends[name] = max(self._ends.get(name, 0), sequence + 1)
        return True

    def _at(self, name: str, sequence: int) -> int:
        return (self._table[name] * MOST_BLOCKS + sequence) * _ENTRY.itemsize

    def _entries(self, name: str, first: int, end: int) -> NDArray[Any]:
        """Places of messages `first` to `end` − 1; those of length 0 are not stored."""
        out = np.zeros(end - first, _ENTRY)
        found = _read(self._index, out.nbytes, self._at(name, first))
        whole = len(found) // _ENTRY.itemsize
        out[:whole] = np.frombuffer(found, _ENTRY, whole)
        return out

    def read(self, name: str, sequence: int) -> bytes | None:
        """The message, or None when it is not stored."""
        with self._lock:
            if not 0 <= sequence < self._ends.get(name, 0):
                return None
            (entry,) = self._entries(name, sequence, sequence + 1)
            if not entry["length"]:
                return self._memory.get((name, sequence))
            return _read(self._file, int(entry["length"]), int(entry["offset"]))

    def names(self) -> list[str]:
        """Names with stored messages."""
        with self._lock:
            return sorted(self._ends)

    def messages(self, name: str) -> Iterator[tuple[int, bytes]]:
        """(sequence number, message) of all stored messages of `name`, in sequence."""
        for sequence in range(self.end(name)):
            message = self.read(name, sequence)
            if message is not None:
                yield sequence, message

    def end(self, name: str) -> int:
        """One more than the highest sequence number stored, 0 when there is none."""
        with self._lock:
            return self._ends.get(name, 0)

    def gaps(self, name: str, end: int, begin: int = 0) -> list[tuple[int, int]]:
        """The first `MOST_GAPS` stretches (first, last) of numbers from `begin` to below `end` that are not stored."""
        out: list[tuple[int, int]] = []
        known = max(begin, min(end, self.end(name)))
        for at in range(begin, known, 1 << 16):
            with self._lock:
                absent = self._entries(name, at, min(at + (1 << 16), known))["length"] == 0
                numbers = [i for i in (np.flatnonzero(absent) + at).tolist() if (name, i) not in self._memory]
            for i in numbers:
                if out and out[-1][1] == i - 1:
                    out[-1] = (out[-1][0], i)
                elif len(out) == MOST_GAPS:
                    return out
                else:
                    out.append((i, i))
        if end > known:
            first = out.pop()[0] if out and out[-1][1] == known - 1 else known
            out.append((first, end - 1))
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
            self._table.pop(name, None)
            self._ends.pop(name, None)
            for key in [key for key in self._memory if key[0] == name]:
                self._memory_bytes -= len(self._memory.pop(key))

    def close(self) -> None:
        """Release memory and disk space."""
        with self._lock:
            self._file.close()
            self._index.close()


def _read(file: Any, length: int, at: int) -> bytes:
    """What is there of `length` bytes at that place."""
    out = bytearray(length)
    return bytes(out[: read_at(file.fileno(), memoryview(out), at)])


def _write(file: Any, data: bytes, at: int) -> bool:
    """Whether all of `data` could be written at that place."""
    try:
        return write_at(file.fileno(), data, at) == len(data)
    except OSError:
        return False
