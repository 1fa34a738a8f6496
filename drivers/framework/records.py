"""Base of the drivers of sensors that send one fixed binary record a sample, little-endian.

A record holds a counter, a device clock, 16-bit values and a CRC, in a serial stream or in datagrams: each driver has
its own way to find records. A raw value of −32768 means: not valid.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Block, Flag
from lacet.daq.frames import Frames
from lacet.drivers.framework.counters import CounterState, add, follow_counter, steady_counters, unwrap_clock
from lacet.drivers.framework.crc import Crc
from lacet.drivers.framework.outgoing import not_valid, together
from lacet.drivers.framework.sequence import Recent, Sampling, Stream, in_order, last_rows

NOT_VALID = -32768
FULL = 32767
"""Largest raw value; ±FULL is the end of the range."""
_COUNTS = (
    "received", "samples", "lost", "bad_checksum", "bad_status", "saturated", "restarts", "repeated", "reordered",
)  # fmt: skip


@dataclass(frozen=True)
class RecordState:
    """State of a record driver between batches.

    `waiting` : bytes not yet parsed (serial only); `held` : records held back; counter, clock [µs] and ledger.
    """

    waiting: Frames
    held: Records
    recent: Recent
    counter: CounterState
    clock_us: int | None
    ledger: Mapping[str, int]


class Records(NamedTuple):
    """Records in rows (N, length), their stamps (N,), and the flags (N,) that make one unusable."""

    rows: NDArray[np.uint8]
    t_ns: NDArray[np.int64]
    faults: NDArray[np.uint8]

    def after(self, held: Records) -> Records:
        """The records of `held`, then these."""
        if not len(held.t_ns):
            return self
        return Records(
            np.concatenate((held.rows, self.rows)),
            np.concatenate((held.t_ns, self.t_ns)),
            np.concatenate((held.faults, self.faults)),
        )


@dataclass(frozen=True)
class Part:
    """One channel of a record: its first value, their number, raw step [SI unit], and whether it wraps at ±π rad."""

    channel: str
    first: int
    width: int
    step: float
    wraps: bool = False


@dataclass(frozen=True)
class Record:
    """Byte layout of a record.

    Attributes
    ----------
    head : constant first bytes.
    counter_bytes : width of the sample counter, which follows the head; a 32-bit clock [µs] follows the counter.
    values : number of 16-bit values, after the clock.
    crc : algorithm; the CRC is at the end, low byte first.
    crc_from : first byte that the CRC covers.
    """

    head: bytes
    counter_bytes: int
    values: int
    crc: Crc
    crc_from: int

    @property
    def dtype(self) -> np.dtype:
        """Structured, packed type of one record."""
        return np.dtype([
            ("head", "u1", (len(self.head),)),
            ("counter", f"<u{self.counter_bytes}"),
            ("clock", "<u4"),
            ("values", "<i2", (self.values,)),
            ("crc", f"<u{self.crc.width // 8}"),
        ])  # fmt: skip

    @property
    def length(self) -> int:
        """Length of a record [byte]."""
        return self.dtype.itemsize

    def crc_of(self, rows: NDArray[np.uint8]) -> NDArray[np.uint32]:
        """(N,) CRC of records held in rows (N, length)."""
        return self.crc.over(rows[:, self.crc_from : self.length - self.crc.width // 8])

    def crc_right(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(N,) whether the CRC sent is that of the bytes, `rows` (N, length) contiguous."""
        return rows.view(self.dtype)["crc"][:, 0] == self.crc_of(rows)


class RecordSensor:
    """Decoder and encoder of binary records; base of drivers, which define `record` and `parts`."""

    name: str
    record: Record
    bus: str
    channels: tuple[str, ...]
    parts: tuple[Part, ...]
    documents: dict[str, str]

    def start(self) -> RecordState:
        """State before the first byte."""
        ledger: dict[str, int] = dict.fromkeys(_COUNTS, 0)
        return RecordState(Frames.empty(self.bus), self.none(), Recent(), CounterState(), None, ledger)

    def none(self) -> Records:
        """No records."""
        return Records(np.zeros((0, self.record.length), np.uint8), np.zeros(0, np.int64), np.zeros(0, np.uint8))

    def counts(self, state: RecordState) -> dict[str, int]:
        """The ledger; ``restarts`` are jumps of the counter backwards, ``repeated`` and ``reordered`` count records."""
        return dict(state.ledger)

    def samples(self, records: Records, state: RecordState, ended: bool = False) -> tuple[list[Block], RecordState]:
        """Blocks of records in the order of their counter, and the state after them; all of them when it has `ended`.

        A faulty record advances neither counter nor clock; its device stamp repeats the last good one.
        """
        records = records.after(state.held)
        if not len(records.t_ns):
            return [], state
        counter_of = self._counter
        bits = 8 * self.record.counter_bytes
        spans = [(0, slice(0, len(records.t_ns)))]
        steady = None
        if not records.faults.any() and state.recent.counter == state.counter.last:
            steady = steady_counters(counter_of(records.rows), spans, bits, [state.counter])
        if steady is not None:
            recent = Recent(last_rows(records.rows[:, None], state.recent), None, steady[0].last)
            state = replace(state, held=self.none(), recent=recent)
        else:
            stream = Stream(np.zeros(len(records.t_ns), np.int8), records.rows, records.faults == 0, records.t_ns)
            found = in_order(stream, Sampling(1, bits, None, lambda rows: counter_of(rows[:, 0])), state.recent, ended)
            ledger = add(state.ledger, repeated=found.repeated, reordered=found.reordered)
            end = found.held
            held = Records(records.rows[end:], records.t_ns[end:], records.faults[end:])
            records = Records(records.rows[found.frames], found.t_ns, records.faults[found.frames])
            state = replace(state, held=held, recent=found.recent, ledger=ledger)
            if not len(records.t_ns):
                return [], state
        rows, t_ns, faults = records
        fields = np.ascontiguousarray(rows).view(self.record.dtype)[:, 0]
        good = faults == 0
        jumps, counter = follow_counter(counter_of(rows), good, bits, state.counter)
        device_ns, back, clock_us = unwrap_clock(fields["clock"].astype(np.int64), good, state.clock_us)
        flags = faults.astype(np.uint8)
        flags[jumps.gap] |= np.uint8(Flag.GAP)
        flags[back] |= np.uint8(Flag.CLOCK)
        any_status = np.zeros(len(rows), bool)
        any_saturated = np.zeros(len(rows), bool)
        blocks = []
        for part in self.parts:
            raw = fields["values"][:, part.first : part.first + part.width]
            bad_status = good & (raw == NOT_VALID).any(axis=1)
            saturated = good & ~bad_status & (np.abs(raw.astype(np.int32)) >= FULL).any(axis=1)
            values = raw * part.step
            values[~good | bad_status] = np.nan
            own = flags.copy()
            own[bad_status] |= np.uint8(Flag.STATUS)
            own[saturated] |= np.uint8(Flag.RANGE)
            any_status |= bad_status
            any_saturated |= saturated
            blocks.append(Block(part.channel, t_ns, values, own, device_ns))
        ledger = add(
            state.ledger,
            samples=len(rows),
            lost=jumps.lost.sum(),
            bad_checksum=np.count_nonzero(faults & np.uint8(Flag.CHECKSUM)),
            bad_status=np.count_nonzero(any_status),
            saturated=np.count_nonzero(any_saturated),
            restarts=np.count_nonzero(jumps.back),
        )
        return blocks, replace(state, counter=counter, clock_us=clock_us, ledger=ledger)

    def _counter(self, rows: NDArray[np.uint8]) -> NDArray[np.int64]:
        return np.ascontiguousarray(rows).view(self.record.dtype)["counter"][:, 0].astype(np.int64)

    def encode(self, blocks: Mapping[str, Block], counter: int = 0) -> Frames:
        """The frames that a sensor would send, one record a frame.

        Values are rounded to the nearest raw step and saturate at the ends of the range; NaN and flagged samples are
        sent as not valid. The device clock is the blocks' own, else the stamp, in µs.

        Parameters
        ----------
        blocks : by channel; all of this driver's or none.
        counter : first value of the sample counter.

        Raises
        ------
        UsageError : a channel is missing, or the channels are on different stamps.
        """
        given = together(blocks, self.channels)
        if not given:
            return Frames.empty(self.bus)
        t_ns = given[0].t_ns
        device_ns = next((block.device_ns for block in given if block.device_ns is not None), t_ns)
        fields = np.zeros(len(t_ns), self.record.dtype)
        fields["head"] = np.frombuffer(self.record.head, np.uint8)
        fields["counter"] = (counter + np.arange(len(t_ns))) % (1 << 8 * self.record.counter_bytes)
        fields["clock"] = device_ns // 1000 % (1 << 32)
        fields["values"] = NOT_VALID
        for part, block in zip(self.parts, given, strict=True):
            values = block.values
            if part.wraps:
                values = np.mod(np.where(np.isfinite(values), values, np.nan) + np.pi, 2 * np.pi) - np.pi
            raw = np.clip(np.rint(values / part.step), -FULL, FULL)
            bad = not_valid(block, np.asarray((np.abs(raw) >= FULL).any(axis=1)))
            raw[bad | np.isnan(raw).any(axis=1)] = NOT_VALID
            fields["values"][:, part.first : part.first + part.width] = raw
        rows = fields.view(np.uint8).reshape(len(fields), self.record.length)
        fields["crc"] = self.record.crc_of(rows)
        offset = np.arange(len(t_ns) + 1, dtype=np.int64) * self.record.length
        return Frames(self.bus, t_ns.copy(), np.zeros(len(t_ns), np.uint32), offset, rows.reshape(-1).copy())
