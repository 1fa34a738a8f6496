"""Cyclic redundancy checks of many messages at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Crc:
    """A CRC algorithm of 8 to 32 bits, a whole number of bytes."""

    name: str
    width: int
    polynomial: int
    initial: int
    reflected: bool
    final_xor: int

    @cached_property
    def table(self) -> NDArray[np.uint32]:
        """(256,) remainder of every byte."""
        mask = (1 << self.width) - 1
        polynomial = int(f"{self.polynomial:0{self.width}b}"[::-1], 2) if self.reflected else self.polynomial
        table = []
        for byte in range(256):
            register = byte if self.reflected else byte << (self.width - 8)
            for _ in range(8):
                if self.reflected:
                    register = (register >> 1) ^ (polynomial if register & 1 else 0)
                else:
                    register = ((register << 1) & mask) ^ (polynomial if register >> (self.width - 1) else 0)
            table.append(register)
        return np.array(table, np.uint32)

    def over(self, rows: NDArray[np.uint8]) -> NDArray[np.uint32]:
        """(N,) CRC of each of N messages of equal length, `rows` (N, length)."""
        register = np.full(len(rows), self.initial, np.uint32)
        mask = np.uint32((1 << self.width) - 1)
        # One table look-up for each byte position, of all messages together.
        for byte in np.ascontiguousarray(rows.T):
            if self.reflected:
                register = (register >> 8) ^ self.table[(register ^ byte) & 0xFF]
            else:
                register = ((register << 8) & mask) ^ self.table[(register >> (self.width - 8)) ^ byte]
        return (register ^ np.uint32(self.final_xor)).astype(np.uint32)


class RowCrc:
    """CRC of some bits of each row of bytes, the sum of what each two bytes contribute by tables.

    Parameters
    ----------
    crc : the algorithm.
    width : length of a row [byte], even.
    message : columns and bits of the message in its order; bits that are not given count as 0.
    """

    def __init__(self, crc: Crc, width: int, message: Sequence[tuple[int, int]]):
        dtype = np.uint8 if crc.width == 8 else np.uint16 if crc.width == 16 else np.uint32
        self._start = dtype(crc.over(np.zeros((1, len(message)), np.uint8))[0])
        alone = np.zeros((len(message), 256, len(message)), np.uint8)  # each value of each byte, the others 0
        for k in range(len(message)):
            alone[k, :, k] = np.arange(256)
        linear = replace(crc, initial=0, final_xor=0).over(alone.reshape(-1, len(message))).astype(dtype)
        columns = np.zeros((width, 256), dtype)
        for k, (column, bits) in enumerate(message):
            columns[column] = linear.reshape(len(message), 256)[k][np.arange(256) & bits]
        pairs = [(i, np.bitwise_xor.outer(columns[2 * i + 1], columns[2 * i]).ravel()) for i in range(width // 2)]
        self._pairs = [(i, table) for i, table in pairs if table.any()]

    def over(self, rows: NDArray[np.uint8]) -> NDArray[Any]:
        """(N,) CRC of each row, `rows` (N, width) contiguous."""
        register = np.full(len(rows), self._start)
        words = rows.view("<u2")
        for i, table in self._pairs:
            register ^= table.take(words[:, i])
        return register


CRC8_J1850 = Crc("CRC-8/SAE-J1850", 8, 0x1D, 0xFF, False, 0xFF)
CRC8_AUTOSAR = Crc("CRC-8/AUTOSAR", 8, 0x2F, 0xFF, False, 0xFF)
CRC16_CCITT_FALSE = Crc("CRC-16/CCITT-FALSE", 16, 0x1021, 0xFFFF, False, 0x0000)
CRC32 = Crc("CRC-32/ISO-HDLC", 32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF)
"""The CRC-32 of zlib and Ethernet."""
