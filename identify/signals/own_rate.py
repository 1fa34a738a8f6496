"""A channel's own sample rate, where its table has more rows than it has samples.

A table of several instruments has the stamps of all: one has empty cells where another alone was sampled. These are no
lost samples: interpolated over them, a slower instrument's noise would be that of a faster one.
"""

from __future__ import annotations

import numpy as np

from lacet.daq.blocks import Flag
from lacet.daq.pauses import longest_step
from lacet.daq.run import Signal

_EVEN = (0.6, 1.6)
"""Steps ÷ the usual one between samples of which none is lost: 100 Hz in a table of 250 Hz has steps of two and three
rows."""
_NEARLY_ALL = 0.9
"""Part of a channel's steps that are so even, at least. Source: a choice; the rest are losses of the channel, while of
cells that are empty by chance, three in five, four in ten steps are even."""
_MOST = 0.5
"""Part of the empty cells that lie within such a step, at least: of lost samples none does. Source: the larger part."""


def at_own_rate(signal: Signal) -> Signal:
    """The signal without the empty cells between its samples, in a table that has the stamps of other channels, too."""
    filled = (signal.flags & int(Flag.MISSING)) == 0
    if filled.all() or np.count_nonzero(filled) < 2:
        return signal
    steps = np.diff(signal.t[filled])
    usual = float(np.median(steps))
    even = (steps >= _EVEN[0] * usual) & (steps <= _EVEN[1] * usual)
    empty = np.diff(np.flatnonzero(filled)) - 1
    if float(np.mean(even)) < _NEARLY_ALL or np.sum(empty[even]) < _MOST * np.sum(empty) or not np.any(empty):
        return signal
    return Signal(signal.t[filled], signal.values[filled], signal.flags[filled])


def sample_rate(signal: Signal) -> float:
    """Usable samples of a signal per second [Hz], without its pauses."""
    good = signal.usable
    t = signal.t[good] if np.count_nonzero(good) > 1 else signal.t
    steps = np.diff(t)
    inside = steps <= longest_step(float(np.median(steps)))
    return (len(t) - 1) / float(np.ptp(t)) if inside.all() else int(np.sum(inside)) / float(np.sum(steps[inside]))
