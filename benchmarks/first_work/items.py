"""What is measured: commands of both commits, second times, limits in seconds, long runs."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.first_work import material
from benchmarks.first_work.measuring import Cost, answered, ran
from benchmarks.first_work.sides import Side

Measured = Callable[[Side, Side], dict[str, Cost]]
"""Given the side and the present one: costs by part."""

START, FIRST, SECOND = "start-up", "first", "second"
"""Parts of a measurement: the imports alone, the command, and the same once more on what the first left."""
SECOND_SHARE = 0.10
"""Largest share of the first time, both beyond start-up, that a second time may take (issue 20)."""
DRAWS = 39
"""Noise-floor simulations of `make demo`."""
DRAWS_BLIND = 199
EFFECT = "anti_roll_bar.front"
TO_SEPARATE = ("spring_cubic.front", "bump_stop.front")


@dataclass(frozen=True)
class Pair:
    """A command of both commits; `wanted` is the largest ratio now ÷ then beyond start-up, None for information."""

    name: str
    what: str
    wanted: float | None
    measure: Measured


@dataclass(frozen=True)
class Again:
    """A command of the present commit, twice on the same study; start-up, first and second are measured."""

    name: str
    what: str
    measure: Measured


@dataclass(frozen=True)
class Limit:
    """Something of the present commit that takes at most `seconds`; `clock`: the wall clock is told, too."""

    name: str
    what: str
    seconds: float
    measure: Measured
    clock: bool = False


@dataclass(frozen=True)
class Long:
    """A command of the present commit on one run of so many minutes, measured in one round only."""

    name: str
    what: str
    minutes: int
    measure: Measured


def _start(side: Side, command: str, *after: object) -> Cost:
    """A command's imports up to its first work: it finds that there is no such study or run."""
    return ran(side.lacet(command, "no-such-folder/none.mcap", *after), side, exits=(2,))


def _on_runs(command: str) -> Measured:
    def measure(side: Side, now: Side) -> dict[str, Cost]:
        at = material.logs(now)
        runs = [at / f"{name}.mcap" for name in material.USED]
        return {START: _start(side, command), FIRST: ran(side.lacet(command, *runs), side)}

    return measure


def _on_study(state: str, command: str, *after: object, cold: bool = True, times: int = 1) -> Measured:
    """A command on a copy of a study; `times` 2 for once more on the same copy."""

    def measure(side: Side, now: Side) -> dict[str, Cost]:
        source = material.study(side, now, state)
        out = {START: _start(side, command, *after)}
        work = material.copied(source, cold)
        for part in (FIRST, SECOND)[:times]:
            out[part] = ran(side.lacet(command, work, *after), side)
        return out

    return measure


def _only_start(command: str) -> Measured:
    return lambda side, now: {FIRST: _start(side, command)}


def _script(name: str, words: Callable[[Side, Side], Sequence[object]]) -> Measured:
    def measure(side: Side, now: Side) -> dict[str, Cost]:
        python = [*side.lacet()[:1], "-P", str(material.SCRIPTS / name)]
        return {START: ran(python, side), FIRST: ran([*python, *map(str, words(side, now))], side)}

    return measure


def _made_then_shown(side: Side, now: Side) -> dict[str, Cost]:
    work = _emptied(side.work / "made")
    first = ran(side.lacet(*material.new_study(now, work)), side)
    return {START: _start(side, "study"), FIRST: first, SECOND: ran(side.lacet("study", work), side)}


def _opened(side: Side, now: Side) -> dict[str, Cost]:
    return {FIRST: ran(side.lacet("study", material.copied(material.study(side, now, "finished"), cold=True)), side)}


def _served(cold: bool) -> Measured:
    return lambda side, now: {
        FIRST: answered(side, str(material.copied(material.study(side, now, "finished"), cold=cold)))
    }


def _ten_minutes(cold: bool) -> Measured:
    return lambda side, now: {
        FIRST: ran(side.lacet("diagnose", material.copied(material.study(side, now, "ten"), cold)), side)
    }


def _long(minutes: int, command: str, *after: object) -> Measured:
    def measure(side: Side, now: Side) -> dict[str, Cost]:
        if command == "study new":
            work = _emptied(side.work / "made")
            material.long_run(now, minutes)
            return {FIRST: ran(side.lacet(*material.new_long(now, work, minutes)), side)}
        source = material.study(side, now, f"long-{minutes}")
        return {FIRST: ran(side.lacet(command, material.copied(source, cold=True), *after), side)}

    return measure


def _emptied(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    return folder


REPORT = ("--report", "report.html")
PAIRS = (
    Pair("identify", "`identify` of three runs of 16 s", 1 / 3, _on_runs("identify")),
    Pair("diagnose", "`diagnose`, base model", 1 / 3, _on_study("new", "diagnose")),
    Pair("add", f"`add {EFFECT}` on a study just diagnosed", 1 / 5, _on_study("diagnosed", "add", EFFECT, cold=False)),
    Pair("where", "`where`, base model", 1 / 5, _on_study("new", "where")),
    Pair("report", "`study --report` of a finished study", 1 / 5, _on_study("finished", "study", *REPORT)),
    Pair(
        "report-warm", "`study --report` of a study just finished, cache kept", None,
        _on_study("finished", "study", *REPORT, cold=False),
    ),
    Pair(
        "demo", "all after the live part of `make demo`", 1 / 4,
        _script("demo_part.py", lambda side, now: (material.logs(now), side.work / "demo", DRAWS)),
    ),
    Pair(
        "blind", f"one blind trial ({material.CELL}), its tables made before", 1 / 3,
        _script("blind_trial.py", lambda side, now: ("try", material.CELL, material.blind_tables(now), DRAWS_BLIND)),
    ),
)  # fmt: skip
STARTS = tuple(
    Limit(f"start-{command}", f"`{command}`", 0.7, _only_start(command))
    for command in ("identify", "study", "diagnose", "add", "where", "compare")
)
"""Measured in both commits; the limit is for the present one."""
AGAIN = (
    Again("again-study", "`study new`, then `study`", _made_then_shown),
    Again("again-compare", "`compare`, finished study", _on_study("finished", "compare", times=2)),
    Again("again-where", "`where`, base model", _on_study("new", "where", times=2)),
    Again("again-diagnose", "`diagnose`, base model", _on_study("new", "diagnose", times=2)),
    Again("again-report", "`study --report`, finished study", _on_study("finished", "study", *REPORT, times=2)),
    Again(
        "again-next", "`diagnose --next` of two effects", _on_study("new", "diagnose", "--next", *TO_SEPARATE, times=2)
    ),
    Again("again-plan", "`plan`, finished study", _on_study("finished", "plan", times=2)),
)
LIMITS = (
    Limit("opened", "`study` of a finished study, cold", 2.0, _opened),
    Limit("ui-cold", "`ui` of a finished study, cold, until page and study are served", 2.0, _served(True), clock=True),
    Limit("ui", "the same with the cache kept", 2.0, _served(False), clock=True),
    Limit("ten", "`diagnose` of 10 minutes in three runs, four effects missing, cold", 10.0, _ten_minutes(True)),
    Limit("ten-warm", "the same just after `study new`, cache kept", 10.0, _ten_minutes(False)),
)


def long_runs(minutes: Sequence[int]) -> tuple[Long, ...]:
    """Commands on one long run, cold."""
    return tuple(
        Long(f"long-{length}-{name}", f"`{what}`", length, _long(length, *words))
        for length in minutes
        for name, what, words in (
            ("study", "study new", ("study new",)),
            ("diagnose", "diagnose", ("diagnose",)),
            ("where", "where", ("where",)),
            ("report", "study --report", ("study", *REPORT)),
        )
    )


MINUTES, MINUTES_LONG = (1, 10), (1, 10, 60)
