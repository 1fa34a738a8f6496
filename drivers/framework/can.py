"""Base of the drivers of CAN sensors, whose sample is one message, or several in order, laid out by a DBC file.

A driver defines which messages carry which channels. Inside a message, the signal of a channel has the name of its
exchange-table column with ``_`` for ``.`` (``wheel_fl_force_x``); ids, bits, scales, units and ranges are the DBC's.
The last message of a sample also has ``counter``; ``checksum`` where the driver requires one; and ``status``, or one
``<channel>_status`` for each channel. A status other than 0 means: not valid.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Block, Flag
from lacet.daq.frames import Frames
from lacet.drivers.framework import dbc
from lacet.drivers.framework.can_layout import Reading, Unit, compile_units, read_layout
from lacet.drivers.framework.counters import CounterState, add, follow_counter
from lacet.drivers.framework.crc import Crc
from lacet.drivers.framework.options import check_options, corner_map
from lacet.drivers.framework.outgoing import not_valid, together

NOT_VALID = 1
"""Status that the encoder sends with samples that have no value."""


@dataclass(frozen=True)
class Parts:
    """Messages of one sensor in a batch: `unit`, `part` (N,) identify each; `whole` : whether its length is right."""

    unit: NDArray[np.int8]
    part: NDArray[np.int8]
    t_ns: NDArray[np.int64]
    words: NDArray[np.uint64]
    whole: NDArray[np.bool_]

    def __getitem__(self, index: NDArray[np.int64]) -> Parts:
        return Parts(self.unit[index], self.part[index], self.t_ns[index], self.words[index], self.whole[index])

    @classmethod
    def concat(cls, items: list[Parts]) -> Parts:
        """Batches joined end to end, in the order given (at least one)."""
        columns = ([getattr(item, name) for item in items] for name in ("unit", "part", "t_ns", "words", "whole"))
        return cls(*(np.concatenate(column) for column in columns))


@dataclass(frozen=True)
class CanState:
    """State of a CAN driver between batches: incomplete samples and counter of each unit, and the ledger."""

    begun: Parts
    counters: tuple[CounterState, ...]
    ledger: Mapping[str, int]


class CanSensor:
    """Base of the CAN drivers: decoder and encoder of a sensor whose samples are described by `messages`.

    Class attributes
    ----------------
    messages : message name → channels it carries, in the order in which the messages of a sample are sent; ``{c}`` is a
        corner.
    layout : DBC file in ``drivers/dbc`` used when the rig file names none.
    cyclic : channels (with ``{c}``) whose raw value is cyclic over a full turn; they wrap when sent, never saturate,
        and are decoded within [0, 2π) rad.
    checksum : CRC over the payloads of the messages of a sample end to end, the checksum's own bits taken as 0.

    Raises
    ------
    DbcError : the DBC file has faults or lacks messages or signals, all of them listed.
    RigError : an option is unknown or wrong.
    """

    name: str
    messages: Mapping[str, tuple[str, ...]]
    layout: str
    cyclic: tuple[str, ...] = ()
    checksum: Crc | None = None

    def __init__(
        self,
        bus: str,
        options: Mapping[str, object] | None = None,
        folder: Path | None = None,
        documents: Mapping[str, str] | None = None,
    ) -> None:
        cornered = any("{c}" in message for message in self.messages)
        options = options or {}
        check_options(self.name, options, ("corners", "dbc") if cornered else ("dbc",))
        self.bus = bus
        file, text = read_layout(options.get("dbc", self.layout), folder, documents or {})
        self.documents = {file: text}
        units = compile_units(file, text, self.messages, self.cyclic, self.checksum is not None)
        if cornered:
            corners = corner_map(self.name, options, tuple(unit.corner for unit in units))
            units = [unit.mounted_at(corners[unit.corner]) for unit in units if unit.corner in corners]
        self.units: tuple[Unit, ...] = tuple(units)
        self.channels: tuple[str, ...] = tuple(reading.channel for unit in units for reading in unit.readings)
        self._words = max(dbc.row_width(message.length) for unit in units for message in unit.messages) // dbc.WORD
        idents = [message.ident for unit in units for message in unit.messages]
        # Units of one layout are decoded together: the cost of small live batches is the number of NumPy calls.
        alike: dict[object, list[int]] = {}
        for u, unit in enumerate(self.units):
            alike.setdefault(unit.layout(), []).append(u)
        self._alike = list(alike.values())
        self._order = np.argsort(idents)
        self._sorted = np.array(idents, np.uint32)[self._order]
        self._unit = np.array([u for u, unit in enumerate(units) for _ in unit.messages], np.int8)
        self._part = np.array([p for unit in units for p in range(len(unit.messages))], np.int8)
        self._length = np.array([message.length for unit in units for message in unit.messages], np.int64)

    def start(self) -> CanState:
        """State before the first frame."""
        ledger: dict[str, int] = dict.fromkeys(
            ("received", "samples", "lost", "bad_checksum", "incomplete", "bad_length", "bad_status", "saturated"), 0
        )
        return CanState(self._parts(Frames.empty(self.bus)), (CounterState(),) * len(self.units), ledger)

    def decode(self, frames: Frames, state: CanState) -> tuple[list[Block], CanState]:
        """Blocks of a batch, without the frames with other sensors' ids, and the state after it."""
        parts = self._parts(frames)
        ledger = add(state.ledger, received=len(parts.unit), bad_length=np.count_nonzero(~parts.whole))
        return self._samples(Parts.concat([state.begun, parts]), state.counters, ledger, ended=False)

    def finish(self, state: CanState) -> tuple[list[Block], CanState]:
        """Blocks at the end of the stream: a sample with missing messages becomes an incomplete one."""
        return self._samples(state.begun, state.counters, state.ledger, ended=True)

    def counts(self, state: CanState) -> dict[str, int]:
        """The ledger: ``received`` and ``bad_length`` count frames, all others samples (of one wheel)."""
        return dict(state.ledger)

    def _parts(self, frames: Frames) -> Parts:
        """This sensor's messages of a batch, payloads in rows of little-endian words."""
        near = np.minimum(np.searchsorted(self._sorted, frames.ident), len(self._sorted) - 1)
        mine = np.flatnonzero(self._sorted[near] == frames.ident)
        number = self._order[near[mine]]
        at = frames.offset[mine]
        # Views of 8 bytes at every offset, without a copy: one gather a word. Bytes past a payload are never read.
        padded = np.concatenate((frames.data, np.zeros(dbc.WORD * (self._words + 1), np.uint8)))
        anywhere = np.ndarray((len(padded) - dbc.WORD + 1,), "<u8", padded, strides=(1,))
        words = np.stack([anywhere[at + dbc.WORD * w] for w in range(self._words)], axis=1)
        whole = frames.offset[mine + 1] - at == self._length[number]
        return Parts(self._unit[number], self._part[number], frames.t_ns[mine], words, whole)

    def _samples(
        self, parts: Parts, counters: tuple[CounterState, ...], ledger: Mapping[str, int], ended: bool
    ) -> tuple[list[Block], CanState]:
        """Samples of all units assembled from messages; incomplete ones stay in the state unless the stream `ended`."""
        order = np.argsort(parts.unit, kind="stable")
        unit, part = parts.unit[order], parts.part[order]
        # A message not later in the order than the one before it begins a new sample.
        begins = np.ones(len(order), bool)
        begins[1:] = (part[1:] <= part[:-1]) | (unit[1:] != unit[:-1])
        starts = np.flatnonzero(begins)
        sample = np.cumsum(begins) - 1
        owner = unit[starts]
        waits = np.zeros(len(starts), bool)
        if not ended and len(starts):
            final = part[np.append(starts[1:], len(order)) - 1] == len(self.messages) - 1
            waits = ~final & np.append(owner[1:] != owner[:-1], True)
        cells = np.zeros((len(starts), len(self.messages), self._words), np.uint64)
        cells[sample, part] = parts.words[order]
        whole = np.zeros(cells.shape[:2], bool)
        whole[sample, part] = parts.whole[order]
        rows = cells.astype("<u8", copy=False).view(np.uint8)
        complete = np.asarray(whole.all(axis=1))
        t_ns = parts.t_ns[order[starts]]
        blocks: list[Block] = []
        after = list(counters)
        for members in self._alike:
            mine = np.flatnonzero(np.isin(owner, members) & ~waits)
            if len(mine):
                decoded, ledger = self._blocks(
                    members, owner[mine], rows[mine], complete[mine], t_ns[mine], after, ledger
                )
                blocks += decoded
        return blocks, CanState(parts[np.sort(order[waits[sample]])], tuple(after), ledger)

    def _blocks(
        self,
        members: list[int],
        owner: NDArray[np.int8],
        rows: NDArray[np.uint8],
        complete: NDArray[np.bool_],
        t_ns: NDArray[np.int64],
        counters: list[CounterState],
        ledger: Mapping[str, int],
    ) -> tuple[list[Block], Mapping[str, int]]:
        """Blocks of samples, each checked as a whole: all its values are used or none.

        `rows` (N, messages, width) are samples of units of one layout, sorted by their `owner` (N,); `counters` of all
        units are updated in place.
        """
        layout = self.units[members[0]]
        last = rows[:, -1]
        flags = np.where(complete, 0, Flag.INCOMPLETE).astype(np.uint8)
        if layout.checksum is not None:
            flags[complete & (self._crc(layout, rows) != layout.checksum.raw(last))] = Flag.CHECKSUM
        trusted = flags == 0
        ledger = add(
            ledger,
            samples=len(rows),
            incomplete=np.count_nonzero(~complete),
            bad_checksum=np.count_nonzero(flags == Flag.CHECKSUM),
        )
        count = layout.counter.raw(last)
        edges = np.searchsorted(owner, [*members, len(self.units)])
        spans = {u: slice(a, b) for u, a, b in zip(members, edges[:-1], edges[1:], strict=True) if a < b}
        for u, span in spans.items():
            jumps, counters[u] = follow_counter(count[span], trusted[span], layout.counter.length, counters[u])
            flags[span][jumps.gap] |= np.uint8(Flag.GAP)
            ledger = add(ledger, lost=jumps.lost.sum())
        any_status = np.zeros(len(rows), bool)
        any_saturated = np.zeros(len(rows), bool)
        blocks = []
        for i, reading in enumerate(layout.readings):
            bad_status = trusted & (reading.status.raw(last) != 0)
            values, saturated = _values(reading, rows)
            saturated &= trusted & ~bad_status
            values[~trusted | bad_status] = np.nan
            own = flags.copy()
            own[bad_status] |= np.uint8(Flag.STATUS)
            own[saturated] |= np.uint8(Flag.RANGE)
            any_status |= bad_status
            any_saturated |= saturated
            blocks += [
                Block(self.units[u].readings[i].channel, t_ns[span], values[span], own[span])
                for u, span in spans.items()
            ]
        return blocks, add(ledger, bad_status=np.count_nonzero(any_status), saturated=np.count_nonzero(any_saturated))

    def _crc(self, unit: Unit, rows: NDArray[np.uint8]) -> NDArray[np.int64]:
        """(N,) checksum of samples held in `rows` (N, messages, width)."""
        if self.checksum is None or unit.checksum is None:
            raise ValueError(f"{self.name} has no checksum")
        payloads = [rows[:, p, : message.length] for p, message in enumerate(unit.messages)]
        end = rows[:, -1].copy()
        unit.checksum.put(end, 0)
        payloads[-1] = end[:, : unit.messages[-1].length]
        return self.checksum.over(np.concatenate(payloads, axis=1)).astype(np.int64)

    def encode(self, blocks: Mapping[str, Block], counter: int = 0) -> Frames:
        """The frames that a sensor would send for these samples.

        The messages of a sample all carry its stamp and come in the order of `messages`. Values are rounded to the
        nearest raw step and saturate at the ends of the range; NaN and flagged samples are sent with a bad status.

        Parameters
        ----------
        blocks : by channel. Units without a given channel send nothing.
        counter : first value of the sample counters.

        Raises
        ------
        UsageError : a channel of a message is missing, or channels of one message are on different stamps.
        """
        sent = list(self._sent(blocks, counter))
        if not sent:
            return Frames.empty(self.bus)
        t_ns, ident, length, rows = (np.concatenate(column) for column in zip(*sent, strict=True))
        order = np.argsort(t_ns, kind="stable")
        length, rows = length[order], rows[order]
        offset = np.concatenate(([0], np.cumsum(length)))
        data = rows[np.arange(rows.shape[1]) < length[:, None]]
        return Frames(self.bus, t_ns[order], ident[order], offset, data)

    def _sent(self, blocks: Mapping[str, Block], counter: int) -> Iterator[tuple[NDArray, ...]]:
        """For each unit with samples: stamps, ids, lengths (M,) and payload rows (M, W) of its frames."""
        for unit in self.units:
            given = together(blocks, tuple(reading.channel for reading in unit.readings))
            if not given:
                continue
            n = len(given[0])
            rows = np.zeros((n, len(unit.messages), self._words * dbc.WORD), np.uint8)
            last = rows[:, -1]
            unit.counter.put(last, (counter + np.arange(n)) % (1 << unit.counter.length))
            for reading, block in zip(unit.readings, given, strict=True):
                saturated = _put_values(reading, rows, block.values)
                bad = not_valid(block, saturated)
                reading.status.put(last, np.where(bad, NOT_VALID, reading.status.raw(last)))
            if unit.checksum is not None:
                unit.checksum.put(last, self._crc(unit, rows))
            parts = len(unit.messages)
            yield (
                np.repeat(given[0].t_ns, parts),
                np.tile(np.array([message.ident for message in unit.messages], np.uint32), n),
                np.tile(np.array([message.length for message in unit.messages], np.int64), n),
                rows.reshape(n * parts, rows.shape[2]),
            )


def _values(reading: Reading, rows: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(N, k) values in SI units and (N,) whether any component is at the end of its range."""
    values = np.empty((len(rows), len(reading.components)))
    saturated = np.zeros(len(rows), bool)
    for column, component in enumerate(reading.components):
        raw = component.signal.raw(rows[:, component.part])
        values[:, column] = component.signal.physical(raw) * component.si
        if not reading.cyclic:
            saturated |= (raw <= component.signal.low) | (raw >= component.signal.high)
    return values, saturated


def _put_values(reading: Reading, rows: NDArray[np.uint8], values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Write (N, k) values in SI units into `rows`, NaN as 0; return (N,) whether any component saturated."""
    saturated = np.zeros(len(rows), bool)
    for column, component in enumerate(reading.components):
        signal = component.signal
        raw = np.rint((values[:, column] / component.si - signal.offset) / signal.factor)
        if reading.cyclic:
            raw = np.mod(np.where(np.isfinite(raw), raw, 0.0), 1 << signal.length)
        else:
            raw = np.clip(np.where(np.isnan(raw), 0.0, raw), signal.low, signal.high)
            saturated |= (raw <= signal.low) | (raw >= signal.high)
        signal.put(rows[:, component.part], raw.astype(np.int64))
    return saturated
