"""Signals of CAN frames compiled from a DBC file: parsed by cantools."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import cantools.database

from lacet.daq.can_signal import Signal
from lacet.daq.errors import DbcError


@dataclass(frozen=True)
class Message:
    """One CAN message: arbitration id, payload length [byte] and signals by name."""

    name: str
    ident: int
    length: int
    signals: dict[str, Signal]


@dataclass(frozen=True)
class Database:
    """The messages of a DBC file by name, and every fault found in it.

    `left_out` : reason for each message (``message``) and signal (``message.signal``) that cannot be decoded.
    """

    messages: dict[str, Message] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)


def parse(text: str, path: object) -> Database:
    """The messages of a DBC file, with the structural faults of all of them.

    Multiplexed messages and floating-point signals are left out, with the reason.

    Raises
    ------
    DbcError : the text is no DBC file. Faults inside a readable file are listed in the result, so that a driver can
        add its own and raise all of them at once.
    """
    try:
        # Not strict: cantools would stop at the first overlap; all of them are listed below.
        database = cantools.database.load_string(text, "dbc", strict=False)
    except Exception as error:  # cantools raises exceptions of many types, its parser's among them
        raise DbcError(path, [f"not a DBC file: {error}"]) from None
    if not isinstance(database, cantools.database.Database):
        raise DbcError(path, ["describes diagnostics, not CAN messages"])
    out = Database()
    owner: dict[int, str] = {}
    for entry in database.messages:
        if entry.name in out.messages:
            out.faults.append(f"message '{entry.name}' comes twice; rename or remove one")
        if entry.frame_id in owner:
            out.faults.append(f"messages '{owner[entry.frame_id]}' and '{entry.name}' share the id {entry.frame_id:#x}")
        owner[entry.frame_id] = entry.name
        if entry.is_multiplexed():
            out.left_out[entry.name] = "is multiplexed; give the signals a message of their own"
            continue
        signals = []
        for signal in entry.signals:
            if signal.is_float:
                out.left_out[f"{entry.name}.{signal.name}"] = "is a floating-point number; use an integer and a factor"
            else:
                signals.append(_signal(signal, out.faults, entry.name))
        message = Message(entry.name, entry.frame_id, entry.length, {signal.name: signal for signal in signals})
        out.messages[entry.name] = message
        out.faults.extend(_layout_faults(message, signals))
    return out


def _signal(signal: Any, faults: list[str], message: str) -> Signal:
    """The signal with its raw range narrowed to the physical bounds of the DBC."""
    low, high = (
        (-(1 << signal.length - 1), (1 << signal.length - 1) - 1)
        if signal.is_signed
        else (
            0,
            (1 << signal.length) - 1,
        )
    )
    factor, offset = float(signal.scale), float(signal.offset)
    if factor == 0.0 or not math.isfinite(factor) or not math.isfinite(offset):
        faults.append(f"message '{message}': signal '{signal.name}' has factor {factor:g} and offset {offset:g}")
        factor, offset = 1.0, 0.0
    bounds = [bound for bound in (signal.minimum, signal.maximum) if bound is not None and math.isfinite(bound)]
    if len(bounds) == 2:
        # The bound itself is inside the range: rounding of minimum / factor must not exclude it.
        ends = [min(max(end, low - 1), high + 1) for end in sorted((bound - offset) / factor for bound in bounds)]
        low, high = max(low, math.ceil(ends[0] - 1e-6)), min(high, math.floor(ends[1] + 1e-6))
        if low >= high:
            faults.append(f"message '{message}': signal '{signal.name}' has no range between minimum and maximum")
    return Signal(
        signal.name,
        signal.start,
        signal.length,
        signal.byte_order == "big_endian",
        signal.is_signed,
        factor,
        offset,
        signal.unit or "",
        low,
        high,
    )


def _layout_faults(message: Message, signals: list[Signal]) -> list[str]:
    """Faults of a message: signals of equal names, outside the message, longer than a word, or on the same bits."""
    faults = []
    place = f"message '{message.name}': signal"
    for i, signal in enumerate(signals):
        if signal.length > 64:
            faults.append(f"{place} '{signal.name}' has {signal.length} bits; 64 is the most")
        if signal.start < 0:
            faults.append(f"{place} '{signal.name}' starts at bit {signal.start}; bits are counted from 0")
        outside = [bit for bit in signal.bits if bit >= 8 * message.length]
        if outside:
            faults.append(
                f"{place} '{signal.name}' needs byte {max(outside) // 8} but the message has {message.length} bytes"
            )
        for other in signals[:i]:
            if other.name == signal.name:
                faults.append(f"{place} '{signal.name}' comes twice")
            elif shared := len(other.bits & signal.bits):
                faults.append(f"{place}s '{other.name}' and '{signal.name}' overlap in {shared} bits")
    return faults
