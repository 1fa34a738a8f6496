"""Records of MCAP files that may be damaged: recognition of records, contents of chunks, position of the next chunk.

Format: https://mcap.dev/spec. Definitions are interpreted by the `mcap` library.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

HEAD = struct.Struct("<BQ")  # opcode, length
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CHUNK = struct.Struct("<QQQI")  # first log time, last log time, uncompressed size, its CRC
_MARKS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")  # the compression of a chunk, as the record holds it
_LARGEST = 1 << 30  # bytes; a record that claims more is damage
_SIZE4, _SIZE8 = struct.Struct("<I"), struct.Struct("<Q")
_WINDOW = 1 << 20
_KNOWN = {int(code) for code in Opcode}
READERS = {Opcode.SCHEMA: Schema.read, Opcode.CHANNEL: Channel.read, Opcode.METADATA: Metadata.read}
BROKEN = (McapError, struct.error, UnicodeDecodeError, ValueError)


def plausible(head: bytes) -> bool:
    """Whether bytes can be the head of a record. Opcodes from 0x80 are private extensions and are skipped."""
    if len(head) < HEAD.size:
        return False
    opcode, length = HEAD.unpack(head)
    return (opcode in _KNOWN or opcode >= 0x80) and length <= _LARGEST


def followed(file: BinaryIO, opcode: int, position: int, end: int) -> bool:
    """Whether the length in a record's head can be right: a wrong one would skip good chunks."""
    if opcode == Opcode.CHUNK and _chunk_end(file, position) != end:
        return False
    file.seek(end)
    head = file.read(HEAD.size)
    return len(head) < HEAD.size or plausible(head)


def _chunk_end(file: BinaryIO, position: int) -> int:
    """End of a chunk record by the sizes inside it."""
    begin = position + HEAD.size + CHUNK.size
    file.seek(begin)
    name = int.from_bytes(file.read(4), "little")
    file.seek(begin + 4 + name)
    return begin + 4 + name + 8 + int.from_bytes(file.read(8), "little")


def parse_definition(opcode: int, data: bytes) -> Schema | Channel | Metadata:
    """The definition in a record's contents; one of `BROKEN` when there is none."""
    return READERS[Opcode(opcode)](ReadDataStream(BytesIO(data)))


def chunk_contents(data: bytes) -> bytes:
    """Contents of a chunk record, decompressed; ValueError when it is damaged."""
    _, _, size, crc = CHUNK.unpack_from(data)
    at = CHUNK.size + 4
    (name,) = _SIZE4.unpack_from(data, at - 4)
    compression = str(data[at : at + name], "utf-8")
    (packed,) = _SIZE8.unpack_from(data, at + name)
    rest = data[at + name + 8 : at + name + 8 + packed]
    if size > _LARGEST:
        raise ValueError(f"claims {size} bytes")
    try:
        if compression == "zstd":
            if zstandard.get_frame_parameters(rest).content_size != size:
                raise ValueError("its size is not what it claims")
            contents = zstandard.ZstdDecompressor().decompress(rest)
        elif compression == "lz4":
            contents = lz4.frame.decompress(rest)
        elif not compression:
            contents = rest
        else:
            raise ValueError(f"compression {compression!r} is not known")
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise ValueError("cannot be decompressed") from error
    if crc and zlib.crc32(contents) != crc:
        raise ValueError("wrong CRC")
    if len(contents) != size:
        raise ValueError("its size is not what it claims")
    return contents


def _records(contents: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of the contents of each record in a chunk."""
    position, size = 0, len(contents)
    while position < size:
        opcode, length = HEAD.unpack_from(contents, position)
        begin = position + HEAD.size
        position = begin + length
        if position > size:
            raise ValueError("its records do not fit in it")
        yield opcode, begin, position


def messages_in(contents: bytes) -> Iterator[tuple[int, int, int, int, int, int]]:
    """Channel, sequence, log time, publish time, begin and end of each message in a segment."""
    for opcode, begin, end in _records(contents):
        if opcode == Opcode.MESSAGE:
            yield *MESSAGE.unpack_from(contents, begin), begin + MESSAGE.size, end


def inside(contents: bytes) -> tuple[list[tuple[int, int, int]], list[Schema | Channel | Metadata]]:
    """Messages (channel, sequence, log time) and definitions in a chunk."""
    messages: list[tuple[int, int, int]] = []
    definitions: list[Schema | Channel | Metadata] = []
    for opcode, begin, end in _records(contents):
        if opcode == Opcode.MESSAGE:
            messages.append(MESSAGE.unpack_from(contents, begin)[:3])
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            definitions.append(parse_definition(opcode, contents[begin:end]))
    return messages, definitions


def next_chunk(file: BinaryIO, position: int, size: int) -> int:
    """Position of the next complete compressed chunk record at or after `position`, −1 when there is none."""
    before = HEAD.size + CHUNK.size
    start = position
    while start < size:
        file.seek(start)
        window = file.read(_WINDOW + 64)
        hits = sorted(hit for mark in _MARKS for hit in _find_all(window, mark))
        for hit in hits:
            if hit < before:
                continue
            opcode, length = HEAD.unpack_from(window, hit - before)
            mark = 4 + window[hit]
            tail = window[hit + mark : hit + mark + 8]
            fits = len(tail) == 8 and length == CHUNK.size + mark + 8 + int.from_bytes(tail, "little")
            found = start + hit - before
            if opcode == Opcode.CHUNK and fits and found + HEAD.size + length <= size:
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
