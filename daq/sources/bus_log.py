"""Raw frames of other tools' bus logs as `Frames`, bus by bus: for replay onto the wires and for drivers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lacet.daq.frames import Frames, wire_idents
from lacet.daq.sources.frames import (
    Beside,
    BusFrames,
    bus_kind,
    form_not_read,
    is_bus_log,
    read_frames,
    read_mdf_frames,
)
from lacet.daq.sources.source import fault

KINDS = "candump, BLF, ASC, TRC, or an MDF bus log (.mf4)"


def is_raw_log(path: Path) -> bool:
    """Whether a file is a bus log of another tool, by its suffix and contents, in a form that is read or not."""
    if path.suffix.lower() in (".mf4", ".mdf"):
        return True
    return path.is_file() and bool(bus_kind(path) or form_not_read(path))


def read_bus_log(
    path: Path, damage: list[str] | None = None, beside: Beside | None = None
) -> dict[str, Frames]:  # fmt: skip
    """All data frames of a log, by the name or number of the bus in it, in order of their stamps.

    Where the log's clock was put back stamps go on from the last one, in the order of the file. That, and what is lost
    of a log that is cut short, is added to `damage`, one line each, and the steps to `beside`, with the number of error
    and remote frames, which are left out. Raises RunError for a file that is none or cannot be read.
    """
    if not path.is_file():
        raise fault(path, "no such file")
    beside = Beside() if beside is None else beside
    start_ns, pieces = _opened(path, damage, beside)
    parts: dict[str, list[Frames]] = {}
    origin = 0.0
    for at, piece in enumerate(pieces):
        if at == 0 and start_ns is None:  # as an import takes it, so that stamps are the same to the nanosecond
            origin = float(piece.t[0])
            start_ns = piece.start_ns + round(origin * 1e9)
        t_ns = (start_ns or 0) + np.rint((piece.t - origin) * 1e9).astype(np.int64)
        for number in np.unique(piece.bus):
            name = piece.buses[number]
            parts.setdefault(name, []).append(_packed(name, piece, t_ns, np.flatnonzero(piece.bus == number)))
    if not parts:
        raise fault(path, "it holds no frames", *(damage or []))
    beside.zero_ns = (start_ns or 0) - round(origin * 1e9)
    return {name: _in_order(Frames.concat(name, frames)) for name, frames in parts.items()}


def _opened(path: Path, damage: list[str] | None, beside: Beside) -> tuple[int | None, Iterator[BusFrames]]:
    if kind := bus_kind(path):
        return None, read_frames(path, kind, damage, beside)
    if path.suffix.lower() in (".mf4", ".mdf"):
        from lacet.daq.sources.mdf import open_mdf, start_of

        mdf = open_mdf(path)
        if is_bus_log(mdf):
            return start_of(mdf), read_mdf_frames(path, mdf, damage, beside)
        raise fault(
            path, "this MDF file holds measured channels, no raw frames of a bus: lacet import reads it by a map"
        )
    if form := form_not_read(path):
        raise fault(path, form)
    raise fault(path, f"no raw frames of a bus: give {KINDS}, or a capture of lacet's (.mcap)")


def _packed(name: str, piece: BusFrames, t_ns: np.ndarray, mine: np.ndarray) -> Frames:
    lengths, rows = piece.lengths[mine], piece.rows[mine]
    data = rows[np.arange(rows.shape[1]) < lengths[:, None]]
    offset = np.concatenate(([0], np.cumsum(lengths))).astype(np.int64)
    return Frames(name, t_ns[mine], wire_idents(piece.ident[mine]), offset, data)


def _in_order(frames: Frames) -> Frames:
    """Frames by their stamps, which a log need not be in the order of."""
    if (np.diff(frames.t_ns) >= 0).all():
        return frames
    order = np.argsort(frames.t_ns, kind="stable")
    lengths = frames.lengths[order]
    offset = np.concatenate(([0], np.cumsum(lengths))).astype(np.int64)
    take = np.arange(offset[-1]) + np.repeat(frames.offset[:-1][order] - offset[:-1], lengths)
    return Frames(frames.source, frames.t_ns[order], frames.ident[order], offset, frames.data[take])
