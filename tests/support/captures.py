"""Committed captures, cut short."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lacet.daq.formats.log import LogReader, LogWriter
from tests.support.places import HOME

SINUS = HOME / "replay_logs" / "anti-roll-bars" / "sinus.mcap"


def cut(source: Path, path: Path, seconds: float) -> LogReader:
    """Write the first seconds of a capture, by the stamps of its frames; returns the whole."""
    raw = LogReader(source)
    end = raw.start.started_ns + int(seconds * 1e9)
    assert raw.stop is not None
    with LogWriter(path, raw.start) as log:
        for name in raw.sources():
            frames = raw.frames(name)
            log.write_frames(frames[: int((frames.t_ns < end).sum())])
        log.close(
            replace(raw.stop, stopped_ns=end, counts={}, losses={}) if hasattr(raw.stop, "stopped_ns") else raw.stop
        )
    return raw
