"""Signals of CAN frames: where a value stands among the bytes, taken from all frames at once by NumPy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

WORD = 8
"""Length of a word [byte]: rows of frames are whole 64-bit words, so that a signal is one shift of one word."""


def row_width(length: int) -> int:
    """Length of a row that holds `length` bytes of payload [byte]: whole words, at least one."""
    return max(1, -(-length // WORD)) * WORD


@dataclass(frozen=True)
class Signal:
    """One signal of a message: ``physical = raw * factor + offset`` [unit].

    Attributes
    ----------
    start : start bit as in the DBC: the lowest bit in little-endian order, the highest in big-endian order.
    low, high : end values of the raw range: those of the bits, narrowed to [minimum|maximum] where the DBC gives them.
    """

    name: str
    start: int
    length: int
    big_endian: bool
    signed: bool
    factor: float
    offset: float
    unit: str
    low: int
    high: int

    @cached_property
    def _first(self) -> int:
        """Distance of the leading bit from the start of the row, in the order of the signal."""
        return self.start // 8 * 8 + 7 - self.start % 8 if self.big_endian else self.start

    @cached_property
    def bits(self) -> frozenset[int]:
        """Bits that the signal occupies: 8 × byte + bit, bit 0 the lowest of the byte."""
        stream = range(self._first, self._first + self.length)
        return frozenset(s // 8 * 8 + 7 - s % 8 for s in stream) if self.big_endian else frozenset(stream)

    def bare(self) -> Signal:
        """The signal without its name: equal for signals that are extracted alike."""
        return replace(self, name="")

    @cached_property
    def _masks(self) -> list[tuple[int, np.uint8, int]]:
        """For each byte of the signal: its index, its bits, and the shift of the raw value to it."""
        last = self._first + self.length - 1
        return [
            (
                byte,
                np.uint8(sum(1 << (bit % 8) for bit in self.bits if bit // 8 == byte)),
                last - 8 * byte - 7 if self.big_endian else 8 * byte - self.start,
            )
            for byte in range(self._first // 8, last // 8 + 1)
        ]

    @cached_property
    def aligned(self) -> tuple[int, str] | None:
        """First byte and type of a signal that is a whole number in memory, None for any other."""
        if self.length not in (8, 16, 32, 64) or self._first % 8:
            return None
        return self._first // 8, f"{'>' if self.big_endian else '<'}{'i' if self.signed else 'u'}{self.length // 8}"

    def raw(self, rows: NDArray[np.uint8]) -> NDArray[Any]:
        """Raw value of each row.

        Parameters
        ----------
        rows : (N, W) payloads, W a multiple of 8, contiguous along the last axis; bytes past the payload are not read.

        Returns
        -------
        (N,) integers of any type that holds them.
        """
        if self.aligned is not None:
            begin, kind = self.aligned
            return rows[:, begin : begin + self.length // 8].view(kind)[:, 0]
        base = min(self._first // 8, rows.shape[1] - WORD)
        skip = self._first - 8 * base
        order = ">u8" if self.big_endian else "<u8"
        word = rows[:, base : base + WORD].view(order)[:, 0].astype(np.uint64, copy=False)
        over = max(0, skip + self.length - 64)
        if over:  # the signal extends into a ninth byte
            ninth = rows[:, base + WORD].astype(np.uint64)
            if self.big_endian:
                word = (word << np.uint64(over)) | (ninth >> np.uint64(8 - over))
            else:
                word = (word >> np.uint64(skip)) | (ninth << np.uint64(64 - skip))
            skip = 64 - self.length if self.big_endian else 0
        # Shift the signal to the top of the word, then down with or without its sign.
        up = skip if self.big_endian else 64 - skip - self.length
        top = word << np.uint64(up)
        down = 64 - self.length
        if self.signed:
            return top.view(np.int64) >> np.int64(down)
        bare = top >> np.uint64(down)
        return bare if self.length == 64 else bare.view(np.int64)

    def put(self, rows: NDArray[np.uint8], raw: NDArray[Any] | int) -> None:
        """Write raw values (N,) into `rows` (N, W) in place; other bits are unchanged."""
        value = np.broadcast_to(np.asarray(raw), len(rows)).astype(np.uint64)
        for byte, mask, down in self._masks:
            part = value >> np.uint64(down) if down >= 0 else value << np.uint64(-down)
            rows[:, byte] = (rows[:, byte] & ~mask) | (part.astype(np.uint8) & mask)

    def physical(self, raw: NDArray[Any]) -> NDArray[np.float64]:
        """(N,) values in the unit of the DBC [unit]."""
        return raw * self.factor + self.offset
