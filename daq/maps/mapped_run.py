"""Runs made of logs of other systems by a channel map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lacet.daq.errors import RunError
from lacet.daq.maps.assembly import ChannelPiece
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.conversion import Conversion
from lacet.daq.run import Run, Signal, signal_of

SHARED_MAP = "map.toml"
"""Name of the map for every log in its folder that has none of its own."""


def map_beside(path: Path) -> Path | None:
    """The map of a log: ``run.map.toml`` beside ``run.csv``, or ``map.toml`` in its folder; None without."""
    for file in (path.with_suffix(".map.toml"), path.with_name(SHARED_MAP)):
        if file.is_file():
            return file
    return None


def mapped_run(paths: Sequence[str | Path], map_: ChannelMap, without_unit: list[str] | None = None) -> Run:
    """The run of one or more logs of one drive, by a map; `without_unit` gets the names that are taken as SI.

    Raises RunError, with every reason, when a file cannot be read or no channel can be made.
    """
    conversion = Conversion.of(paths, map_)
    if without_unit is not None:
        without_unit += conversion.without_unit
    parts: dict[str, list[ChannelPiece]] = {}
    try:
        for piece in conversion.pieces():
            parts.setdefault(piece.channel, []).append(piece)
    finally:
        conversion.close()
    if not parts:
        raise RunError(paths[0], [*conversion.notes, "no channel of the map has samples in it"])
    start = min(float(pieces[0].t[0]) for pieces in parts.values())
    bases: dict[tuple[int, ...], np.ndarray] = {}
    signals: dict[str, Signal] = {}
    for name, pieces in parts.items():
        key = tuple(id(piece.t) for piece in pieces)
        if key not in bases:
            bases[key] = np.concatenate([piece.t for piece in pieces]) - start
        values, flags = (np.concatenate([getattr(piece, what) for piece in pieces]) for what in ("values", "flags"))
        signals[name] = signal_of(name, bases[key], values, flags)
    metadata = dict(map_.metadata)
    return Run(name=Path(paths[0]).stem, signals=signals, problems=tuple(conversion.notes), marks=(), **metadata)
