"""Raw bus logs with the owner's DBC: every signal is a name ``Message.Signal``, decoded from all frames at once.

No counter, checksum or status is asked of the bus. Multiplexed and floating-point signals, CAN FD and J1939 (frames
distinguished by their parameter group) are read.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.can_signal import Signal
from lacet.daq.errors import DbcError
from lacet.daq.sources.frames import EXTENDED, BusFrames
from lacet.daq.sources.source import Array, Listed, Piece, Series, Source, fault

_NO_VALUE = re.compile(r"\b(sna|invalid|not[ _]?avail\w*|no[ _]?value|error|fault|undefined|init)\b", re.IGNORECASE)
"""Names of raw values that mean that there is none."""
_PGN, _PGN_TO_ALL = np.uint32(0x03FFFF00), np.uint32(0x03FF0000)
"""Bits of a J1939 identifier that are the parameter group: of a broadcast, and of a message to one receiver."""


@dataclass(frozen=True)
class _Decoded:
    """A signal of a DBC: its place, and the values of its multiplexers with which it is sent."""

    name: str
    signal: Signal
    is_float: bool
    needs: tuple[tuple[Signal, tuple[int, ...]], ...]
    without_value: tuple[int, ...]
    bytes_needed: int


@dataclass(frozen=True)
class _Message:
    name: str
    ident: int
    j1939: bool
    signals: tuple[_Decoded, ...]

    def of(self, ident: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """(N,) which frames are this message."""
        if not self.j1939:
            return ident == np.uint32(self.ident)
        mask = _PGN if (self.ident >> 16) & 0xFF >= 0xF0 else _PGN_TO_ALL
        return (ident & mask) == (np.uint32(self.ident) & mask)


class BusSource(Source):
    """The signals of a raw bus log; `frames` reads it anew from its beginning."""

    def __init__(
        self, path: Path, dbc: Sequence[Path], frames: Callable[[], Iterator[BusFrames]], start_ns: int | None
    ):
        super().__init__(path, start_ns=start_ns)
        self._frames = frames
        self._size = max(1, path.stat().st_size)
        if not dbc:
            raise fault(
                path, f"these are raw frames of a bus ({_some_ids(frames)}): the file that describes them is missing; "
                'say it in the map, [read] dbc = ["my-car.dbc"], or with --dbc FILE',
            )  # fmt: skip
        self._messages = [message for file in dbc for message in read_dbc(file)]
        first = next(iter(frames()), None)
        if first is None:
            raise fault(path, "it holds no frames")
        self._origin = float(first.t[0]) if self.start_ns is None else 0.0
        if self.start_ns is None and self._origin > 1e8:
            self.start_ns = round(self._origin * 1e9)
        self._twice: set[str] = set()
        for message in self._messages:
            mine = message.of(first.ident)
            buses = np.unique(first.bus[mine])
            if len(buses) > 1:
                self._twice.add(message.name)
            befores = [f"{first.buses[bus]}." for bus in buses] if len(buses) > 1 else [""]
            for before in befores:
                for one in message.signals:
                    name = f"{before}{message.name}.{one.name}"
                    place = f"message {message.ident & ~EXTENDED:#05x}" + (
                        "" if mine.any() else ", no frame of it seen"
                    )
                    self.listed.setdefault(name, Listed(name, one.signal.unit, None, place))
        known = np.zeros(len(first.ident), bool)
        for message in self._messages:
            known |= message.of(first.ident)
        others = np.unique(first.ident[~known])
        some = ""
        if others.size:
            some = ", ".join(f"{i & ~np.uint32(EXTENDED):#05x}" for i in others[:8])
            self.notes.append(f"{others.size} identifiers are not in the DBC: {some}{' …' if others.size > 8 else ''}")
        if not known.any():
            names = ", ".join(str(file.name) for file in dbc)
            raise fault(path, f"none of its first {len(known):,} frames is in {names}: it has {some}")

    def pieces(self, names: Collection[str]) -> Iterator[Piece]:
        """Some hundred thousand frames at a time."""
        asked = set(names)
        read = 0
        for frames in self._frames():
            read += len(frames.t)
            piece: dict[str, Series] = {}
            for message in self._messages:
                if not any(f"{message.name}." in name for name in asked):
                    continue
                rows = np.flatnonzero(message.of(frames.ident))
                if not rows.size:
                    continue
                for before, mine in self._by_bus(message, frames, rows):
                    t = frames.t[mine] - self._origin
                    payload, lengths = np.ascontiguousarray(frames.rows[mine]), frames.lengths[mine]
                    for one in message.signals:
                        name = f"{before}{message.name}.{one.name}"
                        if name in asked:
                            piece[name] = _series(one, t, payload, lengths)
            self.done = min(0.99, self.done + len(frames.t) * 24 / self._size)
            if piece:
                yield piece
        self.done = 1.0

    def _by_bus(
        self, message: _Message, frames: BusFrames, rows: NDArray[np.int64]
    ) -> Iterator[tuple[str, NDArray[np.int64]]]:
        if message.name not in self._twice:
            yield "", rows
            return
        for bus in np.unique(frames.bus[rows]):
            yield f"{frames.buses[bus]}.", rows[frames.bus[rows] == bus]


def _series(one: _Decoded, t: Array, payload: NDArray[np.uint8], lengths: NDArray[np.int64]) -> Series:
    sent = np.ones(len(t), bool)
    for multiplexer, values in one.needs:
        sent &= np.isin(multiplexer.raw(payload), values)
    if not sent.all():
        t, payload, lengths = t[sent], payload[sent], lengths[sent]
    raw = one.signal.raw(payload)
    if one.is_float:
        kind = np.float32 if one.signal.length == 32 else np.float64
        whole = np.uint32 if one.signal.length == 32 else np.uint64
        values = one.signal.physical(np.asarray(raw).astype(whole).view(kind).astype(float))
    else:
        values = np.asarray(one.signal.physical(raw), float)
    lacking = lengths < one.bytes_needed
    if one.without_value:
        lacking |= np.isin(raw, one.without_value)
    if lacking.any():
        values = np.where(lacking, np.nan, values)
    return Series(t, values)


def read_dbc(path: Path) -> list[_Message]:
    """The messages of a DBC (or another file that cantools reads). Raises DbcError."""
    import cantools.database

    try:
        text = path.read_text(encoding="cp1252", errors="replace")
        database = cantools.database.load_string(text, path.suffix.lower().removeprefix(".") or "dbc", strict=False)
    except OSError as cause:
        raise DbcError(path, [f"cannot be read: {cause.strerror}"]) from None
    except Exception as cause:  # cantools raises exceptions of many types, its parser's among them
        raise DbcError(path, [f"not a DBC file: {cause}"]) from None
    if not isinstance(database, cantools.database.Database):
        raise DbcError(path, ["describes diagnostics, not CAN messages"])
    return [_message(entry) for entry in database.messages]


def _message(entry: Any) -> _Message:
    signals = {signal.name: _signal(signal) for signal in entry.signals}
    out = [
        _Decoded(
            signal.name, signals[signal.name], bool(signal.is_float), _multiplexers(signal, entry, signals),
            _without_value(signal), max(bit // 8 for bit in signals[signal.name].bits) + 1,
        )
        for signal in entry.signals
        if signal.length <= 64
    ]  # fmt: skip
    ident = entry.frame_id | (EXTENDED if entry.is_extended_frame else 0)
    return _Message(entry.name, ident, entry.protocol == "j1939", tuple(out))


def _signal(signal: Any) -> Signal:
    return Signal(
        signal.name, signal.start, signal.length, signal.byte_order == "big_endian", bool(signal.is_signed),
        float(signal.scale), float(signal.offset), signal.unit or "", 0, 0,
    )  # fmt: skip


def _multiplexers(signal: Any, entry: Any, signals: dict[str, Signal]) -> tuple[tuple[Signal, tuple[int, ...]], ...]:
    """Multiplexers of a signal, each with the values that select it, outer ones too."""
    by_name = {one.name: one for one in entry.signals}
    out: list[tuple[Signal, tuple[int, ...]]] = []
    while signal.multiplexer_ids and signal.multiplexer_signal in by_name:
        out.append((signals[signal.multiplexer_signal], tuple(signal.multiplexer_ids)))
        signal = by_name[signal.multiplexer_signal]
    return tuple(out)


def _without_value(signal: Any) -> tuple[int, ...]:
    """Raw values that a DBC names as no value, for signals that are quantities and no states."""
    choices = signal.choices or {}
    if signal.length < 6:
        return ()
    return tuple(int(raw) for raw, text in choices.items() if _NO_VALUE.search(str(text)))


def _some_ids(frames: Callable[[], Iterator[BusFrames]]) -> str:
    first = next(iter(frames()), None)
    if first is None:
        return "none at all"
    idents = np.unique(first.ident) & ~np.uint32(EXTENDED)
    return "identifiers " + ", ".join(f"{i:#05x}" for i in idents[:8]) + (" …" if idents.size > 8 else "")
