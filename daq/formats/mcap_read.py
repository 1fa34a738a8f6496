"""Reader of MCAP files that may be unfinished, truncated or damaged: every complete record is read, losses are named.

The `mcap` library's seeking reader needs a footer and its streaming reader stops at the first corrupt byte, so the
iteration over records is here; their interpretation is the library's. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

from array import array
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from lacet.daq.formats.mcap_records import (
    BROKEN,
    CHUNK,
    HEAD,
    MESSAGE,
    READERS,
    chunk_contents,
    followed,
    inside,
    messages_in,
    next_chunk,
    parse_definition,
    plausible,
)

KEPT_BYTES = 8 << 20
"""Decompressed segments that a scan keeps for the next reader [bytes]: some seconds of a full rig."""


class Stored(NamedTuple):
    """A message of a file, in segment number `segment`."""

    channel: int
    sequence: int
    log_ns: int
    publish_ns: int
    segment: int
    data: bytes


class Contents:
    """What a file holds of one channel.

    Attributes
    ----------
    messages : how many.
    segments : numbers of the segments that hold any, in the file's order.
    lasts : log time of the last one in each of these segments [ns].
    runs : first sequence number and the one after the last, of each stretch of consecutive ones, in the file's order.
    first_ns, last_ns : least and largest log time [ns].
    """

    def __init__(self) -> None:
        self.messages = 0
        self.segments = array("I")
        self.lasts = array("Q")
        self.runs: list[list[int]] = []
        self.first_ns, self.last_ns = 1 << 64, 0

    def add(self, segment: int, sequence: int, log_ns: int) -> None:
        """Count a message."""
        self.messages += 1
        if not self.segments or self.segments[-1] != segment:
            self.segments.append(segment)
            self.lasts.append(log_ns)
        self.lasts[-1] = log_ns
        if self.runs and self.runs[-1][1] == sequence:
            self.runs[-1][1] += 1
        else:
            self.runs.append([sequence, sequence + 1])
        if log_ns < self.first_ns:
            self.first_ns = log_ns
        if log_ns > self.last_ns:
            self.last_ns = log_ns

    def join(self, later: Contents) -> None:
        """Count the messages of a later file of the run; `segments` and `lasts` stay those of this one."""
        self.messages += later.messages
        self.runs += [list(run) for run in later.runs]
        self.first_ns, self.last_ns = min(self.first_ns, later.first_ns), max(self.last_ns, later.last_ns)

    def between(self, start_ns: int, stop_ns: int) -> array[int]:
        """Segments with the messages that reach into a time, begin included; all where log times step back.

        A message covers the time from the one before it to its own log time.
        """
        lasts = np.array(self.lasts, np.uint64)
        if (lasts[1:] < lasts[:-1]).any():
            return self.segments
        first, last = np.searchsorted(lasts, np.array([max(0, start_ns), max(0, stop_ns)], np.uint64)).tolist()
        return self.segments[first : last + 1]


@dataclass
class McapScan:
    """Index of the complete records of an MCAP file, of a size that does not depend on that of its messages.

    A segment is a chunk, or a message outside of any.

    Attributes
    ----------
    contents : of each channel, by id.
    channels, schemas : by id.
    metadata : name → key → text.
    damage : missing or unreadable parts, one line each.
    finished : whether the file was closed properly.
    """

    path: Path
    contents: dict[int, Contents] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    finished: bool = False
    _segments: array[int] = field(default_factory=lambda: array("q"))  # position of each segment's record
    _guarded: set[tuple[Opcode, int]] = field(default_factory=set)  # definitions read from chunks, hence under a CRC
    _kept: OrderedDict[int, bytes] = field(default_factory=OrderedDict)  # contents of segments read last
    _kept_bytes: int = 0

    @classmethod
    def of(cls, path: Path) -> McapScan:
        """The index of the file at `path`; OSError when it cannot be read."""
        scan = cls(path)
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(0)
            scan._walk(file, size)
        lost = [number for number in scan.contents if number not in scan.channels]
        if lost:
            messages = sum(scan.contents.pop(number).messages for number in lost)
            scan.damage.append(f"{messages} messages belong to no known topic: its definition is lost")
        return scan

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self._segments)

    def messages(
        self, channels: Iterable[int] | None = None, last: bool = False, between: tuple[int, int] | None = None
    ) -> Iterator[Stored]:
        """Messages of some channels (by default of all) in the file's order.

        Those of the segment with the `last` ones alone, or of the segments that reach `between` two log times [ns].
        Contents of segments are kept up to `KEPT_BYTES`, so that several may be read at once, side by side.
        """
        wanted = self.contents.keys() if channels is None else self.contents.keys() & set(channels)
        numbers: list[array[int]] = []
        for channel in wanted:
            held = self.contents[channel]
            numbers.append(held.between(*between) if between else held.segments[-1:] if last else held.segments)
        segments = numbers[0] if len(numbers) == 1 else sorted(set().union(*numbers))
        with self.path.open("rb") as file:
            for number in segments:
                contents = self._segment(file, number)
                for channel, sequence, log_ns, publish_ns, begin, end in messages_in(contents):
                    if channel in wanted:
                        yield Stored(channel, sequence, log_ns, publish_ns, number, contents[begin:end])

    def _segment(self, file: BinaryIO, number: int) -> bytes:
        """Contents of a segment: records, decompressed."""
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        file.seek(self._segments[number])
        head = file.read(HEAD.size)
        opcode, length = HEAD.unpack(head)
        data = file.read(length)
        data = chunk_contents(data) if opcode == Opcode.CHUNK else head + data
        self._kept[number] = data
        self._kept_bytes += len(data)
        while self._kept_bytes > KEPT_BYTES and len(self._kept) > 1:
            self._kept_bytes -= len(self._kept.popitem(last=False)[1])
        return data

    def _walk(self, file: BinaryIO, size: int) -> None:
        position = 0
        if file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC:
            position = len(MCAP0_MAGIC)
        else:
            position = self._resume(file, 0, size, "no MCAP file begins like this")
        while position < size:
            file.seek(position)
            head = file.read(HEAD.size)
            if size - position == len(MCAP0_MAGIC) and self.finished:
                self.finished = head == MCAP0_MAGIC
                break
            opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
            end = position + HEAD.size + length
            if not plausible(head) or end > size or not followed(file, opcode, position, end):
                self.finished = False
                position = self._resume(file, position, size, "no whole record")
                continue
            file.seek(position + HEAD.size)
            self._record(file, opcode, position + HEAD.size, length)
            position = end
        else:
            self.finished = False

    def _resume(self, file: BinaryIO, position: int, size: int, what: str) -> int:
        """Position of the next chunk after damage at `position`, or the end of the file."""
        start = next_chunk(file, position + 1, size)
        if start < 0:
            if self.contents or position:
                self.damage.append(f"cut off at byte {position}: the last {size - position} bytes are no whole record")
            return size
        self.damage.append(f"bytes {position} to {start}: {what}; read on from the chunk after them")
        return start

    def _record(self, file: BinaryIO, opcode: int, position: int, length: int) -> None:
        if opcode == Opcode.CHUNK:
            self._chunk(file, position, length)
        elif opcode == Opcode.MESSAGE and length >= MESSAGE.size:
            channel, sequence, log_ns, _ = MESSAGE.unpack(file.read(MESSAGE.size))
            self._add(position, [(channel, sequence, log_ns)])
        elif opcode in READERS:
            try:
                self._define(parse_definition(opcode, file.read(length)), guarded=False)
            except BROKEN:
                self.damage.append(f"byte {position}: a {Opcode(opcode).name.lower()} record does not make sense")
        elif opcode == Opcode.FOOTER:
            self.finished = True

    def _chunk(self, file: BinaryIO, position: int, length: int) -> None:
        data = file.read(length)
        try:
            messages, definitions = inside(chunk_contents(data))
        except BROKEN as error:
            when = ""
            if length >= CHUNK.size:
                first, last, *_ = CHUNK.unpack_from(data)
                when = f" from {first / 1e9:.3f} to {last / 1e9:.3f} s"
            self.damage.append(f"byte {position}: a chunk{when} is damaged ({error}) and left out")
            return
        for definition in definitions:
            self._define(definition, guarded=True)
        self._add(position, messages)

    def _add(self, position: int, messages: list[tuple[int, int, int]]) -> None:
        """Index the messages (channel, sequence, log time) of the segment whose record's contents are at `position`."""
        number = len(self._segments)
        self._segments.append(position - HEAD.size)
        for channel, sequence, log_ns in messages:
            if channel not in self.contents:
                self.contents[channel] = Contents()
            self.contents[channel].add(number, sequence, log_ns)

    def _define(self, record: Schema | Channel | Metadata, guarded: bool) -> None:
        if isinstance(record, Metadata):
            self.metadata.setdefault(record.name, record.metadata)
            return
        kind = Opcode.SCHEMA if isinstance(record, Schema) else Opcode.CHANNEL
        if not guarded and (kind, record.id) in self._guarded:
            return
        if guarded:
            self._guarded.add((kind, record.id))
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        else:
            self.channels[record.id] = record
