"""Counters, checksums and status of a bus's messages, checked only where the rig file names them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.can_signal import Signal
from lacet.daq.errors import nearest
from lacet.daq.sources.dbc_messages import BusMessage, BusSignal
from lacet.daq.sources.source import resolve
from lacet.drivers.framework.crc import CRC8_AUTOSAR, CRC8_J1850, CRC16_CCITT_FALSE, Crc

CHECKSUMS: dict[str, Crc | None] = {
    "crc8-sae-j1850": CRC8_J1850, "crc8-autosar": CRC8_AUTOSAR, "crc16-ccitt-false": CRC16_CCITT_FALSE, "xor": None,
    "sum": None,
}  # fmt: skip
"""Kinds of checksum; ``xor`` and ``sum`` are of bytes."""
CHECKSUM_KEYS = ("kind", "before", "after")
STATUS_KEYS = ("valid", "of")

Signals = Mapping[str, tuple[BusMessage, BusSignal]]
"""``Message.Signal`` → the message and the signal."""


@dataclass(frozen=True)
class Checksum:
    """A checksum over the bytes of a message in order, except its own, between constant bytes."""

    kind: str
    signal: Signal
    length: int
    before: bytes
    after: bytes

    def right(self, payload: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(N,) whether the checksum sent is that of the payload (N, W)."""
        rows = payload[:, : self.length].copy()
        own = [byte for byte in range(self.length) if any(bit // 8 == byte for bit in self.signal.bits)]
        filled = [byte for byte in own if all(8 * byte + bit in self.signal.bits for bit in range(8))]
        for byte in set(own) - set(filled):  # of a byte that it shares its own bits count as 0
            rows[:, byte] &= np.uint8(0xFF & ~sum(1 << bit % 8 for bit in self.signal.bits if bit // 8 == byte))
        rows = np.delete(rows, filled, axis=1)
        ends = [
            np.broadcast_to(np.frombuffer(end, np.uint8), (len(rows), len(end))) for end in (self.before, self.after)
        ]
        rows = np.concatenate([ends[0], rows, ends[1]], axis=1)
        crc = CHECKSUMS[self.kind]
        if crc is not None:
            found = crc.over(rows)
        elif self.kind == "xor":
            found = np.bitwise_xor.reduce(rows, axis=1)
        else:
            found = rows.sum(axis=1, dtype=np.uint32)
        mask = np.int64((1 << self.signal.length) - 1)
        return (found.astype(np.int64) & mask) == self.signal.raw(payload).astype(np.int64)


@dataclass(frozen=True)
class Status:
    """A signal that says by its raw value whether others are valid: `of`, names in its message, or all of them."""

    signal: Signal
    valid: tuple[int, ...]
    of: tuple[str, ...]


@dataclass(frozen=True)
class MessageChecks:
    """Checks of one message; none by default."""

    counter: Signal | None = None
    checksum: Checksum | None = None
    status: tuple[Status, ...] = ()


def read_checks(options: Mapping[str, Any], signals: Signals, faults: list[str]) -> dict[str, MessageChecks]:
    """Message → what the options ``counter``, ``checksum`` and ``status`` ask of it; what is wrong goes to `faults`."""
    out: dict[str, MessageChecks] = {}

    def found(place: str, name: object) -> tuple[BusMessage, BusSignal] | None:
        try:
            return signals[resolve(str(name), signals)]
        except KeyError as cause:
            faults.append(f"{place}: {cause.args[0]}")
            return None

    counters = options.get("counter", [])
    for name in [counters] if isinstance(counters, str) else counters if isinstance(counters, list) else [None]:
        if not isinstance(name, str):
            faults.append(f'counter: must be signals, counter = ["Alive"], found {counters!r}')
        elif (hit := found("counter", name)) is not None:
            before = out.get(hit[0].name, MessageChecks())
            if before.counter is not None:
                faults.append(f"counter: {hit[0].name} has two, and one is enough")
            out[hit[0].name] = MessageChecks(hit[1].signal, before.checksum, before.status)
    for name, entry in _table(options, "checksum", 'checksum = { Crc = "crc8-sae-j1850" }', faults).items():
        if (hit := found("checksum", name)) is not None:
            one = _checksum(f"checksum.{name}", entry, *hit, faults)
            before = out.get(hit[0].name, MessageChecks())
            out[hit[0].name] = MessageChecks(before.counter, one, before.status)
    for name, entry in _table(options, "status", "status = { AccState = 0 }", faults).items():
        if (hit := found("status", name)) is not None and (state := _status(f"status.{name}", entry, *hit, faults)):
            before = out.get(hit[0].name, MessageChecks())
            out[hit[0].name] = MessageChecks(before.counter, before.checksum, (*before.status, state))
    return out


def _table(options: Mapping[str, Any], key: str, form: str, faults: list[str]) -> dict[str, Any]:
    entry = options.get(key, {})
    if not isinstance(entry, dict):
        faults.append(f"{key}: write {form}")
        return {}
    out: dict[str, Any] = {}
    for name, value in entry.items():  # `Message.Signal` without quotes is nested in TOML
        keys = CHECKSUM_KEYS if key == "checksum" else STATUS_KEYS
        if isinstance(value, dict) and not set(value) & set(keys):
            out |= {f"{name}.{inner}": one for inner, one in value.items()}
        else:
            out[name] = value
    return out


def _checksum(place: str, entry: Any, message: BusMessage, one: BusSignal, faults: list[str]) -> Checksum | None:
    entry = {"kind": entry} if isinstance(entry, str) else entry
    if not isinstance(entry, dict):
        faults.append(f'{place}: write "crc8-sae-j1850", or {{ kind = "crc8-autosar", before = [0x12, 0x34] }}')
        return None
    faults += [f"{place}.{key}: unknown key{nearest(key, CHECKSUM_KEYS)}" for key in entry if key not in CHECKSUM_KEYS]
    kind = str(entry.get("kind", ""))
    if kind not in CHECKSUMS:
        faults.append(f"{place}: must be one of {', '.join(CHECKSUMS)}, found '{kind}'{nearest(kind, CHECKSUMS)}")
        return None
    ends: list[bytes] = []
    for key in ("before", "after"):
        try:
            given: Any = entry.get(key, [])
            ends.append(bytes(given))
        except (TypeError, ValueError):
            faults.append(f"{place}.{key}: must be bytes, [0x12, 0x34], found {entry[key]!r}")
            return None
    return Checksum(kind, one.signal, message.length, *ends)


def _status(place: str, entry: Any, message: BusMessage, one: BusSignal, faults: list[str]) -> Status | None:
    entry = entry if isinstance(entry, dict) else {"valid": entry}
    faults += [f"{place}.{key}: unknown key{nearest(key, STATUS_KEYS)}" for key in entry if key not in STATUS_KEYS]
    valid = entry.get("valid")
    valid = valid if isinstance(valid, list) else [valid]
    if not valid or not all(isinstance(raw, int) for raw in valid):
        faults.append(f"{place}: must be the raw values that mean valid, 0 or [0, 1], found {entry.get('valid')!r}")
        return None
    of = entry.get("of", [])
    of = [of] if isinstance(of, str) else of
    return Status(one.signal, tuple(int(raw) for raw in valid), tuple(_names(place, of, message, faults)))


def _names(place: str, of: Any, message: BusMessage, faults: list[str]) -> Collection[str]:
    if not isinstance(of, list):
        faults.append(f'{place}.of: must be signals of {message.name}, of = ["LatAcc"], found {of!r}')
        return ()
    out: list[str] = []
    known = [one.name for one in message.signals]
    for name in of:
        bare = str(name).removeprefix(f"{message.name}.")
        if bare in known:
            out.append(bare)
        else:
            faults.append(
                f"{place}.of: {message.name} has no signal '{bare}'{nearest(bare, known)}: {', '.join(known)}"
            )
    return out
