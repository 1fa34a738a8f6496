"""Frames of one message of a bus in the order of its counter, each checked by counter and checksum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Flag
from lacet.daq.can_signal import Signal
from lacet.drivers.framework.counters import WIDE, CounterState, add, follow_counter
from lacet.drivers.framework.message_checks import MessageChecks
from lacet.drivers.framework.sequence import Recent, Sampling, Stream, in_order, in_sequence, last_rows
from lacet.drivers.framework.turns import Pace, whole_turns

SETTLED = 1.0
"""Time without a frame of a message after which those held back are settled [s]: one late by more is not put in its
place. Source: a choice; no queue keeps a frame so long."""


class MessageFrames(NamedTuple):
    """Frames of one message: payloads in rows (N, W), filled with zeros, their lengths (N,) and stamps (N,)."""

    payload: NDArray[np.uint8]
    lengths: NDArray[np.int64]
    t_ns: NDArray[np.int64]

    def at(self, which: slice | NDArray[np.int64]) -> MessageFrames:
        """Some of them."""
        return MessageFrames(self.payload[which], self.lengths[which], self.t_ns[which])

    @classmethod
    def joined(cls, parts: list[MessageFrames]) -> MessageFrames:
        """Several, end to end."""
        return parts[0] if len(parts) == 1 else cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))


@dataclass(frozen=True)
class MessageState:
    """State of one message between batches: counter, pace, last frames, those held back, and one in order of which the
    next says whether it was late or others are lost.

    `stood` : frames whose counter is that of the first one; None once it has been another.
    """

    counter: CounterState = field(default_factory=CounterState)
    pace: Pace = field(default_factory=Pace)
    recent: Recent = field(default_factory=Recent)
    held: MessageFrames | None = None
    undecided: MessageFrames | None = None
    stood: int | None = 0

    @property
    def waits_from(self) -> int | None:
        """Stamp of the first frame that is not yet delivered [ns]; None without any."""
        stamps = [int(one.t_ns[0]) for one in (self.undecided, self.held) if one is not None]
        return min(stamps, default=None)


def followed(
    frames: MessageFrames, front_ns: NDArray[np.int64], ended: bool, checks: MessageChecks, state: MessageState,
    ledger: Mapping[str, int],
) -> tuple[MessageFrames, NDArray[np.uint8], MessageState, Mapping[str, int]]:  # fmt: skip
    """The next frames in order, without repeated ones, and the flags that their checks give them.

    Parameters
    ----------
    frames : as received, by stamps.
    front_ns : (N + 1,) latest stamp of the bus up to each of them, and up to the end of the batch [ns].
    ended : nothing comes any more.
    """
    if checks.counter is not None:
        frames, state, ledger = _in_order(frames, front_ns, ended, checks, checks.counter, state, ledger)
        if state.undecided is not None:
            frames, state = MessageFrames.joined([state.undecided, frames]), replace(state, undecided=None)
    flags = np.zeros(len(frames.lengths), np.uint8)
    if checks.checksum is not None:
        flags[~checks.checksum.right(frames.payload)] = np.uint8(Flag.CHECKSUM)
    if checks.counter is None:
        return frames, flags, state, add(ledger, bad_checksum=np.count_nonzero(flags))
    counter, bits = checks.counter.raw(frames.payload).astype(np.int64), checks.counter.length
    trusted = (flags == 0) & _reaches(frames, checks.counter)
    turns, pace = None, state.pace
    if bits < WIDE:
        turns, pace = whole_turns(counter, trusted, frames.t_ns, bits, state.counter.last, pace)
        last = int(np.flatnonzero(trusted)[-1]) if trusted.any() else 0
        if (turns[last:] > 0).any() and not ended and front_ns[-1] - frames.t_ns[last] <= np.int64(SETTLED * 1e9):
            state = replace(state, undecided=frames.at(slice(last, None)))
            frames, counter, trusted, flags = frames.at(slice(last)), counter[:last], trusted[:last], flags[:last]
            turns, pace = whole_turns(counter, trusted, frames.t_ns, bits, state.counter.last, state.pace)
    ledger = add(ledger, bad_checksum=np.count_nonzero(flags & np.uint8(Flag.CHECKSUM)))
    jumps, after = follow_counter(counter, trusted, bits, state.counter, turns)
    still, stood = _standing(counter, trusted, state)
    flags[jumps.gap & ~still] |= np.uint8(Flag.GAP)
    ledger = add(ledger, lost=jumps.lost[~still].sum(), restarts=np.count_nonzero(jumps.back | still))
    return frames, flags, replace(state, counter=after, pace=pace, stood=stood), ledger


def _standing(
    counter: NDArray[np.int64], trusted: NDArray[np.bool_], state: MessageState
) -> tuple[NDArray[np.bool_], int | None]:
    """(N,) frames behind the first one whose counter has never been another so far, and `MessageState.stood` after.

    A counter that has never counted shows no loss.
    """
    still = np.zeros(len(counter), bool)
    at = np.flatnonzero(trusted)
    if state.stood is None or not len(at):
        return still, state.stood
    values = counter[at]
    first = values[0] if state.counter.last is None else state.counter.last
    other = np.flatnonzero(values != first)
    end = int(other[0]) if len(other) else len(at)
    still[at[int(state.counter.last is None) : end]] = True
    return still, None if len(other) else state.stood + end


def _reaches(frames: MessageFrames, counter: Signal) -> NDArray[np.bool_]:
    """(N,) frames that do not end before their counter."""
    return frames.lengths > max(counter.bits) // 8


def _in_order(
    frames: MessageFrames, front_ns: NDArray[np.int64], ended: bool, checks: MessageChecks, counter: Signal,
    state: MessageState, ledger: Mapping[str, int],
) -> tuple[MessageFrames, MessageState, Mapping[str, int]]:  # fmt: skip
    """Frames with those held back, as far as they are settled, in the order of their counter."""
    checksum = checks.checksum
    if state.held is None:
        trusted = _reaches(frames, counter)
        if checksum is not None:
            trusted &= checksum.right(frames.payload)
        values = counter.raw(frames.payload).astype(np.int64)
        if in_sequence(values, trusted, counter.length, state.recent):
            last = int(values[-1]) if len(values) else state.recent.counter
            recent = Recent(last_rows(frames.payload[:, None], state.recent), None, last)
            return frames, replace(state, recent=recent) if len(values) else state, ledger
    before = 0 if state.held is None else len(state.held.t_ns)
    every = frames if state.held is None else MessageFrames.joined([state.held, frames])
    # A silence settles what was before it: it is seen as soon as any frame of the bus is so much later.
    later = np.append(every.t_ns, front_ns[-1])
    later[before:] = front_ns
    edges = 1 + np.flatnonzero(later[1:] - every.t_ns > np.int64(SETTLED * 1e9))
    edges = edges[edges >= before]
    ends = np.unique(np.append(edges, len(every.t_ns))).tolist()
    settled = ended or len(every.t_ns) in edges
    unit = Sampling(
        1, counter.length, None if checksum is None else lambda rows: checksum.right(rows[:, 0]),
        lambda rows: counter.raw(rows[:, 0]).astype(np.int64),
    )  # fmt: skip
    parts: list[MessageFrames] = []
    recent, begin, held = state.recent, 0, None
    for end in ends:
        part = every.at(slice(begin, end))
        stream = Stream(np.zeros(end - begin, np.int64), part.payload, _reaches(part, counter), part.t_ns)
        found = in_order(stream, unit, recent, ended=end < len(every.t_ns) or settled)
        parts.append(part.at(found.frames)._replace(t_ns=found.t_ns))
        held = part.at(slice(found.held, None)) if found.held < end - begin else None
        recent, begin = found.recent, end
        ledger = add(ledger, repeated=found.repeated, reordered=found.reordered)
    return MessageFrames.joined(parts), replace(state, recent=recent, held=held), ledger
