"""CAN messages of one sensor picked from the frames of a bus by their arbitration ids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.can_signal import WORD
from lacet.daq.frames import Frames

TABLE = 1 << 16
"""Ids below this are looked up in a table; that has all standard ids, 11 bits. Extended ones are searched for."""


class Numbering:
    """Index of arbitration ids in a list of distinct ones."""

    def __init__(self, idents: Sequence[int]):
        self._order = np.argsort(idents).astype(np.int16)
        self._sorted = np.array(idents, np.uint32)[self._order]
        self._table: NDArray[np.int16] | None = None
        if max(idents) < TABLE:
            self._table = np.full(max(idents) + 2, -1, np.int16)  # the last entry is for all ids beyond
            self._table[idents] = np.arange(len(idents))

    def of(self, ident: NDArray[np.uint32]) -> NDArray[np.int16]:
        """(N,) index of each id, -1 for one not in the list."""
        if self._table is not None:
            return self._table.take(ident, mode="clip")
        near = np.minimum(np.searchsorted(self._sorted, ident), len(self._sorted) - 1)
        return np.where(self._sorted[near] == ident, self._order[near], np.int16(-1))


@dataclass(frozen=True)
class Parts:
    """Messages of one sensor in a batch: `number` (N,) counts its units' messages; `whole` : if the length is right."""

    number: NDArray[np.int16]
    t_ns: NDArray[np.int64]
    words: NDArray[np.uint64]
    whole: NDArray[np.bool_]

    def __getitem__(self, index: NDArray[np.int64]) -> Parts:
        return Parts(self.number[index], self.t_ns[index], self.words[index], self.whole[index])

    def after(self, begun: Parts) -> Parts:
        """The messages of `begun`, then these."""
        if not len(begun.number):
            return self
        columns = ((getattr(begun, name), getattr(self, name)) for name in ("number", "t_ns", "words", "whole"))
        return Parts(*(np.concatenate(column) for column in columns))


class MessagePicker:
    """Picker of some messages from batches of frames.

    Parameters
    ----------
    idents, lengths : arbitration id and payload length [byte] of each message.
    words : words of a row that holds any payload.
    """

    def __init__(self, idents: Sequence[int], lengths: Sequence[int], words: int):
        self._numbering = Numbering(idents)
        self._words = words
        self._same_length = len(set(lengths)) == 1
        self._length = np.array(lengths, np.int64)
        self.nothing = Parts(
            np.zeros(0, np.int16), np.zeros(0, np.int64), np.zeros((0, words), np.uint64), np.zeros(0, bool)
        )
        """No messages."""

    def of(self, frames: Frames) -> Parts:
        """The messages in a batch, payloads in rows of little-endian words."""
        number, offset, t_ns = self._numbering.of(frames.ident), frames.offset, frames.t_ns
        starts, lengths = offset[:-1], offset[1:] - offset[:-1]
        dense = len(number) and number.min() >= 0
        if not dense:
            mine = np.flatnonzero(number >= 0)
            number, starts, lengths, t_ns = number[mine], starts[mine], lengths[mine], t_ns[mine]
        whole = lengths == (self._length[0] if self._same_length else self._length[number])
        all_whole = bool(whole.all())
        # Views of 8 bytes at every offset, without a copy: one gather a word. Bytes past a payload are never read.
        padded = np.concatenate((frames.data, np.zeros(WORD * (self._words + 1), np.uint8)))
        if dense and self._same_length and self._words == 1 and all_whole:  # at equal distances: no gather either
            words = np.ndarray((len(number), 1), "<u8", padded, int(offset[0]), (int(self._length[0]), WORD))
        else:
            anywhere = np.ndarray((len(padded) - WORD + 1,), "<u8", padded, strides=(1,))
            words = np.stack([anywhere[starts + WORD * w] for w in range(self._words)], axis=1)
        return Parts(number, t_ns, words, whole)
