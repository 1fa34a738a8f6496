"""Exchange tables of the reference car, cut and spoilt on purpose."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.open_run import open_run
from lacet.daq.run import Run

CAR = Path(__file__).parents[1] / "data" / "car"
FILES = ("--rig", str(CAR / "rig.toml"), "--vehicle", str(CAR / "vehicle.toml"))
"""The arguments that name the reference car's rig and vehicle."""


@cache
def piece(name: str = "sine", start: float = 5.0, stop: float = 15.0) -> Run:
    """Some seconds of one of its runs."""
    run = open_run(CAR / f"{name}.parquet")
    signals = {}
    for channel, s in run.signals.items():
        keep = (s.t >= start) & (s.t < stop)
        signals[channel] = replace(s, t=s.t[keep], values=s.values[keep], flags=s.flags[keep])
    return replace(run, signals=signals)


def written(run: Run, path: Path) -> Path:
    """The run as a table."""
    write_table(run, path)
    return path


def without(run: Run, *starts: str) -> Run:
    """The run without the channels whose names start so."""
    return replace(run, signals={n: s for n, s in run.signals.items() if not n.startswith(starts)})


def exchanged(run: Run, one: str, other: str, sensor: str = "wheel") -> Run:
    """The run with the wires of two wheels' dynamometers, or lasers, exchanged."""
    signals = dict(run.signals)
    for what in ("force", "moment", "speed", "angle") if sensor == "wheel" else ("hub", "ground"):
        a, b = f"{sensor}.{one}.{what}", f"{sensor}.{other}.{what}"
        signals[a], signals[b] = run.signals[b], run.signals[a]
    return replace(run, signals=signals)


def spoilt(run: Run, channel: str, start: int, stop: int, value: float = np.nan) -> Run:
    """The run with some samples of a channel replaced."""
    values = run.signals[channel].values.copy()
    values[start:stop] = value
    return run.with_values({channel: values})
