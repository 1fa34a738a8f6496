"""``lacet paper --car second`` over seeds: noise, zeros, clocks and road drawn anew.

    python -P benchmarks/second_car_seeds.py --seeds 20

Goes on where it was cut off, in the file ``second_car_seeds.jsonl`` beside it, and writes
``docs/benchmarks/second-car-seeds.md`` from what is there; ``--page`` only writes. The runs of a seed are deleted once
it is scored.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lacet.services.commands.__main__ import main as command
from lacet.services.one_thread import one_thread
from lacet.services.render.intervals import half_width, to_interval

RESULTS = Path(__file__).with_suffix(".jsonl")
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "second-car-seeds.md"
HEAD = """# The paper's tables on the second car, over seeds

`make second-car-seeds` repeats [`lacet paper --car second`](../paper.md#on-a-car-of-another-class) with noise, zeros,
clocks and road drawn anew, {count} seeds so far. *met*: error no larger than the paper's own or half of our 95 %
interval (tables 5 to 7: our interval alone); *held*: the truth is in our interval, whatever the paper's error. Error:
mean over seeds ± its 1 σ from seed to seed; half-width: of our interval, mean."""


def trial(seed: int) -> dict[str, Any]:
    """The lines of all tables with one seed: truth, estimate, half of the 95 % interval, met, held."""
    began = time.process_time()
    with tempfile.TemporaryDirectory(prefix="lacet-second-") as folder, contextlib.redirect_stdout(io.StringIO()):
        result = Path(folder) / "result.json"
        words = ["paper", "--car", "second", "--seed", str(seed), "--out", str(Path(folder) / "out")]
        command([*words, "--json", str(result)])
        found = json.loads(result.read_text(encoding="utf-8"))
    lines = {
        f"{line['table']} {line['parameter']}": [
            line["unit"], line["truth"], line["estimate"], line["half95"], line["verdict"] == "met", line["within"]
        ]
        for campaign in found["campaigns"]
        for line in campaign["lines"]
        if line["estimate"] is not None
    }  # fmt: skip
    return {"seed": seed, "lines": lines, "seconds": round(time.process_time() - began)}


def done() -> list[dict[str, Any]]:
    """The seeds on file."""
    return [json.loads(line) for line in RESULTS.read_text().splitlines()] if RESULTS.exists() else []


def page(trials: Sequence[dict[str, Any]]) -> str:
    """The page in Markdown."""
    parts = [HEAD.format(count=len(trials))]
    names = list(trials[0]["lines"])
    for title, tables in (("Tables 1 to 4, the simulation", "1234"), ("Tables 5 to 7, the experiment", "567")):
        some = [name for name in names if name[0] in tables]
        of = [[one["lines"][name] for one in trials if name in one["lines"]] for name in some]
        met, held = (sum(line[k] for each in of for line in each) for k in (4, 5))
        count = sum(map(len, of))
        parts.append(
            f"## {title}\n\nOf {count} lines {met} met ({100 * met / count:.0f} %), {held} held "
            f"({100 * held / count:.0f} %)."
        )
        rows = ["| line | unit | truth | error | half-width | met | held |", "|---|---|---:|---:|---:|---:|---:|"]
        for name, each in zip(some, of, strict=True):
            error = np.array([line[2] - line[1] for line in each])
            half = float(np.mean([line[3] for line in each]))
            spread = f" ± {to_interval(float(np.std(error, ddof=1)), half)}" if len(error) > 1 else ""
            mean = to_interval(float(np.mean(error)), half)
            rows.append(
                f"| {name[2:]} | {each[0][0]} | {to_interval(each[0][1], half)} | {mean}{spread} "
                f"| {half_width(half)} | {sum(line[4] for line in each)} of {len(each)} "
                f"| {sum(line[5] for line in each)} of {len(each)} |"
            )
        parts.append("\n".join(rows))
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Run what is missing, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="seeds 1 to this one")
    parser.add_argument("--page", action="store_true", help="only write the page")
    args = parser.parse_args()
    known = {one["seed"] for one in done()}
    for seed in range(1, args.seeds + 1) if not args.page else ():
        if seed not in known:
            with one_thread():
                found = trial(seed)
            with RESULTS.open("a") as file:
                file.write(json.dumps(found) + "\n")
            print(f"seed {seed}: {found['seconds']} s of processor time", file=sys.stderr, flush=True)
            PAGE.write_text(page(done()), encoding="utf-8")
    if done():
        PAGE.write_text(page(done()), encoding="utf-8")


if __name__ == "__main__":
    main()
