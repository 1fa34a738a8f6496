"""Share of a job that is done and the remaining time, from its plan, its steps and a clock.

A job announces its plan beforehand: stages in order, with the time that each usually takes. The remaining time is that
of the stages ahead at the pace of those behind; within a stage whose parts are counted, the parts done say how long it
takes. Stages that are passed over, as their values are known, neither cost time nor count for the pace. The share done
is the time passed ÷ all time, and never falls.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from lacet.services.progress import AnyStep, JobPlan, ServiceStep, Stretch
from lacet.services.timing.memory import remember, remembered

USUAL_PACE = 0.02
"""Part of a plan that the usual pace counts for, beside the pace of the stages behind."""
COUNTED = 0.1
"""Part of a stage done from which on its own counting weighs more than its expected time."""
OVERDUE = 0.1
"""Remaining time of a stage that takes longer than expected, as a part of the time that it has taken."""
SEEN = 0.1
"""Share done below which the remaining time is not shown: too little of the job has been seen."""
UNPLANNED = 0.2
"""Part of the time passed, spent in steps that the last plan had not at first, from which the remaining time is not
shown: a search goes on as long as it finds effects, and nobody knows how many."""
KNOWN = 0.05
"""Time ÷ expected time below which a stage found its values known: it says nothing of the pace."""
NEARLY = 0.99
"""Largest share of a job that has not ended."""


@dataclass(frozen=True)
class Estimate:
    """Share of a job done (0 to 1), and the remaining time [s]; None where too little of the job has been seen, or was
    planned. `passed` : time since it began [s]; `overdue` : whether it is in what was not planned, for nobody knows how
    long, so that its share means little."""

    share: float
    remaining: float | None
    passed: float
    overdue: bool


@dataclass
class _Visited:
    """A stretch of the plan: its expected time, the time spent in it and the part done by its own counting; `added` to
    the plan as a search went on."""

    stretch: Stretch
    expected: float
    added: bool = False
    spent: float = 0.0
    first: int | None = None
    done: int = 0
    fraction: float = 0.0
    counted: float = 0.0

    @property
    def is_evidence(self) -> bool:
        """Whether it has been through and says something of the pace."""
        return self.spent > KNOWN * self.expected > 0.0

    def count(self, step: AnyStep, spent: float) -> None:
        """Take the parts done from a step, `spent` seconds after the beginning of the stretch."""
        if step.total <= 0:
            return
        if self.first is None:
            self.first = step.done
        self.done = step.done
        parts = step.total - self.first
        fraction = (step.done - self.first) / parts if parts > 0 else 0.0
        if fraction > self.fraction:
            self.fraction, self.counted = min(fraction, 1.0), spent

    def remaining(self, pace: float, spent: float) -> float:
        """Remaining time in it [s]."""
        whole = self.expected * pace
        if self.fraction > 0.0:
            weight = self.fraction / (self.fraction + COUNTED)
            whole = weight * self.counted / self.fraction + (1.0 - weight) * whole
        return max(whole - spent, OVERDUE * spent if self.fraction < 1.0 else 0.0)


class JobTime:
    """Time of one job; `step` receives its steps, `estimate` may be called from any thread.

    Parameters
    ----------
    clock : monotonic time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock, self._lock = clock, threading.Lock()
        self._began = self._since = clock()
        self._plan: list[_Visited] = []
        self._memory: JobPlan | None = None
        self._at = -1
        self._inside = False
        self._share = 0.0
        self._unplanned = 0.0

    def step(self, step: AnyStep) -> None:
        """Take a step of the job."""
        with self._lock:
            now = self._clock()
            if isinstance(step, ServiceStep) and step.plan is not None:
                self._take(step.plan, now)
                return
            place = self._find(step)
            if place is None and self._extended(step):
                place = self._find(step)
            if place is None:
                self._leave(now)
                return
            if place != self._at or not self._inside:
                self._leave(now)
                self._at, self._inside = place, True
            present = self._plan[place]
            if step.stage == present.stretch.stage:
                present.count(step, present.spent + now - self._since)

    def estimate(self) -> Estimate | None:
        """Share done and time remaining now; None for a job that has announced no plan."""
        with self._lock:
            if not self._plan:
                return None
            now = self._clock()
            passed, remaining = now - self._began, self._remaining(now)
            share = passed / (passed + remaining) if passed + remaining > 0.0 else 0.0
            self._share = max(self._share, min(share, NEARLY))
            overdue = self._not_planned(now) > UNPLANNED * passed
            shown = self._share >= SEEN and not overdue
            return Estimate(self._share, remaining if shown else None, passed, overdue and self._share >= SEEN)

    def end(self, done: bool = True) -> None:
        """The job is over: remember the paces of its stages, the last among them when it was `done`."""
        with self._lock:
            self._leave(self._clock())
            if self._memory is None:
                return
            ended = self._at + 1 if done else self._at
            taken: dict[str, tuple[float, float]] = {}
            for one in self._plan[:ended]:
                if one.is_evidence:
                    spent, usual = taken.get(one.stretch.name, (0.0, 0.0))
                    taken[one.stretch.name] = (spent + one.spent, usual + one.stretch.usual)
            remember(self._memory.memory, {name: spent / usual for name, (spent, usual) in taken.items()})

    def _take(self, plan: JobPlan, now: float) -> None:
        """Go on with a plan of what is ahead, whatever of those before was not planned."""
        self._leave(now)
        self._memory, self._unplanned = plan, 0.0
        behind = self._plan[: self._at + 1]
        for one in behind:
            one.added = False
        self._plan = [*behind, *self._expected(plan.stretches)]

    def _extended(self, step: AnyStep) -> bool:
        """Whether the plan goes on with what is ahead from an unplanned stage."""
        ahead = self._memory.further.get(step.stage) if self._memory else None
        if ahead is None:
            return False
        after = self._at + 1
        self._plan[after:after] = self._expected(ahead, added=True)
        return True

    def _not_planned(self, now: float) -> float:
        """Time spent since the last plan was made in what it had not at first [s]."""
        inside = self._plan[self._at].added if self._inside else True
        return self._unplanned + sum(one.spent for one in self._plan if one.added) + inside * (now - self._since)

    def _expected(self, stretches: Sequence[Stretch], added: bool = False) -> list[_Visited]:
        """Stretches with their expected times, by the paces that their stages had the last time."""
        assert self._memory is not None
        paces = remembered(self._memory.memory)
        known = [one for one in self._memory.stretches if one.name in paces]
        usual = sum(one.usual for one in known)
        others = sum(paces[one.name] * one.usual for one in known) / usual if usual > 0.0 else 1.0
        return [_Visited(one, one.likely * one.usual * paces.get(one.name, others), added) for one in stretches]

    def _find(self, step: AnyStep) -> int | None:
        """Place in the plan of a step: where it is, or the next ahead; None for one that is not planned."""
        for place in range(max(self._at, 0), len(self._plan)):
            one = self._plan[place]
            if place == self._at and step.stage in one.stretch.within:
                return place
            if one.stretch.stage != step.stage or one.stretch.subject not in ("", step.subject):
                continue
            # Counting that begins anew belongs to the next stretch of this stage, where there is one.
            if place == self._at and step.total and step.done < one.done:
                anew = [k for k in range(place + 1, len(self._plan)) if self._plan[k].stretch == one.stretch]
                return anew[0] if anew else None if one.stretch.once else place
            return place
        return None

    def _leave(self, now: float) -> None:
        """Leave the present stretch, or what was done outside the plan."""
        if self._inside:
            self._plan[self._at].spent += now - self._since
        else:
            self._unplanned += now - self._since
        self._inside, self._since = False, now

    def _remaining(self, now: float) -> float:
        """Remaining time [s]."""
        spent, expected = (USUAL_PACE * sum(one.expected for one in self._plan),) * 2
        for one in self._plan[: max(self._at, 0)]:
            if one.is_evidence:
                spent, expected = spent + one.spent, expected + one.expected
        present, time_in = None, 0.0
        if self._at >= 0:
            present = self._plan[self._at]
            time_in = present.spent + (now - self._since if self._inside else 0.0)
            if present.counted > KNOWN * present.fraction * present.expected:
                spent, expected = spent + present.counted, expected + present.fraction * present.expected
            elif time_in > present.expected:
                spent, expected = spent + time_in, expected + present.expected
        pace = spent / expected if expected > 0.0 else 1.0
        remaining = pace * sum(one.expected for one in self._plan[self._at + 1 :])
        return remaining + (present.remaining(pace, time_in) if present is not None and self._inside else 0.0)
