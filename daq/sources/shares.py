"""Logs whose series lie in the file as whole arrays, each with its times: read in equal shares."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from lacet.daq.sources.source import PIECE_SAMPLES, Array, Listed, Piece, Series, Source, read_by_library


@dataclass(frozen=True)
class Stored:
    """A stored array: its length, and how samples `start` to `stop` are read."""

    count: int
    read: Callable[[int, int], Array]

    @classmethod
    def of(cls, values: Array) -> Stored:
        """One that is in memory."""
        return cls(len(values), lambda start, stop: np.asarray(values[start:stop], float))


@dataclass
class SharedSource(Source):
    """A log of stored arrays.

    `values` : name → its array; `times` : name → key of its times, and `bases` : key → the times [s].
    """

    values: dict[str, Stored] = field(default_factory=dict)
    times: dict[str, str] = field(default_factory=dict)
    bases: dict[str, Stored] = field(default_factory=dict)

    def add(self, listed: Listed, values: Stored, key: str, base: Stored) -> None:
        """One more name with its times."""
        self.listed[listed.name] = listed
        self.values[listed.name], self.times[listed.name], self.bases[key] = values, key, base

    def pieces(self, names: Collection[str]) -> Iterator[Piece]:
        """The same share of every series at a time, so that they go on together whatever their rates."""
        longest = max((self.values[name].count for name in names), default=0)
        parts = max(1, -(-longest // PIECE_SAMPLES))
        for part in range(parts):
            shared: dict[tuple[str, int], Array] = {}
            piece: dict[str, Series] = {}
            for name in names:
                stored, key = self.values[name], self.times[name]
                start, stop = (stored.count * k // parts for k in (part, part + 1))
                if stop == start:
                    continue
                place = (key, stored.count)
                with read_by_library(self.path, f"from sample {start} of '{name}' on"):
                    if place not in shared:
                        shared[place] = self.bases[key].read(start, stop)
                    piece[name] = Series(shared[place], stored.read(start, stop))
            self.done = (part + 1) / parts
            yield piece
