"""Writer of MCAP files in which a failing disk or a lost chunk damages no other chunk."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer

from lacet.daq.topics import PROFILE

_NEVER = 1 << 62  # chunks are closed by flush() alone
PROTOBUF = "protobuf"


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
        # The sink has the three methods that the writer uses of a stream.
        self._writer = Writer(self._sink, chunk_size=_NEVER, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
        self._writer.start(PROFILE, library="lacet")
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[str, int] = {}

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
        self._writer.add_metadata(name, dict(texts))

    def flush(self) -> None:
        """End the chunk and pass everything to the operating system."""
        self._writer.flush()

    def sync(self) -> None:
        """Force the operating system to write to the medium."""
        self._sink.sync()

    def finish(self) -> None:
        """Write the index and the footer."""
        self._writer.finish()
        self._sink.flush()

    def abandon(self) -> None:
        """Close the file without index and footer."""
        self._sink.close()

    def _add(self, topic: str, schema: Schema | None, encoding: str, metadata: dict[str, str]) -> None:
        ahead = RecordBuilder()
        schema_id = 0
        if schema is not None:
            key = (schema.name, schema.encoding, schema.data)
            if key not in self._schemas:
                self._schemas[key] = self._writer.register_schema(*key)
                Schema(self._schemas[key], schema.data, schema.encoding, schema.name).write(ahead)
            schema_id = self._schemas[key]
        channel_id = self._writer.register_channel(topic, encoding, schema_id, metadata)
        Channel(channel_id, topic, encoding, metadata, schema_id).write(ahead)
        self._channels[topic] = channel_id
        self._sink.write(ahead.end())  # the writer buffers nothing outside its open chunk, so order is kept

    def _message(self, topic: str, data: bytes, log_ns: int, publish_ns: int, sequence: int) -> None:
        self._writer.add_message(self._channels[topic], log_ns, data, publish_ns, sequence & 0xFFFFFFFF)


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


class _Sink:
    """Buffer of the writer's output, written to the file by `flush`: all of it or nothing."""

    def __init__(self, path: Path, overwrite: bool):
        mode = os.O_TRUNC if overwrite else os.O_EXCL
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | mode | getattr(os, "O_BINARY", 0), 0o666)
        self._pending: list[bytes] = []
        self._position = 0
        self.stored = 0

    def write(self, data: bytes) -> int:
        self._pending.append(bytes(data))
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        return self._position

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
