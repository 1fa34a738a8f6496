"""Stamps that samples share, for they came together: in one read of a serial line, in one transfer of an adapter.

Where they are received each is kept, one nanosecond behind the other. In a run they are spread over the time since the
read before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TOGETHER_NS = 1000
"""Distance of the stamps of one channel below which its samples came together [ns]. Reason: stamps are read to a
microsecond or finer, and the shortest CAN frame alone lasts 47 µs at 1 Mbit/s."""

Stamps = NDArray[np.int64]


def one_by_one(t_ns: Stamps, last_ns: int | None = None) -> Stamps:
    """Stamps in order (N,) [ns] with each later than the one before it: of equal ones every next by a nanosecond.

    `last_ns` : the last one made so before these, None at first.
    """
    if not len(t_ns) or ((last_ns is None or t_ns[0] > last_ns) and (t_ns[1:] > t_ns[:-1]).all()):
        return t_ns
    number = np.arange(len(t_ns))
    start = t_ns[0] if last_ns is None else max(int(t_ns[0]), last_ns + 1)
    return np.maximum(np.maximum.accumulate(t_ns - number), start) + number


def spread(t_ns: Stamps, usual_ns: float) -> tuple[Stamps, int]:
    """Stamps with those of samples that came together spread over the time since the stamp before, and their number.

    The last of them keeps the stamp: those before it were taken while it was waited for. Behind a pause they lie as far
    apart as samples of the channel usually do. Stamps earlier than one before them are as they were.

    Parameters
    ----------
    t_ns : (N,) receipt stamps [ns].
    usual_ns : time between samples [ns] where all came together.
    """
    if len(t_ns) < 2:
        return t_ns, 0
    step = np.diff(t_ns)
    together = (step >= 0) & (step < TOGETHER_NS)
    if not together.any():
        return t_ns, 0
    first = np.flatnonzero(np.concatenate(([True], ~together)))
    count = np.diff(np.append(first, len(t_ns)))
    stamp = t_ns[first + count - 1]
    since = np.diff(np.maximum.accumulate(stamp), prepend=stamp[0])
    in_order = np.concatenate(([True], stamp[1:] > np.maximum.accumulate(stamp)[:-1]))
    apart = since / count
    known = in_order & (since > 0)
    usual = float(np.median(apart[known])) if known.any() else usual_ns
    apart[known] = np.minimum(apart[known], usual)
    apart[0] = usual
    behind = np.repeat(first + count, count) - 1 - np.arange(len(t_ns))
    moved = np.repeat(in_order & (count > 1), count)
    out = np.where(moved, np.repeat(stamp, count) - np.rint(behind * np.repeat(apart, count)).astype(np.int64), t_ns)
    return out, int((count[in_order] - 1).sum())
