"""The server and the browser, and what is measured with them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any
from urllib.request import urlopen

from playwright.sync_api import Page

from benchmarks.workbench_draw.runs import NAMES, SECONDS

ROUNDS, PASSES = 10, 3
"""Times that each layout is drawn in a pass; passes, of which the one with the quietest machine counts."""
FLAGS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)
SCRIPT = (Path(__file__).parent / "drawing.js").read_text(encoding="utf-8")
LAST = "all samples drawn"
"""The end of a first draw."""
PLOTTED = 50
"""Channels drawn, each a component: the first of a run."""


@dataclass(frozen=True)
class Layout:
    """Plots, lines in each, height of a plot [px], width and height of the window [px]."""

    name: str
    plots: int
    lines: int
    height: int
    window: tuple[int, int]


LAYOUTS = (
    Layout("50 plots of 1 channel, 1280 × 720", 50, 1, 110, (1280, 720)),
    Layout("10 plots of 5 channels, 1280 × 1700", 10, 5, 120, (1280, 1700)),
    Layout("50 plots of 1 channel on one tall page, 1280 × 4400", 50, 1, 50, (1280, 4400)),
)


@dataclass
class Pass:
    """Ten rounds of a layout: plots in sight, times and processor times [ms] by what was done, reference load."""

    seen: int = 0
    times: dict[str, list[float]] = field(default_factory=dict)
    processor: dict[str, list[float]] = field(default_factory=dict)
    reference: list[float] = field(default_factory=list)


@dataclass
class Listing:
    """First listing of the four runs: wall clock and processor time of the server [s], its memory after [MB]."""

    wall: float
    processor: float
    memory: float


def chromium() -> str:
    """The browser. Raises SystemExit when there is none."""
    found = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if not found:
        raise SystemExit("no chromium on this machine: install it, or name it in CHROMIUM")
    return found


@contextmanager
def serving(folder: Path) -> Iterator[tuple[int, str]]:
    """The workbench itself, on a free port: the number of its process and its address."""
    command = [sys.executable, "-u", "-m", "lacet.services.commands.__main__", "ui", str(folder), "--port", "0",
               "--no-token"]  # fmt: skip
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2])
    assert server.stdout is not None
    try:
        for line in server.stdout:
            if "http://" in line:
                yield server.pid, line[line.index("http://") :].split()[0]
                return
        raise SystemExit("the workbench did not start")
    finally:
        server.terminate()
        server.wait()


def spent(process: int) -> float:
    """Processor time of a process so far [s]."""
    parts = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(parts[11]) + int(parts[12])) / os.sysconf("SC_CLK_TCK")


def memory(process: int) -> float:
    """Memory that a process holds [MB]."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1e3


def first_listing(folder: Path) -> Listing:
    """What the first listing of the runs takes; nothing is known of them before."""
    shutil.rmtree(folder / ".cache", ignore_errors=True)
    with serving(folder) as (process, address):
        with urlopen(f"{address}api/study") as answer:
            answer.read()
        before, begin = spent(process), time.perf_counter()
        with urlopen(f"{address}api/runs") as answer:
            answer.read()
        wall = time.perf_counter() - begin
        return Listing(wall, spent(process) - before, memory(process))


def channels(page: Page) -> list[str]:
    """Channels whose components are the lines that are drawn."""
    about: Any = page.evaluate("(async () => (await fetch('api/runs/sine')).json())()")
    out: list[str] = []
    lines = 0
    for channel in about["channels"]:
        if lines < PLOTTED:
            out.append(channel["name"])
            lines += max(1, len(channel["components"]))
    return out


def measured(page: Page, layout: Layout, names: list[str]) -> Pass:
    """Ten rounds of a layout, each a page of its own; one before them warms up and does not count."""
    found = Pass()
    meter = page.context.new_cdp_session(page)
    meter.send("Performance.enable", {"timeDomain": "threadTicks"})

    def processor() -> float:
        """Time that the page's main thread has been at work [ms]."""
        metrics = meter.send("Performance.getMetrics")["metrics"]
        return 1e3 * next(m["value"] for m in metrics if m["name"] == "TaskDuration")

    page.set_viewport_size({"width": layout.window[0], "height": layout.window[1]})
    about = {"charts": layout.plots, "each": layout.lines, "height": layout.height, "channels": names}
    for k in range(ROUNDS + 1):
        page.evaluate(SCRIPT, about)
        reference = page.evaluate("bench.reference()")
        before = processor()
        first = page.evaluate("(run) => bench.first(run)", NAMES[k % len(NAMES)])
        times, spent_on = dict(first["times"]), {LAST: processor() - before}
        for number, what in enumerate(page.evaluate("(seconds) => bench.acts(seconds)", SECONDS)):
            before = processor()
            times[what] = page.evaluate("(number) => bench.act(number)", number)
            spent_on[what] = processor() - before
        if first["seen"] < layout.plots:
            times["scroll to the last plot"] = page.evaluate("bench.scroll()")
        page.evaluate("bench.end()")
        if k:
            found.seen = first["seen"]
            found.reference.append(reference)
            for kept, new in ((found.times, times), (found.processor, spent_on)):
                for what, one in new.items():
                    kept.setdefault(what, []).append(one)
    meter.detach()
    return found


def quietest(passes: list[Pass]) -> Pass:
    """The pass in which the reference load took least: its median is compared, never the result."""
    return min(passes, key=lambda one: median(one.reference))
