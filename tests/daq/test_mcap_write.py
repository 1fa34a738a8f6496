"""The bytes of an MCAP file are those of the public library's writer for the same calls."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import pytest
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

from lacet.daq.formats import mcap_write
from lacet.daq.formats.mcap_write import PROTOBUF, McapWriter, describe
from lacet.daq.schema import lacet_pb2 as pb
from lacet.daq.topics import PROFILE

MESSAGES = [
    (f"/raw/bus{k % 3}", pb.RawFrames, bytes([k]) * (50 * k), 10**18 + k * 7**5 - (k == 4) * 10**9, k)
    for k in range(12)
] + [("/decoded/imu/rate", pb.DecodedBlock, b"x" * 1000, 5, 2**32 + 3)]  # fmt: skip


def by_library(flushes: set[int]) -> bytes:
    """Definitions twice, once outside the chunk that follows, as `McapWriter` writes them."""
    out = BytesIO()
    writer = Writer(out, chunk_size=1 << 62, compression=CompressionType.ZSTD)
    writer.start(PROFILE, library="lacet")
    writer.add_metadata("lacet.start", {"b": "1", "a": "2"})
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for k, (topic, kind, data, log_ns, sequence) in enumerate(MESSAGES):
        if topic not in channels:
            ahead, name = RecordBuilder(), kind.DESCRIPTOR.full_name
            if name not in schemas:
                schemas[name] = writer.register_schema(name, PROTOBUF, describe(kind))
                Schema(schemas[name], describe(kind), PROTOBUF, name).write(ahead)
            channels[topic] = writer.register_channel(topic, PROTOBUF, schemas[name], {})
            Channel(channels[topic], topic, PROTOBUF, {}, schemas[name]).write(ahead)
            out.write(ahead.end())
        writer.add_message(channels[topic], log_ns, data, log_ns, sequence & 0xFFFFFFFF)
        if k in flushes:
            writer.flush()
    writer.add_metadata("lacet.stop", {})
    writer.finish()
    return out.getvalue()


@pytest.mark.parametrize("flushes", [set(), {0}, {2, 3, 9}, {5, 12}, set(range(13))], ids=str)
def test_same_bytes_as_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flushes: set[int]):
    monkeypatch.setattr(mcap_write, "_RECORDS", 3)  # so that some of the index is packed
    path = tmp_path / "a.mcap"
    writer = McapWriter(path)
    writer.metadata("lacet.start", {"b": "1", "a": "2"})
    for k, message in enumerate(MESSAGES):
        writer.message(*message)
        if k in flushes:
            writer.flush()
    writer.metadata("lacet.stop", {})
    writer.finish()
    writer.abandon()
    assert path.read_bytes() == by_library(flushes)


def test_a_file_without_messages_is_the_library_s(tmp_path: Path):
    writer = McapWriter(tmp_path / "a.mcap")
    writer.flush()
    writer.finish()
    writer.abandon()
    out = BytesIO()
    library = Writer(out, chunk_size=1 << 62, compression=CompressionType.ZSTD)
    library.start(PROFILE, library="lacet")
    library.finish()
    assert (tmp_path / "a.mcap").read_bytes() == out.getvalue()
