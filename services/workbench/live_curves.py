"""Curves of the channels of a car that is recording: the last seconds of each, as extremes of short bins."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import UNUSABLE, Block

SPAN = 30.0
"""Length of the curves [s]."""
BIN = 0.05
"""Time of which a curve has the lowest and the highest value [s]."""


@dataclass
class LiveCurve:
    """The last `SPAN` of one channel: bins in order of time, each with its number and the extremes of each component.

    A bin without a usable sample has NaN. Samples older than the last bin, which came late, are not drawn.
    """

    bins: deque[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = field(
        default_factory=lambda: deque[tuple[int, NDArray[np.float64], NDArray[np.float64]]](maxlen=round(SPAN / BIN))
    )

    def take(self, block: Block) -> None:
        """Add a block of samples."""
        if not len(block.t_ns):
            return
        number = block.t_ns // round(1e9 * BIN)
        values = np.where((block.flags & int(UNUSABLE) == 0)[:, None], block.values, np.nan)
        starts = np.flatnonzero(np.diff(number, prepend=number[0] - 1) > 0)
        lows, highs = (reduce.reduceat(values, starts, axis=0) for reduce in (np.fmin, np.fmax))
        for k, start in enumerate(starts):
            self._put(int(number[start]), lows[k], highs[k])

    def _put(self, number: int, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        if self.bins and number <= self.bins[-1][0]:
            if number == self.bins[-1][0]:
                _, first, second = self.bins[-1]
                self.bins[-1] = (number, np.fmin(first, low), np.fmax(second, high))
            return
        self.bins.append((number, low, high))

    def series(self, start_ns: int, components: Sequence[str]) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        """Times since `start_ns` [s], twice in every bin, and of each component the lowest and the highest in turn."""
        if not self.bins:
            return np.zeros(0), [np.zeros(0) for _ in components]
        numbers = np.array([number for number, _, _ in self.bins], float)
        first = BIN * numbers - 1e-9 * start_ns
        t = np.stack([first, first + BIN / 2.0], axis=1).ravel()
        both = np.stack([[low for _, low, _ in self.bins], [high for _, _, high in self.bins]], axis=1)
        return t, [both[:, :, k].ravel() for k in range(len(components))]
