"""Run the blind benchmark, or a part of it: ``python -m benchmarks.blind --help``."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from fnmatch import fnmatch
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.blind.cases import BANDS, CAUSES, SINGLES, Cell, cells
from benchmarks.blind.making import BUILD, code_of, forget
from benchmarks.blind.page import write_page
from benchmarks.blind.scoring import trial
from benchmarks.blind.sizing import settle
from lacet.services.one_thread import one_thread

DESCRIPTION = """Hide effects in a simulated car, give its tables to lacet, and count how often the right one is named.

  python -m benchmarks.blind                        everything (hours); goes on where it was cut off
  python -m benchmarks.blind --only 'coulomb*' --seeds 2
  python -m benchmarks.blind --table                docs/benchmarks/blind.md from what is there
  python -m benchmarks.blind --size                 sizes of effects that have none (benchmarks/blind/sizes.json)

Results are in benchmarks/blind/trials.jsonl, one line a trial. Lines of other sources of identify/, simulate/ or daq/
(comments aside) are left alone and not counted.
"""
RESULTS = Path(__file__).with_name("trials.jsonl")
"""Kept with the sources: days of processor time."""


def code() -> str:
    """Digest of what decides a trial's outcome."""
    return code_of("identify", "simulate", "daq")


def results(path: Path, digest: str) -> dict[tuple[str, int], dict[str, Any]]:
    """Trials of these sources, by cell and seed; a line cut off by a crash is left out."""
    out: dict[tuple[str, int], dict[str, Any]] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        if digest in ("any", record["code"]):
            out[record["cell"], record["seed"]] = record
    return out


def append(path: Path, record: dict[str, Any]) -> None:
    """One line in one write, so that two processes do not mix theirs; a line that was cut off is ended first."""
    line = (json.dumps(record) + "\n").encode()
    handle = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        size = os.fstat(handle).st_size
        if size and os.pread(handle, 1, size - 1) != b"\n":
            line = b"\n" + line
        os.write(handle, line)
    finally:
        os.close(handle)


def run_cell(cell: Cell, seeds: Sequence[int], path: Path, digest: str, draws: int, keep: bool) -> list[str]:
    """Every trial of a cell; its motion is simulated once. Returns a line for each."""
    out: list[str] = []
    # A reference left by a run that was cut off may be of another size.
    shutil.rmtree(BUILD / "tables" / cell.name.replace("/", "-"), ignore_errors=True)
    with one_thread():
        for seed in seeds:
            begin = time.process_time()
            record = {"code": digest, "draws": draws, **trial(cell, seed, BUILD, draws)}
            record["total"] = time.process_time() - begin
            append(path, record)
            named = [key for key, _ in record.get("added", [])]
            verdict = record["steps"][0]["verdict"] if "steps" in record else record["failed"]
            line = f"{cell.name} seed {seed}: {verdict}; {', '.join(named) or '-'} ({record['total']:.0f} s)"
            print(line, flush=True)
            out.append(line)
    shutil.rmtree(BUILD / "tables" / cell.name.replace("/", "-"), ignore_errors=True)
    if not keep:
        forget(cell)
    return out


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blind", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", metavar="PATTERN", help="cells, as case/band; * stands for anything")
    parser.add_argument("--seeds", type=int, help="no more seeds than these a cell")
    parser.add_argument("--draws", type=int, default=199, help="noise-floor simulations (default 199)")
    parser.add_argument("--processes", type=int, default=1, help="cells side by side (default 1; 3 GB of memory each)")
    parser.add_argument("--results", type=Path, default=RESULTS, help=f"default {RESULTS.name} in benchmarks/blind")
    parser.add_argument("--table", action="store_true", help="only write the page")
    parser.add_argument("--any-code", action="store_true", help="with --table: count results of older sources too")
    parser.add_argument("--page", type=Path, help="where the page goes (default docs/benchmarks/blind.md)")
    parser.add_argument("--list", action="store_true", help="only list the cells")
    parser.add_argument("--size", action="store_true", help="find the sizes that are missing, by the oracle")
    parser.add_argument("--band", action="append", choices=[*BANDS], help="with --size: only these sizes")
    parser.add_argument("--keep", action="store_true", help="keep simulated motions (90 MB a cell) for the next run")
    args = parser.parse_args()
    patterns = args.only or ["*"]
    chosen = {name: cell for name, cell in cells().items() if any(fnmatch(name, p) for p in patterns)}
    if args.size:
        names = [n for n in (*SINGLES, *CAUSES) if any(fnmatch(n, p) for p in patterns)]
        with one_thread():
            settle(names, tuple(args.band or BANDS))
        return
    if args.list:
        for name, cell in chosen.items():
            print(f"{name}: {cell.left_out or f'{cell.seeds} seeds, √λ {cell.root_lambda}'}")
        return
    digest = code()
    args.results.parent.mkdir(parents=True, exist_ok=True)
    done = results(args.results, digest)
    jobs: dict[str, tuple[Cell, list[int]]] = {}
    for name, cell in chosen.items():
        last = min(cell.seeds, args.seeds or cell.seeds)
        seeds = [seed for seed in range(1, last + 1) if (name, seed) not in done]
        if seeds and not cell.left_out and not args.table:
            jobs[name] = (cell, seeds)
    if args.processes > 1:
        with ProcessPoolExecutor(args.processes, mp_context=get_context("spawn")) as pool:
            running = [
                pool.submit(run_cell, cell, seeds, args.results, digest, args.draws, args.keep)
                for cell, seeds in jobs.values()
            ]
            for count, job in enumerate(as_completed(running), 1):
                job.result()
                print(f"{count} of {len(jobs)} cells", flush=True)
    else:
        for count, (cell, seeds) in enumerate(jobs.values(), 1):
            run_cell(cell, seeds, args.results, digest, args.draws, args.keep)
            print(f"{count} of {len(jobs)} cells", flush=True)
    write_page(results(args.results, "any" if args.any_code else digest), args.page)


if __name__ == "__main__":
    main()
