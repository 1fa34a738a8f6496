"""A recording that broke off, by a crash or a power cut: whether it goes on, and from where."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from lacet.daq.errors import LacetError
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.formats.run_files import BROKE_OFF, PART, files_of_run, next_path, part_of
from lacet.daq.formats.wire import Manifest
from lacet.services.acquisition.system_calls import is_locked

RESUME_SECONDS = 120.0
"""Longest pause over which a recording goes on as the same run [s]: a computer in the car is up again within it after a
power cut, and a car that is parked for longer begins another drive."""


@dataclass(frozen=True)
class BrokenRun:
    """A recording that broke off.

    Attributes
    ----------
    files : its files, in their order.
    start : its start record.
    held : number and checksum of the messages in them.
    events : number of its events.
    last_ns : the last time in them [ns].
    """

    files: tuple[Path, ...]
    start: StartRecord
    held: Manifest
    events: int
    last_ns: int

    def next_file(self, axes: dict[str, str]) -> LogWriter:
        """The next file of the run, open."""
        part = part_of(self.files[-1]).part + 1
        start = replace(self.start, extra={**self.start.extra, PART: str(part)})
        log = LogWriter(next_path(self.files[0], part), start, axes=axes, after=self.held)
        log.events = self.events
        return log


def broken_run(out: Path, rig_text: str, now_ns: int) -> BrokenRun | None:
    """The recording at a log, or the last one in a folder, if it broke off and is to go on now.

    None where it was closed in order, is still being recorded, broke off more than `RESUME_SECONDS` ago, has another
    rig, or lacks more than its end.
    """
    first = _newest(out) if out.is_dir() else out
    if first is None or not first.is_file():
        return None
    files = [*files_of_run(first).values()]
    if any(is_being_recorded(file) for file in files):
        return None
    try:
        before = LogReader(files[-2], alone=True).manifest if len(files) > 1 else Manifest("")
        last = LogReader(files[-1], alone=True)
        held = last.held(before or Manifest(""))
        start = LogReader(files[0], alone=True).start
    except LacetError:
        return None
    ended = last.stop is not None and not last.stop.reason.startswith(BROKE_OFF)
    last_ns = max((last.last_ns, *((last.stop.stopped_ns,) if last.stop else ())))
    if ended or held is None or start.rig_text != rig_text or not 0 <= now_ns - last_ns <= RESUME_SECONDS * 1e9:
        return None
    return BrokenRun(
        tuple(files), start, held, sum(len(LogReader(file, alone=True).events()) for file in files), last_ns
    )


def is_being_recorded(log: Path) -> bool:
    """Whether a recorder has the log open, on this machine."""
    descriptor = os.open(log, os.O_RDONLY)
    try:
        return is_locked(descriptor)
    finally:
        os.close(descriptor)


def _newest(folder: Path) -> Path | None:
    """The first file of the run in a folder that was written last."""
    logs = sorted(folder.glob("*.mcap"), key=lambda file: file.stat().st_mtime)
    return next(iter(files_of_run(logs[-1]).values())) if logs else None
