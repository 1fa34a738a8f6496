"""Live recording: how late samples are at a listener on the bus, what is lost, and how the recorder's memory grows.

Run: ``python -m benchmarks.live``; ``--write`` writes ``docs/benchmarks/live.md`` anew: the full rig for ten minutes
and three times as fast for one. `lacet replay` sends, `lacet record` records and publishes, this process listens, all
on one machine. A sample's lateness is the time from the arrival of its last frame at the recorder to its arrival here.
With ``--fit`` `lacet live` fits beside it, and how far it is behind and what it costs is printed (docs/live.md).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.decode_vs_cantools import CAPTURE, write_long
from lacet.daq.bus.listener import BusListener
from lacet.daq.bus.session import open_session
from lacet.daq.errors import UsageError
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.wire import WireError, block_from_bytes
from lacet.services.acquisition.recorder import BATCH
from tests.support.places import HOME
from tests.support.rig import free_port

PAGE = HOME / "docs" / "benchmarks" / "live.md"
SETTLED = 5.0
"""Time from the first sample on that is not counted: programs are loaded, queues are filled [s]."""
TICKS = os.sysconf("SC_CLK_TCK")


@dataclass
class Measured:
    """What one recording showed.

    Attributes
    ----------
    speed, seconds : factor on the rig's own time, and duration [s].
    late_ms : lateness of every sample at the listener [ms].
    frames, samples, losses : totals of the recorder.
    memory : (time [s], resident memory of the recorder [MB]), once a second.
    processor : processor time of the recorder by the time recorded.
    load : load average of the machine, from before to after.
    behind : of the live fit, in each of its seconds [s]; `fit_processor` as `processor`, `fit_memory` its largest [MB].
    """

    speed: float
    seconds: float
    late_ms: list[float] = field(default_factory=list)
    frames: int = 0
    samples: int = 0
    losses: dict[str, dict[str, int]] = field(default_factory=dict)
    memory: list[tuple[float, float]] = field(default_factory=list)
    processor: float = 0.0
    load: tuple[float, float] = (0.0, 0.0)
    behind: list[float] = field(default_factory=list)
    fit_processor: float = 0.0
    fit_memory: float = 0.0

    @property
    def growth(self) -> float:
        """Slope of the recorder's memory in the second half [MB/min]."""
        t, m = np.array(self.memory[len(self.memory) // 2 : -2]).T
        return 60.0 * float(np.polyfit(t, m, 1)[0])


def main() -> None:
    """Measure and print; with ``--write`` write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks/live.md")
    parser.add_argument("--runs", default="3x60,1x600", help="SPEEDxSECONDS of each recording (3x60,1x600)")
    parser.add_argument("--fit", action="store_true", help="with the live fit beside each recording")
    args = parser.parse_args()
    found: list[Measured] = []
    for run in args.runs.split(","):
        speed, seconds = map(float, run.split("x"))
        found.append(measure(speed, seconds, args.fit))
        print(row(found[-1]), flush=True)
        if args.fit:
            print(fit_row(found[-1]), flush=True)
    text = page(found)
    if args.write:
        PAGE.write_text(text, encoding="utf-8")


def measure(speed: float, seconds: float, fit: bool = False) -> Measured:
    """One recording of so many seconds of a full rig, sent `speed` times as fast; `fit` : with the live fit beside."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_long(folder / "capture.mcap", int(speed * seconds * 1e9))
        start = LogReader(CAPTURE).start
        (folder / "rig.toml").write_text(start.rig_text, encoding="utf-8")
        (folder / "vehicle.toml").write_text(start.vehicle_text, encoding="utf-8")
        for document, text in start.documents.items():
            (folder / document).write_text(text, encoding="utf-8")
        return _recorded(folder, speed, seconds, fit)


def _recorded(folder: Path, speed: float, seconds: float, fit: bool) -> Measured:
    out = Measured(speed, seconds)
    before = os.getloadavg()[0]
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    lacet = [sys.executable, "-m", "lacet"]
    replay = [*lacet, "replay", "capture.mcap", "--speed", f"{speed:g}", "--endpoints", "wires.json", "--wait", "30"]
    record = [
        *lacet, "record", "--rig", "rig.toml", "--vehicle", "vehicle.toml", "-o", "run.mcap",
        "--endpoints", "wires.json", "--until-idle", "10", "--listen", endpoint, "--ack-wait", "0",
        "--json", "record.json",
    ]  # fmt: skip
    env = {**os.environ, "PYTHONPATH": str(HOME)}
    with (folder / "said.txt").open("w") as said:
        sender = subprocess.Popen(replay, cwd=folder, env=env, stdout=said, stderr=said)
        recorder = subprocess.Popen(record, cwd=folder, env=env, stdout=said, stderr=said)
        watched = threading.Thread(target=_watch, args=(recorder, out))
        watched.start()
        follower = threading.Thread(target=_fit_beside, args=(folder, endpoint, env, out))
        if fit:
            follower.start()
        _listen(endpoint, recorder, out)
        sender.wait(30)
        watched.join()
        if fit:
            follower.join()
    if not (folder / "record.json").exists():
        raise SystemExit((folder / "said.txt").read_text())
    found = json.loads((folder / "record.json").read_text())
    out.frames, out.samples, out.losses = sum(found["frames"].values()), sum(found["samples"].values()), found["losses"]
    out.load = before, os.getloadavg()[0]
    return out


def _listen(endpoint: str, recorder: subprocess.Popen[bytes], out: Measured) -> None:
    """Note the lateness of every sample until the recorder ends."""
    session = None
    while session is None and recorder.poll() is None:
        try:
            session = open_session(connect=(endpoint,), wait=1.0)
        except UsageError:
            time.sleep(0.2)
    assert session is not None
    listener = BusListener(session)
    begun = 0.0
    while recorder.poll() is None:
        message = listener.get(0.2)
        if message is None or message.kind != "block":
            continue
        now_ns, now = time.time_ns(), time.monotonic()
        begun = begun or now
        try:
            block, _ = block_from_bytes(message.payload)
        except WireError:
            continue
        if now - begun > SETTLED:
            out.late_ms.extend(((now_ns - block.t_ns) / 1e6).tolist())
    listener.close()
    session.close()


def _fit_beside(folder: Path, endpoint: str, env: dict[str, str], out: Measured) -> None:
    """Follow the recording with `lacet live` until it ends."""
    command = [sys.executable, "-m", "lacet", "live", "--connect", endpoint, "--lines", "--once"]
    follower = subprocess.Popen(command, cwd=folder, env=env, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    usage = Measured(out.speed, out.seconds)
    watched = threading.Thread(target=_watch, args=(follower, usage))
    watched.start()
    assert follower.stdout is not None
    seconds: set[float] = set()
    for line in follower.stdout:
        found = json.loads(line)
        if found["seconds"] is not None and found["seconds"] not in seconds:
            seconds.add(found["seconds"])
            out.behind.append(found["behind"])
    watched.join()
    out.fit_processor, out.fit_memory = usage.processor, max(memory for _, memory in usage.memory)


def _watch(recorder: subprocess.Popen[bytes], out: Measured) -> None:
    """Note the recorder's memory and processor time once a second until it ends."""
    process = Path("/proc") / str(recorder.pid)
    begun = time.monotonic()
    while recorder.poll() is None:
        try:
            lines = (process / "status").read_text().splitlines()
            resident = next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))
            fields = (process / "stat").read_text().rpartition(")")[2].split()
        except (OSError, StopIteration):
            break
        passed = time.monotonic() - begun
        out.memory.append((passed, resident / 1024.0))
        out.processor = (int(fields[11]) + int(fields[12])) / TICKS / passed
        time.sleep(1.0)


def page(found: list[Measured]) -> str:
    """The page."""
    lines = [
        "# Live recording",
        "",
        "Written by `python -m benchmarks.live --write`: `lacet replay`, `lacet record` and a listener on the bus",
        f"share a machine of {os.cpu_count()} cores with others (load: processes that ran or waited, before and",
        "after). Lateness is the time from the arrival of a sample's last frame at the recorder to its arrival at the",
        f"listener; batches of {1e3 * BATCH:.0f} ms are half of it. Goal: 99 % within 100 ms at the rig's own rate,",
        "nothing lost, memory flat. Growth is that of the second half: before, caches and the windows of the check of",
        "stuck values fill. One `link_down` of the serial line is the end of the replay.",
        "",
        "| full rig | for | frames | lost | late, median | 99 % | largest | memory | grows by | processor | load |",
        "|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    lines += map(row, found)
    return "\n".join(lines) + "\n"


def row(one: Measured) -> str:
    """A recording's line of the table."""
    median, most = np.percentile(one.late_ms, [50, 99])
    lost: Counter[str] = Counter()
    for causes in one.losses.values():
        lost.update(causes)
    text = ", ".join(f"{name} {number}" for name, number in sorted(lost.items())) or "nothing"
    return (
        f"| {one.speed:g} × | {one.seconds:.0f} s | {one.frames:,} | {text} | {median:.0f} ms | {most:.0f} ms "
        f"| {max(one.late_ms):.0f} ms | {one.memory[-1][1]:.0f} MB | {one.growth:+.2f} MB/min "
        f"| {100 * one.processor:.0f} % | {one.load[0]:.1f} → {one.load[1]:.1f} |"
    )


def fit_row(one: Measured) -> str:
    """What the live fit beside a recording showed."""
    median, most = np.percentile(one.behind, [50, 100])
    return (
        f"live fit of {one.seconds:.0f} s: {len(one.behind)} updates, {median:.1f} s behind in the median, "
        f"{most:.1f} s at most; processor {100 * one.fit_processor:.0f} %, memory {one.fit_memory:.0f} MB"
    )


if __name__ == "__main__":
    main()
