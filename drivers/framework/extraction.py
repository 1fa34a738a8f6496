"""Values of all channels of a CAN sensor's samples at once: those laid out alike in one array operation."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.drivers.framework.can_layout import Component, Reading

CHUNK = 8192
"""Samples extracted at a time: what is in between stays in a processor's cache."""


class Extraction:
    """Extraction of the readings of one unit from its samples.

    Parameters
    ----------
    readings : channels of the unit.
    width : bytes of a message in a sample.
    """

    def __init__(self, readings: Sequence[Reading], width: int):
        components = [(component, reading.cyclic) for reading in readings for component in reading.components]
        counts = [len(reading.components) for reading in readings]
        self._of_reading = [slice(end - count, end) for count, end in zip(counts, accumulate(counts), strict=True)]
        self._groups = [
            _Group(kind, list(those), width)
            for (kind, _), those in groupby(components, lambda entry: (_kind(entry[0]), entry[1]))
        ]

    def values(self, samples: NDArray[np.uint8]) -> tuple[list[NDArray[np.float64]], NDArray[np.bool_]]:
        """Values (N, k) of each reading [SI], and (readings, N) whether any component is at the end of its range.

        The values are parts of one array, a component contiguous: the operating system gives a large one large pages.
        """
        values = np.empty((sum(len(group.factor) for group in self._groups), len(samples)))
        saturated = np.zeros((len(self._of_reading), len(samples)), bool)
        for begin in range(0, len(samples), CHUNK):
            part = slice(begin, begin + CHUNK)
            self._extract(samples[part], values[:, part], saturated[:, part])
        return [values[rows].T for rows in self._of_reading], saturated

    def _extract(self, samples: NDArray[np.uint8], values: NDArray[np.float64], saturated: NDArray[np.bool_]) -> None:
        first = 0
        for group in self._groups:
            raw = group.raw(samples)
            own = slice(first, first + len(raw))
            first = own.stop
            found = np.multiply(raw, group.factor, out=values[own])
            if group.offset is not None:
                found += group.offset
            if group.si is not None:
                found *= group.si
            if group.cyclic:
                continue
            ends = raw <= group.low
            ends |= raw >= group.high
            if ends.any():
                for reading, rows in enumerate(self._of_reading):
                    for row in range(max(rows.start, own.start), min(rows.stop, own.stop)):
                        saturated[reading] |= ends[row - own.start]


class _Group:
    """Components that follow each other and are of one type in memory, cyclic or not.

    `factor`, `offset`, `si`, `low` and `high` are (k, 1); `offset` and `si` are None where they change nothing.
    """

    def __init__(self, kind: str | None, those: list[tuple[Component, bool]], width: int):
        self._kind = kind
        self._components = [component for component, _ in those]
        self.cyclic = those[0][1]
        signals = [component.signal for component in self._components]
        starts = [width * c.part + (c.signal.aligned or (0,))[0] for c in self._components]
        self._items = np.array(starts) // (1 if kind is None else int(kind[2:]))
        self.factor = np.array([[signal.factor] for signal in signals])
        self.offset = self.si = None
        if any(signal.offset != 0.0 or signal.factor < 0.0 for signal in signals):  # else 0 added to +0 or a number
            self.offset = np.array([[signal.offset] for signal in signals])
        if any(component.si != 1.0 for component in self._components):
            self.si = np.array([[component.si] for component in self._components])
        dtype = kind and np.dtype(kind).newbyteorder("=")
        self.low, self.high = (np.array([[getattr(s, end)] for s in signals], dtype) for end in ("low", "high"))

    def raw(self, samples: NDArray[np.uint8]) -> NDArray[Any]:
        """(k, N) raw values of samples (N, messages, width)."""
        if self._kind is None:
            return np.stack([one.signal.raw(samples[:, one.part]) for one in self._components])
        return samples.reshape(len(samples), -1).view(self._kind).T[self._items]


def _kind(component: Component) -> str | None:
    """Type of a signal that is a whole number in memory at a place that is a multiple of its size; None of others."""
    place = component.signal.aligned
    return place[1] if place is not None and place[0] % int(place[1][2:]) == 0 else None
