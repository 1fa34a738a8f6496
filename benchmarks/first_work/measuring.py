"""Processor time and largest memory of a child process, kept in a file so that a run that was cut off goes on."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.first_work.sides import Side

PATIENCE = 120.0
"""The longest that the workbench is waited for [s]."""


class Failed(Exception):
    """A command ended as it should not have."""


@dataclass(frozen=True)
class Cost:
    """What a process took.

    `seconds` of processor time, user and system, its own children's included; `clock` [s] by the wall clock; `memory`
    largest resident set [MB]; `load` mean number of processes at work on the machine in the minute before it ended.
    """

    seconds: float
    clock: float
    memory: float
    load: float


def ran(words: Sequence[str], side: Side, exits: Sequence[int] = (0, 3)) -> Cost:
    """Run a command in the side's work folder. Raises Failed when its exit code is not among `exits`."""
    with tempfile.TemporaryFile() as said:
        begin = time.monotonic()
        process = subprocess.Popen(
            words, env=side.environment, cwd=side.work, stdin=subprocess.DEVNULL, stdout=said, stderr=said
        )
        _, status, usage = os.wait4(process.pid, 0)
        clock = time.monotonic() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in exits:
            said.seek(0)
            tail = said.read().decode(errors="replace")[-2000:]
            raise Failed(f"{side.name}: {' '.join(words)}\nexit code {process.returncode}\n{tail}")
    return Cost(usage.ru_utime + usage.ru_stime, clock, usage.ru_maxrss / 1024.0, os.getloadavg()[0])


def answered(side: Side, study: str) -> Cost:
    """`lacet ui` on a study, from its start until it has served its page and the study. Raises Failed."""
    words = side.lacet("ui", study, "--port", "0")
    begin = time.monotonic()
    process = subprocess.Popen(
        words, env=side.environment, cwd=side.work, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        address = next((line.split()[1] for line in process.stdout if line.strip().startswith("open ")), None)
        if address is None:
            raise Failed(f"{' '.join(words)}: ended without an address")
        browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        for page in (address, f"{address.partition('?')[0]}api/study"):
            _fetch(browser, page, begin + PATIENCE)
        clock, entry = time.monotonic() - begin, Path(f"/proc/{process.pid}")
        spent = entry.joinpath("stat").read_text().rsplit(")", 1)[1].split()
        peak = next(row for row in entry.joinpath("status").read_text().splitlines() if row.startswith("VmHWM"))
        ticks = sum(map(int, spent[11:13]))
        return Cost(ticks / os.sysconf("SC_CLK_TCK"), clock, int(peak.split()[1]) / 1024.0, os.getloadavg()[0])
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _fetch(browser: urllib.request.OpenerDirector, address: str, until: float) -> None:
    while True:
        try:
            with browser.open(address, timeout=PATIENCE) as answer:
                answer.read()
            return
        except (urllib.error.URLError, ConnectionError) as cause:
            if isinstance(cause, urllib.error.HTTPError) or time.monotonic() > until:
                raise Failed(f"{address}: {cause}") from None
            time.sleep(0.02)


class Kept:
    """Costs that were measured, by name, in a file that is written after each."""

    def __init__(self, file: Path):
        self._file = file
        self._all: dict[str, list[Cost]] = {}
        if file.is_file():
            read: dict[str, list[dict[str, float]]] = json.loads(file.read_text(encoding="utf-8"))
            self._all = {name: [Cost(**one) for one in costs] for name, costs in read.items()}

    def count(self, name: str) -> int:
        """How often something was measured."""
        return len(self._all.get(name, ()))

    def add(self, name: str, cost: Cost) -> None:
        """Keep one more measurement."""
        self._all.setdefault(name, []).append(cost)
        part = self._file.with_suffix(".part")
        part.write_text(json.dumps({n: [asdict(c) for c in some] for n, some in self._all.items()}), encoding="utf-8")
        part.replace(self._file)

    def forget(self, beginning: str) -> None:
        """Drop everything whose name begins so."""
        self._all = {name: costs for name, costs in self._all.items() if not name.startswith(beginning)}

    def least(self, name: str) -> Cost | None:
        """Smallest processor time, with that measurement's other values; None where nothing was measured."""
        return min(self._all.get(name, ()), key=lambda cost: cost.seconds, default=None)

    def loads(self) -> list[float]:
        """Loads of the machine during all measurements."""
        return [cost.load for costs in self._all.values() for cost in costs]
