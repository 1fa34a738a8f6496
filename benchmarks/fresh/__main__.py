"""Run the fresh benchmark, or make one trial's folder: ``python -m benchmarks.fresh --help``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from benchmarks.blind.making import code_of
from benchmarks.fresh import making, second
from benchmarks.fresh.laws import CLASSES
from benchmarks.fresh.making import SETS, write, write_truth
from benchmarks.fresh.page import write_page
from benchmarks.fresh.running import results_file, run_trial, to_run
from benchmarks.fresh.second_page import write_second_page

DESCRIPTION = f"""Draw a car and what it lacks anew, give its tables to lacet, and compare its verdict with the truth.

  python -m benchmarks.fresh                        90 development trials; goes on where it was cut off
  python -m benchmarks.fresh --class six --trials 180 --processes 2
  python -m benchmarks.fresh --set test --trials 540
  python -m benchmarks.fresh --car second --set test --trials 9     on a car on linkages, with tables of its bench
  python -m benchmarks.fresh --page                 docs/benchmarks/fresh.md from what is there
  python -m benchmarks.fresh --only 12 --folder DIR                DIR/12: development trial 12 as a user has it
  python -m benchmarks.fresh --only 12 --folder DIR --truth OTHER  OTHER/12.json: what is hidden in them

Results are in benchmarks/fresh/development.jsonl and test.jsonl, one line a trial. A development trial is run anew for
other sources of identify/, services/, simulate/ or daq/ (comments aside); a test trial never is.
Trials are numbered from 0; classes take turns ({", ".join(f"{i} {name}" for i, name in enumerate(CLASSES))}).
"""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.fresh", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--set", choices=SETS, default=SETS[0], help=f"default {SETS[0]}; test is to be run once")
    parser.add_argument("--car", choices=("fresh", second.CAR), default="fresh", help="default fresh: drawn anew")
    parser.add_argument("--class", dest="kind", choices=CLASSES, help="trials of this class alone")
    parser.add_argument("--trials", type=int, default=90, help="the first so many trials (default 90)")
    parser.add_argument("--only", metavar="NUMBERS", help="these trials, as 3,17,40")
    parser.add_argument("--list", action="store_true", help="only list the trials")
    parser.add_argument("--folder", type=Path, help="only write the tables of trials, each to a folder of its number")
    parser.add_argument("--truth", type=Path, help="with --folder: folder for what is hidden, a file a trial")
    parser.add_argument("--processes", type=int, default=1, help="trials side by side (default 1; 3 GB of memory each)")
    parser.add_argument("--results", type=Path, help="where results go (default benchmarks/fresh/SET.jsonl)")
    parser.add_argument("--page", action="store_true", help="only write the page")
    args = parser.parse_args()
    pages = {"fresh": write_page, second.CAR: write_second_page}
    if args.page:
        pages[args.car]()
        return
    class_of = second.class_of if args.car == second.CAR else making.class_of
    make = second.make if args.car == second.CAR else making.make
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
        return
    run(args.set, chosen, args.results or results_file(args.set, args.car), args.processes, args.car)
    if args.results is None:
        pages[args.car]()


def run(name: str, numbers: Sequence[int], file: Path, processes: int, car: str = "fresh") -> None:
    """Run the trials that have no result yet."""
    code = code_of("identify", "services", "simulate", "daq")
    todo = to_run(name, numbers, file, code)
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        jobs = [pool.submit(run_trial, name, number, file, code, car) for number in todo]
        for count, job in enumerate(as_completed(jobs), 1):
            print(f"{count} of {len(todo)}: {job.result()}", flush=True)


if __name__ == "__main__":
    main()
