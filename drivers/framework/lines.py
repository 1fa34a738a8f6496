"""Lines of text in a stream of bytes: complete ones, with the stamp of the read that held their first byte."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lacet.daq.frames import Frames

LONGEST = 4096
"""Longest line that is waited for [byte]: what has no end within it is no text and is passed over."""


class Line(NamedTuple):
    """A line: the receipt stamp of its first byte [ns], and its bytes without the line feed at its end."""

    t_ns: int
    text: bytes


def split_lines(waiting: Frames, frames: Frames, begin: bytes = b"") -> tuple[list[Line], Frames]:
    """Lines completed by further reads, and the unfinished rest, to be passed as `waiting` the next time.

    The lines do not depend on how the bytes are split into reads, but for their stamps.

    Parameters
    ----------
    waiting, frames : what the last call returned, none at first; and the reads since.
    begin : what a line begins with, where noise may stand before it: from the last one in it on; else the whole line.
    """
    stream = Frames.concat(frames.source, [waiting, frames])
    ends = np.flatnonzero(stream.data == ord("\n"))
    starts = np.concatenate([[0], ends + 1]).astype(np.int64)
    rest, data = int(starts[-1]), stream.data.tobytes()
    if begin:
        found = [data.rfind(begin, start, end) for start, end in zip(starts.tolist(), ends.tolist(), strict=False)]
        starts[:-1] = np.where(np.array(found, np.int64) >= 0, found, starts[:-1])
    reads = np.searchsorted(stream.offset, starts[:-1], side="right") - 1
    lines = [
        Line(int(stream.t_ns[read]), data[start:end])
        for start, end, read in zip(starts[:-1].tolist(), ends.tolist(), reads.tolist(), strict=True)
        if end - start <= LONGEST
    ]
    # Of an endless line the last bytes are kept: it stays longer than any that is used.
    return lines, rest_of(stream, max(rest, len(stream.data) - LONGEST - 1))


def rest_of(stream: Frames, start: int) -> Frames:
    """The reads of a stream from byte `start` on, the first of them truncated."""
    if start >= len(stream.data):
        return Frames.empty(stream.source)
    first = int(np.searchsorted(stream.offset, start, side="right")) - 1
    rest = stream[first:]
    cut = start - int(stream.offset[first])
    offset = np.maximum(rest.offset - cut, 0)
    return Frames(stream.source, rest.t_ns, rest.ident, offset, rest.data[cut:])
