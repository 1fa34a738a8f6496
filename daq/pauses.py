"""Pauses of a channel: stretches without samples that are long beside its usual period."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

LEAST = 0.020
"""Longest step between samples that is no pause, whatever the period [s]: it is interpolated."""
PERIODS = 3.0
"""The same in usual periods of the channel: one or two lost samples are interpolated."""

Span = tuple[float, float]
"""Last sample before a pause and first one after it [s]."""


def longest_step(usual: float) -> float:
    """Longest step between samples that is no pause [s]; `usual` : the usual period [s]."""
    return max(LEAST, PERIODS * usual)


def pauses(t: NDArray[np.float64], usual: float | None = None) -> list[Span]:
    """Pauses between stamps `t` (N,) [s]; `usual` : the usual period [s], by default the median of these."""
    if len(t) < 2:
        return []
    steps = np.diff(t)
    longest = longest_step(float(np.median(steps)) if usual is None else usual)
    return [(float(t[i]), float(t[i + 1])) for i in np.flatnonzero(steps > longest)]


@dataclass
class Stamps:
    """Stamps of a channel that come piece by piece: its pauses; the first piece gives the usual period."""

    found: list[Span] = field(default_factory=list[Span])
    _usual: float | None = None
    _last: float | None = None

    def add(self, t: NDArray[np.float64]) -> None:
        """Take the next piece's stamps (N,) [s]."""
        whole = t if self._last is None else np.concatenate(([self._last], t))
        if self._usual is None and len(whole) > 1:
            self._usual = float(np.median(np.diff(whole)))
        if self._usual is not None:
            self.found += pauses(whole, self._usual)
        if len(t):
            self._last = float(t[-1])


def alike(by_channel: Mapping[str, Sequence[Span]]) -> dict[tuple[Span, ...], list[str]]:
    """Pauses → the channels that have these, stamps of different channels counting as the same to `LEAST`."""
    out: dict[tuple[Span, ...], list[str]] = {}
    for channel, spans in by_channel.items():
        if not spans:
            continue
        like = next((other for other in out if _same(other, spans)), tuple(spans))
        out.setdefault(like, []).append(channel)
    return out


def _same(a: Sequence[Span], b: Sequence[Span]) -> bool:
    return len(a) == len(b) and bool(np.all(np.abs(np.subtract(a, b)) <= LEAST))
