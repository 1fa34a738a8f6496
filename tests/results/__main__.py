"""Store results, or hold them against what is stored: ``python -m tests.results --help``."""

from __future__ import annotations

import argparse
import gzip
import json
import shlex
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tests.results.compare import differences
from tests.results.parts import LACET, PARTS, QUICK_TRIALS, ROOT, run_trials, stored_trials, trials_drawn

STORED = ROOT / "tests" / "data" / "results"
TRIAL_SETS = {"trials": trials_drawn, "five-trials": lambda: list(QUICK_TRIALS)}
"""Sets of blind trials by name."""
QUICK = ("demo", "reference", "five-trials")
"""What is run after every room (some 5 minutes of processor time)."""
MOST = 20
"""Differences printed of one part."""


def stored_file(name: str) -> Path:
    """Where a part is kept."""
    return STORED / f"{name}.json.gz"


def computed(name: str, lacet: tuple[str, ...] = LACET) -> dict[str, Any]:
    """A part, computed anew."""
    with tempfile.TemporaryDirectory(prefix="lacet-results-") as folder:
        if name in TRIAL_SETS:
            return run_trials(TRIAL_SETS[name](), Path(folder))
        return PARTS[name](Path(folder), lacet)


def stored(name: str) -> dict[str, Any]:
    """A part as it is stored: trials with the blind benchmark, the others in tests/data/results."""
    if name in TRIAL_SETS:
        return stored_trials(TRIAL_SETS[name]())
    return json.loads(gzip.decompress(stored_file(name).read_bytes()))


def store(name: str, result: dict[str, Any]) -> None:
    """Keep a part."""
    STORED.mkdir(parents=True, exist_ok=True)
    text = json.dumps(result, indent=1, ensure_ascii=False)
    stored_file(name).write_bytes(gzip.compress(text.encode(), mtime=0))


def main() -> int:
    """Command line; 1 when something differs."""
    names = [*PARTS, *TRIAL_SETS]
    parser = argparse.ArgumentParser(prog="python -m tests.results", description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*names, "quick", "all"], default="quick", help="default: quick")
    parser.add_argument("--store", action="store_true", help="keep what is computed now (not for trials)")
    parser.add_argument("--lacet", default=shlex.join(LACET), help="how lacet is called")
    parser.add_argument("--relative", type=float, default=0.0, help="numbers may differ by this part (default 0)")
    args = parser.parse_args()
    asked = [args.parts] if isinstance(args.parts, str) else args.parts
    chosen = [n for n in names if n in asked or ("quick" in asked and n in QUICK) or "all" in asked]
    status = 0
    for name in chosen:
        began = time.monotonic()
        result = computed(name, tuple(shlex.split(args.lacet)))
        if args.store and name not in TRIAL_SETS:
            store(name, result)
            print(f"{name}: stored ({time.monotonic() - began:.0f} s)", flush=True)
            continue
        found = list(differences(stored(name), result, args.relative))
        status = max(status, int(bool(found)))
        print(f"{name}: {len(found) or 'no'} differences ({time.monotonic() - began:.0f} s)", flush=True)
        for line in found[:MOST]:
            print(f"  {line}", flush=True)
    return status


if __name__ == "__main__":
    sys.exit(main())
