"""Store of the numbered blocks of a channel: the newest in memory, earlier ones on disk, those not needed dropped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Block
from lacet.daq.set_aside import ArraysOnDisk, DiskSpace

STRETCH = 200
"""Number of blocks that go to disk together: 10 s as a recorder makes them."""
HELD = 6
"""Number of stretches behind the newest that stay in memory: a minute."""


@dataclass(frozen=True)
class _Stretch:
    """Consecutive blocks of a channel on disk; `end_ns` stamp of their last sample [ns]."""

    channel: str
    end_ns: int
    arrays: ArraysOnDisk[str]

    @classmethod
    def of(cls, block: Block, space: DiskSpace) -> _Stretch:
        # Stamps are written bit by bit: as numbers, nanoseconds would not be whole.
        arrays = {"t_ns": _as_float(block.t_ns), "values": block.values, "flags": block.flags.astype(float)}
        if block.device_ns is not None:
            arrays["device_ns"] = _as_float(block.device_ns)
        return cls(block.channel, int(block.t_ns[-1]), space.put(arrays))

    def read(self) -> Block:
        """The blocks, joined."""
        found = dict(self.arrays)
        device = found["device_ns"].view(np.int64) if "device_ns" in found else None
        return Block(
            self.channel, found["t_ns"].view(np.int64), found["values"], found["flags"].astype(np.uint8), device
        )


def _as_float(stamps: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.ascontiguousarray(stamps, np.int64).view(np.float64)


class BlockStore:
    """The blocks of one channel by number.

    Attributes
    ----------
    end : one past the last number that is here or was.
    """

    def __init__(self) -> None:
        self._held: dict[int, dict[int, Block]] = {}
        self._aside: dict[int, _Stretch] = {}
        self._first = 0
        self.end = 0

    def add(self, number: int, block: Block, space: DiskSpace) -> bool:
        """Add a block that is not empty; returns whether old ones went to the `space` on disk.

        Raises OSError when the disk is full; the blocks are then still in memory.
        """
        stretch = number // STRETCH
        if stretch < self._first or stretch in self._aside:
            return False
        self._held.setdefault(stretch, {})[number] = block
        self.end = max(self.end, number + 1)
        newest = (self.end - 1) // STRETCH
        whole = [old for old in self._held if old < newest - HELD and len(self._held[old]) == STRETCH]
        for old in whole:
            blocks = self._held[old]
            self._aside[old] = _Stretch.of(Block.concat(blocks[k] for k in sorted(blocks)), space)
            del self._held[old]
        return bool(whole)

    def read(self, from_ns: int, to_ns: int) -> Block | None:
        """The samples in the order of their blocks, without blocks before `from_ns` or after `to_ns`; None for none."""
        found = list(self._back_from_the_end(from_ns, to_ns))
        return Block.concat(reversed(found)) if found else None

    def _back_from_the_end(self, from_ns: int, to_ns: int) -> Iterator[Block]:
        for stretch in sorted({*self._held, *self._aside}, reverse=True):
            held = self._held.get(stretch, {})
            parts = [held[number] for number in sorted(held, reverse=True)]
            if not held:
                aside = self._aside[stretch]
                parts = [aside.read()] if aside.end_ns >= from_ns else []
                if not parts:
                    return
            for block in parts:
                if int(block.t_ns[-1]) < from_ns:
                    return
                if int(block.t_ns[0]) <= to_ns:
                    yield block

    def forget(self, before_ns: int) -> None:
        """Drop the stretches all of whose samples are before a time [ns]."""
        for stretch in sorted({*self._held, *self._aside}):
            held = self._held.get(stretch)
            end_ns = self._aside[stretch].end_ns if held is None else int(held[max(held)].t_ns[-1])
            if end_ns >= before_ns or stretch == (self.end - 1) // STRETCH:
                return
            self._held.pop(stretch, None)
            self._aside.pop(stretch, None)
            self._first = stretch + 1
