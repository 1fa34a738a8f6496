"""Lines of text in a stream of bytes: complete ones, with the stamp of the read that held their first byte."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lacet.daq.frames import Frames

LONGEST = 4096
"""Longest line that is waited for [byte]: what has no end within it is no text and is passed over."""


class Line(NamedTuple):
    """A line: the receipt stamp of its first byte [ns], and its bytes without the line's end."""

    t_ns: int
    text: bytes


def split_lines(waiting: Frames, frames: Frames) -> tuple[list[Line], Frames]:
    """Lines completed by further reads, and what waits for its end, to be given as `waiting` the next time.

    The lines do not depend on how the bytes are split into reads, but for their stamps.
    """
    stream = Frames.concat(frames.source, [waiting, frames])
    ends = np.flatnonzero(stream.data == ord("\n"))
    starts = np.concatenate([[0], ends + 1]).astype(np.int64)
    reads = np.searchsorted(stream.offset, starts[:-1], side="right") - 1
    data = stream.data.tobytes()
    lines = [
        Line(int(stream.t_ns[read]), data[start:end].rstrip(b"\r"))
        for start, end, read in zip(starts[:-1].tolist(), ends.tolist(), reads.tolist(), strict=True)
        if end - start <= LONGEST
    ]
    rest = int(starts[-1])
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
