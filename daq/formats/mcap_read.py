"""Reader of MCAP files that may be unfinished, truncated or damaged: every complete record is read, losses are named.

The `mcap` library's seeking reader needs a footer and its streaming reader stops at the first corrupt byte, so the
iteration over records is here; their interpretation is the library's. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

_HEAD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK = struct.Struct("<QQQI")  # first log time, last log time, uncompressed size, its CRC
_MARKS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")  # the compression of a chunk, as the record holds it
_LARGEST = 1 << 30  # bytes; a record that claims more is damage
_WINDOW = 1 << 20
_KNOWN = {int(code) for code in Opcode}
_READERS = {Opcode.SCHEMA: Schema.read, Opcode.CHANNEL: Channel.read, Opcode.METADATA: Metadata.read}
_BROKEN = (McapError, struct.error, UnicodeDecodeError, ValueError)


@dataclass(frozen=True)
class Place:
    """Position of a message: bytes `begin` … `end` of the contents of chunk `chunk`, or of the file when that is −1."""

    channel: int
    sequence: int
    log_ns: int
    publish_ns: int
    chunk: int
    begin: int
    end: int


@dataclass
class McapScan:
    """Index of the complete records of an MCAP file.

    Attributes
    ----------
    places : every message, in the file's order.
    channels, schemas : by id.
    metadata : name → key → text.
    damage : missing or unreadable parts, one line each.
    finished : whether the file was closed properly.
    """

    path: Path
    places: list[Place] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    finished: bool = False
    _chunks: list[tuple[int, int]] = field(default_factory=list)  # position and length of the records' contents
    _guarded: set[tuple[Opcode, int]] = field(default_factory=set)  # definitions read from chunks, hence under a CRC

    @classmethod
    def of(cls, path: Path) -> McapScan:
        """The index of the file at `path`; OSError when it cannot be read."""
        scan = cls(path)
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(0)
            scan._walk(file, size)
        known = [place for place in scan.places if place.channel in scan.channels]
        if len(known) < len(scan.places):
            lost = len(scan.places) - len(known)
            scan.damage.append(f"{lost} messages belong to no known topic: its definition is lost")
            scan.places = known
        return scan

    def messages(self, places: list[Place]) -> Iterator[tuple[Place, bytes]]:
        """Messages in the order given; each chunk is read once where that is the file's order."""
        current, contents = -1, b""
        with self.path.open("rb") as file:
            for place in places:
                if place.chunk < 0:
                    file.seek(place.begin)
                    yield place, file.read(place.end - place.begin)
                    continue
                if place.chunk != current:
                    position, length = self._chunks[place.chunk]
                    file.seek(position)
                    current, contents = place.chunk, _contents(file.read(length))
                yield place, contents[place.begin : place.end]

    def message(self, place: Place, data: bytes) -> Message:
        """A message as the library's record."""
        return Message(place.channel, place.log_ns, data, place.publish_ns, place.sequence)

    def _walk(self, file: BinaryIO, size: int) -> None:
        position = 0
        if file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC:
            position = len(MCAP0_MAGIC)
        else:
            position = self._resume(file, 0, size, "no MCAP file begins like this")
        while position < size:
            file.seek(position)
            head = file.read(_HEAD.size)
            if size - position == len(MCAP0_MAGIC) and self.finished:
                self.finished = head == MCAP0_MAGIC
                break
            opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
            end = position + _HEAD.size + length
            if not _plausible(head) or end > size or not _followed(file, opcode, position, end):
                self.finished = False
                position = self._resume(file, position, size, "no whole record")
                continue
            file.seek(position + _HEAD.size)
            self._record(file, opcode, position + _HEAD.size, length)
            position = end
        else:
            self.finished = False

    def _resume(self, file: BinaryIO, position: int, size: int, what: str) -> int:
        """Position of the next chunk after damage at `position`, or the end of the file."""
        start = _next_chunk(file, position + 1, size)
        if start < 0:
            if self.places or position:
                self.damage.append(f"cut off at byte {position}: the last {size - position} bytes are no whole record")
            return size
        self.damage.append(f"bytes {position} to {start}: {what}; read on from the chunk after them")
        return start

    def _record(self, file: BinaryIO, opcode: int, position: int, length: int) -> None:
        if opcode == Opcode.CHUNK:
            self._chunk(file, position, length)
        elif opcode == Opcode.MESSAGE and length >= _MESSAGE.size:
            channel, sequence, log_ns, publish_ns = _MESSAGE.unpack(file.read(_MESSAGE.size))
            begin = position + _MESSAGE.size
            self.places.append(Place(channel, sequence, log_ns, publish_ns, -1, begin, position + length))
        elif opcode in _READERS:
            try:
                self._define(_parse(opcode, file.read(length)), guarded=False)
            except _BROKEN:
                self.damage.append(f"byte {position}: a {Opcode(opcode).name.lower()} record does not make sense")
        elif opcode == Opcode.FOOTER:
            self.finished = True

    def _chunk(self, file: BinaryIO, position: int, length: int) -> None:
        data = file.read(length)
        try:
            contents = _contents(data)
            places, definitions = _inside(contents, len(self._chunks))
        except _BROKEN as error:
            when = ""
            if length >= _CHUNK.size:
                first, last, *_ = _CHUNK.unpack_from(data)
                when = f" from {first / 1e9:.3f} to {last / 1e9:.3f} s"
            self.damage.append(f"byte {position}: a chunk{when} is damaged ({error}) and left out")
            return
        self._chunks.append((position, length))
        for definition in definitions:
            self._define(definition, guarded=True)
        self.places += places

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


def _plausible(head: bytes) -> bool:
    """Whether bytes can be the head of a record. Opcodes from 0x80 are private extensions and are skipped."""
    if len(head) < _HEAD.size:
        return False
    opcode, length = _HEAD.unpack(head)
    return (opcode in _KNOWN or opcode >= 0x80) and length <= _LARGEST


def _followed(file: BinaryIO, opcode: int, position: int, end: int) -> bool:
    """Whether the length in a record's head can be right: a wrong one would skip good chunks."""
    if opcode == Opcode.CHUNK and _chunk_end(file, position) != end:
        return False
    file.seek(end)
    head = file.read(_HEAD.size)
    return len(head) < _HEAD.size or _plausible(head)


def _chunk_end(file: BinaryIO, position: int) -> int:
    """End of a chunk record by the sizes inside it."""
    begin = position + _HEAD.size + _CHUNK.size
    file.seek(begin)
    name = int.from_bytes(file.read(4), "little")
    file.seek(begin + 4 + name)
    return begin + 4 + name + 8 + int.from_bytes(file.read(8), "little")


def _parse(opcode: int, data: bytes) -> Schema | Channel | Metadata:
    return _READERS[Opcode(opcode)](ReadDataStream(BytesIO(data)))


def _contents(data: bytes) -> bytes:
    """Contents of a chunk record, decompressed; ValueError when it is damaged."""
    chunk = Chunk.read(ReadDataStream(BytesIO(data)))
    if chunk.uncompressed_size > _LARGEST:
        raise ValueError(f"claims {chunk.uncompressed_size} bytes")
    try:
        if chunk.compression == "zstd":
            if zstandard.get_frame_parameters(chunk.data).content_size != chunk.uncompressed_size:
                raise ValueError("its size is not what it claims")
            contents = zstandard.ZstdDecompressor().decompress(chunk.data)
        elif chunk.compression == "lz4":
            contents = lz4.frame.decompress(chunk.data)
        elif not chunk.compression:
            contents = chunk.data
        else:
            raise ValueError(f"compression {chunk.compression!r} is not known")
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise ValueError("cannot be decompressed") from error
    if chunk.uncompressed_crc and zlib.crc32(contents) != chunk.uncompressed_crc:
        raise ValueError("wrong CRC")
    if len(contents) != chunk.uncompressed_size:
        raise ValueError("its size is not what it claims")
    return contents


def _inside(contents: bytes, chunk: int) -> tuple[list[Place], list[Schema | Channel | Metadata]]:
    places: list[Place] = []
    definitions: list[Schema | Channel | Metadata] = []
    position = 0
    while position < len(contents):
        opcode, length = _HEAD.unpack_from(contents, position)
        begin = position + _HEAD.size
        position = begin + length
        if position > len(contents):
            raise ValueError("its records do not fit in it")
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(contents, begin)
            places.append(Place(channel, sequence, log_ns, publish_ns, chunk, begin + _MESSAGE.size, position))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            definitions.append(_parse(opcode, contents[begin:position]))
    return places, definitions


def _next_chunk(file: BinaryIO, position: int, size: int) -> int:
    """Position of the next complete compressed chunk record at or after `position`, −1 when there is none."""
    before = _HEAD.size + _CHUNK.size
    start = position
    while start < size:
        file.seek(start)
        window = file.read(_WINDOW + 64)
        hits = sorted(hit for mark in _MARKS for hit in _find_all(window, mark))
        for hit in hits:
            if hit < before:
                continue
            opcode, length = _HEAD.unpack_from(window, hit - before)
            mark = 4 + window[hit]
            tail = window[hit + mark : hit + mark + 8]
            fits = len(tail) == 8 and length == _CHUNK.size + mark + 8 + int.from_bytes(tail, "little")
            found = start + hit - before
            if opcode == Opcode.CHUNK and fits and found + _HEAD.size + length <= size:
                return found
        start += _WINDOW
        if start < size:
            start -= before  # a mark may begin before the boundary of two windows
    return -1


def _find_all(window: bytes, mark: bytes) -> Iterator[int]:
    hit = window.find(mark)
    while hit >= 0:
        yield hit
        hit = window.find(mark, hit + 1)
