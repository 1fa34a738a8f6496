"""Messages and signals of a bus that a DBC describes: which frames are which message, and their values, all at once.

No counter, checksum or status is asked for. Multiplexed and floating-point signals, CAN FD and J1939 (frames
distinguished by their parameter group) are decoded.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Flag
from lacet.daq.can_signal import Signal, row_width
from lacet.daq.errors import DbcError
from lacet.daq.frames import EXTENDED

_NO_VALUE = re.compile(r"\b(sna|invalid|not[ _]?avail\w*|no[ _]?value|error|fault|undefined|init)\b", re.IGNORECASE)
"""Names of raw values that mean that there is none."""
_PGN, _PGN_TO_ALL = np.uint32(EXTENDED | 0x03FFFF00), np.uint32(EXTENDED | 0x03FF0000)
"""Bits of a J1939 identifier that are the parameter group: of a broadcast, and of a message to one receiver."""
_ADDRESS = 0xFF
"""Bits of a J1939 identifier that are the sender's address."""
_NO_ADDRESS = 0xFE
"""Address from which on a DBC names no sender: that of a unit without one, and that of all. Reason: SAE J1939-81."""
_FLOATS: dict[int, tuple[type, type]] = {
    16: (np.uint16, np.float16), 32: (np.uint32, np.float32), 64: (np.uint64, np.float64),
}  # fmt: skip


class Values(NamedTuple):
    """Values of a signal in frames of its message.

    `rows` (M,) which of the frames have it, in order; `values` (M,) in the DBC's unit, NaN where there is none; `flags`
    (M,) why: ``STATUS``, the DBC names this raw value as none; ``INCOMPLETE``, the frame ends before it.
    """

    rows: NDArray[np.int64]
    values: NDArray[np.float64]
    flags: NDArray[np.uint8]


@dataclass(frozen=True)
class BusSignal:
    """A signal of a DBC: its place, and the values of its multiplexers with which it is sent."""

    name: str
    signal: Signal
    is_float: bool
    needs: tuple[tuple[Signal, tuple[int, ...]], ...]
    without_value: tuple[int, ...]
    bytes_needed: int

    def together(self, other: BusSignal) -> bool:
        """Whether a frame can have both: no multiplexer of theirs excludes it."""
        return all(
            mine != theirs or not set(selecting).isdisjoint(others)
            for mine, selecting in self.needs
            for theirs, others in other.needs
        )

    def values(self, payload: NDArray[np.uint8], lengths: NDArray[np.int64]) -> Values:
        """The signal's values in frames of its message: `payload` (N, `BusMessage.width`), `lengths` (N,) [byte]."""
        sent = np.ones(len(lengths), bool)
        for multiplexer, selecting in self.needs:
            sent &= np.isin(multiplexer.raw(payload), selecting)
        rows = np.flatnonzero(sent)
        if len(rows) < len(sent):
            payload, lengths = payload[rows], lengths[rows]
        raw = self.signal.raw(payload)
        if self.is_float:
            whole, kind = _FLOATS[self.signal.length]
            values = self.signal.physical(np.asarray(raw).astype(whole).view(kind).astype(float))
        else:
            values = np.asarray(self.signal.physical(raw), float)
        flags = np.where(lengths < self.bytes_needed, np.uint8(Flag.INCOMPLETE), np.uint8(0))
        if self.without_value:
            flags[np.isin(raw, self.without_value) & (flags == 0)] = np.uint8(Flag.STATUS)
        if flags.any():
            values = np.where(flags != 0, np.nan, values)
        return Values(rows, values, flags)


@dataclass(frozen=True)
class BusMessage:
    """A message of a DBC: its identifier, with `EXTENDED`, its length [byte] and its signals.

    `alone` : no other message of the DBC has its J1939 parameter group.
    """

    name: str
    ident: int
    length: int
    j1939: bool
    signals: tuple[BusSignal, ...]
    alone: bool = True

    @property
    def sender(self) -> int | None:
        """J1939 address of the sender that the DBC names, None where it names none."""
        address = self.ident & _ADDRESS
        return address if self.j1939 and address < _NO_ADDRESS else None

    def of(self, ident: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """(N,) which frames are this message, by identifiers with `EXTENDED`."""
        return (ident & self._mask) == np.uint32(self.group)

    @property
    def group(self) -> int:
        """The bits of its identifier that its frames have: all, of J1939 those of the parameter group."""
        return int(np.uint32(self.ident) & self._mask)

    @property
    def _mask(self) -> np.uint32:
        if not self.j1939:
            return np.uint32(0xFFFFFFFF)
        return _PGN if (self.ident >> 16) & 0xFF >= 0xF0 else _PGN_TO_ALL

    def overlapping(self, names: Collection[str]) -> list[str]:
        """Signals among `names` that share bits with another one that is sent with them, a sentence for each pair."""
        return [
            f"signals {a.name} and {b.name} of message {self.name} share bits in its DBC: the values of one are wrong"
            for a, b in combinations(self.signals, 2)
            if (a.name in names or b.name in names) and a.signal.bits & b.signal.bits and a.together(b)
        ]

    @cached_property
    def width(self) -> int:
        """Length of the rows of payload that its signals are taken from [byte]."""
        return row_width(max((one.bytes_needed for one in self.signals), default=1))

    def fitted(self, rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Rows of payload (N, W), filled with zeros or cut to `width`, contiguous."""
        have = rows.shape[1]
        if have >= self.width:
            return np.ascontiguousarray(rows[:, : self.width])
        return np.concatenate([rows, np.zeros((len(rows), self.width - have), np.uint8)], axis=1)


@dataclass(frozen=True)
class Senders:
    """Senders of a J1939 message: the address of the one that is used, None before the first frame, and the number of
    frames of each other one."""

    used: int | None = None
    others: Mapping[int, int] = field(default_factory=dict)

    def then(self, message: BusMessage, ident: NDArray[np.uint32]) -> tuple[NDArray[np.bool_], Senders]:
        """(N,) which of the next frames of the message are used, by their identifiers; and the senders so far.

        The sender is the one that the DBC names as soon as it is there, until then the first one; only the one that it
        names where the DBC has several messages of this parameter group.
        """
        if not message.j1939 or not len(ident):
            return np.ones(len(ident), bool), self
        address, named = ident & np.uint32(_ADDRESS), message.sender
        used = int(address[0]) if self.used is None else self.used
        used = used if named is None or message.alone else named
        mine = address == used
        if named is not None and used != named and (address == named).any():
            at = int(np.argmax(address == named))
            mine[at:] = address[at:] == named
            used = named
        if mine.all() and used == self.used:
            return mine, self
        others = dict(self.others)
        for other, count in zip(*np.unique(address[~mine], return_counts=True), strict=True):
            others[int(other)] = others.get(int(other), 0) + int(count)
        return mine, Senders(used, others)

    def note(self, message: BusMessage) -> str:
        """What is said of other senders, empty where there are none."""
        if not self.others or not message.alone:
            return ""
        others = ", ".join(f"{address:#04x} ({count:,} frames)" for address, count in sorted(self.others.items()))
        which = "which the DBC names" if self.used == message.sender else "the first one"
        return (
            f"message {message.name} comes from several senders: those of {self.used:#04x} are used, {which}; not used "
            f"are {others}; for another one write its address as the last byte of the identifier in the DBC"
        )


def read_dbcs(paths: Sequence[Path]) -> list[BusMessage]:
    """The messages of several DBCs: one that they describe alike once, others of one name with their file's before it.

    Raises DbcError.
    """
    found = {(path, message.name): message for path in paths for message in read_dbc(path)}
    alike: dict[str, list[BusMessage]] = {}
    for message in found.values():
        if message not in alike.setdefault(message.name, []):
            alike[message.name].append(message)
    out: list[BusMessage] = []
    for (path, name), message in found.items():
        own = replace(message, name=f"{path.stem}.{name}") if len(alike[name]) > 1 else message
        if own not in out:
            out.append(own)
    return out


def read_dbc(path: Path) -> list[BusMessage]:
    """The messages of a DBC (or another file that cantools reads). Raises DbcError."""
    try:
        data = path.read_bytes()
    except OSError as cause:
        raise DbcError(path, [f"cannot be read: {cause.strerror}"]) from None
    return parse_dbc(dbc_text(data), str(path))


def dbc_text(data: bytes) -> str:
    """The text of a DBC file: UTF-8, else cp1252, the encoding of most tools."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def parse_dbc(text: str, name: str) -> list[BusMessage]:
    """The messages of a DBC's text; `name` is the file's, whose suffix says the format. Raises DbcError."""
    import cantools.database

    try:
        kind = Path(name).suffix.lower().removeprefix(".") or "dbc"
        database = cantools.database.load_string(text, kind, strict=False)
    except Exception as cause:  # cantools raises exceptions of many types, its parser's among them
        raise DbcError(name, [f"not a DBC file: {cause}"]) from None
    if not isinstance(database, cantools.database.Database):
        raise DbcError(name, ["describes diagnostics, not CAN messages"])
    faults = [
        f"message '{entry.name}': signal '{signal.name}' has factor {signal.scale:g} and offset {signal.offset:g}: "
        "correct them, or remove the signal"
        for entry in database.messages
        for signal in entry.signals
        if not (math.isfinite(signal.scale) and math.isfinite(signal.offset))
    ]
    faults += [
        f"message '{entry.name}': signal '{signal.name}' starts at bit {signal.start}; bits are counted from 0"
        for entry in database.messages
        for signal in entry.signals
        if signal.start < 0
    ]
    if faults:
        raise DbcError(name, faults)
    messages = [_message(entry) for entry in database.messages]
    groups = Counter(one.group for one in messages)
    return [replace(one, alone=groups[one.group] == 1) for one in messages]


def _message(entry: Any) -> BusMessage:
    signals = {signal.name: _signal(signal) for signal in entry.signals}
    out = [
        BusSignal(
            signal.name, signals[signal.name], bool(signal.is_float), _multiplexers(signal, entry, signals),
            _without_value(signal), max(bit // 8 for bit in signals[signal.name].bits) + 1,
        )
        for signal in entry.signals
        if signal.length <= 64
    ]  # fmt: skip
    ident = entry.frame_id | (EXTENDED if entry.is_extended_frame else 0)
    return BusMessage(entry.name, ident, entry.length, entry.protocol == "j1939", tuple(out))


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
