"""Others' MCAP logs: Protobuf, ROS 2 (CDR) and JSON messages; every number in a message is a name ``topic.field``.

A ROS 2 bag is a folder of such files, one after the other.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from lacet.daq.parts import from_part
from lacet.daq.sources.ros_types import FieldMeaning, fields_of
from lacet.daq.sources.source import PIECE_SAMPLES, Listed, Piece, Reading, Series, Source, fault, read_by_library

SUFFIX = ".mcap"
_PROBED = 5
"""Messages of a topic whose fields are listed."""
_MOST_ELEMENTS = 16
"""Longest array of a message whose elements become names."""
_OF_JOINTS = ("position", "velocity", "effort")
"""Fields of a message of joints (JointState) with a value for each of the joints in its field `name`."""
_ARRAYS = (list, tuple, np.ndarray)


class McapMessages(Source):
    """A log of messages. Times are those of the header that ROS messages carry, otherwise of the logging."""

    def __init__(self, path: Path, reading: Reading):
        super().__init__(path)
        self._files = _in_order(path)
        self._total = 0
        seen: dict[str, int] = {}
        for file in self._files:
            self._list(file, seen)
        self._total = max(1, self._total)
        if not self.listed:
            raise fault(path, *(self.notes or ["it holds no messages with numbers"]))

    def _list(self, file: Path, seen: dict[str, int]) -> None:
        """Add a file's names, by the first messages of each topic; `seen` : topic → how many of its were looked at."""
        with read_by_library(file, "as MCAP"), file.open("rb") as stream:
            reader = _reader(stream)
            summary = reader.get_summary()
            channels = dict(summary.channels) if summary else {}
            counts = dict(summary.statistics.channel_message_counts) if summary and summary.statistics else {}
            self._total += sum(counts.values())
            topics = {one.topic for one in channels.values()}
            for schema, channel, message in reader.iter_messages():
                if self.start_ns is None:
                    self.start_ns = message.log_time
                if seen.get(channel.topic, 0) >= _PROBED:
                    if topics <= seen.keys():
                        break
                    continue
                seen[channel.topic] = seen.get(channel.topic, 0) + 1
                decoded = self._decode(reader, schema, channel, message)
                what = schema.name if schema else channel.message_encoding
                count = counts.get(channel.id) if len(self._files) == 1 else None
                for one in _numbers(decoded, _topic(channel.topic)):
                    self.listed.setdefault(one.name, one.listed(count, what))

    def pieces(self, names: Collection[str]) -> Iterator[Piece]:
        """A bounded number of messages at a time."""
        read = 0
        for file in self._files:
            for count, piece in self._pieces_of(file, names):
                read += count
                self.done = min(1.0, read / self._total)
                yield piece
        self.done = 1.0

    def _pieces_of(self, file: Path, names: Collection[str]) -> Iterator[tuple[int, Piece]]:
        """The pieces of one file, with the number of their messages."""
        wanted = {name.split(".", 1)[0] for name in names}
        rows: dict[str, list[tuple[float, dict[str, float]]]] = {}
        read, held = 0, 0
        with file.open("rb") as stream:
            reader = _reader(stream)
            with read_by_library(file, "as MCAP"):
                summary = reader.get_summary()
            topics = [c.topic for c in summary.channels.values()] if summary else None
            chosen = None if topics is None else [t for t in topics if _topic(t) in wanted]
            messages: Iterator[Any] = iter(reader.iter_messages(topics=chosen)) if chosen != [] else iter(())
            while True:
                with read_by_library(file, f"behind message {read}"):
                    found = next(messages, None)
                if found is None:
                    break
                schema, channel, message = found
                decoded = self._decode(reader, schema, channel, message)
                stamp = _stamp(decoded)
                t = ((message.log_time if stamp is None else stamp) - (self.start_ns or 0)) / 1e9
                key = _topic(channel.topic)
                rows.setdefault(key, []).append((t, {one.name: one.value for one in _numbers(decoded, key)}))
                read, held = read + 1, held + 1
                if held >= PIECE_SAMPLES:
                    yield held, _series(rows, names)
                    rows, held = {}, 0
        yield held, _series(rows, names)

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


def _in_order(path: Path) -> list[Path]:
    """The file, or those of a bag folder in the order in which they were recorded."""
    if path.is_file():
        return [path]
    begins: list[tuple[int, str, Path]] = []
    for file in path.glob(f"*{SUFFIX}"):
        with read_by_library(file, "as MCAP"), file.open("rb") as stream:
            summary = _reader(stream).get_summary()
        known = summary.statistics if summary else None
        begins.append((known.message_start_time if known else 0, file.name, file))
    return [file for _, _, file in sorted(begins)]


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


class _Number(NamedTuple):
    """A number in a message: name, value, what its type says of it, and its name with its place in an array."""

    name: str
    value: float
    meaning: FieldMeaning | None = None
    numbered: str = ""

    def listed(self, count: int | None, place: str) -> Listed:
        """As a name of the log."""
        units, quantity = self.meaning or FieldMeaning(())
        only = units[0] if len(units) == 1 else ""
        return Listed(self.name, only, count, place, self.numbered, () if only else units, quantity)


def _numbers(value: Any, before: str, meaning: FieldMeaning | None = None) -> Iterator[_Number]:
    """Every number in a message with its path; times and headers apart."""
    if isinstance(value, bool | int | float | np.number):
        yield _Number(before, float(value), meaning)
    elif isinstance(value, dict):
        yield from _of_fields(value, before, {}, meaning)
    elif isinstance(value, list | tuple | np.ndarray):
        if len(value) <= _MOST_ELEMENTS:
            for at, one in enumerate(value):
                yield from _numbers(one, f"{before}.{at}", meaning)
    elif hasattr(value, "DESCRIPTOR"):
        for entry in value.DESCRIPTOR.fields:
            if entry.message_type is not None and entry.message_type.full_name == "google.protobuf.Timestamp":
                continue
            part = getattr(value, entry.name)
            yield from _numbers(list(part) if _repeated(entry) else part, f"{before}.{entry.name}")
    elif hasattr(value, "__slots__"):
        fields = {key.strip("_"): getattr(value, key) for key in value.__slots__}
        yield from _of_fields(fields, before, fields_of(value), meaning)


def _of_fields(
    fields: Mapping[str, Any], before: str, known: Mapping[str, FieldMeaning], meaning: FieldMeaning | None
) -> Iterator[_Number]:
    """The numbers of a message's fields; those of joints by the joints' names."""
    joints = _joints(fields)
    for key, one in fields.items():
        if key in ("header", "stamp"):
            continue
        about = known.get(key, meaning)
        if joints and key in _OF_JOINTS and len(one) == len(joints):
            for at, joint in enumerate(joints):
                yield _Number(f"{before}.{key}.{joint}", float(one[at]), about, f"{before}.{key}.{at}")
        else:
            yield from _numbers(one, f"{before}.{key}", about)


def _joints(fields: Mapping[str, Any]) -> list[str]:
    """Names of the joints whose values a message has in arrays; none where they do not say which is which."""
    names = fields.get("name")
    if not isinstance(names, list | tuple) or not all(isinstance(one, str) and one.strip() for one in names):
        return []
    if len(set(names)) < len(names) or not all(isinstance(fields.get(key, ()), _ARRAYS) for key in _OF_JOINTS):
        return []
    return list(names)


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
