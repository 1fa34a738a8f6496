"""Committed captures, cut short."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lacet.daq.formats.log import LogReader, LogWriter
from tests.support.places import HOME
from tests.support.rig import free_port

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


def replay_wires(folder: Path, raw: LogReader) -> tuple[str, list[str]]:
    """Write a capture's rig and vehicle to a folder; returns a router's address, and the wires of `lacet replay`."""
    (folder / "rig.toml").write_text(raw.start.rig_text, encoding="utf-8")
    (folder / "vehicle.toml").write_text(raw.start.vehicle_text, encoding="utf-8")
    wires = [f"can{i}=multicast:{free_port()}" for i in range(2)] + [f"udp0=udp:127.0.0.1:{free_port()}"]
    return f"tcp/127.0.0.1:{free_port()}", [word for wire in wires for word in ("--to", wire)]
