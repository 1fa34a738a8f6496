"""Numbers of CAN messages by their arbitration ids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

TABLE = 1 << 16
"""Ids below this are looked up in a table; that has all standard ids, 11 bits. Extended ones are searched for."""


class Numbering:
    """Place of each of some distinct arbitration ids in their list."""

    def __init__(self, idents: Sequence[int]):
        self._order = np.argsort(idents).astype(np.int16)
        self._sorted = np.array(idents, np.uint32)[self._order]
        self._table: NDArray[np.int16] | None = None
        if max(idents) < TABLE:
            self._table = np.full(max(idents) + 2, -1, np.int16)  # the last entry is for all ids beyond
            self._table[idents] = np.arange(len(idents))

    def of(self, ident: NDArray[np.uint32]) -> NDArray[np.int16]:
        """(N,) number of each id, -1 for an id that is none of them."""
        if self._table is not None:
            return self._table.take(ident, mode="clip")
        near = np.minimum(np.searchsorted(self._sorted, ident), len(self._sorted) - 1)
        return np.where(self._sorted[near] == ident, self._order[near], np.int16(-1))
