"""Reading and writing at a place of an open file, also on a system without such calls (Windows)."""

from __future__ import annotations

import mmap
import os


def read_at(descriptor: int, out: memoryview, start: int) -> int:
    """Fill `out` from byte `start` on. Any number of threads may read at once.

    Returns the bytes read: fewer than asked for at the end of the file, and with much to read (some systems: 2 GB).
    """
    if hasattr(os, "preadv"):
        return os.preadv(descriptor, [out], start)
    stop = min(start + len(out), os.fstat(descriptor).st_size)
    if stop <= start:
        return 0
    page = start - start % mmap.ALLOCATIONGRANULARITY
    with mmap.mmap(descriptor, stop - page, access=mmap.ACCESS_READ, offset=page) as mapped:
        out[: stop - start] = mapped[start - page : stop - page]
    return stop - start


def write_at(descriptor: int, data: bytes | memoryview, start: int) -> int:
    """Write from byte `start` on, which may be beyond the end; the bytes written. One thread at a time may write."""
    if hasattr(os, "pwrite"):
        return os.pwrite(descriptor, data, start)
    os.lseek(descriptor, start, os.SEEK_SET)
    return os.write(descriptor, data)
