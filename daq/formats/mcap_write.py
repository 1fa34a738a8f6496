"""Writer of MCAP files in which a failing disk or a lost chunk damages no other chunk.

The bytes are those that the `mcap` library's writer gives for the same calls. Its records of a message and of a chunk
are packed here, in a tenth of the time and memory: it keeps an object for every topic of every chunk until the end.
"""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import zstandard
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from lacet.daq.topics import PROFILE

PROTOBUF = "protobuf"
COMPRESSION = b"zstd"
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_MESSAGE_REST = _MESSAGE.size - 9
_CHUNK = struct.Struct("<BQQQQII4sQ")  # opcode, length, times, size and CRC unpacked, compression, size packed
_INDEX_SIZE = struct.calcsize("<BQHI")  # opcode, length, channel, size of the entries
_RECORDS = 1000  # of the index at the end, packed or passed to the operating system at a time
_RECORD = struct.Struct("<BQ")  # opcode, length
_FOOTER = struct.Struct("<BQQQ")  # opcode, length, start of the summary, start of its offsets


class McapWriter:
    """Writer of chunked, zstd-compressed MCAP. Chunks end where `flush` is called.

    Every schema and channel is written twice: inside the chunk that first uses it, protected by its CRC, and before
    that chunk, so that after the loss of a chunk the following ones can still be decoded.

    Raises
    ------
    OSError : from the constructor, `flush`, `finish` and `sync`. The file then ends after its last whole record.
    """

    def __init__(self, path: Path, overwrite: bool = False):
        self._sink = _Sink(path, overwrite)
        self._chunk = _Chunk()
        self._compress = zstandard.ZstdCompressor().compress
        self._schemas: dict[tuple[str, str, bytes], Schema] = {}
        self._channels: dict[str, Channel] = {}
        self._indexes = _Records()  # of chunks
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._first_ns = self._last_ns = 0
        self._sink.write(MCAP0_MAGIC + _record(Header(PROFILE, "lacet")))

    @property
    def stored(self) -> int:
        """Bytes passed to the operating system."""
        return self._sink.stored

    def message(self, topic: str, kind: Any, data: bytes, log_ns: int, sequence: int) -> None:
        """Add one protobuf message of class `kind`, already serialized."""
        if topic not in self._channels:
            self._add(topic, Schema(0, describe(kind), PROTOBUF, kind.DESCRIPTOR.full_name), PROTOBUF, {})
        self._message(topic, data, log_ns, log_ns, sequence)

    def copy(self, channel: Channel, schema: Schema | None, message: Message) -> None:
        """Add a message of another file unchanged."""
        if channel.topic not in self._channels:
            self._add(channel.topic, schema, channel.message_encoding, channel.metadata)
        self._message(channel.topic, message.data, message.log_time, message.publish_time, message.sequence)

    def metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Add a metadata record."""
        record = _record(Metadata(name, dict(texts)))
        self._metadata.append(MetadataIndex(self._sink.position, len(record), name))
        self._sink.write(record)

    def flush(self) -> None:
        """End the chunk and pass everything to the operating system."""
        self._end_chunk()
        self._sink.flush()

    def sync(self) -> None:
        """Force the operating system to write to the medium."""
        self._sink.sync()

    def finish(self) -> None:
        """Write the index and the footer."""
        self._end_chunk()
        self._sink.write(_record(DataEnd(0)))
        start = self._sink.position
        groups = [
            (Opcode.SCHEMA, map(_record, self._schemas.values())),
            (Opcode.CHANNEL, map(_record, self._channels.values())),
            (Opcode.STATISTICS, [_record(self._statistics())]),
            (Opcode.CHUNK_INDEX, self._indexes),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, map(_record, self._metadata)),
        ]
        crc, offsets = 0, b""
        for opcode, records in groups:
            begin = self._sink.position
            for number, record in enumerate(records):
                self._sink.write(record)
                crc = zlib.crc32(record, crc)
                if number % _RECORDS == _RECORDS - 1:
                    self._sink.flush()
            offsets += _record(SummaryOffset(opcode, begin, self._sink.position - begin))
        at = self._sink.position
        crc = zlib.crc32(_FOOTER.pack(Opcode.FOOTER, 20, start, at), zlib.crc32(offsets, crc))
        self._sink.write(offsets + _record(Footer(start, at, crc)) + MCAP0_MAGIC)
        self._sink.flush()

    def abandon(self) -> None:
        """Close the file without index and footer."""
        self._sink.close()

    def _add(self, topic: str, schema: Schema | None, encoding: str, metadata: dict[str, str]) -> None:
        records = []
        schema_id = 0
        if schema is not None:
            key = (schema.name, schema.encoding, schema.data)
            if key not in self._schemas:
                new = Schema(len(self._schemas) + 1, schema.data, schema.encoding, schema.name)
                self._schemas[key] = new
                records.append(_record(new))
            schema_id = self._schemas[key].id
        channel = Channel(len(self._channels) + 1, topic, encoding, metadata, schema_id)
        self._channels[topic] = channel
        records.append(_record(channel))
        self._chunk.parts += records
        self._chunk.size += sum(map(len, records))
        self._sink.write(b"".join(records))  # nothing is buffered outside the open chunk, so order is kept

    def _message(self, topic: str, data: bytes, log_ns: int, publish_ns: int, sequence: int) -> None:
        number, chunk = self._channels[topic].id, self._chunk
        head = _MESSAGE.pack(
            Opcode.MESSAGE, _MESSAGE_REST + len(data), number, sequence & 0xFFFFFFFF, log_ns, publish_ns
        )
        chunk.entries[number] += (log_ns, chunk.size)
        chunk.parts += (head, data)
        chunk.size += _MESSAGE.size + len(data)
        self._counts[number] += 1

    def _end_chunk(self) -> None:
        """Write the open chunk and the index of its messages, unless it has none."""
        chunk, sink = self._chunk, self._sink
        if not chunk.entries:
            return
        contents = b"".join(chunk.parts)
        packed = self._compress(contents)
        stamps = [stamp for entries in chunk.entries.values() for stamp in entries[::2]]
        first, last = min(stamps), max(stamps)
        self._first_ns = min(self._first_ns, first) if self._indexes else first
        self._last_ns = max(self._last_ns, last)
        crc, size, name = zlib.crc32(contents), len(contents), len(COMPRESSION)
        head = _CHUNK.pack(
            Opcode.CHUNK, _CHUNK.size - 9 + len(packed), first, last, size, crc, name, COMPRESSION, len(packed)
        )
        begin = sink.position
        sink.write(head)
        sink.write(packed)
        length = sink.position - begin
        at, kinds, index, offsets = sink.position, "<", list[int](), list[int]()
        for number, entries in chunk.entries.items():
            kinds += f"BQHI{len(entries)}Q"
            index += (Opcode.MESSAGE_INDEX, 6 + 8 * len(entries), number, 8 * len(entries), *entries)
            offsets += (number, at)
            at += _INDEX_SIZE + 8 * len(entries)
        sink.write(struct.pack(kinds, *index))
        summary = struct.pack(
            f"<QQQQI{'HQ' * (len(offsets) // 2)}QI4sQQ",
            *(first, last, begin, length, 5 * len(offsets), *offsets),
            *(sink.position - begin - length, name, COMPRESSION, len(packed), size),
        )
        self._indexes.add(_RECORD.pack(Opcode.CHUNK_INDEX, len(summary)) + summary)
        self._chunk = _Chunk()

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._indexes),
            message_count=sum(self._counts.values()),
            message_end_time=self._last_ns,
            message_start_time=self._first_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def describe(kind: Any) -> bytes:
    """The serialized FileDescriptorSet of a message class: its file and all that it imports, imports first."""
    found: dict[str, FileDescriptor] = {}

    def visit(file: FileDescriptor) -> None:
        for dependency in file.dependencies:
            visit(dependency)
        found.setdefault(file.name, file)

    visit(kind.DESCRIPTOR.file)
    files = FileDescriptorSet()
    for file in found.values():
        file.CopyToProto(files.file.add())
    return files.SerializeToString(deterministic=True)


class _Records:
    """Records kept until the end of the file, packed: those of ten chunks a second are much alike."""

    def __init__(self) -> None:
        self._packed: list[bytes] = []
        self._open: list[bytes] = []
        self._number = 0

    def __len__(self) -> int:
        return self._number

    def add(self, record: bytes) -> None:
        """Append a record."""
        self._open.append(record)
        self._number += 1
        if len(self._open) == _RECORDS:
            self._packed.append(zstandard.compress(b"".join(self._open)))
            self._open.clear()

    def __iter__(self) -> Iterator[bytes]:
        for packed in self._packed:
            records, at = zstandard.decompress(packed), 0
            while at < len(records):
                end = at + _RECORD.size + _RECORD.unpack_from(records, at)[1]
                yield records[at:end]
                at = end
        yield from self._open


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class _Chunk:
    """The open chunk: its records, and for each channel the log times and positions of its messages in turn."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self.entries: dict[int, list[int]] = defaultdict(list)


class _Sink:
    """Buffer of the writer's output, written to the file by `flush`: all of it or nothing."""

    def __init__(self, path: Path, overwrite: bool):
        mode = os.O_TRUNC if overwrite else os.O_EXCL
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | mode | getattr(os, "O_BINARY", 0), 0o666)
        self._pending: list[bytes] = []
        self.position = 0
        self.stored = 0

    def write(self, data: bytes) -> None:
        self._pending.append(data)
        self.position += len(data)

    def flush(self) -> None:
        data = memoryview(b"".join(self._pending))
        self._pending.clear()
        try:
            done = 0
            while done < len(data):
                done += os.write(self._fd, data[done:])
        except OSError:
            with contextlib.suppress(OSError):  # a partial record costs no more than a line in the reader's report
                os.ftruncate(self._fd, self.stored)
                os.lseek(self._fd, self.stored, os.SEEK_SET)
            raise
        self.stored += len(data)

    def sync(self) -> None:
        os.fsync(self._fd)

    def close(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
