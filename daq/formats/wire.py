"""Serialization of the records of logs and of the bus as protobuf messages of ``daq/schema/lacet.proto``.

Frames and blocks, which are arrays, are in `formats.array_messages` and offered here too. Serialization is
deterministic (maps are sorted).
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lacet.daq.formats.array_messages import (
    WireError,
    block_from_bytes,
    block_to_bytes,
    frames_from_bytes,
    frames_to_bytes,
    parse,
    serialize,
)
from lacet.daq.schema import lacet_pb2 as pb

__all__ = [
    "Document", "Losses", "Manifest", "StartRecord", "StopRecord", "Tally", "WireError",
    "block_from_bytes", "block_to_bytes", "document_from_bytes", "document_to_bytes", "frames_from_bytes",
    "frames_to_bytes", "manifest_from_bytes", "manifest_to_bytes", "start_from_bytes", "start_to_bytes",
    "stop_from_bytes", "stop_to_bytes",
]  # fmt: skip

FORMAT = "lacet-log 1"
"""Format name in a start record."""

Losses = Mapping[str, Mapping[str, int]]
"""Numbers of samples or frames lost: source → cause → number."""


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


def start_to_bytes(record: StartRecord) -> bytes:
    """The `StartRecord` message of a record."""
    fields: dict[str, Any] = {**vars(record), "documents": dict(record.documents), "extra": dict(record.extra)}
    return serialize(pb.StartRecord(format=FORMAT, **fields))


def start_from_bytes(data: bytes) -> StartRecord:
    """The record of a `StartRecord` message. Raises WireError when it is none."""
    message = parse(pb.StartRecord, data)
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
    return serialize(message)


def stop_from_bytes(data: bytes) -> StopRecord:
    """The record of a `StopRecord` message. Raises WireError when it is none."""
    message = parse(pb.StopRecord, data)
    return StopRecord(message.stopped_ns, message.reason, dict(message.counts), _get_losses(message.losses))


def manifest_to_bytes(manifest: Manifest) -> bytes:
    """The `Manifest` message of a manifest."""
    message = pb.Manifest(run_id=manifest.run_id)
    for entries, tallies in ((message.channel, manifest.channels), (message.source, manifest.sources)):
        for name, tally in sorted(tallies.items()):
            entries.add(name=name, messages=tally.messages, samples=tally.samples, checksum=tally.checksum)
    _put_losses(message.losses, manifest.losses)
    return serialize(message)


def manifest_from_bytes(data: bytes) -> Manifest:
    """The manifest of a `Manifest` message. Raises WireError when it is none."""
    message = parse(pb.Manifest, data)
    channels, sources = (
        {entry.name: Tally(entry.messages, entry.samples, entry.checksum) for entry in entries}
        for entries in (message.channel, message.source)
    )
    return Manifest(message.run_id, channels, sources, _get_losses(message.losses))


def document_to_bytes(document: Document) -> bytes:
    """The `Document` message of a document."""
    return serialize(pb.Document(**vars(document)))


def document_from_bytes(data: bytes) -> Document:
    """The document of a `Document` message. Raises WireError when it is none."""
    message = parse(pb.Document, data)
    return Document(message.kind, message.run_id, message.json, message.sequence)


def _put_losses(target: Any, losses: Losses) -> None:
    for source, causes in losses.items():
        target[source].cause.update(causes)


def _get_losses(message: Any) -> dict[str, dict[str, int]]:
    return {source: dict(losses.cause) for source, losses in message.items()}
