"""Base of the drivers of CAN sensors, whose sample is one message, or several in order, laid out by a DBC file.

A driver defines which messages carry which channels. Inside a message, the signal of a channel has the name of its
exchange-table column with ``_`` for ``.`` (``wheel_fl_force_x``); ids, bits, scales, units and ranges are the DBC's.
The last message of a sample also has ``counter``; ``checksum`` where the driver requires one; and ``status``, or one
``<channel>_status`` for each channel. A status other than 0 means: not valid.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Block, Flag
from lacet.daq.can_signal import WORD, row_width
from lacet.daq.frames import Frames
from lacet.drivers.framework.can_layout import Reading, Unit, compile_units, read_layout
from lacet.drivers.framework.can_messages import MessagePicker, Parts
from lacet.drivers.framework.counters import CounterState, add, follow_counter, steady_counters
from lacet.drivers.framework.crc import Crc, RowCrc
from lacet.drivers.framework.extraction import Extraction
from lacet.drivers.framework.options import check_options, corner_map
from lacet.drivers.framework.outgoing import not_valid, together

NOT_VALID = 1
"""Status that the encoder sends with samples that have no value."""


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
        self._words = max(row_width(message.length) for unit in units for message in unit.messages) // WORD
        idents = [message.ident for unit in units for message in unit.messages]
        # Units of one layout are decoded together: the cost of small live batches is the number of NumPy calls.
        alike: dict[object, list[int]] = {}
        for u, unit in enumerate(self.units):
            alike.setdefault(unit.layout(), []).append(u)
        self._alike = list(alike.values())
        self._crc = {u: crc for members in self._alike for crc in (self._row_crc(units[members[0]]),) for u in members}
        lengths = [message.length for unit in units for message in unit.messages]
        self._picker = MessagePicker(idents, lengths, self._words)
        extractions = [Extraction(units[members[0]].readings, self._words * WORD) for members in self._alike]
        self._extract = {u: one for one, members in zip(extractions, self._alike, strict=True) for u in members}

    def start(self) -> CanState:
        """State before the first frame."""
        ledger: dict[str, int] = dict.fromkeys(
            ("received", "samples", "lost", "bad_checksum", "incomplete", "bad_length", "bad_status", "saturated"), 0
        )
        return CanState(self._picker.nothing, (CounterState(),) * len(self.units), ledger)

    def decode(self, frames: Frames, state: CanState) -> tuple[list[Block], CanState]:
        """Blocks of a batch, without the frames with other sensors' ids, and the state after it."""
        parts = self._picker.of(frames)
        ledger = add(
            state.ledger, received=len(parts.number), bad_length=len(parts.number) - np.count_nonzero(parts.whole)
        )
        return self._samples(parts.after(state.begun), state.counters, ledger, ended=False)

    def finish(self, state: CanState) -> tuple[list[Block], CanState]:
        """Blocks at the end of the stream: a sample with missing messages becomes an incomplete one."""
        return self._samples(state.begun, state.counters, state.ledger, ended=True)

    def counts(self, state: CanState) -> dict[str, int]:
        """The ledger: ``received`` and ``bad_length`` count frames, all others samples (of one wheel)."""
        return dict(state.ledger)

    def _samples(
        self, parts: Parts, counters: tuple[CounterState, ...], ledger: Mapping[str, int], ended: bool
    ) -> tuple[list[Block], CanState]:
        """Samples of all units assembled from messages; incomplete ones stay in the state unless the stream `ended`."""
        size = len(self.messages)
        unit = (parts.number // np.int16(size)).astype(np.int8)
        order = np.argsort(unit, kind="stable")  # of bytes: one pass
        number = parts.number[order]
        edges = np.searchsorted(unit[order], np.arange(len(self.units) + 1)).tolist()
        # A message not later in the order than the one before it begins a new sample.
        begins = np.ones(len(order), bool)
        np.less_equal(number[1:], number[:-1], out=begins[1:])
        begins[[edge for edge in edges if edge < len(order)]] = True
        starts = np.flatnonzero(begins)
        begun = order[:0]
        if not ended:
            open_ones = [b for a, b in pairwise(edges) if a < b and number[b - 1] % size != size - 1]
            if open_ones:
                held = np.zeros(len(order), bool)
                for end in open_ones:
                    held[starts[np.searchsorted(starts, end) - 1] : end] = True
                begun = np.sort(order[held])
                edges = [edge - int(np.count_nonzero(held[:edge])) for edge in edges]
                order, number, begins = order[~held], number[~held], begins[~held]
                starts = np.flatnonzero(begins)
        rows, complete = self._rows(parts, order, number, begins, len(starts))
        t_ns = parts.t_ns[order[starts]]
        ends = np.searchsorted(starts, edges).tolist()
        blocks: list[Block] = []
        after = list(counters)
        for members in self._alike:
            if len(members) == len(self.units):
                mine = slice(None)
            else:
                mine = np.concatenate([np.arange(ends[u], ends[u + 1]) for u in members])
            lengths = [ends[u + 1] - ends[u] for u in members]
            at = [0, *accumulate(lengths)]
            spans = [(u, slice(at[i], at[i + 1])) for i, u in enumerate(members) if lengths[i]]
            if spans:
                decoded, ledger = self._blocks(spans, rows[mine], complete[mine], t_ns[mine], after, ledger)
                blocks += decoded
        return blocks, CanState(parts[begun] if len(begun) else self._picker.nothing, tuple(after), ledger)

    def _rows(
        self,
        parts: Parts,
        order: NDArray[np.int64],
        number: NDArray[np.int16],
        begins: NDArray[np.bool_],
        samples: int,
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Payloads of so many samples (N, messages, width), 0 where missing; whether each has all of its own (N,)."""
        shape = samples, len(self.messages), self._words
        if len(order) == samples * len(self.messages):  # none is missing: they are in order
            cells = parts.words[order].reshape(shape)
            if parts.whole.all():
                return cells.astype("<u8", copy=False).view(np.uint8), np.ones(samples, bool)
            whole = parts.whole[order].reshape(shape[:2])
        else:
            sample, part = np.cumsum(begins) - 1, number % np.int16(len(self.messages))
            cells, whole = np.zeros(shape, np.uint64), np.zeros(shape[:2], bool)
            cells[sample, part] = parts.words[order]
            whole[sample, part] = parts.whole[order]
        return cells.astype("<u8", copy=False).view(np.uint8), np.asarray(whole.all(axis=1))

    def _blocks(
        self,
        spans: list[tuple[int, slice]],
        rows: NDArray[np.uint8],
        complete: NDArray[np.bool_],
        t_ns: NDArray[np.int64],
        counters: list[CounterState],
        ledger: Mapping[str, int],
    ) -> tuple[list[Block], Mapping[str, int]]:
        """Blocks of samples, each checked as a whole: all its values are used or none.

        `spans` are units of one layout, and the samples of each in `rows` (N, messages, width); `counters` of all units
        are updated in place.
        """
        layout = self.units[spans[0][0]]
        last = rows[:, -1]
        flags = np.where(complete, np.uint8(0), np.uint8(Flag.INCOMPLETE))
        crc = self._crc[spans[0][0]]
        if layout.checksum is not None and crc is not None:
            wrong = crc.over(rows.reshape(len(rows), -1)) != layout.checksum.raw(last)
            flags[wrong & complete] = Flag.CHECKSUM
        trusted = flags == 0
        bad = np.count_nonzero(flags)
        incomplete = len(rows) - np.count_nonzero(complete)
        count = layout.counter.raw(last).astype(np.int64)
        lost = 0
        steady = None if bad else steady_counters(count, spans, layout.counter.length, counters)
        if steady is not None:
            for u, state in steady.items():
                counters[u] = state
        else:
            for u, span in spans:
                jumps, counters[u] = follow_counter(count[span], trusted[span], layout.counter.length, counters[u])
                flags[span][jumps.gap] |= np.uint8(Flag.GAP)
                lost += int(jumps.lost.sum())
        values, saturated = self._extract[spans[0][0]].values(rows)
        signals = {id(reading.status): reading.status for reading in layout.readings}  # channels may share one
        status = {key: signal.raw(last) != 0 for key, signal in signals.items()}
        own_flags = np.repeat(flags[None], len(values), axis=0)
        bad_status = saturated[:0]
        if bad or any(one.any() for one in status.values()):
            bad_status = np.array([status[id(reading.status)] for reading in layout.readings]) & trusted
            for of_channel, without in zip(values, bad_status | ~trusted, strict=True):
                of_channel[without] = np.nan
            own_flags[bad_status] |= np.uint8(Flag.STATUS)
            saturated &= trusted & ~bad_status
        if saturated.any():
            own_flags[saturated] |= np.uint8(Flag.RANGE)
        blocks = [
            Block(self.units[u].readings[i].channel, t_ns[span], values[i][span], own_flags[i, span])
            for i in range(len(values))
            for u, span in spans
        ]
        return blocks, add(
            ledger,
            samples=len(rows),
            incomplete=incomplete,
            bad_checksum=bad - incomplete,
            lost=lost,
            bad_status=np.count_nonzero(bad_status.any(axis=0)),
            saturated=np.count_nonzero(saturated.any(axis=0)),
        )

    def _row_crc(self, unit: Unit) -> RowCrc | None:
        """The checksum of a unit's samples in rows of all their messages, its own bits taken as 0."""
        if self.checksum is None or unit.checksum is None:
            return None
        width, last = self._words * WORD, len(unit.messages) - 1
        message = []
        for part, laid in enumerate(unit.messages):
            for byte in range(laid.length):
                own = sum(1 << bit % 8 for bit in unit.checksum.bits if bit // 8 == byte and part == last)
                message.append((width * part + byte, 0xFF & ~own))
        return RowCrc(self.checksum, width * len(unit.messages), message)

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
        for u, unit in enumerate(self.units):
            given = together(blocks, tuple(reading.channel for reading in unit.readings))
            if not given:
                continue
            n = len(given[0])
            rows = np.zeros((n, len(unit.messages), self._words * WORD), np.uint8)
            last = rows[:, -1]
            unit.counter.put(last, (counter + np.arange(n)) % (1 << unit.counter.length))
            for reading, block in zip(unit.readings, given, strict=True):
                saturated = _put_values(reading, rows, block.values)
                bad = not_valid(block, saturated)
                reading.status.put(last, np.where(bad, NOT_VALID, reading.status.raw(last)))
            crc = self._crc[u]
            if unit.checksum is not None and crc is not None:
                unit.checksum.put(last, crc.over(rows.reshape(n, rows.shape[1] * rows.shape[2])))
            parts = len(unit.messages)
            yield (
                np.repeat(given[0].t_ns, parts),
                np.tile(np.array([message.ident for message in unit.messages], np.uint32), n),
                np.tile(np.array([message.length for message in unit.messages], np.int64), n),
                rows.reshape(n * parts, rows.shape[2]),
            )


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
