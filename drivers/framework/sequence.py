"""Samples in the order in which they were sent: frames repeated on the way are used once, late ones in their place.

A sample is *in sequence* when it is whole, its checksum is right and its counter is one more than that of the sample
received before it. What is not is held back until enough samples in sequence follow it, and put in order with them:
the result does not depend on how the stream is cut into batches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

REPEATS = 8
"""Samples back in which one is recognised as sent again, as gateways, retransmission and a second receiver do. Of a
counter of few bits at most those that it tells apart."""

LATE = 3
"""Samples by which one can come late and is still put in its place: queues of adapters and networks exchange
neighbours. A later one is counted as a loss of all but so many values of the counter."""

STRETCH = 24
"""Samples put in order together, and held back, at most: 48 ms of a wheel. Frames of two to four a sample in any order
fill it evenly."""


class Recent(NamedTuple):
    """What one unit of a sensor sent last.

    Attributes
    ----------
    rows : (H, …) the last trusted samples received, `REPEATS` at most; None before the first sample.
    frame : number in its sample and payload of the last frame, -1 for one of a wrong length; None where that is the
        last one of the last row.
    counter : that of the last sample received; None when it could not be trusted.
    """

    rows: NDArray[Any] | None = None
    frame: tuple[int, NDArray[Any]] | None = None
    counter: int | None = None

    def last_frame(self, size: int) -> tuple[int, NDArray[Any]] | None:
        """The last frame received; None before the first."""
        if self.frame is None and self.rows is not None:
            return size - 1, self.rows[-1, -1]
        return self.frame


class Stream(NamedTuple):
    """Frames of one unit: number in the sample (F,), payload (F, W), right length (F,), stamps (F,)."""

    part: NDArray[np.integer]
    payload: NDArray[Any]
    whole: NDArray[np.bool_]
    t_ns: NDArray[np.int64]


@dataclass(frozen=True)
class Sampling:
    """How the samples of a unit are made up.

    Attributes
    ----------
    size : frames of a sample.
    bits : width of the counter.
    right, counter : (N,) whether the checksum is right, and the counter, of samples in rows (N, size, W). Without a
        checksum (None) frames out of order in their sample are not put in order.
    """

    size: int
    bits: int
    right: Callable[[NDArray[Any]], NDArray[np.bool_]] | None
    counter: Callable[[NDArray[Any]], NDArray[np.int64]]


@dataclass(frozen=True)
class Ordered:
    """Frames in the order of the samples.

    Attributes
    ----------
    frames : (F,) index of each in the stream.
    sample : (F,) number of its sample, 0, 1, 2 …
    t_ns : (N,) stamps of the samples: of those put in order, their own stamps in order.
    held : the stream from this index on is held back.
    recent : what was sent last before that.
    repeated, reordered : number of frames sent again, and of samples that came out of order or in frames out of order.
    """

    frames: NDArray[np.int64]
    sample: NDArray[np.int64]
    t_ns: NDArray[np.int64]
    held: int
    recent: Recent
    repeated: int
    reordered: int


def last_rows(rows: NDArray[Any], recent: Recent) -> NDArray[Any]:
    """The last `REPEATS` rows received, trusted ones in `rows` after those before."""
    if len(rows) >= REPEATS or recent.rows is None:
        return rows[-REPEATS:]
    return np.concatenate((recent.rows, rows))[-REPEATS:]


def in_order(stream: Stream, unit: Sampling, recent: Recent, ended: bool) -> Ordered:
    """The samples of a stream in the order of their counter; its end is held back unless the stream has `ended`."""
    again = _sent_again(stream, unit, recent)
    kept = np.flatnonzero(~again)
    part = stream.part[kept]
    begins = np.ones(len(kept), bool)  # a frame not later in the order than the one before it begins a sample
    np.less_equal(part[1:], part[:-1], out=begins[1:])
    group, starts = np.cumsum(begins) - 1, kept[begins]
    groups = len(starts) - (not ended and len(kept) > 0 and int(part[-1]) != unit.size - 1)
    closed = group < groups
    made = _samples(stream, unit, kept[closed], group[closed], groups)
    sound = made.trusted & _follows(made.counter, made.trusted, unit.bits, recent)
    stretch, groups = _stretches(sound, ended)
    held = int(starts[groups]) if groups < len(starts) else len(stream.part)
    made = Samples(made.rows[:groups], made.has[:groups], made.trusted[:groups], made.counter[:groups])
    repeated = _repeated(made.rows, made.has, made.trusted, ~sound[:groups], unit.bits, recent)
    settled = group < groups
    frames, group, mended, dropped = _regrouped(
        stream, unit, kept[settled], group[settled], stretch, made.trusted, repeated
    )
    names, sample = np.unique(group, return_inverse=True)
    stretch = stretch[names]
    now = _samples(stream, unit, frames, sample, len(names))
    order, late = _by_counter(now.counter, now.trusted, stretch, unit.bits)
    t_ns = _earliest(stream.t_ns[frames], sample, len(names))
    if late:  # frames can be late, never early: the stamps of samples put in order, in order, are late ones too
        t_ns = t_ns[np.lexsort((t_ns, _blocks_of(stretch)))]
    sample = np.argsort(order)[sample]
    at = np.lexsort((stream.part[frames], sample))
    return Ordered(
        frames[at],
        sample[at],
        t_ns,
        held,
        _recent(stream, made, recent, held),
        int(np.count_nonzero(again[:held])) + dropped,
        late + mended,
    )


def _sent_again(stream: Stream, unit: Sampling, recent: Recent) -> NDArray[np.bool_]:
    """(F,) frames that are those before them again; of samples of one frame the counter says it."""
    part, payload, whole = stream.part, stream.payload, stream.whole
    again = np.zeros(len(part), bool)
    if unit.size > 1 and len(part):
        again[1:] = (part[1:] == part[:-1]) & (payload[1:] == payload[:-1]).all(axis=1) & whole[:-1]
        last = recent.last_frame(unit.size)
        again[0] = last is not None and part[0] == last[0] and np.array_equal(payload[0], last[1])
    return again & whole


def _recent(stream: Stream, made: Samples, before: Recent, held: int) -> Recent:
    """What was sent last before the frame `held`, of the samples `made` as they were received."""
    if not held:
        return before
    number = int(stream.part[held - 1]) if stream.whole[held - 1] else -1
    counter = before.counter
    if len(made.counter):
        counter = int(made.counter[-1]) if made.trusted[-1] else None
    return Recent(last_rows(made.rows[made.trusted], before), (number, stream.payload[held - 1]), counter)


def in_sequence(counter: NDArray[np.int64], trusted: NDArray[np.bool_], bits: int, recent: Recent) -> bool:
    """Whether samples are trusted, and each in sequence with the one before it: nothing is to be put in order."""
    return bool((trusted & _follows(counter, trusted, bits, recent)).all())


class Samples(NamedTuple):
    """Samples made of frames: rows (N, size, W), frames present (N, size), whether trusted (N,), counters (N,)."""

    rows: NDArray[Any]
    has: NDArray[np.bool_]
    trusted: NDArray[np.bool_]
    counter: NDArray[np.int64]


def _samples(
    stream: Stream, unit: Sampling, frames: NDArray[np.int64], sample: NDArray[np.int64], number: int
) -> Samples:
    rows = np.zeros((number, unit.size, stream.payload.shape[1]), stream.payload.dtype)
    has = np.zeros((number, unit.size), bool)
    whole = np.zeros((number, unit.size), bool)
    part = stream.part[frames]
    rows[sample, part], has[sample, part], whole[sample, part] = stream.payload[frames], True, stream.whole[frames]
    trusted = np.asarray(whole.all(axis=1))
    if unit.right is not None and trusted.any():
        trusted[trusted] = unit.right(rows[trusted])
    return Samples(rows, has, trusted, unit.counter(rows))


def _follows(counter: NDArray[np.int64], trusted: NDArray[np.bool_], bits: int, recent: Recent) -> NDArray[np.bool_]:
    """(N,) whether each counter is one more than the trusted one of the sample received before it."""
    out = np.ones(len(counter), bool)
    if len(counter):
        mask = np.int64((1 << min(bits, 62)) - 1)
        out[1:] = trusted[:-1] & ((counter[1:] - counter[:-1]) & mask == 1)
        if recent.rows is not None:
            out[0] = recent.counter is not None and (int(counter[0]) - recent.counter) & int(mask) == 1
    return out


def _stretches(sound: NDArray[np.bool_], ended: bool) -> tuple[NDArray[np.int64], int]:
    """Number of the stretch of each sample that is to be put in order, -1 outside; and how many samples are settled.

    A stretch ends when `LATE` samples in sequence follow its last one that is not, or at `STRETCH` samples.
    """
    out = np.full(len(sound), -1)
    wrong = np.flatnonzero(~sound)
    k = number = 0
    while k < len(wrong):  # a step a stretch, not a sample
        begin, some = int(wrong[k]), wrong[k : k + STRETCH]
        apart = np.flatnonzero(np.diff(some) > LATE)
        end = min(int(some[apart[0]] if len(apart) else some[-1]) + LATE + 1, begin + STRETCH)
        if end > len(sound) and not ended:
            return out[:begin], begin
        out[begin:end] = number
        number, k = number + 1, int(np.searchsorted(wrong, end))
    return out, len(sound)


def _repeated(
    rows: NDArray[Any],
    has: NDArray[np.bool_],
    trusted: NDArray[np.bool_],
    unsound: NDArray[np.bool_],
    bits: int,
    recent: Recent,
) -> NDArray[np.bool_]:
    """(N,) samples, or parts of one, whose frames are those of a trusted sample received shortly before."""
    out = np.zeros(len(rows), bool)
    which = np.flatnonzero(unsound & (trusted | ~has.all(axis=1)))
    known = rows[trusted] if recent.rows is None else np.concatenate((recent.rows, rows[trusted]))
    if not len(which) or not len(known):
        return out
    before = len(known) - np.count_nonzero(trusted) + (np.cumsum(trusted) - trusted)[which]
    for back in range(1, 1 + min(REPEATS, (1 << min(bits, 62)) - 1)):
        there = before >= back
        same = (rows[which] == known[np.maximum(before - back, 0)]).all(axis=2) | ~has[which]
        out[which] |= there & same.all(axis=1)
    return out


def _regrouped(
    stream: Stream,
    unit: Sampling,
    frames: NDArray[np.int64],
    group: NDArray[np.int64],
    stretch: NDArray[np.int64],
    trusted: NDArray[np.bool_],
    repeated: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64], int, int]:
    """Frames and their samples without repeated ones, those out of order in their sample put there.

    The frames of a stretch are put in order only where whole samples with right checksums are made of all of them.
    Then how many samples that has mended, and how many frames were repeated.
    """
    number = len(frames)
    use = ~(repeated & trusted)[group]
    frames, group = frames[use], group[use]
    mended = 0
    parts_again = repeated & ~trusted
    torn = np.zeros(int(stretch.max(initial=-1)) + 1, bool)
    torn[stretch[(stretch >= 0) & ~trusted]] = True
    for leave_out in (False, True):  # repeated parts of samples
        if unit.right is None or unit.size == 1 or not torn.any():
            break
        mine = (stretch[group] >= 0) & torn[stretch[group]]
        if leave_out:
            mine &= ~parts_again[group]
        which, of, part = np.flatnonzero(mine), stretch[group[mine]], stream.part[frames[mine]]
        counts = np.bincount(of * unit.size + part, minlength=len(torn) * unit.size).reshape(len(torn), unit.size)
        even = torn & (counts == counts[:, :1]).all(axis=1) & (counts[:, 0] > 0 if not leave_out else True)
        at = np.lexsort((which, part, of))
        at = at[even[of[at]]]
        key = of[at] * unit.size + part[at]
        first = np.flatnonzero(np.diff(key, prepend=-1)) if len(key) else key
        nth = np.arange(len(key)) - np.repeat(first, np.diff(np.append(first, len(key))))
        total = np.cumsum(np.where(even, counts[:, 0], 0))
        sample = nth + (total - np.where(even, counts[:, 0], 0))[of[at]]
        made = int(total[-1])
        good = _samples(stream, unit, frames[which[at]], sample, made).trusted
        right = even.copy()
        right[np.repeat(np.arange(len(torn)), np.where(even, counts[:, 0], 0))[~good]] = False
        begin = np.full(len(torn), -1)
        places = np.flatnonzero(np.diff(stretch, prepend=-1) * (stretch >= 0))
        begin[stretch[places]] = places
        done = right[of[at]]
        new = group.copy()
        new[which[at][done]] = begin[of[at][done]] + nth[done]
        inside = (stretch >= 0) & right[stretch]
        mended += int(np.where(right, counts[:, 0], 0).sum()) - int(np.count_nonzero(inside & trusted & ~repeated))
        if leave_out:
            stay = ~((stretch[group] >= 0) & right[stretch[group]] & parts_again[group])
            frames, new = frames[stay], new[stay]
        group, torn = new, torn & ~right
    if torn.any():  # parts of samples sent again beside others that are not mended
        stay = ~parts_again[group] | (stretch[group] < 0) | ~torn[stretch[group]]
        frames, group = frames[stay], group[stay]
    at = np.argsort(group, kind="stable")
    return frames[at], group[at], mended, number - len(frames)


def _by_counter(
    counter: NDArray[np.int64], trusted: NDArray[np.bool_], stretch: NDArray[np.int64], bits: int
) -> tuple[NDArray[np.int64], int]:
    """Order of samples, in each stretch by counter where that makes one sequence; and how many were late.

    It does where no value comes twice and the last sample received is the last one, or none is missing.
    """
    order = np.arange(len(counter))
    inside = np.flatnonzero(stretch >= 0)
    if not len(inside):
        return order, 0
    of = stretch[inside]
    edges = np.flatnonzero(np.diff(of, prepend=-1))
    ends = np.append(edges[1:], len(of))
    modulus = 1 << min(bits, 62)
    back = min(LATE, modulus // 4)
    step = (np.diff(counter[inside], prepend=0) + back) % modulus - back
    step[edges] = 0
    total = np.cumsum(step)
    value = total - np.repeat(total[edges], ends - edges)
    low, high = np.minimum.reduceat(value, edges), np.maximum.reduceat(value, edges)
    number = np.repeat(np.arange(len(edges)), ends - edges)
    at = np.lexsort((value, number))
    twice = np.bincount(number[1:][(np.diff(value[at]) == 0) & (np.diff(number) == 0)], minlength=len(edges)) > 0
    untrusted = np.bincount(number[~trusted[inside]], minlength=len(edges)) > 0
    joined = (value[ends - 1] == high) | (high - low == ends - edges - 1)
    sorted_ = ~twice & ~untrusted & joined
    at = np.where(sorted_[number], at, np.arange(len(at)))
    order[inside] = inside[at]
    place = np.empty(len(at), np.int64)
    place[at] = np.arange(len(at))
    return order, int(np.count_nonzero(place < np.maximum.accumulate(place)))


def _earliest(t_ns: NDArray[np.int64], sample: NDArray[np.int64], number: int) -> NDArray[np.int64]:
    """(N,) earliest stamp of the frames of each sample."""
    out = np.full(number, np.iinfo(np.int64).max)
    np.minimum.at(out, sample, t_ns)
    return out


def _blocks_of(stretch: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) ascending numbers, one for each stretch and one for each sample outside."""
    return np.cumsum((stretch < 0) | (np.diff(stretch, prepend=-2) != 0))
