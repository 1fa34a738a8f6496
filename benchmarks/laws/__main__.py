"""Run the benchmark of laws: ``python -m benchmarks.laws --help``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from threadpoolctl import threadpool_limits

from benchmarks.blind.__main__ import append
from benchmarks.blind.making import code_of
from benchmarks.fresh.running import rounded
from benchmarks.laws.finding import find
from benchmarks.laws.forms import SETS
from benchmarks.laws.making import write
from benchmarks.laws.page import write_page

HERE = Path(__file__).parent
DESCRIPTION = """Hide a law that nobody listed in a fresh simulated car, and compare the formula that is found for it.

  python -m benchmarks.laws                         development laws; goes on where it was cut off
  python -m benchmarks.laws --set test              laws of other forms; to be run once
  python -m benchmarks.laws --page                  docs/benchmarks/laws.md from what is there

Results are in benchmarks/laws/development.jsonl and test.jsonl, one line a law. A development law is run anew for other
sources of identify/ or simulate/ (comments aside); a test law never is.
"""


def read(name: str, code: str | None = None) -> dict[int, dict[str, Any]]:
    """Results of a set by number, of these sources alone when a digest is given."""
    file = HERE / f"{name}.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    records = [json.loads(line) for line in lines]
    return {one["trial"]: one for one in records if code in (None, one["code"])}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.laws", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--set", choices=SETS, default="development", help="default development; test is to be run once"
    )
    parser.add_argument("--only", metavar="NUMBERS", help="these laws, as 3,17")
    parser.add_argument("--page", action="store_true", help="only write the page")
    args = parser.parse_args()
    code = code_of("identify", "simulate")
    if not args.page:
        numbers = [int(word) for word in args.only.split(",")] if args.only else range(len(SETS[args.set]))
        done = read(args.set, None if args.set == "test" else code)
        for number in [number for number in numbers if number not in done]:
            with TemporaryDirectory(prefix="laws-") as place, threadpool_limits(1):
                truth = write(args.set, number, Path(place))
                record = {"set": args.set, "trial": number, "code": code, "truth": truth, **find(Path(place))}
            append(HERE / f"{args.set}.jsonl", rounded(record))
            print(line_of(record), flush=True)
    write_page({name: list(read(name).values()) for name in SETS})


def line_of(record: dict[str, Any]) -> str:
    """A law in a line."""
    best = record["formulas"][0] if record["formulas"] else None
    head = f"{record['trial']} {record['truth']['where']}: {record['truth']['law']}"
    if best is None:
        return f"{head} → none (failing: {', '.join(record['failing']) or 'none'})"
    share = (
        f"{100 * best['law']['explained']:.0f} %, held-out run {100 * best['held']:.0f} %, {record['seconds']:.1f} s"
    )
    return f"{head} → {best['text']} {best['law']['listed']}: {share}"


if __name__ == "__main__":
    main()
