"""The whole containers of a BLF log as a file for python-can's reader, which ends at the first one that is damaged."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

_HEAD = struct.Struct("<4sHHLL")
"""Begin of every object: ``LOBJ``, length of its header, version of that, its length [byte], its kind."""
_CONTAINER_HEAD = struct.Struct("<H6xL4x")
"""Behind it in a container: how it is packed (`_ZLIB` or 0), and its length when it is not [byte]."""
_MARK = b"LOBJ"
_CONTAINER, _ZLIB = 10, 2
_LONGEST_HEAD = 64
"""Length beyond which a header is none [byte]: those of all kinds have 32 or 40."""
_AT_A_TIME = 1 << 20
"""Bytes read, or unpacked to be checked, at a time."""


class _Part(NamedTuple):
    """Bytes `begin` to `end` of the file, read as they are, or, beside a damaged part, without cut objects there.

    `lost` : the damaged bytes before it, (begin, end); None for none.
    """

    begin: int
    end: int
    after: bool = False
    before: bool = False
    lost: tuple[int, int] | None = None


class WholeContainers(io.RawIOBase):
    """The file header and the whole containers of a BLF log, one after the other.

    `damage` : what was passed over so far, one sentence each. `reached` : time of the frame that was read last, from
    the first one on [s].
    """

    def __init__(self, path: Path, reached: Callable[[], float]) -> None:
        super().__init__()
        self._file = path.open("rb")
        self._size = path.stat().st_size
        self._reached = reached
        self._parts = iter(_parts(self._file, self._size))
        self._held = b""
        self.damage: list[str] = []

    def read(self, size: int = -1, /) -> bytes:
        """The next bytes, fewer only at the end."""
        while size < 0 or len(self._held) < size:
            part = next(self._parts, None)
            if part is None:
                break
            if part.lost:
                begin, end = part.lost
                self.damage.append(
                    f"bytes {begin:,} to {end:,} of {self._size:,} cannot be read, after {self._reached():.2f} s: "
                    "the frames in them are missing"
                )
            self._held += _content(self._file, part)
        out, self._held = (self._held, b"") if size < 0 else (self._held[:size], self._held[size:])
        return out

    def close(self) -> None:
        self._file.close()
        super().close()


def _parts(file: BinaryIO, size: int) -> list[_Part]:
    """The whole parts of a BLF log, from its header on."""
    file.seek(0)
    begin = file.read(8)
    at = struct.unpack("<4xL", begin)[0] if len(begin) == 8 else size
    out = [_Part(0, min(at, size))]
    lost: int | None = None
    while at < size:
        end = _whole(file, at, size)
        if end is None:
            lost = at if lost is None else lost
            found = _next_container(file, at + 1, size)
            if found is None:
                if _cut_short(file, lost, size):  # its reader takes what is whole of the container
                    return [*out, _Part(lost, size)]
                out[-1] = out[-1]._replace(before=len(out) > 1)
                return [*out, _Part(size, size, lost=(lost, size))]
            at = found
        elif lost is None:
            out.append(_Part(at, end))
            at = end
        else:
            out[-1] = out[-1]._replace(before=len(out) > 1)
            out.append(_Part(at, end, after=True, lost=(lost, at)))
            lost, at = None, end
    return out


def _whole(file: BinaryIO, at: int, size: int) -> int | None:
    """End of the object at a place, with its padding; None where it is damaged or not whole."""
    file.seek(at)
    head = file.read(_HEAD.size + _CONTAINER_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    mark, _, _, length, kind = _HEAD.unpack_from(head)
    if mark != _MARK or not _HEAD.size <= length <= size - at:
        return None
    if kind == _CONTAINER:
        if length < len(head) or len(head) < _HEAD.size + _CONTAINER_HEAD.size:
            return None
        if _CONTAINER_HEAD.unpack_from(head, _HEAD.size)[0] == _ZLIB and not _unpacks(file, length - len(head)):
            return None
    return min(size, at + length + length % 4)


def _cut_short(file: BinaryIO, at: int, size: int) -> bool:
    """Whether the object at a place is a container that goes on behind the end of the file."""
    file.seek(at)
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return True
    mark, _, _, length, kind = _HEAD.unpack(head)
    return mark == _MARK and kind == _CONTAINER and length > size - at


def _unpacks(file: BinaryIO, length: int) -> bool:
    """Whether so many bytes of the file from here on are one whole zlib stream."""
    unpacker = zlib.decompressobj()
    try:
        while length > 0 and not unpacker.eof:
            packed = file.read(min(length, _AT_A_TIME))
            if not packed:
                return False
            length -= len(packed)
            while packed and not unpacker.eof:
                unpacker.decompress(packed, _AT_A_TIME)
                packed = unpacker.unconsumed_tail
    except zlib.error:
        return False
    return unpacker.eof


def _next_container(file: BinaryIO, at: int, size: int) -> int | None:
    """Place of the next whole container; None for none."""
    while at < size:
        file.seek(at)
        read = file.read(_AT_A_TIME)
        found = read.find(_MARK)
        while found >= 0:
            file.seek(at + found)
            head = file.read(_HEAD.size)
            if len(head) == _HEAD.size and _HEAD.unpack(head)[4] == _CONTAINER and _whole(file, at + found, size):
                return at + found
            found = read.find(_MARK, found + 1)
        at += max(1, len(read) - len(_MARK) + 1)
    return None


def _content(file: BinaryIO, part: _Part) -> bytes:
    """The bytes of a part as its reader gets them."""
    file.seek(part.begin)
    content = file.read(part.end - part.begin)
    if not (part.after or part.before) or _HEAD.unpack_from(content)[4] != _CONTAINER:
        return content
    length = _HEAD.unpack_from(content)[3]
    packing, _ = _CONTAINER_HEAD.unpack_from(content, _HEAD.size)
    objects = content[_HEAD.size + _CONTAINER_HEAD.size : length]
    objects = zlib.decompressobj().decompress(objects) if packing == _ZLIB else objects
    if part.after:
        objects = objects[next((at for at in _heads(objects) if _followed(objects, at)), len(objects)) :]
    if part.before:
        last = max(_heads(objects), default=0)
        if last + _HEAD.size > len(objects) or last + _HEAD.unpack_from(objects, last)[3] > len(objects):
            objects = objects[:last]
    length = _HEAD.size + _CONTAINER_HEAD.size + len(objects)
    head = _HEAD.pack(_MARK, _HEAD.size, 1, length, _CONTAINER) + _CONTAINER_HEAD.pack(0, len(objects))
    return head + objects + bytes(length % 4)


def _heads(objects: bytes) -> Iterator[int]:
    """Places at which an object may begin."""
    at = objects.find(_MARK)
    while at >= 0:
        if at + _HEAD.size > len(objects):
            yield at
        else:
            _, head, version, length, _ = _HEAD.unpack_from(objects, at)
            if _HEAD.size <= head <= min(length, _LONGEST_HEAD) and version in (1, 2):
                yield at
        at = objects.find(_MARK, at + 1)


def _followed(objects: bytes, at: int) -> bool:
    """Whether another object, or the end, is behind the one at a place."""
    if at + _HEAD.size > len(objects):
        return True
    end = at + _HEAD.unpack_from(objects, at)[3]
    return end >= len(objects) or _MARK in objects[end : end + 8]
