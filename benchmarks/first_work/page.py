"""The page docs/benchmarks/first-work.md out of what was measured."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.first_work.items import (
    AGAIN,
    FIRST,
    LIMITS,
    MINUTES_LONG,
    PAIRS,
    SECOND,
    SECOND_SHARE,
    START,
    STARTS,
    long_runs,
)
from benchmarks.first_work.measuring import Kept
from benchmarks.first_work.sides import HOME, Side

PAGE = HOME / "docs" / "benchmarks" / "first-work.md"
TEXT = """# How long one waits

Written by `make first-work`, which goes on where it was cut off. Then is commit {then}, now {now}, in turns by the same
Python and packages, each command a process of its own with compiled bytecode. Seconds are processor time, the smallest
of the rounds, beyond start-up (the same command asked for a study or run that is not there) and with a cold cache of
the study, where not said otherwise. Linear algebra has one thread in both.

{when}

## Against then

The runs are the captures with two hidden anti-roll bars: sinus, lift-off and rough used, spiral and braking held out,
16 s each. In the demo, what its live part would record is copied from logs decoded before.

{pairs}

## Start-up

{starts}

## A second time

The present commit alone, twice on the same study; times below {least:g} s count as that.

{again}

## In seconds

The present commit alone, with start-up. What is waited for at a page has its time by the clock beside it.

{limits}

## Long runs

The present commit alone, with start-up; one run, the reference car's tables of sine steering and rough road repeated,
125 Hz; measured once; caches cold.

{long}

## What misses

{missed}
"""
LEAST = 0.01
"""Smallest time beyond start-up that a ratio is made of [s]: below it processor time is not resolved."""


def key(name: str, side: Side, part: str) -> str:
    """Name of a measurement."""
    return f"{name}|{side.name}|{part}"


@dataclass
class _Page:
    kept: Kept
    then: Side
    now: Side
    rounds: int
    missed: list[str] = field(default_factory=list)
    unmeasured: list[str] = field(default_factory=list)

    def seconds(self, name: str, side: Side, part: str) -> float | None:
        """Smallest processor time of a part [s]."""
        cost = self.kept.least(key(name, side, part))
        return None if cost is None else cost.seconds

    def beyond(self, name: str, side: Side, part: str) -> float | None:
        """Smallest processor time of a part beyond the smallest start-up [s]."""
        whole, start = self.seconds(name, side, part), self.seconds(name, side, START)
        return None if whole is None or start is None else max(LEAST, whole - start)

    def holds(self, what: str, value: float, wanted: float, unit: str) -> str:
        """Yes or no; what does not hold is remembered."""
        if value <= wanted:
            return "yes"
        self.missed.append(f"{what}: {_number(value, unit)}, wanted {_number(wanted, unit)}")
        return "**no**"

    def pairs(self) -> list[str]:
        rows = ["| what | then [s] | now [s] | now ÷ then | wanted | holds |", "|---|---:|---:|---:|---:|---|"]
        for item in PAIRS:
            then, now = (self.beyond(item.name, side, FIRST) for side in (self.then, self.now))
            if then is None or now is None:
                self.unmeasured.append(item.what)
                continue
            verdict = "" if item.wanted is None else self.holds(item.what, now / then, item.wanted, "")
            wanted = "" if item.wanted is None else f"1/{1 / item.wanted:.0f}"
            rows.append(f"| {item.what} | {then:.2f} | {now:.2f} | {now / then:.3f} | {wanted} | {verdict} |")
        return rows

    def starts(self) -> list[str]:
        rows = [
            "| start-up of | then [s] | now [s] | now ÷ then | wanted [s] | holds |",
            "|---|---:|---:|---:|---:|---|",
        ]
        for item in STARTS:
            then, now = (self.seconds(item.name, side, FIRST) for side in (self.then, self.now))
            if then is None or now is None:
                self.unmeasured.append(f"start-up of {item.what}")
                continue
            verdict = self.holds(f"start-up of {item.what}", now, item.seconds, "s")
            rows.append(f"| {item.what} | {then:.2f} | {now:.2f} | {now / then:.2f} | {item.seconds:g} | {verdict} |")
        return rows

    def again(self) -> list[str]:
        rows = ["| what | start-up [s] | first [s] | second [s] | second ÷ first | wanted | holds |",
                "|---|---:|---:|---:|---:|---:|---|"]  # fmt: skip
        for item in AGAIN:
            first, second = (self.beyond(item.name, self.now, part) for part in (FIRST, SECOND))
            start = self.seconds(item.name, self.now, START)
            if first is None or second is None or start is None:
                self.unmeasured.append(f"a second time: {item.what}")
                continue
            share = second / first
            verdict = self.holds(f"a second time: {item.what}", share, SECOND_SHARE, "")
            times = f"{start:.2f} | {first:.2f} | {second:.2f} | {share:.3f}"
            rows.append(f"| {item.what} | {times} | {SECOND_SHARE:g} | {verdict} |")
        return rows

    def limits(self) -> list[str]:
        rows = ["| what | processor [s] | clock [s] | memory [MB] | wanted [s] | holds |",
                "|---|---:|---:|---:|---:|---|"]  # fmt: skip
        for item in LIMITS:
            cost = self.kept.least(key(item.name, self.now, FIRST))
            if cost is None:
                self.unmeasured.append(item.what)
                continue
            verdict = self.holds(item.what, cost.seconds, item.seconds, "s")
            clock = f"{cost.clock:.2f}" if item.clock else ""
            rows.append(
                f"| {item.what} | {cost.seconds:.2f} | {clock} | {cost.memory:.0f} | {item.seconds:g} | {verdict} |"
            )
        return rows

    def long(self) -> list[str]:
        rows = ["| one run of | command | processor [s] | memory [MB] |", "|---:|---|---:|---:|"]
        for item in long_runs(MINUTES_LONG):
            cost = self.kept.least(key(item.name, self.now, FIRST))
            if cost is None:
                self.unmeasured.append(f"{item.what} on {item.minutes} min")
                continue
            rows.append(f"| {item.minutes} min | {item.what} | {cost.seconds:.1f} | {cost.memory:.0f} |")
        return rows

    def text(self) -> str:
        tables = [self.pairs(), self.starts(), self.again(), self.limits(), self.long()]
        loads = self.kept.loads()
        missed = [f"- {one}." for one in self.missed] or ["Nothing that was measured misses what was wanted."]
        unmeasured = ["", f"Not measured: {'; '.join(self.unmeasured)}."] if self.unmeasured else []
        day, rounds = time.strftime("%Y-%m-%d", time.gmtime()), f"{self.rounds} round{'s' * (self.rounds > 1)}"
        mean, most = sum(loads) / max(1, len(loads)), max(loads, default=0.0)
        when = (
            f"{day}, {rounds}; {_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}; on average\n"
            f"{mean:.1f} processes at work on the machine meanwhile, {most:.1f} at most, these included."
        )
        names = ("pairs", "starts", "again", "limits", "long")
        return TEXT.format(
            then=self.then.commit, now=self.now.commit, when=when, least=LEAST,
            missed="\n".join([*missed, *unmeasured]),
            **{name: "\n".join(table) for name, table in zip(names, tables, strict=True)},
        )  # fmt: skip


def page(kept: Kept, then: Side, now: Side, rounds: int) -> str:
    """The page's text."""
    return _Page(kept, then, now, rounds).text()


def _number(value: float, unit: str) -> str:
    return f"{value:.2f} s" if unit else f"{value:.3f}"


def _processor() -> str:
    """The processor's name."""
    try:
        rows: Sequence[str] = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        rows = ()
    named = (row.split(":", 1)[1].strip() for row in rows if row.startswith("model name"))
    return next(named, platform.machine())
