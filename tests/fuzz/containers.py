"""Well-formed containers with mutated contents: MCAP files with right checksums of whatever messages."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import NamedTuple

from mcap.writer import Writer

from lacet.daq.formats.mcap_read import McapScan
from tests.fuzz.mutation import INTEGERS, bytes_changed, one_changed

TOPICS = ("/raw/x", "/decoded/no/such", "/decoded/imu/rate", "/lacet/start", "/lacet/manifest", "/lacet/events", "/")


class Stored(NamedTuple):
    """A message of an MCAP file: topic, name of its type, sequence number, log time [ns], contents."""

    topic: str
    kind: str
    sequence: int
    log_ns: int
    data: bytes


def log_messages(path: Path) -> list[Stored]:
    """The messages of a log."""
    scan = McapScan.of(path)
    return [
        Stored(
            scan.channels[one.channel].topic, scan.schemas[scan.channels[one.channel].schema_id].name, one.sequence,
            one.log_ns, one.data,
        )
        for one in scan.messages()
    ]  # fmt: skip


def messages_changed(random: Random, messages: list[Stored]) -> list[Stored]:
    """Messages of which some have other numbers, times, topics or contents, or are lost, repeated or exchanged."""
    out = messages
    for _ in range(random.choice((1, 1, 2, 5))):
        out = one_changed(random, out, _changed) if out else out
    return out


def _changed(random: Random, one: Stored) -> Stored:
    match random.randrange(6):
        case 0:
            return one._replace(sequence=random.choice(INTEGERS) % 2**32)
        case 1:
            return one._replace(log_ns=random.choice(INTEGERS) % 2**64)
        case 2:
            return one._replace(topic=random.choice(TOPICS))
        case _:
            return one._replace(data=bytes_changed(random, one.data))


def write_messages(path: Path, messages: list[Stored]) -> None:
    """Write messages as an MCAP file, by the mcap library: every length and checksum is right."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096)
        writer.start("lacet")
        kinds: dict[str, int] = {}
        topics: dict[str, int] = {}
        for one in messages:
            if one.kind not in kinds:
                kinds[one.kind] = writer.register_schema(one.kind, "protobuf", b"")
            if one.topic not in topics:
                topics[one.topic] = writer.register_channel(one.topic, "protobuf", kinds[one.kind])
            writer.add_message(topics[one.topic], one.log_ns, one.data, one.log_ns, one.sequence)
        writer.finish()
