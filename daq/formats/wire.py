"""Serialization of the records of logs and of the bus as protobuf messages of ``daq/schema/lacet.proto``.

The arrays of a message are packed fields of fixed width, whose encoding is the little-endian array itself (protobuf
encoding, "packed repeated fields"). They are therefore appended unchanged to the message's other fields: the same bytes
as ``extend`` would give, in another order of fields, 50 times faster. Parsing uses protobuf.

Serialization is deterministic (maps are sorted).
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import LacetError
from lacet.daq.frames import Frames
from lacet.daq.schema import lacet_pb2 as pb

FORMAT = "lacet-log 1"
"""Format name in a start record."""

Losses = Mapping[str, Mapping[str, int]]
"""Numbers of samples or frames lost: source → cause → number."""


class WireError(LacetError):
    """Bytes that are no valid message of the expected kind, or of a version not supported; the text has the reason."""


@dataclass(frozen=True)
class StartRecord:
    """Start record of a run: when and under what conditions it began.

    Attributes
    ----------
    run_id : unique name of the run.
    started_ns : time of the start [ns since the Unix epoch].
    vehicle_text, rig_text : full texts of the vehicle and the rig file.
    documents : file name → full text of each file that a driver used (DBC …).
    vehicle, manoeuvre : names.
    wheel_reference : ``contact`` or ``hub``.
    brakes : ``off``, ``used`` or ``unknown``.
    software : name and version of the recording software.
    extra : further settings by name (zeroing, filters …).
    """

    run_id: str
    started_ns: int
    vehicle_text: str = ""
    rig_text: str = ""
    documents: Mapping[str, str] = field(default_factory=dict)
    vehicle: str = ""
    manoeuvre: str = ""
    wheel_reference: str = "contact"
    brakes: str = "unknown"
    notes: str = ""
    software: str = ""
    extra: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class StopRecord:
    """Stop record of a run: when and why it ended, with counts and losses.

    Attributes
    ----------
    stopped_ns : time of the end [ns since the Unix epoch].
    reason : ``stopped``, ``end of input``, or the fault.
    counts : channel or source → samples or frames.
    losses : source → cause → number lost.
    """

    stopped_ns: int
    reason: str
    counts: Mapping[str, int] = field(default_factory=dict)
    losses: Losses = field(default_factory=dict)


@dataclass(frozen=True)
class Tally:
    """Number and checksum of the messages of one channel or source.

    Attributes
    ----------
    messages : blocks or frame batches, numbered 0 … messages − 1.
    samples : samples or frames.
    checksum : CRC-32 over the messages' bytes, in sequence.
    """

    messages: int = 0
    samples: int = 0
    checksum: int = 0

    def add(self, message: bytes, samples: int) -> Tally:
        """The tally with one more message."""
        return Tally(self.messages + 1, self.samples + samples, zlib.crc32(message, self.checksum))

    @property
    def last_sequence(self) -> int:
        """Sequence number of the last message, −1 when there is none."""
        return self.messages - 1


@dataclass(frozen=True)
class Manifest:
    """Number and checksum of all messages of a log or a sender, by which a receiver checks completeness."""

    run_id: str
    channels: Mapping[str, Tally] = field(default_factory=dict)
    sources: Mapping[str, Tally] = field(default_factory=dict)
    losses: Losses = field(default_factory=dict)


@dataclass(frozen=True)
class Document:
    """A JSON text on the bus of a `kind` (``ack``, ``fit`` …)."""

    kind: str
    run_id: str
    json: str
    sequence: int = 0


def frames_to_bytes(frames: Frames, sequence: int) -> bytes:
    """The `RawFrames` message of a batch."""
    head = pb.RawFrames(source=frames.source, sequence=sequence, first_ns=_first(frames.t_ns))
    return b"".join(
        (
            _serialize(head),
            *_packed(4, _delta(frames.t_ns), "<i8"),
            *_packed(5, frames.ident, "<u4"),
            *_packed(6, frames.lengths, "<u4"),
            *_packed(7, frames.data[frames.offset[0] : frames.offset[-1]], "u1"),
        )
    )


def frames_from_bytes(data: bytes) -> tuple[Frames, int]:
    """The batch of a `RawFrames` message and its sequence number.

    Raises
    ------
    WireError : not such a message, or one whose parts do not fit together.
    """
    message = _parse(pb.RawFrames, data)
    t_ns = _stamps(message.first_ns, message.delta_ns)
    lengths = np.asarray(message.length, np.int64)
    offset = np.concatenate((np.zeros(1, np.int64), np.cumsum(lengths)))
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
    channel = CHANNELS[block.channel]
    head = pb.DecodedBlock(
        channel=block.channel,
        sequence=sequence,
        unit=channel.unit,
        axes=axes or channel.axes,
        first_ns=_first(block.t_ns),
        flags=block.flags.astype("u1").tobytes(),
    )
    device: tuple[bytes, ...] = ()
    if block.device_ns is not None:
        head.device_first_ns = _first(block.device_ns)
        device = _packed(10, _delta(block.device_ns), "<i8")
    parts = [_serialize(head), *_packed(6, _delta(block.t_ns), "<i8")]
    for name, column in zip(channel.components or ("value",), block.values.T, strict=True):
        component = _serialize(pb.DecodedBlock.Component(name=name)) + b"".join(_packed(2, column, "<f8"))
        parts += [_key(7), _varint(len(component)), component]
    return b"".join((*parts, *device))


def block_from_bytes(data: bytes) -> tuple[Block, int]:
    """The block of a `DecodedBlock` message and its sequence number.

    Raises
    ------
    WireError : not such a message, one whose parts do not fit together, or a channel unknown to this version.
    """
    message = _parse(pb.DecodedBlock, data)
    channel = CHANNELS.get(message.channel)
    if channel is None:
        raise WireError(f"channel {message.channel!r} is not in this version's vocabulary")
    names = tuple(component.name for component in message.component)
    if names != (channel.components or ("value",)):
        raise WireError(f"{message.channel}: components {names}, expected {channel.components or ('value',)}")
    if message.unit != channel.unit:
        raise WireError(f"{message.channel}: in {message.unit!r}, expected {channel.unit!r}")
    device = None
    if message.HasField("device_first_ns"):
        device = _stamps(message.device_first_ns, message.device_delta_ns)
    try:
        values = np.stack([np.asarray(component.value, np.float64) for component in message.component], axis=1)
        block = Block(
            message.channel,
            _stamps(message.first_ns, message.delta_ns),
            values,
            np.frombuffer(message.flags, np.uint8),
            device,
        )
    except ValueError as error:
        raise WireError(str(error)) from error
    return block, message.sequence


def start_to_bytes(record: StartRecord) -> bytes:
    """The `StartRecord` message of a record."""
    fields = {**vars(record), "documents": dict(record.documents), "extra": dict(record.extra)}
    return _serialize(pb.StartRecord(format=FORMAT, **fields))


def start_from_bytes(data: bytes) -> StartRecord:
    """The record of a `StartRecord` message. Raises WireError when it is none."""
    message = _parse(pb.StartRecord, data)
    if message.format != FORMAT:
        raise WireError(f"format {message.format!r}, this version reads {FORMAT!r}")
    return StartRecord(
        message.run_id,
        message.started_ns,
        message.vehicle_text,
        message.rig_text,
        dict(message.documents),
        message.vehicle,
        message.manoeuvre,
        message.wheel_reference,
        message.brakes,
        message.notes,
        message.software,
        dict(message.extra),
    )


def stop_to_bytes(record: StopRecord) -> bytes:
    """The `StopRecord` message of a record."""
    message = pb.StopRecord(stopped_ns=record.stopped_ns, reason=record.reason, counts=dict(record.counts))
    _put_losses(message.losses, record.losses)
    return _serialize(message)


def stop_from_bytes(data: bytes) -> StopRecord:
    """The record of a `StopRecord` message. Raises WireError when it is none."""
    message = _parse(pb.StopRecord, data)
    return StopRecord(message.stopped_ns, message.reason, dict(message.counts), _get_losses(message.losses))


def manifest_to_bytes(manifest: Manifest) -> bytes:
    """The `Manifest` message of a manifest."""
    message = pb.Manifest(run_id=manifest.run_id)
    for entries, tallies in ((message.channel, manifest.channels), (message.source, manifest.sources)):
        for name, tally in sorted(tallies.items()):
            entries.add(name=name, messages=tally.messages, samples=tally.samples, checksum=tally.checksum)
    _put_losses(message.losses, manifest.losses)
    return _serialize(message)


def manifest_from_bytes(data: bytes) -> Manifest:
    """The manifest of a `Manifest` message. Raises WireError when it is none."""
    message = _parse(pb.Manifest, data)
    channels, sources = (
        {entry.name: Tally(entry.messages, entry.samples, entry.checksum) for entry in entries}
        for entries in (message.channel, message.source)
    )
    return Manifest(message.run_id, channels, sources, _get_losses(message.losses))


def document_to_bytes(document: Document) -> bytes:
    """The `Document` message of a document."""
    return _serialize(pb.Document(**vars(document)))


def document_from_bytes(data: bytes) -> Document:
    """The document of a `Document` message. Raises WireError when it is none."""
    message = _parse(pb.Document, data)
    return Document(message.kind, message.run_id, message.json, message.sequence)


def _first(t_ns: NDArray[np.int64]) -> int:
    return int(t_ns[0]) if len(t_ns) else 0


def _delta(t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.diff(t_ns, prepend=t_ns[:1])


def _stamps(first: int, delta: Any) -> NDArray[np.int64]:
    return first + np.cumsum(np.asarray(delta, np.int64), dtype=np.int64)


def _packed(number: int, array: NDArray[Any], dtype: str) -> tuple[bytes, ...]:
    """Key, length and bytes of field `number`; empty for no elements."""
    data = array.astype(dtype).tobytes()
    return (_key(number), _varint(len(data)), data) if data else ()


def _key(number: int) -> bytes:
    return bytes([number << 3 | 2])  # 2: length-delimited; enough for numbers up to 15


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _serialize(message: Any) -> bytes:
    return message.SerializeToString(deterministic=True)


def _parse(kind: Any, data: bytes) -> Any:
    try:
        return kind.FromString(data)
    except DecodeError as error:
        raise WireError(f"not a {kind.__name__} message ({len(data)} bytes)") from error


def _put_losses(target: Any, losses: Losses) -> None:
    for source, causes in losses.items():
        target[source].cause.update(causes)


def _get_losses(message: Any) -> dict[str, dict[str, int]]:
    return {source: dict(losses.cause) for source, losses in message.items()}
