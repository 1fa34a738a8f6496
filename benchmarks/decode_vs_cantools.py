"""Decoding: wheel dynamometer frames against cantools, and `lacet decode` against the time recorded, in one run.

Run: ``python benchmarks/decode_vs_cantools.py``; ``--write`` writes ``docs/benchmarks/decode.md`` anew, with half an
hour of run. All times are processor time, user and system, of one thread; turns of driver and cantools alternate and
the shortest of each counts. Absolute figures vary with the machine; the ratios hold. cantools only decodes here; the
driver also checks checksum, counter and status and converts to SI units.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cantools.database
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.log import LogReader, LogWriter
from lacet.daq.frames import Frames
from lacet.drivers import open_driver
from lacet.services.acquisition.capture import BATCH_NS, merged
from lacet.services.acquisition.stream_decoder import decode_frames
from lacet.services.workspace.decode import open_decoder
from tests.support.places import HOME

PAGE = HOME / "docs" / "benchmarks" / "decode.md"
CAPTURE = HOME / "replay_logs" / "anti-roll-bars" / "rough.mcap"
TILE_NS = 16_000_000_000
"""Length of that capture [ns]: it is repeated, counters and clocks going on."""
SAMPLES = 50_000
"""Samples a wheel of the whole arrays: 600,000 frames, 100 s."""
FEW = 20_000
"""Frames that cantools decodes in a turn."""
LIVE_MS = 100
PROBE = """
import os, sys
from lacet.services.commands.__main__ import main
code = main(sys.argv[1:])
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(sum(os.times()[:2]), peak.split()[1], file=sys.stderr)
sys.exit(code)
"""
"""The command lacet, which then says its processor time [s] and largest memory [kB] (Linux)."""
TURNS = 12


def main() -> None:
    """Measure and print; with ``--write`` write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks/decode.md")
    parser.add_argument("--minutes", help="lengths of run for lacet decode (default: 1,10; with --write 1,10,30)")
    args = parser.parse_args()
    minutes = [int(n) for n in (args.minutes or ("1,10,30" if args.write else "1,10")).split(",")]
    text = page(frame_times(), {n: decode_command(n) for n in minutes})
    print(text)
    if args.write:
        PAGE.write_text(text, encoding="utf-8")


def frame_times() -> dict[str, float]:
    """Processor time a frame of cantools and of the driver [s]."""
    driver = open_driver("igel", "can0")
    rng = np.random.default_rng(0)
    t_ns = np.arange(SAMPLES, dtype=np.int64) * 2_000_000
    flags = np.zeros(SAMPLES, np.uint8)
    blocks = {c: Block(c, t_ns, rng.normal(size=(SAMPLES, CHANNELS[c].width)), flags) for c in driver.channels}
    frames = driver.encode(blocks)
    database = cantools.database.load_string(next(iter(driver.documents.values())), "dbc")
    assert isinstance(database, cantools.database.Database)
    few = [(frame.ident, frame.payload) for frame in frames[:FEW]]
    size = 6 * LIVE_MS
    batches = [frames[i : i + size] for i in range(0, 60_000, size)]

    def live() -> None:
        state = driver.start()
        for batch in batches:
            _, state = driver.decode(batch, state)

    work: dict[str, tuple[Callable[[], object], int]] = {
        "cantools": (lambda: [database.decode_message(*frame) for frame in few], FEW),
        "whole": (lambda: driver.decode(frames, driver.start()), len(frames)),
        "ten seconds": (lambda: driver.decode(frames[:60_000], driver.start()), 60_000),
        "live": (live, 60_000),
    }
    found: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(TURNS):
        for name, (what, number) in work.items():
            for _ in range(3):
                begin = time.process_time()
                what()
                found[name].append((time.process_time() - begin) / number)
    return {name: min(times) for name, times in found.items()}


def decode_command(minutes: int) -> tuple[float, float]:
    """Processor time [s] and largest memory [MB] of ``lacet decode`` on a capture of so many minutes."""
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.mcap"
        write_long(raw, 60_000_000_000 * minutes)
        words = [sys.executable, "-c", PROBE, "decode", str(raw), "-o", str(raw.with_name("run.mcap"))]
        env = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        env |= {"PYTHONPATH": str(HOME), "PYTHONPYCACHEPREFIX": str(Path(tempfile.gettempdir()) / "lacet-bytecode")}
        found = []
        for _ in range(2):  # the first compiles what is imported
            raw.with_name("run.mcap").unlink(missing_ok=True)
            said = subprocess.run(words, env=env, check=True, capture_output=True, text=True).stderr.split()
            found.append((float(said[-2]), float(said[-1]) / 1024.0))
        return min(found)


def write_long(path: Path, duration_ns: int) -> None:
    """Write a capture of so many nanoseconds: the samples of `CAPTURE` again and again."""
    reader = LogReader(CAPTURE)
    decoder = open_decoder(reader, None, [])
    blocks = decode_frames(decoder, [reader.frames(source) for source in reader.sources()])
    begin = reader.start.started_ns
    with LogWriter(path, replace(reader.start, run_id="long")) as writer:
        for k in range(-(-duration_ns // TILE_NS)):
            buses: dict[str, list[Frames]] = {}
            for sensor in decoder.rig.sensors:
                assert sensor.driver is not None
                assert sensor.bus is not None
                driver = open_driver(sensor.driver, sensor.bus, sensor.options, None, decoder.documents)
                tile = {name: _shifted(blocks[name], k * TILE_NS) for name in driver.channels}
                count = len(next(iter(tile.values())))
                buses.setdefault(sensor.bus, []).append(driver.encode(tile, counter=k * count))
            lanes = {bus: merged(bus, parts) for bus, parts in sorted(buses.items())}
            for edge in begin + k * TILE_NS + np.arange(0, TILE_NS, BATCH_NS):
                if edge - begin >= duration_ns:
                    break
                for bus, frames in lanes.items():
                    last = edge - begin + BATCH_NS >= (k + 1) * TILE_NS
                    end = len(frames) if last else int(np.searchsorted(frames.t_ns, edge + BATCH_NS))
                    writer.write_frames(frames[:end])
                    lanes[bus] = frames[end:]


def _shifted(block: Block, by_ns: int) -> Block:
    device = None if block.device_ns is None else block.device_ns + by_ns
    return replace(block, t_ns=block.t_ns + by_ns, device_ns=device)


def page(frame: dict[str, float], commands: dict[int, tuple[float, float]]) -> str:
    """The page."""
    ratio = {name: frame["cantools"] / value for name, value in frame.items()}
    (short, (_, least)), (long, (seconds, most)) = min(commands.items()), max(commands.items())
    growth = (most - least) / max(1, long - short)
    lines = [
        "# Decoding",
        "",
        "Written by `benchmarks/decode_vs_cantools.py --write`. Processor time, user and system, one thread; turns of",
        "the driver and of cantools alternate, the shortest of each counts.",
        "",
        "| what | measured | goal |",
        "|---|---:|---:|",
        f"| driver against cantools, one array of 100 s (600,000 frames) | {ratio['whole']:.0f} × | 50 × |",
        f"| the same, an array of 10 s | {ratio['ten seconds']:.0f} × | |",
        f"| driver against cantools, live batches of {LIVE_MS} ms (600 frames) | {ratio['live']:.1f} × | 5 × |",
        f"| `lacet decode` against the time recorded, {long} minutes | {60 * long / seconds:.0f} × | 60 × |",
        f"| memory a minute of run, from {short} to {long} minutes | {growth:.1f} MB | flat |",
        "",
        "The driver checks checksum, counter and status and converts to SI units; cantools only decodes. It took",
        f"{1e6 * frame['cantools']:.2f} µs a frame, the driver {1e9 * frame['whole']:.0f} ns on the array of 100 s,",
        f"{1e9 * frame['ten seconds']:.0f} ns on that of 10 s and {1e9 * frame['live']:.0f} ns in live batches.",
        "The long array costs more a frame: the operating system has to clear the memory that its samples fill.",
        "",
        "`lacet decode` of a full rig (four buses, 7,550 frames a second, 36 channels), start of the program included:",
        "",
        "| minutes of run | processor time | × time recorded | largest memory |",
        "|---:|---:|---:|---:|",
    ]
    for n, (spent, memory) in commands.items():
        lines.append(f"| {n} | {spent:.1f} s | {60 * n / spent:.0f} | {memory:.0f} MB |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
