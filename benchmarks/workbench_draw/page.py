"""The page that says what was measured."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from benchmarks.workbench_draw.measuring import LAST, PASSES, PLOTTED, ROUNDS, Listing, Pass
from benchmarks.workbench_draw.runs import CHANNELS, NAMES, RATE, SECONDS

PAGE = Path(__file__).parents[2] / "docs" / "benchmarks" / "workbench.md"
FIRST, ZOOM, LISTING = 500.0, 100.0, 2.0
"""Limits of drawing and of zooming [ms], and of the first listing [s of processor time]."""
WITHOUT = ("answer", "samples", LAST)
"""Times without a limit: they are parts of the first draw, or come after it."""


@dataclass(frozen=True)
class Found:
    """What was measured: the browser's version, listing, memory [MB] of the server at the end, layouts."""

    version: str
    listing: Listing
    memory: float
    layouts: Mapping[str, Pass]


def limit(what: str) -> float | None:
    """Limit of a time [ms]; None where there is none."""
    if what in WITHOUT:
        return None
    return FIRST if what.startswith("first") else ZOOM


def text(found: Found) -> tuple[str, bool]:
    """The page, and whether every limit is kept."""
    lines: list[str] = []
    kept = found.listing.processor <= LISTING
    for name, one in found.layouts.items():
        lines += [
            f"## {name[:1].upper()}{name[1:]} ({one.seen} in sight)",
            "",
            "| what | median [ms] | worst of ten [ms] | limit [ms] | worst ÷ limit | CPU, median [ms] |",
            "|---|---:|---:|---:|---:|---:|",
        ]
        for what, times in one.times.items():
            most, bound = max(times), limit(what)
            over = f"{bound:.0f} | {most / bound:.2f}" if bound else "– | –"
            work = f"{median(one.processor[what]):.0f}" if what in one.processor else ""
            lines.append(f"| {what} | {median(times):.0f} | {most:.0f} | {over} | {work} |")
            kept = kept and (bound is None or most <= bound)
        load = one.reference
        lines += [f"| reference load | {median(load):.0f} | {max(load):.0f} | – | – |  |", ""]
    about = (
        f"{len(NAMES)} runs of {SECONDS} s with {CHANNELS} channels at {RATE} Hz; the first {PLOTTED} are drawn. "
        f"Chromium {found.version} without a graphics card on {os.cpu_count()} cores; {ROUNDS} rounds of each layout, "
        f"the quietest of {PASSES} passes by the reference load. {os.getloadavg()[2]:.1f} processes were at work on "
        "the machine meanwhile, of which these are two."
    )
    listing = (
        f"**First listing** of the {len(NAMES)} runs, overviews included: {found.listing.processor:.1f} s of processor "
        f"time, {found.listing.wall:.1f} s by the clock (limit {LISTING:.0f} s). The server then holds "
        f"{found.listing.memory:.0f} MB, and {found.memory:.0f} MB after all that is in the table."
    )
    verdict = "All limits are kept." if kept else "**A limit is missed.**"
    return "\n".join([HEAD, about, "", verdict, "", listing, "", FOOT, "", *lines]), kept


HEAD = """# How fast the workbench draws

Written by `python -m benchmarks.workbench_draw --write`. Limits for the worst of ten: 0.5 s for the first draw, 100 ms
for a zoom of all linked plots. Times run from the user's action (of the first draw from the question to the server) to
the frame after the one in which the picture was drawn, so that each holds at least 17 ms of waiting. The reference load
is a fixed loop in the page, which is slower when the machine is busy; CPU is the time of the page's main thread, of a
zoom by a frame drawn with the mouse ("zoom: … to …") that of its six moves, too, which set the cursor in all plots.
"""
FOOT = """The plots are first drawn from an overview, all channels in one answer; all samples follow in a second one
([decision](../decisions/page.md)). Plots more than 400 px out of sight are drawn when the browser is
idle, or when they are scrolled to."""
