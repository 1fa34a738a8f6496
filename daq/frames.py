"""Received frames: `Frame` for one, `Frames` for many, packed in arrays for vectorised processing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

EXTENDED = 1 << 31
"""Bit of a CAN identifier of 29 bits. In `Frames` it is set only where the number does not show it, up to 0x7FF."""
STANDARD = 0x7FF
"""The largest CAN identifier of 11 bits."""
PUT_BACK = 2.0
"""Step back of a bus's stamps from which it is taken for a clock put back, not for frames out of order [s]. Source: a
choice; loggers of several buses write what they hold back once a second or more often."""


class Frame(NamedTuple):
    """One received frame.

    `source` names the bus as in the rig file; `t_ns` is the receipt stamp [ns since the Unix epoch]; `ident` is the
    CAN arbitration id (0 on serial lines and UDP); `payload` holds one CAN frame's data, one datagram, or the bytes of
    one serial read.
    """

    source: str
    t_ns: int
    ident: int
    payload: bytes


@dataclass(frozen=True)
class Frames:
    """Frames of one source, packed in arrays.

    Attributes
    ----------
    source : bus name as in the rig file.
    t_ns : (N,) int64, receipt stamps [ns].
    ident : (N,) uint32, CAN arbitration ids, see `EXTENDED`; 0 elsewhere.
    offset : (N + 1,) int64; frame i is ``data[offset[i]:offset[i + 1]]``.
    data : (B,) uint8, all payloads end to end.
    """

    source: str
    t_ns: NDArray[np.int64]
    ident: NDArray[np.uint32]
    offset: NDArray[np.int64]
    data: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def lengths(self) -> NDArray[np.int64]:
        """(N,) payload lengths [bytes]."""
        return np.diff(self.offset)

    @classmethod
    def empty(cls, source: str) -> Frames:
        """No frames of `source`."""
        return cls.from_iter(source, ())

    @classmethod
    def from_iter(cls, source: str, frames: Iterable[Frame | tuple[str, int, int, bytes]]) -> Frames:
        """A batch of single frames (whose own `source` is ignored), in the order given."""
        rows = list(frames)
        lengths = np.fromiter((len(row[3]) for row in rows), np.int64, len(rows))
        return cls(
            source,
            np.fromiter((row[1] for row in rows), np.int64, len(rows)),
            np.fromiter((row[2] for row in rows), np.uint32, len(rows)),
            np.concatenate(([0], np.cumsum(lengths))).astype(np.int64),
            np.frombuffer(b"".join(row[3] for row in rows), np.uint8).copy(),
        )

    @classmethod
    def concat(cls, source: str, parts: Iterable[Frames]) -> Frames:
        """Batches joined end to end, in the order given."""
        items = [part for part in parts if len(part)]
        if not items:
            return cls.empty(source)
        lengths = np.concatenate([part.lengths for part in items])
        return cls(
            source,
            np.concatenate([part.t_ns for part in items]),
            np.concatenate([part.ident for part in items]),
            np.concatenate(([0], np.cumsum(lengths))).astype(np.int64),
            np.concatenate([part.data[part.offset[0] : part.offset[-1]] for part in items]),
        )

    def __getitem__(self, index: slice) -> Frames:
        """A contiguous slice (step 1)."""
        start, stop, step = index.indices(len(self))
        if step != 1:
            raise ValueError("Frames can only be sliced with step 1")
        offset = self.offset[start : max(start, stop) + 1]
        return Frames(
            self.source,
            self.t_ns[start:stop],
            self.ident[start:stop],
            offset - offset[0],
            self.data[offset[0] : offset[-1]],
        )

    def frame(self, i: int) -> Frame:
        """Frame `i` as a single object."""
        payload = self.data[self.offset[i] : self.offset[i + 1]].tobytes()
        return Frame(self.source, int(self.t_ns[i]), int(self.ident[i]), payload)

    def __iter__(self):
        return (self.frame(i) for i in range(len(self)))


def wire_idents(ident: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """(N,) identifiers as in `Frames`, from ones that carry `EXTENDED` wherever they have 29 bits."""
    bare = ident & np.uint32(EXTENDED - 1)
    return np.where(bare > STANDARD, bare, ident)


def full_idents(ident: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """(N,) identifiers that carry `EXTENDED` wherever they have 29 bits, from those in `Frames`."""
    return np.where(ident > STANDARD, ident | np.uint32(EXTENDED), ident)
