"""Steps back of a bus log's clock: the order of frames in the file is that of the drive, and stamps go on.

As in a live recording they are without the step: what is stamped behind it is later by its size.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LASTS = 8
"""Frames of a bus before and behind a step back, of which all but one are stamped later, or earlier, than the others:
a clock was put back. Fewer are frames out of order, which drivers put in their place up to three samples late."""
WAITED = 4096
"""Frames behind a step that are waited for, so that most identifiers have come again, and before it that are kept."""


class Stamped(NamedTuple):
    """Stamps `t` (N,) [s] of frames in the order of the file, their `ident` (N,), and `bus` (N,) by number."""

    t: NDArray[np.float64]
    ident: NDArray[np.uint32]
    bus: NDArray[np.int64]

    def of(self, which: slice) -> Stamped:
        """Consecutive ones of the frames."""
        return Stamped(self.t[which], self.ident[which], self.bus[which])

    def then(self, more: Stamped) -> Stamped:
        """These and more behind them."""
        return Stamped(
            np.concatenate([self.t, more.t]), np.concatenate([self.ident, more.ident]),
            np.concatenate([self.bus, more.bus]),
        )  # fmt: skip


_NONE = Stamped(np.zeros(0), np.zeros(0, np.uint32), np.zeros(0, np.int64))


@dataclass
class ClockSteps:
    """The stamps of a log that comes piece by piece, without the steps back of its clock.

    Each bus has its own order. A step is as long as the identifiers that come most often say: their usual interval
    less the one across the step. Without out-of-order frames nothing is held back.

    `found` : number of the bus, time on the stamps that go on [s] and size [s] of each step so far.
    """

    found: list[tuple[int, float, float]] = field(default_factory=list)
    _before: Stamped = _NONE
    _steps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))  # their places in `_before`
    _waiting: Stamped = _NONE
    _shift: dict[int, float] = field(default_factory=dict)

    def feed(self, more: Stamped, last: bool = False) -> NDArray[np.float64]:
        """Stamps [s] of the next frames, those that waited first; frames too near to the end wait, unless `last`."""
        frames = self._before.then(self._waiting).then(more)
        begin = len(self._before.t)
        count, end = len(frames.t), len(frames.t)
        places = [np.flatnonzero(frames.bus == bus) for bus in np.unique(frames.bus)]
        back = [mine[1:][np.diff(frames.t[mine]) < 0.0] for mine in places]
        back = [one[one >= begin] for one in back]
        if not last:
            end = min((int(one[one > count - WAITED][0]) for one in back if (one > count - WAITED).any()), default=end)
        t = frames.t[begin:end].copy()
        steps = [self._steps]
        for mine, its in zip(places, back, strict=True):
            bus = int(frames.bus[mine[0]])
            shift = np.full(len(mine), self._shift.get(bus, 0.0))
            if (its < end).any():
                first, behind = np.searchsorted(mine, [begin, end]).tolist()
                known = np.searchsorted(mine, self._steps[frames.bus[self._steps] == bus])
                new, sizes = _sized(frames.t[mine], frames.ident[mine], first, behind, known)
                for place, size in zip(new.tolist(), sizes.tolist(), strict=True):
                    shift[place:] += size
                    self.found.append((bus, float(frames.t[mine[place]] + shift[place]), size))
                steps.append(mine[new])
            now = (mine >= begin) & (mine < end)
            if now.any():
                self._shift[bus] = float(shift[now][-1])
                t[mine[now] - begin] += shift[now]
        kept = max(0, end - WAITED)
        self._before, self._waiting = frames.of(slice(kept, end)), frames.of(slice(end, None))
        all_steps = np.concatenate(steps) - kept
        self._steps = all_steps[all_steps >= 0]
        return t


def _sized(
    t: NDArray[np.float64], ident: NDArray[np.uint32], begin: int, end: int, known: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Places of the steps back among a bus's frames `begin` to `end`, and their sizes [s]; `known` : places before."""
    order = np.argsort(ident, kind="stable")
    before = np.full(len(t), -1)  # place of the last frame of the same identifier
    same = np.flatnonzero(ident[order][1:] == ident[order][:-1])
    before[order[same + 1]] = order[same]
    new = _places(t, before, begin, end)
    if not len(new):
        return new, np.zeros(0)
    part = np.zeros(len(t), np.int64)
    part[np.concatenate([known, new])] = 1
    part = np.cumsum(part)
    has = np.flatnonzero((before >= 0) & np.isfinite(t) & np.isfinite(t[before]))
    interval, across = t[has] - t[before[has]], part[has] - part[before[has]]
    within = has[(across == 0) & (interval > 0.0)]
    idents, number = np.unique(ident, return_inverse=True)
    usual = _medians(number[within], t[within] - t[before[within]], len(idents))
    over = has[across == 1]
    over = over[np.isfinite(usual[number[over]])]  # in the order of the file, and so of the parts
    first, behind = (np.searchsorted(part[over], part[new], side) for side in ("left", "right"))
    sizes = np.zeros(len(new))
    for i, place in enumerate(new.tolist()):
        mine = over[first[i] : behind[i]]
        mine = mine[np.argsort(usual[number[mine]], kind="stable")][: (len(mine) + 1) // 2]
        say = usual[number[mine]] - (t[mine] - t[before[mine]])
        sizes[i] = max(float(t[place - 1] - t[place]), float(np.median(say)) if len(say) else 0.0)
    return new, sizes


def _places(t: NDArray[np.float64], before: NDArray[np.int64], begin: int, end: int) -> NDArray[np.int64]:
    """Places at which a clock is put back: stamps stay behind, and identifiers come again at an earlier time."""
    back = np.flatnonzero(np.diff(t) < 0.0) + 1
    back = back[(back >= max(begin, LASTS)) & (back < end)]
    next_ones = np.minimum(back[:, None] + np.arange(LASTS), len(t) - 1)
    former = back[:, None] - 1 - np.arange(LASTS)
    lasting = np.sort(t[next_ones], axis=1)[:, -2] < np.sort(t[former], axis=1)[:, 1]
    back, next_ones = back[lasting], next_ones[lasting]
    across = (before[next_ones] >= 0) & (before[next_ones] < back[:, None])
    again = across & (t[next_ones] < t[before[next_ones]])
    back = back[again.any(axis=1) & (2 * again.sum(axis=1) >= across.sum(axis=1))]
    out: list[int] = []
    for place in back.tolist():  # of several so near to each other it is the longest
        if _late(t, place):
            continue
        if not out or place - out[-1] >= LASTS:
            out.append(place)
        elif t[place - 1] - t[place] > t[out[-1] - 1] - t[out[-1]]:
            out[-1] = place
    return np.array(out, np.int64)


def _late(t: NDArray[np.float64], place: int) -> bool:
    """Whether the frames from a place on are late: fewer than those before that are stamped later, to whose stamps the
    log returns, and at times that were free before."""
    returned = np.flatnonzero(t[place : place + WAITED] >= t[place - 1])
    if not returned.size:
        return False
    block, before = t[place : place + int(returned[0])], t[max(0, place - WAITED) : place]
    stamped_so = int(np.count_nonzero((before >= block.min()) & (before <= block.max())))
    later = int(np.count_nonzero(before > block.max()))
    return 2 * stamped_so < len(block) <= later


def _medians(group: NDArray[np.int64], values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Median (of an even number the lower one) of the values of each of `count` groups; NaN of none."""
    out = np.full(count, np.nan)
    order = np.lexsort((values, group))
    sizes = np.bincount(group, minlength=count)
    first = np.concatenate(([0], np.cumsum(sizes)[:-1]))
    has = sizes > 0
    out[has] = values[order][(first + (sizes - 1) // 2)[has]]
    return out
