"""Driver of GNSS receivers that send NMEA 0183 sentences on a serial line. Wire format: ``docs/wires/nmea.md``."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import time
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.blocks import Block, Flag
from lacet.daq.errors import RigError, nearest
from lacet.daq.frames import Frames
from lacet.drivers.framework.base import Reader
from lacet.drivers.framework.counters import add
from lacet.drivers.framework.lines import Line, split_lines
from lacet.drivers.framework.options import check_options

SOURCES = {"speed_from": ("RMC", "VTG"), "position_from": ("GGA", "RMC", "GLL", "GNS")}
"""Options: which sentence speed and course, and latitude and longitude, are taken from; the first by default."""
_DAY_NS = 86_400 * 10**9
_KNOT, _DEGREE = 1852.0 / 3600.0, np.pi / 180.0
_SENTENCE = re.compile(rb"\$([A-Z]{2})([A-Z]{3}),[\x20-\x7e]*\*[0-9A-Fa-f]{2}")
_LEAP = re.compile(rb",(\d{4})60(\.\d*)?,")
"""The time of a leap second, which no clock of the library's can show: it is the second before again."""

Sample = tuple[int, float, int, int | None]
"""Stamp [ns], value (NaN for none), flags, device clock [ns] or None."""


@dataclass(frozen=True)
class NmeaState:
    """State between batches: bytes of an unfinished line, bytes used, last time of day continued over midnight [ns],
    the last one of each channel, and ledger."""

    waiting: Frames
    used: int
    clock_ns: int | None
    last_ns: Mapping[str, int]
    ledger: Mapping[str, int]


class Nmea(Reader):
    """Driver of NMEA sentences: speed and course, position, altitude; UTC of day as device clock.

    A sentence counts when its checksum is right; what stands between sentences, and other sentences, are passed over.
    """

    name: str = "nmea"
    channels: tuple[str, ...] = ("gnss.speed", "gnss.course", "gnss.latitude", "gnss.longitude", "gnss.altitude")

    def __init__(
        self,
        bus: str,
        options: Mapping[str, object] | None = None,
        folder: Path | None = None,
        documents: Mapping[str, str] | None = None,
    ) -> None:
        options = options or {}
        check_options(self.name, options, tuple(SOURCES))
        chosen = {key: str(options.get(key, known[0])) for key, known in SOURCES.items()}
        faults = [
            f"{key}: must be one of {', '.join(SOURCES[key])}, found '{word}'{nearest(word, SOURCES[key])}"
            for key, word in chosen.items()
            if word not in SOURCES[key]
        ]
        if faults:
            raise RigError(f"options of driver '{self.name}'", faults)
        self.bus = bus
        self.documents: dict[str, str] = {}
        altitude = chosen["position_from"] if chosen["position_from"] in ("GGA", "GNS") else "GGA"
        self._channels: dict[str, list[str]] = {}  # of each kind of sentence
        for kind, names in (
            (chosen["speed_from"], self.channels[:2]), (chosen["position_from"], self.channels[2:4]),
            (altitude, self.channels[4:]),
        ):  # fmt: skip
            self._channels.setdefault(kind, []).extend(names)

    def start(self) -> NmeaState:
        """State before the first byte."""
        ledger: dict[str, int] = dict.fromkeys(("received", "samples", "bad_checksum", "bad_field", "bad_status"), 0)
        return NmeaState(Frames.empty(self.bus), 0, None, {}, ledger)

    def counts(self, state: NmeaState) -> dict[str, int]:
        """The ledger: ``received`` and ``skipped_bytes`` (outside valid sentences) count bytes, ``samples`` those of
        all channels, the rest sentences."""
        skipped = state.ledger["received"] - state.used - len(state.waiting.data)
        return {**state.ledger, "skipped_bytes": skipped}

    def decode(self, frames: Frames, state: NmeaState) -> tuple[list[Block], NmeaState]:
        """Blocks of the sentences that a batch of reads completes; a sample has the stamp of its first byte's read."""
        lines, waiting = split_lines(state.waiting, frames, b"$")
        state = replace(state, waiting=waiting, ledger=add(state.ledger, received=len(frames.data)))
        found: dict[str, list[Sample]] = {}
        for line in lines:  # some tens a second; each has fields of its own
            state = self._sentence(line, state, found)
        blocks: list[Block] = []
        for channel, rows in found.items():
            t_ns, values, flags, device = zip(*rows, strict=True)
            clock = None if None in device else np.array(device, np.int64)
            column = np.array(values, float)[:, None]
            blocks.append(Block(channel, np.array(t_ns, np.int64), column, np.array(flags, np.uint8), clock))
        return blocks, replace(state, ledger=add(state.ledger, samples=sum(map(len, blocks))))

    def _sentence(self, line: Line, state: NmeaState, found: dict[str, list[Sample]]) -> NmeaState:
        """Add the samples of one line to `found`; the state after it."""
        if not line.text.startswith(b"$"):
            return state
        text = line.text.rstrip(b"\r")
        match = _SENTENCE.fullmatch(text)
        if match is None or _checksum(text[1:-3]) != int(text[-2:], 16):
            return replace(state, ledger=add(state.ledger, bad_checksum=1))
        state = replace(state, used=state.used + len(line.text) + 1)
        channels = self._channels.get(match[2].decode(), [])
        if match[1].startswith(b"P") or not channels:  # a maker's own, or one that is not used
            return state
        try:
            values, seconds = _parsed(text, match[2].decode())
        except Exception:  # the library raises exceptions of many types for fields that are none
            return replace(state, ledger=add(state.ledger, bad_field=1))
        clock = None if seconds is None else _continued(round(seconds * 1e9), state.clock_ns)
        last = dict(state.last_ns)
        for channel in channels:
            value = values.get(channel, np.nan)
            flags = 0 if np.isfinite(value) else int(Flag.STATUS)
            if clock is not None:
                flags |= int(Flag.CLOCK) if clock <= last.get(channel, clock - 1) else 0
                last[channel] = clock
            found.setdefault(channel, []).append((line.t_ns, value if np.isfinite(value) else np.nan, flags, clock))
        invalid = all(not np.isfinite(values.get(channel, np.nan)) for channel in channels)
        return replace(
            state, clock_ns=state.clock_ns if clock is None else clock, last_ns=last,
            ledger=add(state.ledger, bad_status=int(invalid)),
        )  # fmt: skip


def _checksum(body: bytes) -> int:
    return int(np.bitwise_xor.reduce(np.frombuffer(body, np.uint8)))


def _continued(of_day_ns: int, last_ns: int | None) -> int:
    """A time of day continued over midnight: the day that brings it nearest to the last one."""
    if last_ns is None:
        return of_day_ns
    return last_ns + (of_day_ns - last_ns + _DAY_NS // 2) % _DAY_NS - _DAY_NS // 2


def _parsed(text: bytes, kind: str) -> tuple[dict[str, float], float | None]:
    """Values in SI by channel, none where the receiver has no fix or leaves a field empty; and the time of day [s]."""
    import pynmeagps

    leap = _LEAP.search(text)
    if leap is not None:
        text = text[: leap.end(1)] + b"59" + text[leap.end(1) + 2 :]
    message = pynmeagps.NMEAReader.parse(text + b"\r\n", validate=pynmeagps.VALNONE)
    values = {} if _invalid(message, kind) else {name: get(message) for name, get in _FIELDS.items()}
    when = getattr(message, "time", None)
    if not isinstance(when, time):
        return values, None
    seconds = 3600.0 * when.hour + 60.0 * when.minute + when.second + 1e-6 * when.microsecond
    return values, seconds


def _invalid(message: Any, kind: str) -> bool:
    """Whether a sentence says that the receiver has no fix."""
    if kind == "GGA":
        return message.quality in (0, "")
    mode = str(getattr(message, "posMode", "")).strip("N")
    without_mode = getattr(message, "posMode", "") != "" and not mode  # one letter a satellite system, all N
    return without_mode or getattr(message, "status", "A") != "A"


def _number(message: Any, field: str, factor: float) -> float:
    value = getattr(message, field, "")
    return factor * float(value) if value not in ("", None) else np.nan


def _speed(message: Any) -> float:
    return next((v for f, k in _SPEEDS if np.isfinite(v := _number(message, f, k))), np.nan)


_SPEEDS = (("spd", _KNOT), ("sogk", 1.0 / 3.6), ("sogn", _KNOT))
_FIELDS: dict[str, Callable[[Any], float]] = {
    "gnss.speed": _speed,
    "gnss.course": lambda m: _number(m, "cog" if hasattr(m, "cog") else "cogt", _DEGREE),
    "gnss.latitude": lambda m: _number(m, "lat", _DEGREE),
    "gnss.longitude": lambda m: _number(m, "lon", _DEGREE),
    "gnss.altitude": lambda m: _number(m, "alt", 1.0),
}
