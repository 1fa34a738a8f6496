"""Base of the drivers of CAN sensors, whose sample is one message, or several in order, laid out by a DBC file.

A driver defines which messages carry which channels. Inside a message, the signal of a channel has the name of its
exchange-table column with ``_`` for ``.`` (``wheel_fl_force_x``); ids, bits, scales, units and ranges are the DBC's.
The last message of a sample also has ``counter``; ``checksum`` where the driver requires one; and ``status``, or one
``<channel>_status`` for each channel. A status other than 0 means: not valid.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import NamedTuple

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
from lacet.drivers.framework.sequence import Recent, Sampling, Stream, in_order, last_rows

NOT_VALID = 1
"""Status that the encoder sends with samples that have no value."""
_COUNTS = (
    "received", "samples", "lost", "bad_checksum", "incomplete", "bad_length", "bad_status", "saturated", "repeated",
    "reordered",
)  # fmt: skip


@dataclass(frozen=True)
class CanState:
    """State of a CAN driver between batches: messages held back, counter and last samples of each unit, and ledger."""

    begun: Parts
    counters: tuple[CounterState, ...]
    recent: tuple[Recent, ...]
    ledger: Mapping[str, int]


class _Samples(NamedTuple):
    """Samples of units of one layout, end to end: payloads (N, messages, width), whether all messages are there (N,),
    stamps (N,), and the units that have any with the samples of each."""

    rows: NDArray[np.uint8]
    complete: NDArray[np.bool_]
    t_ns: NDArray[np.int64]
    spans: list[tuple[int, slice]]


class _Checked(NamedTuple):
    """Flags and counters of samples; the units' counters after them where all are right and none is lost."""

    flags: NDArray[np.uint8]
    counter: NDArray[np.int64]
    steady: dict[int, CounterState] | None


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
        widths = np.array(lengths).reshape(len(units), -1, 1)
        self._used = np.where(np.arange(self._words * WORD) < widths, np.uint8(255), np.uint8(0))  # bytes of payloads
        extractions = [Extraction(units[members[0]].readings, self._words * WORD) for members in self._alike]
        self._extract = {u: one for one, members in zip(extractions, self._alike, strict=True) for u in members}

    def start(self) -> CanState:
        """State before the first frame."""
        units = len(self.units)
        return CanState(self._picker.nothing, (CounterState(),) * units, (Recent(),) * units, dict.fromkeys(_COUNTS, 0))

    def decode(self, frames: Frames, state: CanState) -> tuple[list[Block], CanState]:
        """Blocks of a batch, without the frames with other sensors' ids, and the state after it."""
        parts = self._picker.of(frames)
        ledger = add(
            state.ledger, received=len(parts.number), bad_length=len(parts.number) - np.count_nonzero(parts.whole)
        )
        return self._samples(parts.after(state.begun), state, ledger, ended=False)

    def finish(self, state: CanState) -> tuple[list[Block], CanState]:
        """Blocks at the end of the stream: a sample with missing messages becomes an incomplete one."""
        return self._samples(state.begun, state, state.ledger, ended=True)

    def counts(self, state: CanState) -> dict[str, int]:
        """The ledger: ``received``, ``bad_length`` and ``repeated`` count frames, all others samples (of one wheel)."""
        return dict(state.ledger)

    def _samples(
        self, parts: Parts, state: CanState, ledger: Mapping[str, int], ended: bool
    ) -> tuple[list[Block], CanState]:
        """Samples of all units assembled from messages; those begun, or not in sequence, stay in the state unless the
        stream has `ended`."""
        size = len(self.messages)
        unit = (parts.number // np.int16(size)).astype(np.int8)
        order = np.argsort(unit, kind="stable")  # of bytes: one pass
        edges = np.searchsorted(unit[order], np.arange(len(self.units) + 1)).tolist()
        all_of, firsts = order, edges
        number = parts.number[order]
        # A message not later in the order than the one before it begins a new sample.
        begins = np.ones(len(order), bool)
        np.less_equal(number[1:], number[:-1], out=begins[1:])
        begins[[edge for edge in edges if edge < len(order)]] = True
        starts = np.flatnonzero(begins)
        begun: dict[int, NDArray[np.int64]] = {}
        if not ended:
            open_ones = [u for u, (a, b) in enumerate(pairwise(edges)) if a < b and number[b - 1] % size != size - 1]
            if open_ones:
                held = np.zeros(len(order), bool)
                for u in open_ones:
                    tail = slice(starts[np.searchsorted(starts, edges[u + 1]) - 1], edges[u + 1])
                    held[tail] = True
                    begun[u] = order[tail]
                edges = [edge - int(np.count_nonzero(held[:edge])) for edge in edges]
                order, number, begins = order[~held], number[~held], begins[~held]
                starts = np.flatnonzero(begins)
        sample = None if len(order) == len(starts) * size else np.cumsum(begins) - 1
        rows, complete = self._rows(parts, order, sample, len(starts))
        t_ns = parts.t_ns[order[starts]]
        ends = np.searchsorted(starts, edges).tolist()
        blocks: list[Block] = []
        counters, recent = list(state.counters), list(state.recent)
        for members in self._alike:
            if len(members) == len(self.units):
                mine = slice(None)
            else:
                mine = np.concatenate([np.arange(ends[u], ends[u + 1]) for u in members])
            spans = _spans(members, [ends[u + 1] - ends[u] for u in members])
            if not spans:
                continue
            samples = _Samples(rows[mine], complete[mine], t_ns[mine], spans)
            checked = self._checked(samples, counters)
            if checked.steady is None or any(recent[u].counter != counters[u].last for u, _ in spans):
                received = {u: all_of[firsts[u] : firsts[u + 1]] for u in members}
                samples, ledger = self._in_order(parts, received, recent, begun, ledger, ended)
                if not samples.spans:
                    continue
                checked = self._checked(samples, counters)
            else:
                for u, span in spans:
                    recent[u] = Recent(last_rows(samples.rows[span], recent[u]), None, checked.steady[u].last)
            decoded, ledger = self._blocks(samples, checked, counters, ledger)
            blocks += decoded
        waiting = parts[np.sort(np.concatenate(list(begun.values())))] if begun else self._picker.nothing
        return blocks, CanState(waiting, tuple(counters), tuple(recent), ledger)

    def _in_order(
        self,
        parts: Parts,
        received: Mapping[int, NDArray[np.int64]],
        recent: list[Recent],
        begun: dict[int, NDArray[np.int64]],
        ledger: Mapping[str, int],
        ended: bool,
    ) -> tuple[_Samples, Mapping[str, int]]:
        """Samples of units of one layout in the order of their counters, of the messages `received` by unit; `recent`
        and `begun` are updated in place."""
        one = next(iter(received))
        size, layout = len(self.messages), self.units[one]
        crc, counter = self._crc[one], layout.counter

        def right(rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
            assert crc is not None
            assert layout.checksum is not None
            return crc.over(rows.reshape(len(rows), -1)) == layout.checksum.raw(rows[:, -1])

        unit = Sampling(
            size, counter.length, None if crc is None else right, lambda rows: counter.raw(rows[:, -1]).astype(np.int64)
        )
        used = self._used[one]
        payload = parts.words.astype("<u8", copy=False).view(np.uint8) & used[parts.number % size]
        rows, complete, t_ns, lengths = [], [], [], []
        for u, mine in received.items():
            stream = Stream(parts.number[mine] % size, payload[mine], parts.whole[mine], parts.t_ns[mine])
            before = recent[u] if recent[u].rows is None else recent[u]._replace(rows=recent[u].rows & used)
            found = in_order(stream, unit, before, ended)
            begun[u], recent[u] = mine[found.held :], found.recent
            of_unit = self._rows(parts, mine[found.frames], found.sample, len(found.t_ns))
            rows.append(of_unit[0])
            complete.append(of_unit[1])
            t_ns.append(found.t_ns)
            lengths.append(len(found.t_ns))
            ledger = add(ledger, repeated=found.repeated, reordered=found.reordered)
        joined = np.ascontiguousarray(np.concatenate(rows))
        return _Samples(joined, np.concatenate(complete), np.concatenate(t_ns), _spans(received, lengths)), ledger

    def _rows(
        self, parts: Parts, order: NDArray[np.int64], sample: NDArray[np.int64] | None, samples: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Payloads of so many samples (N, messages, width), 0 where missing; whether each has all of its own (N,).

        `sample` is the one of each message; None where none is missing and they are in order.
        """
        shape = samples, len(self.messages), self._words
        if sample is None:
            cells = parts.words[order].reshape(shape)
            if parts.whole.all():
                return cells.astype("<u8", copy=False).view(np.uint8), np.ones(samples, bool)
            whole = parts.whole[order].reshape(shape[:2])
        else:
            part = parts.number[order] % np.int16(len(self.messages))
            cells, whole = np.zeros(shape, np.uint64), np.zeros(shape[:2], bool)
            cells[sample, part] = parts.words[order]
            whole[sample, part] = parts.whole[order]
        return cells.astype("<u8", copy=False).view(np.uint8), np.asarray(whole.all(axis=1))

    def _checked(self, samples: _Samples, counters: list[CounterState]) -> _Checked:
        """Samples of units of one layout, each checked as a whole: all its values are used or none."""
        one = samples.spans[0][0]
        layout, crc = self.units[one], self._crc[one]
        rows, complete = samples.rows, samples.complete
        flags = np.where(complete, np.uint8(0), np.uint8(Flag.INCOMPLETE))
        if layout.checksum is not None and crc is not None:
            wrong = crc.over(rows.reshape(len(rows), -1)) != layout.checksum.raw(rows[:, -1])
            flags[wrong & complete] = Flag.CHECKSUM
        count = layout.counter.raw(rows[:, -1]).astype(np.int64)
        steady = None if flags.any() else steady_counters(count, samples.spans, layout.counter.length, counters)
        return _Checked(flags, count, steady)

    def _blocks(
        self,
        samples: _Samples,
        checked: _Checked,
        counters: list[CounterState],
        ledger: Mapping[str, int],
    ) -> tuple[list[Block], Mapping[str, int]]:
        """Blocks of samples of units of one layout; the `counters` of all units are updated in place."""
        spans, rows, flags = samples.spans, samples.rows, checked.flags
        layout = self.units[spans[0][0]]
        last = rows[:, -1]
        trusted: NDArray[np.bool_] = np.ones((), bool)
        bad = incomplete = lost = 0
        if checked.steady is not None:
            for u, state in checked.steady.items():
                counters[u] = state
        else:
            trusted = flags == 0
            bad, incomplete = np.count_nonzero(flags), len(rows) - np.count_nonzero(samples.complete)
            for u, span in spans:
                jumps, counters[u] = follow_counter(
                    checked.counter[span], trusted[span], layout.counter.length, counters[u]
                )
                flags[span][jumps.gap] |= np.uint8(Flag.GAP)
                lost += int(jumps.lost.sum())
        values, saturated = self._extract[spans[0][0]].values(rows)
        signals = {id(reading.status): reading.status for reading in layout.readings}  # channels may share one
        status = {key: signal.raw(last) != 0 for key, signal in signals.items()}
        own_flags = np.repeat(flags[None], len(values), axis=0)
        invalid = at_end = 0
        if bad or any(one.any() for one in status.values()):
            bad_status = np.array([status[id(reading.status)] for reading in layout.readings]) & trusted
            invalid = np.count_nonzero(bad_status.any(axis=0))
            for of_channel, without in zip(values, bad_status | np.logical_not(trusted), strict=True):
                of_channel[without] = np.nan
            own_flags[bad_status] |= np.uint8(Flag.STATUS)
            saturated &= trusted & ~bad_status
        if saturated.any():
            own_flags[saturated] |= np.uint8(Flag.RANGE)
            at_end = np.count_nonzero(saturated.any(axis=0))
        blocks = [
            Block(self.units[u].readings[i].channel, samples.t_ns[span], values[i][span], own_flags[i, span])
            for i in range(len(values))
            for u, span in spans
        ]
        return blocks, add(
            ledger,
            samples=len(rows),
            incomplete=incomplete,
            bad_checksum=bad - incomplete,
            lost=lost,
            bad_status=invalid,
            saturated=at_end,
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


def _spans(units: Iterable[int], lengths: Sequence[int]) -> list[tuple[int, slice]]:
    """The units that have any samples, and those of each, end to end."""
    ends = list(accumulate(lengths))
    return [(u, slice(end - n, end)) for u, n, end in zip(units, lengths, ends, strict=True) if n]


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
