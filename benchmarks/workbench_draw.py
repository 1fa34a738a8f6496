"""How long the workbench takes to draw 50 channels of 60,000 samples, and to zoom them together.

Run: ``python benchmarks/workbench_draw.py [--write]``; needs Chromium (``CHROMIUM`` names it, otherwise the system's). The
page is served by the workbench itself and its own charts are drawn, in a headless browser. Times are from the call to the
frame after the one in which the picture was there. Exit code 1 when a median misses its limit.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from playwright.sync_api import Page, sync_playwright

CHANNELS, SAMPLES = 50, 60_000
RATE = 250.0
"""Samples a second: four minutes."""
FIRST, ZOOM = 500.0, 100.0
"""Limits [ms]."""
ROUNDS, ZOOMS = 5, 20
LAYOUTS = {
    "50 charts of 1 channel, 1280 × 720": (50, 1, 110, (1280, 720)),
    "10 charts of 5 channels, all in sight, 1280 × 1700": (10, 5, 120, (1280, 1700)),
    "50 charts of 1 channel, all in sight, 1280 × 4400": (50, 1, 50, (1280, 4400)),
}
"""Charts, channels of each, height of a plot [px], window [px]."""
TALLEST = 2160
"""Height up to which the limits hold [px]; no screen is as tall as the third layout, which shows what more would cost."""
FLAGS = "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking --disable-component-update --disable-sync"
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "workbench.md"

SCRIPT = """
async ({charts, each, height, samples, rate, zooms}) => {
  const { timeChart, pending } = await import("/js/chart.js");
  const root = document.createElement("div");
  root.style.cssText = "position:fixed;inset:0;overflow:auto;background:var(--panel);z-index:99";
  document.body.append(root);
  let seed = 1;
  const noise = () => { seed = (seed * 48271) % 2147483647; return seed / 2147483647 - 0.5; };
  const t = Float32Array.from({ length: samples }, (_, i) => i / rate);
  const data = Array.from({ length: charts * each }, (_, k) => {
    const values = new Float32Array(samples);
    for (let i = 0; i < samples; i += 1) values[i] = 900 * Math.sin(t[i] * (0.4 + 0.1 * k)) + 300 * noise();
    return values;
  });
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  const sight = () => [...root.querySelectorAll(".chart-plot")].filter((p) => {
    const box = p.getBoundingClientRect();
    return box.bottom > 0 && box.top < innerHeight;
  });
  await frame();
  await frame();
  const start = performance.now();
  const made = Array.from({ length: charts }, (_, k) => timeChart(root, {
    t, sync: "benchmark", unit: "N", title: `channel ${k}`, height,
    series: Array.from({ length: each }, (_, j) =>
      ({ name: `component ${j}`, values: data[k * each + j], colour: `--effect-${j % 8}` })),
  }));
  do await frame(); while (sight().some((p) => !p.querySelector("canvas")));
  await frame();
  const first = performance.now() - start;
  const seen = sight().length;
  while (pending()) await frame();
  await frame();
  const all = performance.now() - start;
  const zoom = [];
  for (let k = 0; k < zooms; k += 1) {
    const wide = (samples / rate) * (0.04 + 0.9 * ((k * 7) % zooms) / zooms);
    const from = (samples / rate - wide) * (((k * 11) % zooms) / zooms);
    const begin = performance.now();
    made[0].setWindow(from, from + wide);
    await frame(); // in this frame all that is in sight is drawn
    await frame();
    const drawn = performance.now() - begin;
    while (pending()) await frame();
    zoom.push([drawn, performance.now() - begin]);
  }
  for (const chart of made) chart.destroy();
  root.remove();
  return { first, all, zoom, seen, frame: await new Promise(async (done) => {
    const a = await frame(); for (let k = 0; k < 10; k += 1) await frame(); done((await frame() - a) / 11); }) };
}
"""


def chromium() -> str:
    """The browser. Raises SystemExit when there is none."""
    found = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if not found:
        raise SystemExit("no chromium on this machine: install it, or name it in CHROMIUM")
    return found


def measure(page: Page) -> dict[str, list[dict[str, Any]]]:
    """Every layout, several times; the first round of each warms up and does not count."""
    out: dict[str, list[dict[str, Any]]] = {}
    for name, (charts, each, height, (width, tall)) in LAYOUTS.items():
        page.set_viewport_size({"width": width, "height": tall})
        setting = {"charts": charts, "each": each, "height": height, "samples": SAMPLES, "rate": RATE, "zooms": ZOOMS}
        print(f"{name} …", file=sys.stderr, flush=True)
        out[name] = [page.evaluate(SCRIPT, setting) for _ in range(ROUNDS + 1)][1:]
    return out


def table(found: dict[str, list[dict[str, Any]]]) -> tuple[list[str], bool]:
    """Lines of a Markdown table, and whether every limit is kept."""
    # A machine that is at work on something else makes single times long: medians are held to the limits.
    lines = ["| layout | what | median [ms] | worst [ms] | limit [ms] | median ÷ limit | worst ÷ limit |", "|---|---|---:|---:|---:|---:|---:|"]
    kept = True
    for name, rounds in found.items():
        seen, tall = rounds[0]["seen"], LAYOUTS[name][3][1]
        zooms = [pair for one in rounds for pair in one["zoom"]]
        for what, times, limit in (
            (f"first draw of the {seen} in sight", [one["first"] for one in rounds], FIRST),
            ("first draw of all", [one["all"] for one in rounds], None),
            (f"zoom of the {seen} in sight", [pair[0] for pair in zooms], ZOOM),
            ("zoom of all", [pair[1] for pair in zooms], None),
        ):
            if tall > TALLEST:
                limit = None
            usual, most = median(times), max(times)
            over = f"{limit:.0f} | {usual / limit:.2f} | {most / limit:.2f}" if limit else "– | – | –"
            lines.append(f"| {name} | {what} | {usual:.0f} | {most:.0f} | {over} |")
            kept = kept and (limit is None or usual <= limit)
    return lines, kept


def serve(folder: Path) -> tuple[subprocess.Popen[str], str]:
    """The workbench itself, on a free port: the process and its address."""
    command = [sys.executable, "-u", "-m", "services.cli", "ui", str(folder), "--port", "0"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
    assert server.stdout is not None
    for line in server.stdout:
        if "http://" in line:
            return server, line[line.index("http://") :].split()[0]
    raise SystemExit("the workbench did not start")


def main() -> int:
    """Measure, print, and write the page when asked to."""
    with tempfile.TemporaryDirectory() as folder:
        server, address = serve(Path(folder) / "study")
        try:
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS.split())
                version = browser.version
                page = browser.new_page()
                page.goto(address)
                found = measure(page)
                browser.close()
        finally:
            server.terminate()
            server.wait()
    lines, kept = table(found)
    frame = median(one["frame"] for rounds in found.values() for one in rounds)
    about = (
        f"{CHANNELS} channels × {SAMPLES:,} samples, Chromium {version} without a graphics card on {os.cpu_count()} cores, "
        f"{ROUNDS} pages and {ROUNDS * ZOOMS} zooms of each layout; a frame lasts {frame:.0f} ms; "
        f"{os.getloadavg()[0]:.1f} processes were at work on the machine."
    )
    print(about, *lines, "limits kept" if kept else "LIMITS MISSED", sep="\n")
    if "--write" in sys.argv:
        PAGE.write_text(f"{HEAD}\n{about}\n\n" + "\n".join(lines) + f"\n\n{FOOT}\n", encoding="utf-8")
    return 0 if kept else 1


HEAD = """# How fast the workbench draws

Written by `python benchmarks/workbench_draw.py --write`, with the page served by the workbench itself. Limits: 0.5 s for the
first draw, 100 ms for a zoom of all linked charts. Times run from the call to the frame after the one in which the
picture was there, so that each holds at least one frame of waiting.
"""
FOOT = """Medians are held to the limits; single times are longer where something else is at work on the machine.

Charts out of sight (more than 400 px away) are drawn when the browser has nothing else to do, or when they are
scrolled to. Where there are more than 1.5 samples to a
pixel, the lowest and the highest of each column of pixels are drawn (`js/pyramid.js`): no peak is lost."""


if __name__ == "__main__":
    sys.exit(main())
