"""How fast the workbench draws: ``python -m benchmarks.workbench_draw [--runs FOLDER] [--write]`` (4 minutes).

Needs Chromium (``CHROMIUM`` names it, otherwise the system's). The runs are made in FOLDER, and used again if they are
there; without it in a temporary folder. Exit code 1 when a limit is missed; ``--write`` makes the page anew.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from benchmarks.workbench_draw.measuring import (
    FLAGS,
    LAYOUTS,
    PASSES,
    channels,
    chromium,
    first_listing,
    measured,
    memory,
    quietest,
    serving,
)
from benchmarks.workbench_draw.page import PAGE, Found, text
from benchmarks.workbench_draw.runs import make_runs


def measure(folder: Path) -> Found:
    """Everything that the page says."""
    make_runs(folder)
    listings = [first_listing(folder) for _ in range(PASSES)]
    with serving(folder) as (process, address), sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS.split())
        page = browser.new_page()
        page.goto(f"{address}#/live")
        names = channels(page)
        passes = {layout.name: [] for layout in LAYOUTS}
        for number in range(PASSES):
            for layout in LAYOUTS:
                print(f"pass {number + 1}: {layout.name} …", file=sys.stderr, flush=True)
                passes[layout.name].append(measured(page, layout, names))
        version = browser.version
        browser.close()
        held = memory(process)
    listing = min(listings, key=lambda one: one.processor)
    return Found(version, listing, held, {name: quietest(found) for name, found in passes.items()})


def main() -> int:
    """Measure, print, and write the page when asked to."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.workbench_draw", description=__doc__)
    parser.add_argument("--runs", type=Path, metavar="FOLDER", help="where the runs are, or are made and kept")
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.name} anew")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        body, kept = text(measure(args.runs or Path(temporary)))
    print(body)
    if args.write:
        PAGE.write_text(body, encoding="utf-8")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
