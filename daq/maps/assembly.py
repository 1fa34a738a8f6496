"""Assembly of one channel from names of a log, piece by piece: expressions, delays, and one time base for a channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lacet.daq.channels import Channel
from lacet.daq.maps.channel_map import Mapped
from lacet.daq.run import UNWRAPPED
from lacet.daq.sources.source import Array, Series

GAP_STEPS = 10.0
"""Longest distance of two samples between which a series is interpolated, in its own median steps: beyond, it dropped
out and there is no value."""


class Key(NamedTuple):
    """A series as an expression takes it: its name in the log, its unit, and the delay that is removed [s]."""

    name: str
    unit: str
    delay: float


class ChannelPiece(NamedTuple):
    """The next samples of a channel: times (N,) [s], values (N, k) in SI, NaN where there is none."""

    channel: str
    t: Array
    values: Array


@dataclass
class Assembly:
    """One channel in the making.

    Attributes
    ----------
    channel : of the vocabulary.
    columns : where each component comes from.
    keys : for each column, name in its expression → series.
    """

    channel: Channel
    columns: Sequence[Mapped]
    keys: Sequence[Mapping[str, Key]]
    interpolated: bool = False
    """Whether a component had other stamps than the first and was interpolated."""
    _held: dict[Key, list[Series]] = field(default_factory=dict)
    _last: Array | None = None

    @property
    def series(self) -> list[Key]:
        """Every series needed, that of the time base first."""
        return list(dict.fromkeys(key for keys in self.keys for key in keys.values()))

    def feed(self, piece: Mapping[Key, Series], last: bool = False) -> ChannelPiece | None:
        """The samples that can be made with a further piece; `last` when there is none behind it."""
        names = self.series
        fresh = [piece.get(key) for key in names]
        if not any(self._held.values()) and all(one is not None and one.t is fresh[0].t for one in fresh):  # type: ignore[union-attr]
            assert fresh[0] is not None
            return self._made(fresh[0].t, {key: one.values for key, one in zip(names, fresh, strict=True) if one})
        for key, one in zip(names, fresh, strict=True):
            if one is not None and len(one.t):
                self._held.setdefault(key, []).append(one)
        if not all(self._held.get(key) for key in names):
            return None
        joined = {key: _joined(self._held[key]) for key in names}
        base = joined[names[0]]
        end = np.inf if last else min(float(one.t[-1]) for one in joined.values())
        count = int(np.searchsorted(base.t, end, side="right"))
        if count == 0:
            self._held = {key: [one] for key, one in joined.items()}
            return None
        t = base.t[:count]
        values = {names[0]: base.values[:count]}
        held = {names[0]: Series(base.t[count:], base.values[count:])}
        for key in names[1:]:
            other = joined[key]
            same = len(other.t) >= count and np.array_equal(other.t[:count], t)
            values[key] = other.values[:count] if same else _between(other, t)
            self.interpolated |= not same
            keep = max(0, int(np.searchsorted(other.t, t[-1], side="right")) - (0 if same else 1))
            held[key] = Series(other.t[keep:], other.values[keep:])
        self._held = {key: [one] if len(one.t) else [] for key, one in held.items()}
        return self._made(t, values)

    def _made(self, t: Array, series: Mapping[Key, Array]) -> ChannelPiece | None:
        if not len(t):
            return None
        parts: list[Array] = []
        for mapped, keys in zip(self.columns, self.keys, strict=True):
            with np.errstate(all="ignore"):
                part = mapped.written.expression.series({name: series[key] for name, key in keys.items()}, len(t))
            part = part if mapped.lookup is None else mapped.lookup.of(part)
            parts.append(np.where(np.isfinite(part), part, np.nan))
        values = np.stack(parts, axis=1)
        return ChannelPiece(self.channel.name, t, self._continuous(values))

    def _continuous(self, values: Array) -> Array:
        """Angles without jumps of a turn, also from piece to piece."""
        if self.channel.family not in UNWRAPPED:
            return values
        good = np.all(np.isfinite(values), axis=1)
        before = [] if self._last is None else [self._last[None]]
        if good.any():
            turned = np.unwrap(np.concatenate([*before, values[good]]), axis=0)[len(before) :]
            values[good], self._last = turned, turned[-1]
        return values


def _joined(parts: list[Series]) -> Series:
    if len(parts) == 1:
        return parts[0]
    return Series(np.concatenate([one.t for one in parts]), np.concatenate([one.values for one in parts]))


def _between(series: Series, t: Array) -> Array:
    """Values at other times by straight lines; none outside and where the series dropped out."""
    if len(series.t) < 2:
        return np.full(len(t), np.nan)
    out = np.interp(t, series.t, series.values, left=np.nan, right=np.nan)
    steps = np.diff(series.t)
    wide = steps > GAP_STEPS * float(np.median(steps))
    if wide.any():
        at = np.clip(np.searchsorted(series.t, t, side="left") - 1, 0, len(steps) - 1)
        inside = (t > series.t[at]) & (t < series.t[at + 1])
        out[inside & wide[at]] = np.nan
    return out
