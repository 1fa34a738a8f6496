"""Driver of u-blox GNSS receivers on a serial line: UBX-NAV-PVT. Wire format: ``docs/wires/ubx.md``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Block, Flag
from lacet.daq.frames import Frames
from lacet.drivers.framework.base import Reader
from lacet.drivers.framework.counters import add
from lacet.drivers.framework.lines import rest_of
from lacet.drivers.framework.options import check_options

HEAD = b"\xb5\x62\x01\x07"
LENGTHS = (84, 92)
"""Lengths of the payload [byte]: protocol version 14 (u-blox 7), and 15 and later."""
_AROUND = 8  # bytes: head, length, checksum
_WEEK_NS = 7 * 86_400 * 10**9
_FIX_OK, _NO_POSITION = 0x01, 0x01  # bits of `flags` and `flags3`
_NO_FIX, _FLAT, _TIME_ONLY = 0, 2, 5  # values of `fixType`

_PVT = np.dtype([
    ("itow", "<u4"), ("date", "u1", (7,)), ("valid", "u1"), ("time_accuracy", "<u4"), ("nano", "<i4"), ("fix", "u1"),
    ("flags", "u1"), ("flags2", "u1"), ("satellites", "u1"), ("longitude", "<i4"), ("latitude", "<i4"),
    ("height", "<i4"), ("altitude", "<i4"), ("accuracy", "<u4", (2,)), ("velocity", "<i4", (3,)), ("speed", "<i4"),
    ("course", "<i4"), ("accuracies", "<u4", (2,)), ("dilution", "<u2"), ("flags3", "<u2"), ("rest", "u1", (4,)),
])  # fmt: skip
"""The first 84 bytes of the payload."""
_CHANNELS = {
    # channel: field, step in SI
    "gnss.speed": ("speed", 1e-3),
    "gnss.course": ("course", 1e-5 * np.pi / 180.0),
    "gnss.latitude": ("latitude", 1e-7 * np.pi / 180.0),
    "gnss.longitude": ("longitude", 1e-7 * np.pi / 180.0),
    "gnss.altitude": ("altitude", 1e-3),
}


@dataclass(frozen=True)
class UbxState:
    """State between batches: bytes that may begin a message, last time [ns from the first week's begin], and ledger."""

    waiting: Frames
    last_ns: int | None
    ledger: Mapping[str, int]


class Ubx(Reader):
    """Driver of UBX-NAV-PVT: speed, course, position and altitude, with the receiver's time as device clock.

    A message is found by its first bytes and verified by its checksum; other messages and other protocols on the line
    are passed over.
    """

    name: str = "ubx"
    channels: tuple[str, ...] = tuple(_CHANNELS)

    def __init__(
        self,
        bus: str,
        options: Mapping[str, object] | None = None,
        folder: Path | None = None,
        documents: Mapping[str, str] | None = None,
    ) -> None:
        check_options(self.name, options or {}, ())
        self.bus = bus
        self.documents: dict[str, str] = {}

    def start(self) -> UbxState:
        """State before the first byte."""
        ledger: dict[str, int] = dict.fromkeys(
            ("received", "samples", "bad_checksum", "bad_status", "skipped_bytes"), 0
        )
        return UbxState(Frames.empty(self.bus), None, ledger)

    def counts(self, state: UbxState) -> dict[str, int]:
        """The ledger: ``received`` and ``skipped_bytes`` (outside valid messages) count bytes, the rest messages."""
        return dict(state.ledger)

    def decode(self, frames: Frames, state: UbxState) -> tuple[list[Block], UbxState]:
        """Blocks of the messages that a batch of reads completes; a sample has the stamp of its first byte's read."""
        stream = Frames.concat(self.bus, [state.waiting, frames])
        found, bad, hold = _scan(stream.data.tobytes())
        starts = np.array([start for start, _ in found], np.int64)
        used = sum(length + _AROUND for _, length in found)
        ledger = add(
            state.ledger, received=len(frames.data), bad_checksum=bad, skipped_bytes=hold - used, samples=len(found)
        )
        state = replace(state, waiting=rest_of(stream, hold), ledger=ledger)
        if not found:
            return [], state
        rows = stream.data[starts[:, None] + 6 + np.arange(_PVT.itemsize)]
        read = np.searchsorted(stream.offset, starts, side="right") - 1
        return self._samples(np.ascontiguousarray(rows).view(_PVT)[:, 0], stream.t_ns[read], state)

    def finish(self, state: UbxState) -> tuple[list[Block], UbxState]:
        """No blocks: the bytes waiting are an incomplete message."""
        ledger = add(state.ledger, skipped_bytes=len(state.waiting.data))
        return [], replace(state, waiting=Frames.empty(self.bus), ledger=ledger)

    def _samples(
        self, fields: NDArray[np.void], t_ns: NDArray[np.int64], state: UbxState
    ) -> tuple[list[Block], UbxState]:
        device_ns, back = _unwrapped(fields["itow"].astype(np.int64) * 10**6, state.last_ns)
        without = (fields["flags"] & _FIX_OK == 0) | np.isin(fields["fix"], (_NO_FIX, _TIME_ONLY))
        nowhere = without | (fields["flags3"] & _NO_POSITION != 0)
        bad = {
            "gnss.latitude": nowhere, "gnss.longitude": nowhere, "gnss.altitude": nowhere | (fields["fix"] == _FLAT),
        }  # fmt: skip
        blocks = []
        for channel, (field, step) in _CHANNELS.items():
            invalid = bad.get(channel, without)
            flags = np.where(invalid, np.uint8(Flag.STATUS), np.uint8(0)) | np.where(back, np.uint8(Flag.CLOCK), 0)
            values = np.where(invalid, np.nan, fields[field] * step)
            blocks.append(Block(channel, t_ns, values[:, None], flags.astype(np.uint8), device_ns))
        ledger = add(state.ledger, bad_status=np.count_nonzero(without))
        return blocks, replace(state, last_ns=int(device_ns[-1]), ledger=ledger)


def _scan(data: bytes) -> tuple[list[tuple[int, int]], int, int]:
    """Good messages (start, length of the payload), how many are broken, and where what may still be one begins.

    One step a message, some ten a second.
    """
    found: list[tuple[int, int]] = []
    bad, at = 0, 0
    while (start := data.find(HEAD, at)) >= 0:
        if start + 6 > len(data):
            return found, bad, start
        length = int.from_bytes(data[start + 4 : start + 6], "little")
        end = start + length + _AROUND
        if length not in LENGTHS:
            at = start + 1
        elif end > len(data):
            return found, bad, start
        elif _checksum(data[start + 2 : end - 2]) == data[end - 2 : end]:
            found.append((start, length))
            at = end
        else:
            bad += 1
            at = start + 1  # a good message may begin inside a broken one
    begun = max((n for n in range(1, len(HEAD)) if data[at:].endswith(HEAD[:n])), default=0)
    return found, bad, len(data) - begun


def _checksum(body: bytes) -> bytes:
    """The 8-bit Fletcher checksum of class, identifier, length and payload."""
    values = np.frombuffer(body, np.uint8).astype(np.int64)
    return bytes([int(values.sum()) & 0xFF, int((values * np.arange(len(values), 0, -1)).sum()) & 0xFF])


def _unwrapped(itow_ns: NDArray[np.int64], last_ns: int | None) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Times of week (N,) continued past the week's end, and (N,) where the time stood still or went back."""
    first = int(itow_ns[0]) if last_ns is None else last_ns
    steps = np.diff(np.concatenate([[first], itow_ns]))
    steps = (steps + _WEEK_NS // 2) % _WEEK_NS - _WEEK_NS // 2
    back = steps <= 0
    if last_ns is None:
        back[0] = False
    return first + np.cumsum(steps), back
