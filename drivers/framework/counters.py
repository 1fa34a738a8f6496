"""Sample counters and device clocks continued across batches, and the sums of the loss ledger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import SupportsInt

import numpy as np
from numpy.typing import NDArray

WIDE = 16
"""Number of bits from which a counter does not wrap within one loss.

A jump of more than half its range is then a restart of the sensor, not a loss of thousands of samples."""


@dataclass(frozen=True)
class CounterState:
    """State of a sample counter between batches: last trusted value (None before the first), samples since."""

    last: int | None = None
    between: int = 0


@dataclass(frozen=True)
class Jumps:
    """Losses shown by a sequence of counters: samples lost before each (N,), and whether it fell (N,)."""

    lost: NDArray[np.int64]
    back: NDArray[np.bool_]

    @property
    def gap(self) -> NDArray[np.bool_]:
        """(N,) samples to be flagged `GAP`."""
        return (self.lost > 0) | self.back


def follow_counter(
    counter: NDArray[np.int64],
    trusted: NDArray[np.bool_],
    bits: int,
    state: CounterState,
    turns: NDArray[np.int64] | None = None,
) -> tuple[Jumps, CounterState]:
    """Losses shown by a sample counter: each trusted value is compared with the trusted one before it.

    Samples in between whose counter cannot be trusted (bad checksum, incomplete) account for that many steps, so they
    are not counted again as lost. A loss is known modulo the range of the counter only; `turns` are those that it made
    unseen before each sample (N,), -1 where it stands still (`turns.whole_turns`).
    """
    modulus = 1 << bits
    lost = np.zeros(len(counter), np.int64)
    back = np.zeros(len(counter), bool)
    at = np.flatnonzero(trusted)
    if len(at) == 0:
        return Jumps(lost, back), CounterState(state.last, state.between + len(counter))
    values = counter[at]
    between = np.diff(at, prepend=-1) - 1
    between[0] += state.between
    # Losses before the first trusted counter are unknown.
    before = np.concatenate(([values[0] - 1 if state.last is None else state.last], values[:-1]))
    steps = (values - before - 1) % modulus
    went_back = (steps >= modulus // 2) & (bits >= WIDE)
    if turns is not None:
        steps = steps + modulus * turns[at]
        went_back |= turns[at] < 0
    lost[at] = np.where(went_back, 0, np.maximum(steps - between, 0))
    back[at] = went_back
    return Jumps(lost, back), CounterState(int(values[-1]), len(counter) - 1 - int(at[-1]))


def steady_counters(
    counter: NDArray[np.int64], spans: Sequence[tuple[int, slice]], bits: int, states: Sequence[CounterState]
) -> dict[int, CounterState] | None:
    """States after trusted samples of several sensors, of which none is lost; None where `follow_counter` is needed.

    `spans` are the sensors and the samples of each, end to end.
    """
    if bits > 62:  # beyond what integers of 64 bits can tell apart
        return None
    modulus = 1 << bits
    ends = {span.stop - 1 for _, span in spans}
    if not ends.issuperset(np.flatnonzero((counter[1:] - counter[:-1]) & (modulus - 1) != 1).tolist()):
        return None
    after: dict[int, CounterState] = {}
    for number, span in spans:
        before, first = states[number], int(counter[span.start])
        if before.between or (before.last is not None and (first - before.last) % modulus != 1):
            return None
        after[number] = CounterState(int(counter[span.stop - 1]))
    return after


def unwrap_clock(
    clock: NDArray[np.int64], trusted: NDArray[np.bool_], last_us: int | None
) -> tuple[NDArray[np.int64], NDArray[np.bool_], int | None]:
    """A 32-bit microsecond clock continued past its wrap every 71.6 minutes.

    Only trusted readings advance it. A reading more than half the range ahead is a step back.

    Returns
    -------
    device_ns : (N,) unwrapped clock [ns]; a sample without a trusted reading repeats the last one (0 before the first).
    back : (N,) the clock stood still or went back here.
    last_us : the last unwrapped reading [µs], None when there was none yet.
    """
    at = np.flatnonzero(trusted)
    back = np.zeros(len(clock), bool)
    if len(at) == 0:
        return np.full(len(clock), (last_us or 0) * 1000, np.int64), back, last_us
    values = clock[at]
    first = int(values[0]) if last_us is None else last_us
    step = np.diff(np.concatenate(([first], values)))
    step = (step + (1 << 31)) % (1 << 32) - (1 << 31)
    back[at] = step <= 0
    if last_us is None:
        back[at[0]] = False
    unwrapped = first + np.cumsum(step)
    # Index of the last trusted reading at or before each sample, -1 before the first.
    held = np.cumsum(trusted) - 1
    values_us = np.where(held >= 0, unwrapped[held], last_us or 0)
    return values_us * 1000, back, int(unwrapped[-1])


def add(ledger: Mapping[str, int], **more: SupportsInt) -> dict[str, int]:
    """A loss ledger with each count in `more` added."""
    return {**ledger, **{key: ledger.get(key, 0) + int(count) for key, count in more.items()}}
