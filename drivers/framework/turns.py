"""Whole turns of a sample counter, found by the time that passed where the period of the samples is known.

A counter of four bits is where it was after 16 samples: it shows neither a loss of 16 nor that it stands still.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

INTERVALS = 32
"""Intervals between samples in sequence, just before, of which the median is the period. Source: a choice; at 10 Hz
three seconds."""
EVEN = 0.9
"""Fraction of these intervals that differ from the period by half of it at most, from which it is known. Source: a
choice; messages sent on a change have no period, and one turn lost among `INTERVALS` leaves it known."""
PAUSE = 0.03
"""Longest pause of the arrivals of samples that are not lost [s]: half a turn must last longer. Source: arrivals at a
laptop (``docs/decisions/frames-and-stamps.md``)."""
OFF = 2.0
"""Pause from which a sender is taken to have been off [s]: what it would have sent is no loss. Source: a choice; a
control unit starts within seconds, and a turn of four bits at 10 Hz lasts 1.6 s."""


@dataclass(frozen=True)
class Pace:
    """Times of samples between batches: stamp of the last trusted one, and the last intervals in sequence [ns]."""

    last_ns: int | None = None
    intervals: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


def whole_turns(
    counter: NDArray[np.int64], trusted: NDArray[np.bool_], t_ns: NDArray[np.int64], bits: int, last: int | None,
    pace: Pace,
) -> tuple[NDArray[np.int64], Pace]:  # fmt: skip
    """Turns that the counter made unseen before each trusted sample (N,), by stamps in order; and the pace after them.

    The counter has less than `counters.WIDE` bits.
    `last` is the trusted counter before these samples. A turn of -1: the counter stands still, and no time for a turn
    has passed. Without a known period, after a pause of `OFF`, and where the next one comes at once behind it, for they
    were late together, it is 0.
    """
    turns = np.zeros(len(counter), np.int64)
    at = np.flatnonzero(trusted)
    if not len(at):
        return turns, pace
    modulus = 1 << bits
    first_ns = int(t_ns[at[0]])
    passed = np.diff(t_ns[at], prepend=first_ns if pace.last_ns is None else pace.last_ns)
    steps = np.diff(counter[at], prepend=int(counter[at[0]]) - 1 if last is None else last)
    steps = (steps - 1) % modulus + 1  # 1 … modulus: one that stands still has made a turn, or none
    in_sequence = (steps == 1) & (passed > 0)
    history = np.concatenate((pace.intervals, passed[in_sequence]))
    before = len(pace.intervals) + np.cumsum(in_sequence) - in_sequence
    # Less than half a turn of the shortest interval is less than half a turn: most samples end here.
    may = (steps == modulus) | (2 * passed > modulus * history.min(initial=np.iinfo(np.int64).max // modulus))
    may = np.flatnonzero(may & (before >= INTERVALS) & (passed < OFF * 1e9))
    if len(may):
        windows = sliding_window_view(history, INTERVALS)[before[may] - INTERVALS]
        period = np.median(windows, axis=1)
        even = np.mean(np.abs(windows - period[:, None]) <= 0.5 * period[:, None], axis=1) >= EVEN
        together = np.append(passed[1:], np.iinfo(np.int64).max)[may] < 0.5 * period
        known = even & ~together & (0.5 * modulus * period > PAUSE * 1e9)
        unseen = np.rint((passed[may] / period - steps[may]) / modulus).astype(np.int64)
        turns[at[may]] = np.where(known, np.maximum(unseen, -(steps[may] == modulus).astype(np.int64)), 0)
    return turns, Pace(int(t_ns[at[-1]]), history[-INTERVALS:])
