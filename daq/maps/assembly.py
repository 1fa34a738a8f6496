"""Assembly of one channel from names of a log, piece by piece: expressions, delays, and one time base for a channel.

The samples do not depend on where the pieces are cut.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from lacet.daq.angles import ContinuousAngle
from lacet.daq.blocks import UNUSABLE, Flag
from lacet.daq.channels import Channel
from lacet.daq.maps.channel_map import Mapped
from lacet.daq.maps.resolution import Key
from lacet.daq.run import UNWRAPPED
from lacet.daq.shared_stamps import TOGETHER_NS
from lacet.daq.sources.source import Array, Series

GAP_STEPS = 10.0
"""Longest distance of two samples between which a series is interpolated, in its own usual steps: beyond, it dropped
out and there is no value."""
USUAL_STEPS = 16
"""Steps just before whose median is the usual one; no drop-out is seen before there are as many."""

Flags = NDArray[np.uint8]


class ChannelPiece(NamedTuple):
    """The next samples of a channel: times (N,) [s], values (N, k) in SI, NaN where there is none, and flags (N,)."""

    channel: str
    t: Array
    values: Array
    flags: Flags


class _Held(NamedTuple):
    """Samples of a series that are still needed: times, values, flags, and whether the step before each is a drop-out.

    `last` : latest time, and `steps` : the steps up to it, also of samples that are not needed any more.
    """

    t: Array
    values: Array
    flags: Flags
    dropped: NDArray[np.bool_]
    last: float
    steps: Array

    def then(self, more: Series) -> _Held:
        """These samples and more behind them."""
        before = more.t[:1] if np.isnan(self.last) else np.array([self.last])
        steps = np.diff(np.concatenate([before, more.t]))
        first = 1 if np.isnan(self.last) else 0  # the first sample of all has no step before it
        apart = first + np.flatnonzero(steps[first:] > TOGETHER_NS / 1e9)  # samples that came together have no step
        history = np.concatenate([self.steps, steps[apart]])
        dropped = np.zeros(len(steps), bool)
        dropped[apart] = _drop_outs(history, len(apart))
        return _Held(
            np.concatenate([self.t, more.t]), np.concatenate([self.values, more.values]),
            np.concatenate([self.flags, _flags_of(more)]), np.concatenate([self.dropped, dropped]), float(more.t[-1]),
            history[-USUAL_STEPS:],
        )  # fmt: skip

    def after(self, count: int) -> _Held:
        """Without the first so many samples."""
        return self._replace(
            t=self.t[count:], values=self.values[count:], flags=self.flags[count:], dropped=self.dropped[count:]
        )  # fmt: skip

    def at(self, t: Array, patience: float) -> tuple[Array, Flags]:
        """Values at other times by straight lines, and flags; none outside, in a drop-out, and where the next sample
        comes later than `patience` [s]."""
        if not len(self.t):
            return np.full(len(t), np.nan), np.full(len(t), np.uint8(Flag.INCOMPLETE))
        out = np.interp(t, self.t, self.values, left=np.nan, right=np.nan)
        behind = np.searchsorted(self.t, t, side="left")
        within = np.minimum(behind, len(self.t) - 1)
        exact = self.t[within] == t
        inside = ~exact & (behind > 0) & (behind < len(self.t))
        # The samples on both sides; a gap before one of them is no gap of this sample.
        around = (self.flags[within] | self.flags[np.maximum(within - 1, 0)]) & np.uint8(~Flag.GAP & 0xFF)
        flags = np.where(exact, self.flags[within], np.where(inside, around, np.uint8(0)))
        absent = ~exact & (~inside | self.dropped[within] | (self.t[within] - t > patience))
        out[absent] = np.nan
        flags[absent] = np.uint8(Flag.INCOMPLETE)
        return out, flags


_NONE = _Held(np.zeros(0), np.zeros(0), np.zeros(0, np.uint8), np.zeros(0, bool), np.nan, np.zeros(0))


@dataclass
class Assembly:
    """A channel being assembled.

    Attributes
    ----------
    channel : of the vocabulary.
    columns : where each component comes from.
    keys : for each column, name in its expression → series.
    patience : longest distance of the next sample of a component with stamps of its own [s], which is waited for twice
        as long, for series may be out of order against each other by as much; without, until the end of the log.
    """

    channel: Channel
    columns: Sequence[Mapped]
    keys: Sequence[Mapping[str, Key]]
    patience: float = np.inf
    interpolated: bool = False
    """Whether a component had other stamps than the first and was interpolated."""
    _held: dict[Key, _Held] = field(default_factory=dict)
    _angle: ContinuousAngle = field(default_factory=ContinuousAngle)

    def __post_init__(self) -> None:
        self.series: list[Key] = list(dict.fromkeys(key for keys in self.keys for key in keys.values()))
        """Every series needed, that of the time base first."""

    def copy(self) -> Assembly:
        """An independent copy of the state."""
        return replace(self, _held=dict(self._held))

    def feed(self, piece: Mapping[Key, Series], last: bool = False, front: float = -np.inf) -> ChannelPiece | None:
        """The samples that can be made with a further piece.

        `last` : nothing comes behind it. `front` : nothing stamped before this [s] comes any more.
        """
        base, *others = self.series
        fresh = piece.get(base)
        if not others:
            return None if fresh is None else self._made(fresh.t, {base: fresh.values}, _flags_of(fresh))
        waiting = self._held.get(base, _NONE)
        together = fresh is not None and all(key in piece and piece[key].t is fresh.t for key in others)
        for key in self.series:
            if key in piece and len(piece[key].t):
                self._held[key] = self._held.get(key, _NONE).then(piece[key])
        if together and fresh is not None and len(fresh.t) and not len(waiting.t):
            flags = _flags_of(fresh)
            for key in others:
                flags = flags | _flags_of(piece[key])
                self._held[key] = self._held[key].after(max(0, len(self._held[key].t) - 1))
            self._held[base] = self._held[base].after(len(self._held[base].t))
            return self._made(fresh.t, {key: piece[key].values for key in self.series}, flags)
        return self._interpolated(last, front)

    def _interpolated(self, last: bool, front: float) -> ChannelPiece | None:
        """The samples of the time base for which the other series have come, or are not waited for any more."""
        base, *others = self.series
        held = {key: self._held.get(key, _NONE) for key in self.series}
        ends = [one.last for one in held.values()]
        end = np.inf if last else -np.inf if np.isnan(ends).any() else min(ends)
        late = front - max(key.delay for key in self.series) - 2.0 * self.patience  # one for series out of order
        count = max(int(np.searchsorted(held[base].t, end, "right")), int(np.searchsorted(held[base].t, late, "left")))
        if count == 0:
            if self.patience < np.inf and not len(held[base].t):  # of what is before the next sample, one is enough
                for key in others:
                    before = int(np.searchsorted(held[key].t, front - base.delay - self.patience, "right"))
                    self._held[key] = held[key].after(max(0, before - 1))
            return None
        t, flags = held[base].t[:count], held[base].flags[:count]
        values = {base: held[base].values[:count]}
        for key in others:
            other = held[key]
            self.interpolated |= not np.isin(t, other.t, assume_unique=True).all()
            values[key], its = other.at(t, self.patience)
            flags = flags | its
            self._held[key] = other.after(max(0, int(np.searchsorted(other.t, t[-1], "right")) - 1))
        self._held[base] = held[base].after(count)
        return self._made(t, values, flags)

    def _made(self, t: Array, series: Mapping[Key, Array], flags: Flags) -> ChannelPiece | None:
        if not len(t):
            return None
        parts: list[Array] = []
        for mapped, keys in zip(self.columns, self.keys, strict=True):
            with np.errstate(all="ignore"):
                part = mapped.written.expression.series({name: series[key] for name, key in keys.items()}, len(t))
            part = part if mapped.lookup is None else mapped.lookup.of(part)
            parts.append(np.where(np.isfinite(part), part, np.nan))
        values = np.stack(parts, axis=1)
        unusable = (flags & np.uint8(UNUSABLE)) != 0
        values[unusable] = np.nan
        without = np.isnan(values).any(axis=1) & ~unusable
        flags = np.where(without, flags | np.uint8(Flag.MISSING), flags)
        return ChannelPiece(self.channel.name, t, self._continuous(values), flags)

    def _continuous(self, values: Array) -> Array:
        """Angles without jumps of a turn, also from piece to piece."""
        if self.channel.family not in UNWRAPPED:
            return values
        good = np.all(np.isfinite(values), axis=1)
        values[good] = self._angle.add(values[good])
        return values


def _flags_of(series: Series) -> Flags:
    return np.zeros(len(series.t), np.uint8) if series.flags is None else series.flags


def _drop_outs(history: Array, count: int) -> NDArray[np.bool_]:
    """Whether each of the last `count` steps is longer than `GAP_STEPS` usual ones, the median of those before it."""
    out = np.zeros(count, bool)
    at = np.arange(len(history) - count, len(history))
    # Less than ten times the shortest step is less than ten times any median: most series end here.
    may = np.flatnonzero((history[at] > GAP_STEPS * history.min(initial=np.inf)) & (at >= USUAL_STEPS))
    if may.size:
        before = sliding_window_view(history, USUAL_STEPS)[at[may] - USUAL_STEPS]
        out[may] = history[at[may]] > GAP_STEPS * np.median(before, axis=1)
    return out
