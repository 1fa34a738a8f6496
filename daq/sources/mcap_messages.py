"""Others' MCAP logs: Protobuf, ROS 2 (CDR) and JSON messages; every number in a message is a name ``topic.field``."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from lacet.daq.parts import from_part
from lacet.daq.sources.source import PIECE_SAMPLES, Listed, Piece, Reading, Series, Source, fault, read_by_library

_PROBED = 5
"""Messages of a topic whose fields are listed."""
_MOST_ELEMENTS = 16
"""Longest array of a message whose elements become names."""


class McapMessages(Source):
    """A log of messages. Times are those of the header that ROS messages carry, otherwise of the logging."""

    def __init__(self, path: Path, reading: Reading):
        super().__init__(path)
        with read_by_library(path, "as MCAP"), path.open("rb") as stream:
            reader = _reader(stream)
            summary = reader.get_summary()
            channels = dict(summary.channels) if summary else {}
            counts = dict(summary.statistics.channel_message_counts) if summary and summary.statistics else {}
            self._total = max(1, sum(counts.values()))
            seen: dict[str, int] = {}
            for schema, channel, message in reader.iter_messages():
                if seen.get(channel.topic, 0) >= _PROBED:
                    if len(seen) == len({one.topic for one in channels.values()}):
                        break
                    continue
                seen[channel.topic] = seen.get(channel.topic, 0) + 1
                if self.start_ns is None:
                    self.start_ns = message.log_time
                decoded = self._decode(reader, schema, channel, message)
                for name, _ in _numbers(decoded, _topic(channel.topic)):
                    what = schema.name if schema else channel.message_encoding
                    self.listed.setdefault(name, Listed(name, "", counts.get(channel.id), what))
        if not self.listed:
            raise fault(path, *(self.notes or ["it holds no messages with numbers"]))

    def pieces(self, names: Collection[str]) -> Iterator[Piece]:
        """A bounded number of messages at a time."""
        wanted = {name.split(".", 1)[0] for name in names}
        rows: dict[str, list[tuple[float, dict[str, float]]]] = {}
        read, held = 0, 0
        with self.path.open("rb") as stream:
            reader = _reader(stream)
            with read_by_library(self.path, "as MCAP"):
                summary = reader.get_summary()
            topics = [c.topic for c in summary.channels.values()] if summary else None
            chosen = None if topics is None else [t for t in topics if _topic(t) in wanted]
            messages = reader.iter_messages(topics=chosen)
            while True:
                with read_by_library(self.path, f"behind message {read}"):
                    found = next(messages, None)
                if found is None:
                    break
                schema, channel, message = found
                decoded = self._decode(reader, schema, channel, message)
                stamp = _stamp(decoded)
                t = ((message.log_time if stamp is None else stamp) - (self.start_ns or 0)) / 1e9
                key = _topic(channel.topic)
                rows.setdefault(key, []).append((t, dict(_numbers(decoded, key))))
                read, held = read + 1, held + 1
                if held >= PIECE_SAMPLES:
                    self.done = read / self._total
                    yield _series(rows, names)
                    rows, held = {}, 0
        self.done = 1.0
        yield _series(rows, names)

    def _decode(self, reader: Any, schema: Any, channel: Any, message: Any) -> Any:
        decoder = _decoder(reader, schema, channel)
        if decoder is None:
            note = f"{channel.topic}: messages in {channel.message_encoding!r} are not read (protobuf, cdr, json are)"
            if note not in self.notes:
                self.notes.append(note)
            return None
        try:
            return decoder(message.data)
        except Exception as cause:  # the decoders raise exceptions of many kinds
            note = f"{channel.topic}: messages that cannot be decoded are left out: {cause}"
            if not any(one.startswith(f"{channel.topic}: messages that cannot") for one in self.notes):
                self.notes.append(note)
            return None


def _reader(stream: BinaryIO) -> Any:
    """A reader of messages that takes no record for longer than the file."""
    from mcap.reader import SeekingReader

    with from_part("logs"):
        from mcap_protobuf.decoder import DecoderFactory as Protobuf
        from mcap_ros2.decoder import DecoderFactory as Ros2

    size = os.fstat(stream.fileno()).st_size
    return SeekingReader(stream, decoder_factories=[Protobuf(), Ros2()], record_size_limit=size)


def _decoder(reader: Any, schema: Any, channel: Any) -> Callable[[bytes], Any] | None:
    if channel.message_encoding == "json":
        return json.loads
    for factory in reader._decoder_factories:
        found = factory.decoder_for(channel.message_encoding, schema)
        if found is not None:
            return found
    return None


def _topic(topic: str) -> str:
    """Topic as part of a name: ``/car/imu`` is ``car/imu``."""
    return topic.strip("/").replace(".", "/")


def _numbers(value: Any, before: str) -> Iterator[tuple[str, float]]:
    """Every number in a message with its path; times and headers apart."""
    if isinstance(value, bool | int | float | np.number):
        yield before, float(value)
    elif isinstance(value, dict):
        for key, one in value.items():
            if key not in ("header", "stamp"):
                yield from _numbers(one, f"{before}.{key}")
    elif isinstance(value, list | tuple | np.ndarray):
        if len(value) <= _MOST_ELEMENTS:
            for at, one in enumerate(value):
                yield from _numbers(one, f"{before}.{at}")
    elif hasattr(value, "DESCRIPTOR"):
        for entry in value.DESCRIPTOR.fields:
            if entry.message_type is not None and entry.message_type.full_name == "google.protobuf.Timestamp":
                continue
            part = getattr(value, entry.name)
            yield from _numbers(list(part) if _repeated(entry) else part, f"{before}.{entry.name}")
    elif hasattr(value, "__slots__"):
        for key in value.__slots__:
            if key.strip("_") not in ("header", "stamp"):
                yield from _numbers(getattr(value, key), f"{before}.{key.strip('_')}")


def _repeated(entry: Any) -> bool:
    return bool(entry.is_repeated) if hasattr(entry, "is_repeated") else entry.label == 3


def _stamp(value: Any) -> int | None:
    """Time in a message's header [ns since the Unix epoch], None where it has none."""
    header = value.get("header") if isinstance(value, dict) else getattr(value, "header", None)
    stamp = header.get("stamp") if isinstance(header, dict) else getattr(header, "stamp", None)
    descriptor: Any = getattr(value, "DESCRIPTOR", None)
    if stamp is None and descriptor is not None:
        for entry in descriptor.fields:
            if entry.message_type is not None and entry.message_type.full_name == "google.protobuf.Timestamp":
                stamp = getattr(value, entry.name)
                break
    if stamp is None:
        return None
    read = stamp.get if isinstance(stamp, dict) else lambda key, other=None: getattr(stamp, key, other)
    seconds = next((read(key) for key in ("sec", "secs", "seconds") if read(key) is not None), None)
    parts = next((read(key) for key in ("nanosec", "nsec", "nanos") if read(key) is not None), 0)
    total = None if seconds is None else int(seconds) * 1_000_000_000 + int(parts or 0)
    return total or None


def _series(rows: dict[str, list[tuple[float, dict[str, float]]]], names: Collection[str]) -> Piece:
    out: dict[str, Series] = {}
    for topic, messages in rows.items():
        t = np.array([at for at, _ in messages])
        for name in names:
            if name.split(".", 1)[0] == topic:
                out[name] = Series(t, np.array([values.get(name, np.nan) for _, values in messages]))
    return out
