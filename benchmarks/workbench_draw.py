"""How long the workbench takes to draw 50 channels of 60,000 samples, and to zoom them together.

Run: ``python benchmarks/workbench_draw.py [--write]``; needs Chromium (``CHROMIUM`` names it, otherwise the system's).
The page is served by the workbench itself and its own charts are drawn, in a headless browser. Times are from the call
to the frame after the one in which the picture was there. Exit code 1 when a median misses its limit.
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
"""Height up to which the limits hold [px]; no screen is as tall as the third layout: it shows what more would cost."""
FLAGS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "workbench.md"

PREPARE = """
async ({charts, each, height, samples, rate}) => {
  const { timeChart, pending } = await import("/js/charts/time_chart.js");
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
  let made = [];
  window.bench = {
    async first() {
      const start = performance.now();
      made = Array.from({ length: charts }, (_, k) => timeChart(root, {
        t, sync: "benchmark", unit: "N", title: `channel ${k}`, height,
        series: Array.from({ length: each }, (_, j) =>
          ({ name: `component ${j}`, values: data[k * each + j], colour: `--effect-${j % 8}` })),
      }));
      do await frame(); while (sight().some((p) => !p.querySelector("canvas")));
      await frame();
      const first = performance.now() - start;
      while (pending()) await frame();
      return { first, all: performance.now() - start, seen: sight().length };
    },
    async zoom(k, zooms) {
      const long = samples / rate;
      const wide = long * (0.04 + 0.9 * ((k * 7) % zooms) / zooms);
      const from = (long - wide) * (((k * 11) % zooms) / zooms);
      const begin = performance.now();
      made[0].setWindow(from, from + wide);
      await frame(); // in this frame all that is in sight is drawn
      await frame();
      const drawn = performance.now() - begin;
      while (pending()) await frame();
      return { drawn, all: performance.now() - begin };
    },
    end() {
      for (const chart of made) chart.destroy();
      root.remove();
    },
  };
  await frame();
  await frame();
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
    cpu = page.context.new_cdp_session(page)
    cpu.send("Performance.enable", {"timeDomain": "threadTicks"})

    def spent() -> float:
        """CPU time of the page's main thread so far [ms]: it does not depend on what else the machine does."""
        return 1e3 * next(
            m["value"] for m in cpu.send("Performance.getMetrics")["metrics"] if m["name"] == "TaskDuration"
        )

    out: dict[str, list[dict[str, Any]]] = {}
    for name, (charts, each, height, (width, tall)) in LAYOUTS.items():
        print(f"{name} …", file=sys.stderr, flush=True)
        page.set_viewport_size({"width": width, "height": tall})
        out[name] = []
        for _ in range(ROUNDS + 1):
            page.evaluate(PREPARE, {"charts": charts, "each": each, "height": height, "samples": SAMPLES, "rate": RATE})
            before = spent()
            one = page.evaluate("bench.first()")
            one["cpu"] = spent() - before
            one["zoom"] = []
            for k in range(ZOOMS):
                before = spent()
                zoom = page.evaluate("([k, n]) => bench.zoom(k, n)", [k, ZOOMS])
                one["zoom"].append({**zoom, "cpu": spent() - before})
            page.evaluate("bench.end()")
            out[name].append(one)
        del out[name][0]
    return out


def table(found: dict[str, list[dict[str, Any]]]) -> tuple[list[str], bool]:
    """Lines of a Markdown table, and whether every limit is kept."""
    # A machine that is at work on something else makes single times long: medians are held to the limits.
    lines = [
        "| layout | what | median [ms] | worst [ms] | limit [ms] | median ÷ limit | worst ÷ limit | CPU, median [ms] |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    kept = True
    for name, rounds in found.items():
        seen, tall = rounds[0]["seen"], LAYOUTS[name][3][1]
        zooms = [zoom for one in rounds for zoom in one["zoom"]]
        for what, times, limit, cpu in (
            (f"first draw of the {seen} in sight", [x["first"] for x in rounds], FIRST, None),
            ("first draw of all", [x["all"] for x in rounds], None, [x["cpu"] for x in rounds]),
            (f"zoom of the {seen} in sight", [x["drawn"] for x in zooms], ZOOM, None),
            ("zoom of all", [x["all"] for x in zooms], None, [x["cpu"] for x in zooms]),
        ):
            bound = limit if tall <= TALLEST else None
            usual, most = median(times), max(times)
            over = f"{bound:.0f} | {usual / bound:.2f} | {most / bound:.2f}" if bound else "– | – | –"
            lines.append(
                f"| {name} | {what} | {usual:.0f} | {most:.0f} | {over} | {f'{median(cpu):.0f}' if cpu else ''} |"
            )
            kept = kept and (bound is None or usual <= bound)
    return lines, kept


def serve(folder: Path) -> tuple[subprocess.Popen[str], str]:
    """The workbench itself, on a free port: the process and its address."""
    command = [sys.executable, "-u", "-m", "lacet.services.commands.__main__", "ui", str(folder), "--port", "0"]
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
    about = (
        f"{CHANNELS} channels × {SAMPLES:,} samples, Chromium {version} without a graphics card on "
        f"{os.cpu_count()} cores, {ROUNDS} pages and {ROUNDS * ZOOMS} zooms of each layout; "
        f"{os.getloadavg()[0]:.1f} processes at work on the machine meanwhile, these included."
    )
    print(about, *lines, "limits kept" if kept else "LIMITS MISSED", sep="\n")
    if "--write" in sys.argv:
        PAGE.write_text(f"{HEAD}\n{about}\n\n" + "\n".join(lines) + f"\n\n{FOOT}\n", encoding="utf-8")
    return 0 if kept else 1


HEAD = """# How fast the workbench draws

Written by `python benchmarks/workbench_draw.py --write`; the workbench itself serves the page. Limits: 0.5 s for
the first draw, 100 ms for a zoom of all linked charts. Times run from the call to the frame after the one in which the
picture was there, so that each holds at least one frame (17 ms) of waiting. CPU is the time the page's main thread was
at work, whatever else the machine did.
"""
FOOT = """Medians are held to the limits; single times are longer where something else is at work on the machine.

Charts out of sight (more than 400 px away) are drawn when the browser has nothing else to do, or when they are
scrolled to. Where there are more than 1.5 samples to a pixel (4 with 16 lines or fewer), the lowest and the highest of
each column of pixels are drawn (`js/charts/pyramid.js`): no peak is lost."""


if __name__ == "__main__":
    sys.exit(main())
