"""Run the fresh benchmark, or make one trial's folder: ``python -m benchmarks.fresh --help``."""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.fresh.laws import CLASSES
from benchmarks.fresh.making import SETS, class_of, make, write, write_truth

DESCRIPTION = f"""Draw a car and what it lacks anew, give its tables to lacet, and compare its verdict with the truth.

  python -m benchmarks.fresh --only 12 --folder DIR                DIR/12: development trial 12 as a user has it
  python -m benchmarks.fresh --only 12 --folder DIR --truth OTHER  OTHER/12.json: what is hidden in them

Trials are numbered from 0; classes take turns ({", ".join(f"{i} {name}" for i, name in enumerate(CLASSES))}).
"""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.fresh", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--set", choices=SETS, default=SETS[0], help=f"default {SETS[0]}; test is to be run once")
    parser.add_argument("--class", dest="kind", choices=CLASSES, help="trials of this class alone")
    parser.add_argument("--trials", type=int, default=90, help="the first so many trials (default 90)")
    parser.add_argument("--only", metavar="NUMBERS", help="these trials, as 3,17,40")
    parser.add_argument("--list", action="store_true", help="only list the trials")
    parser.add_argument("--folder", type=Path, help="only write the tables of trials, each to a folder of its number")
    parser.add_argument("--truth", type=Path, help="with --folder: folder for what is hidden, a file a trial")
    args = parser.parse_args()
    numbers = [int(word) for word in args.only.split(",")] if args.only else range(args.trials)
    chosen = [number for number in numbers if args.kind in (None, class_of(number))]
    if args.list:
        for number in chosen:
            print(f"{number}: {class_of(number)}")
        return
    if args.folder:
        for number in chosen:
            trial = make(args.set, number)
            write(trial, args.folder / str(number))
            if args.truth:
                write_truth(trial, args.truth / f"{number}.json")
            print(f"{number}: {args.folder / str(number)}", flush=True)


if __name__ == "__main__":
    main()
