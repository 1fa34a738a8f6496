"""Measure how long each command takes against f0e8420, or a part of it: ``python -m benchmarks.first_work --help``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from fnmatch import fnmatch

from benchmarks.first_work.items import (
    AGAIN,
    FIRST,
    LIMITS,
    MINUTES,
    MINUTES_LONG,
    PAIRS,
    STARTS,
    Again,
    Limit,
    Long,
    Pair,
    long_runs,
)
from benchmarks.first_work.measuring import Failed, Kept
from benchmarks.first_work.page import PAGE, key, page
from benchmarks.first_work.sides import BUILD, NoCommit, Side, sides, uncommitted

DESCRIPTION = """Processor time of lacet's commands, now against commit f0e8420 and the second time against the first.

  python -m benchmarks.first_work --write                 everything, and docs/benchmarks/first-work.md
  python -m benchmarks.first_work --only 'again-*'        some; * stands for anything, --list names all
  python -m benchmarks.first_work --only add --again      anew, dropping what was measured of it
  python -m benchmarks.first_work --long --write          with a run of an hour as well

The present commit is measured (HEAD, not what is uncommitted). Measurements are kept in build/first_work, one file a
commit, so that a run that was cut off goes on; remove that folder to begin anew."""


def main() -> int:
    """Command line; 1 when something failed or the commit to compare with is not there."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.first_work",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--write", action="store_true", help="write the page")
    parser.add_argument("--only", action="append", metavar="NAME", help="only these; * stands for anything")
    parser.add_argument("--rounds", type=int, default=3, help="the smallest of so many counts (default 3)")
    parser.add_argument("--long", action="store_true", help="a run of 60 minutes as well (much memory)")
    parser.add_argument("--again", action="store_true", help="drop what was measured before")
    parser.add_argument("--list", action="store_true", help="only list the names")
    args = parser.parse_args()
    patterns: Sequence[str] = args.only or ["*"]
    every = (*STARTS, *PAIRS, *AGAIN, *LIMITS, *long_runs(MINUTES_LONG if args.long else MINUTES))
    chosen = [item for item in every if any(fnmatch(item.name, pattern) for pattern in patterns)]
    if args.list or not chosen:
        print("\n".join(f"{item.name}: {item.what}" for item in chosen) or f"no such name: {', '.join(patterns)}")
        return 0 if chosen else 1
    BUILD.mkdir(parents=True, exist_ok=True)
    try:
        print("laying out and compiling both commits", flush=True)
        then, now = sides()
    except NoCommit as cause:
        print(cause, file=sys.stderr)
        return 1
    if uncommitted():
        print(f"! there are uncommitted changes, which are not measured: {now.commit} is")
    kept = Kept(BUILD / f"measured-{now.commit}.json")
    failed: list[str] = []
    for number in range(1, args.rounds + 1):
        for item in chosen:
            if item.name not in failed and not measured(item, number, then, now, kept, args.again and number == 1):
                failed.append(item.name)
    text = page(kept, then, now, args.rounds)
    print(f"\n{text}")
    if args.write:
        PAGE.write_text(text, encoding="utf-8")
        print(f"written: {PAGE}")
    return 1 if failed else 0


def measured(item: Pair | Again | Limit | Long, number: int, then: Side, now: Side, kept: Kept, anew: bool) -> bool:
    """Measure one item in one round unless that was done; False when a command failed."""
    both = (then, now) if isinstance(item, Pair) or item in STARTS else (now,)
    for side in both if number % 2 else both[::-1]:
        if anew:
            kept.forget(key(item.name, side, ""))
        if kept.count(key(item.name, side, FIRST)) >= (1 if isinstance(item, Long) else number):
            continue
        try:
            costs = item.measure(side, now)
        except Failed as cause:
            print(f"{item.name}: {cause}", file=sys.stderr, flush=True)
            return False
        for part, cost in costs.items():
            kept.add(key(item.name, side, part), cost)
        said = ", ".join(f"{part} {cost.seconds:.2f} s {cost.memory:.0f} MB" for part, cost in costs.items())
        print(f"round {number}, {item.name}, {side.name}: {said}", flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
