"""The page of the trials on the second car: goals, what of the mechanism was named, what is wrong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.blind.making import HOME
from benchmarks.blind.page import Goal
from benchmarks.fresh.making import SETS
from benchmarks.fresh.page import class_table, wrong_list
from benchmarks.fresh.running import read, results_file
from benchmarks.fresh.scoring import Record, alarm, of_mechanism, scored
from benchmarks.fresh.second import CAR, MECHANISM

PAGE = HOME / "docs" / "benchmarks" / "second-blind.md"
INTRODUCTION = """\
Effects hidden in the [second car](../second-car.md), whose wheels hang on linkages, told by `lacet diagnose --auto`
from tables of four runs, with the right tables of its bench in the vehicle file. Written by `make second-blind`, by the
scoring and the sizing of the [fresh benchmark](fresh.md): √λ at least 15 by the simulator's motion, beside all other
hidden effects and the mechanism's. Each drive (rig, runs, roads, noise and instruments' errors drawn anew) is driven
three times: nothing hidden, one law, two laws. Laws of springs and dampers act along these, not at the wheel.

What the mechanism itself has beyond the class of lacet's model is counted as *of the mechanism* and is no wrong name:
{mechanism}.
As a diagnosis names these first, a hidden effect counts as named when it is in the final set at its axle, not when it
is first; that the mechanism's are found is no goal here. A cause declared as unlisted with nothing hidden
is an alarm. Bounds are one-sided 95 % (Clopper–Pearson)."""


def goals(records: Sequence[Record]) -> list[Goal]:
    """Those of the second car, with counts."""
    none, single, pair = ([r for r in records if r["class"] == kind] for kind in ("none", "single", "pair"))
    named = [(key, r) for r in records for key in r["verdict"]["effects"]]
    well = sum(key not in scored(r).wrong for key, r in named)
    return [
        Goal("nothing hidden: false alarms (95 % bound ≤ 8 %)", sum(map(alarm, none)), len(none), 0.08, True),
        Goal("one law: named at each axle (≥ 92 %)", sum(map(_all_named, single)), len(single), 0.92),
        Goal("two laws: all named (≥ 85 %)", sum(map(_all_named, pair)), len(pair), 0.85),
        Goal("names that are of something hidden or of the mechanism (≥ 98 %)", well, len(named), 0.98),
    ]


def _all_named(record: Record) -> bool:
    return all(scored(record).found)


def mechanism_table(records: Sequence[Record]) -> list[str]:
    """How often each effect of the mechanism was named."""
    counts = Counter(key for r in records for key in r["verdict"]["effects"] if of_mechanism(key, r))
    order = [*MECHANISM, *(key for key in counts if key not in MECHANISM)]
    lines = ["| of the mechanism | named in trials |", "|---|---:|"]
    return [*lines, *(f"| `{key}` | {counts[key]} of {len(records)} |" for key in order)]


def section(name: str, found: Mapping[int, Record]) -> list[str]:
    """A set's part of the page."""
    title = f"## {name.capitalize()} set"
    records = [found[number] for number in sorted(found)]
    ran, failed = [r for r in records if "verdict" in r], [r for r in records if "failed" in r]
    if not ran:
        return [title, "", "Not run." if not failed else f"All {len(failed)} trials failed."]
    seconds = np.median([r["verdict"]["seconds"] for r in ran])
    return [
        title, "",
        f"{len(records)} trials, of which {len(failed)} failed; {seconds:.0f} s of processor time for a verdict "
        "(median). "
        f"Each is a line of [{CAR}-{name}.jsonl](../../benchmarks/fresh/{CAR}-{name}.jsonl).", "",
        "| goal | reached, % | 95 % bound, % | |", "|---|---|---|---|", *(goal.line() for goal in goals(ran)), "",
        *class_table(ran), "", *mechanism_table(ran), "", "Trials that are not right:", "", *wrong_list(ran),
    ]  # fmt: skip


def write_second_page(file: Path = PAGE) -> None:
    """Write the page from the results that are kept."""
    introduction = INTRODUCTION.format(mechanism=", ".join(f"`{key}`" for key in MECHANISM))
    lines = ["# Blind trials on the second car", "", introduction]
    for name in reversed(SETS):
        lines += ["", *section(name, read(results_file(name, CAR)))]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
