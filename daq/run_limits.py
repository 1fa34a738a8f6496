"""Limits of the part of a run that is used: markers set while it was recorded, or seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.errors import RunError, nearest
from lacet.daq.run import Mark, Run, Signal

_SECONDS = re.compile(r"(\d+(?:\.\d*)?)\s*s?")


@dataclass(frozen=True)
class RunLimits:
    """Begin and end of a part: a marker's text, or seconds since the run's start; empty for the run's own.

    Where a text was marked more than once, the part begins at the first and ends at the next one after its begin.
    """

    begin: str = ""
    end: str = ""

    def __bool__(self) -> bool:
        return bool(self.begin or self.end)

    def seconds(self, name: str, marks: Sequence[Mark]) -> tuple[float, float]:
        """Begin and end [s] in a run of that name with those markers; infinite for no end.

        Raises RunError for a marker that it lacks, and for an end before the begin.
        """
        begin = _time(self.begin, name, marks, -np.inf) if self.begin else 0.0
        end = _time(self.end, name, marks, begin) if self.end else float("inf")
        if end <= begin:
            raise RunError(name, [f"'{self.end}' ({end:g} s) is not after '{self.begin or 'its start'}' ({begin:g} s)"])
        return begin, end

    def of(self, run: Run) -> Run:
        """The part of a run, whose time begins anew at 0. Raises RunError as `seconds`, and for an empty part."""
        if not self:
            return run
        begin, end = self.seconds(run.name, run.marks)
        signals = {name: part for name, signal in run.signals.items() if len((part := _part(signal, begin, end)).t)}
        if not signals:
            raise RunError(run.name, [f"nothing was measured from {begin:g} to {end:g} s: it has {run.duration:.1f} s"])
        marks = tuple(Mark(mark.t - begin, mark.text) for mark in run.marks if begin <= mark.t <= end)
        return replace(run, signals=signals, marks=marks)


def _part(signal: Signal, begin: float, end: float) -> Signal:
    a, b = np.searchsorted(signal.t, [begin, end]).tolist()
    return Signal(signal.t[a:b] - begin, signal.values[a:b], signal.flags[a:b])


def _time(text: str, name: str, marks: Sequence[Mark], after: float) -> float:
    """Time of the first marker of a text later than another time, or of a number of seconds [s]."""
    found = [mark.t for mark in marks if mark.text == text]
    if found:
        return next((t for t in found if t > after), found[-1])
    if number := _SECONDS.fullmatch(text):
        return float(number[1])
    known = list(dict.fromkeys(mark.text for mark in marks))
    there = f"its markers: {', '.join(known)}" if known else "it has no markers"
    raise RunError(name, [f"no marker '{text}'{nearest(text, known)}; {there}; or give seconds, as 12.5"])
