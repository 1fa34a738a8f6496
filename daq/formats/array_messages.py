"""Batches of frames and blocks of samples as protobuf messages, many at once.

The arrays of a message are packed fields of fixed width, whose encoding is the little-endian array itself (protobuf
encoding, "packed repeated fields"). Messages are therefore joined from slices of the arrays' own bytes: the same bytes
as ``extend`` would give, in another order of fields, 50 times faster. Parsing uses protobuf.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from itertools import chain, pairwise
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import LacetError
from lacet.daq.frames import Frames
from lacet.daq.schema import lacet_pb2 as pb

EARLIEST_NS, LATEST_NS = -(1 << 61), 1 << 62
"""Range of stamps [ns]: device clocks that began 73 years ago, and the year 2116. Differences fit in 64 bits."""
_FIXED = struct.Struct("<Bq")  # key and value of a field of 8 bytes


class WireError(LacetError):
    """Bytes that are no valid message of the expected kind, or of a version not supported; the text has the reason."""


def serialize(message: Any) -> bytes:
    """The bytes of a protobuf message, maps sorted."""
    return message.SerializeToString(deterministic=True)


def parse(kind: Any, data: bytes) -> Any:
    """The protobuf message of a class. Raises WireError when the bytes are none."""
    try:
        return kind.FromString(data)
    except DecodeError as error:
        raise WireError(f"not a {kind.__name__} message ({len(data)} bytes)") from error


def frames_to_bytes(frames: Frames, sequence: int) -> bytes:
    """The `RawFrames` message of a batch."""
    return frames_to_messages(frames, (0, len(frames)), sequence)[0]


def frames_to_messages(frames: Frames, edges: Sequence[int], sequence: int) -> list[bytes]:
    """The `RawFrames` messages of the stretches of a batch between `edges`, numbered from `sequence` on."""
    source = serialize(pb.RawFrames(source=frames.source))
    steps, first = _stamps_out(frames.t_ns, edges)
    ident, lengths = _view(frames.ident, "<u4"), _view(frames.lengths, "<u4")
    data = _view(frames.data[frames.offset[0] : frames.offset[-1]], "u1")
    at = (frames.offset[np.asarray(edges)] - frames.offset[0]).tolist()
    out = []
    for i, (a, b) in enumerate(pairwise(edges)):
        four, eight = _head(5, 4 * (b - a)), _head(4, 8 * (b - a))
        parts = (
            source, _count(2, sequence + i), _stamp(3, first[i]),
            eight, steps[8 * a : 8 * b], four, ident[4 * a : 4 * b], _head(6, 4 * (b - a)), lengths[4 * a : 4 * b],
            _head(7, at[i + 1] - at[i]), data[at[i] : at[i + 1]],
        )  # fmt: skip
        out.append(b"".join(parts))
    return out


def frames_from_bytes(data: bytes) -> tuple[Frames, int]:
    """The batch of a `RawFrames` message and its sequence number.

    Raises
    ------
    WireError : not such a message, or one whose parts do not fit together.
    """
    message = parse(pb.RawFrames, data)
    t_ns = _stamps_in([message.first_ns], [message.delta_ns], [len(message.delta_ns)])
    lengths = np.asarray(message.length, np.int64)
    offset = np.zeros(len(lengths) + 1, np.int64)
    np.cumsum(lengths, out=offset[1:])
    ident = np.asarray(message.ident, np.uint32)
    payload = np.frombuffer(message.data, np.uint8)
    if not (len(t_ns) == len(ident) == len(lengths) and offset[-1] == len(payload)):
        raise WireError(
            f"frames of {message.source!r}: {len(t_ns)} stamps, {len(ident)} ids, {len(lengths)} lengths of "
            f"{offset[-1]} bytes in all, {len(payload)} bytes"
        )
    return Frames(message.source, t_ns, ident, offset, payload), message.sequence


def block_to_bytes(block: Block, sequence: int, axes: str | None = None) -> bytes:
    """The `DecodedBlock` message of a block; `axes` when the rig file declares others than the vocabulary."""
    return block_to_messages(block, (0, len(block)), sequence, axes)[0]


def block_to_messages(block: Block, edges: Sequence[int], sequence: int, axes: str | None = None) -> list[bytes]:
    """The `DecodedBlock` messages of the stretches of a block between `edges`, numbered from `sequence` on."""
    channel, unit, names = _constants(block.channel, axes)
    steps, first = _stamps_out(block.t_ns, edges)
    flags = _view(block.flags, "u1")
    columns = [_view(block.values[:, j], "<f8") for j in range(len(names))]
    device, device_first = (b"", []) if block.device_ns is None else _stamps_out(block.device_ns, edges)
    out = []
    for i, (a, b) in enumerate(pairwise(edges)):
        begin, end = 8 * a, 8 * b
        parts = [channel, _count(2, sequence + i), unit, _stamp(5, first[i]), _head(8, b - a), flags[a:b]]
        if device_first:
            parts.append(_FIXED.pack(73, device_first[i]))
        parts += (_head(6, end - begin), steps[begin:end])
        for name, column in zip(names, columns, strict=True):
            parts += (_component_head(name, end - begin), column[begin:end])
        if device_first:
            parts += (_head(10, end - begin), device[begin:end])
        out.append(b"".join(parts))
    return out


def block_from_bytes(data: bytes) -> tuple[Block, int]:
    """The block of a `DecodedBlock` message and its sequence number.

    Raises
    ------
    WireError : not such a message, one whose parts do not fit together, or a channel unknown to this version.
    """
    message = parse(pb.DecodedBlock, data)
    return _joined([message]), message.sequence


def samples_in(kind: type[pb.RawFrames] | type[pb.DecodedBlock], data: bytes) -> int:
    """Number of frames or samples in a message, without decoding the rest. Raises WireError when it is none."""
    message = parse(kind, data)
    return len(message.length) if isinstance(message, pb.RawFrames) else len(message.flags)


def joined_block(data: Sequence[bytes]) -> Block:
    """The samples of several `DecodedBlock` messages of one channel, in the order given.

    Raises WireError as `block_from_bytes` where any of them cannot be used, or their channels differ.
    """
    return _joined([parse(pb.DecodedBlock, one) for one in data])


def _joined(messages: Sequence[Any]) -> Block:
    first = messages[0]
    channel = CHANNELS.get(first.channel)
    if channel is None:
        raise WireError(f"channel {first.channel!r} is not in this version's vocabulary")
    names = channel.components or ("value",)
    for message in messages:
        if message.channel != first.channel:
            raise WireError(f"a message of {message.channel!r} among those of {first.channel!r}")
        if (found := tuple([component.name for component in message.component])) != names:
            raise WireError(f"{message.channel}: components {found}, expected {names}")
        if message.unit != channel.unit:
            raise WireError(f"{message.channel}: in {message.unit!r}, expected {channel.unit!r}")
    sizes = [len(message.flags) for message in messages]
    columns = [[message.component[k].value for message in messages] for k in range(len(names))]
    steps = [message.delta_ns for message in messages]
    with_device = all(message.HasField("device_first_ns") for message in messages)
    device_steps = [message.device_delta_ns for message in messages] if with_device else []
    for parts in (steps, *columns, *([device_steps] if with_device else [])):
        if (lengths := list(map(len, parts))) != sizes:
            raise WireError(f"{first.channel}: arrays of {lengths} and {sizes} samples in one message")
    device = None
    if with_device:
        device = _stamps_in([message.device_first_ns for message in messages], device_steps, sizes)
    return Block(
        first.channel,
        _stamps_in([message.first_ns for message in messages], steps, sizes),
        np.stack([np.fromiter(chain.from_iterable(column), np.float64, sum(sizes)) for column in columns], axis=1),
        np.frombuffer(b"".join([message.flags for message in messages]), np.uint8),
        device,
    )


def _stamps_in(first: Sequence[int], steps: Sequence[Sequence[int]], sizes: Sequence[int]) -> NDArray[np.int64]:
    """Stamps of several messages, one after the other, from the first stamp and the steps of each.

    Raises WireError for stamps so far apart that their differences are no numbers of 64 bits.
    """
    sums = np.cumsum(np.fromiter(chain.from_iterable(steps), np.int64, sum(sizes)), dtype=np.int64)
    before = np.concatenate((np.zeros(1, np.int64), sums))[np.cumsum([0, *sizes[:-1]])]
    stamps = sums + np.repeat(np.asarray(first, np.int64) - before, sizes)
    if len(stamps) and (int(stamps.min()) < EARLIEST_NS or int(stamps.max()) > LATEST_NS):
        raise WireError("stamps that are no times")
    return stamps


def _stamps_out(t_ns: NDArray[np.int64], edges: Sequence[int]) -> tuple[memoryview | bytes, list[int]]:
    """Bytes of the steps from stamp to stamp, the first of each stretch 0, and the first stamp of each (0 if empty)."""
    begins = np.asarray(edges[:-1], np.int64)
    filled = begins < np.asarray(edges[1:])
    first = np.zeros(len(begins), np.int64)
    first[filled] = t_ns[begins[filled]]
    steps = np.zeros(len(t_ns), np.int64)
    np.subtract(t_ns[1:], t_ns[:-1], out=steps[1:])
    steps[begins[filled]] = 0
    return _view(steps, "<i8"), first.tolist()


def _view(array: NDArray[Any], dtype: str) -> memoryview | bytes:
    """The bytes of an array of that type."""
    return np.ascontiguousarray(array, dtype).view(np.uint8).data if len(array) else b""


@lru_cache(4096)
def _head(number: int, size: int) -> bytes:
    """Key and length of a field of bytes; nothing for an empty one."""
    return bytes([number << 3 | 2]) + _varint(size) if size else b""  # 2: length-delimited; for numbers up to 15


@lru_cache(4096)
def _component_head(name: bytes, size: int) -> bytes:
    """Head and name of a component with an array of `size` bytes, up to the array."""
    array = _head(2, size)
    return b"".join((bytes([7 << 3 | 2]), _varint(len(name) + len(array) + size), name, array))


@lru_cache(1024)
def _constants(channel: str, axes: str | None) -> tuple[bytes, bytes, tuple[bytes, ...]]:
    """Fields of a channel's blocks that are always the same: name; unit and axes; names of components."""
    about = CHANNELS[channel]
    names = (serialize(pb.DecodedBlock.Component(name=name)) for name in about.components or ("value",))
    unit = serialize(pb.DecodedBlock(unit=about.unit, axes=axes or about.axes))
    return serialize(pb.DecodedBlock(channel=channel)), unit, tuple(names)


@lru_cache(4096)
def _count(number: int, value: int) -> bytes:
    return bytes([number << 3]) + _varint(value) if value else b""


def _stamp(number: int, value: int) -> bytes:
    return _FIXED.pack(number << 3 | 1, value) if value else b""


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
