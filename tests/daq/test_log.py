"""The run log: what goes in comes out, from whole files, cut files and files with a bad byte."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from lacet.daq.blocks import Block
from lacet.daq.errors import RunError
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord, StopRecord, recover
from lacet.daq.frames import Frames
from lacet.daq.topics import decoded_topic, raw_topic
from tests.daq.wire_strategies import blocks, frames, same_blocks, same_frames

T0 = 1_700_000_000 * 10**9
START = StartRecord(
    "run-1", T0, "vehicle", "rig", {"a.dbc": "x" * 500}, "car", "slalom", "hub", "off", "n", "s", {"k": "v"}
)


def batch(source: str, k: int, n: int = 20) -> Frames:
    """n frames in 50 ms, every payload different."""
    t = T0 + k * 50_000_000 + np.arange(n) * (50_000_000 // n)
    return Frames.from_iter(source, [("", int(x), 0x100 + i, f"{source} {k} {i}".encode()) for i, x in enumerate(t)])


def block(k: int, n: int = 10) -> Block:
    t = T0 + k * 50_000_000 + np.arange(n) * 5_000_000
    rng = np.random.default_rng(k)
    return Block("imu.rate", t, rng.normal(size=(n, 3)), rng.integers(0, 255, n).astype(np.uint8), t - T0)


def write(path: Path, rounds: int = 30) -> None:
    with LogWriter(path, START, overwrite=True) as writer:
        for k in range(rounds):
            writer.write_frames(batch("can0", k))
            writer.write_frames(batch("can1", k, 5))
            writer.write_block(block(k))
        writer.close(StopRecord(T0 + 10**10, "stopped", {"extra": 3}, {"can0": {"kernel": 2}}))


@dataclass
class Whole:
    """A whole log, and for each chunk where it ends and how many messages of each topic it holds."""

    path: Path
    data: bytes = field(repr=False)
    chunks: list[tuple[int, dict[str, int]]] = field(repr=False)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    path = tmp_path_factory.mktemp("log") / "whole.mcap"
    write(path)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        ends = [index.chunk_start_offset + index.chunk_length for index in summary.chunk_indexes]
        counts: list[dict[str, int]] = [{} for _ in ends]
        for k, index in enumerate(summary.chunk_indexes):
            for channel, offset in index.message_index_offsets.items():
                file.seek(offset + 11)  # opcode, length, channel id; then the bytes of 16-byte entries
                topic = summary.channels[channel].topic
                counts[k][topic] = int.from_bytes(file.read(4), "little") // 16
    assert len(ends) > 10
    return Whole(path, path.read_bytes(), list(zip(ends, counts, strict=True)))


@given(st.lists(frames() | blocks(), max_size=12))
@settings(max_examples=60, deadline=None)
def test_everything_comes_back(tmp_path_factory: pytest.TempPathFactory, items: list[Frames | Block]):
    path = tmp_path_factory.getbasetemp() / "round.mcap"
    with LogWriter(path, START, chunk_bytes=400, overwrite=True) as writer:
        for item in items:
            (writer.write_frames if isinstance(item, Frames) else writer.write_block)(item)
            writer.tick(T0 + 5)
    reader = LogReader(path)
    assert reader.damage == []
    assert reader.start == START
    assert reader.stop is not None
    kept = [item for item in items if len(item)]
    sources = sorted({item.source for item in kept if isinstance(item, Frames)})
    assert reader.sources() == sources
    for source in sources:
        parts = [item for item in kept if isinstance(item, Frames) and item.source == source]
        same_frames(Frames.concat(source, parts), reader.frames(source))
        assert reader.stop.counts[source] == sum(map(len, parts))
    got = reader.blocks()
    assert sorted(got) == reader.channels() == sorted({item.channel for item in kept if isinstance(item, Block)})
    for channel, joined in got.items():
        same_blocks(
            Block.concat([item for item in kept if isinstance(item, Block) and item.channel == channel]), joined
        )
    replayed = [item for _, item in reader.messages()]
    assert len(replayed) == len(kept)
    for one, two in zip(kept, replayed, strict=True):
        assert len(one) == len(two)
        assert type(one) is type(two)


def test_same_calls_same_bytes(tmp_path: Path, whole: Whole):
    write(tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == whole.data


def test_records_and_manifest(whole: Whole):
    reader = LogReader(whole.path)
    assert reader.damage == []
    assert reader.start == START
    assert reader.stop == StopRecord(
        T0 + 10**10, "stopped", {"can0": 600, "can1": 150, "imu.rate": 300, "extra": 3}, {"can0": {"kernel": 2}}
    )
    assert reader.manifest is not None
    assert reader.manifest.sources["can0"].samples == 600
    assert reader.manifest.channels["imu.rate"].last_sequence == 29
    assert reader.manifest.losses == {"can0": {"kernel": 2}}


def test_the_public_mcap_library_reads_it(whole: Whole):
    """With CRCs checked and every message decoded by the schema in the file, not by our code."""
    with whole.path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        header = reader.get_header()
        assert (header.profile, header.library) == ("lacet", "lacet")
        found = list(reader.iter_decoded_messages())
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert metadata["lacet.start"]["manoeuvre"] == "slalom"
    assert metadata["lacet.stop"]["reason"] == "stopped"
    topics = [channel.topic for _, channel, _, _ in found]
    assert topics.count(raw_topic("can0")) == topics.count(decoded_topic("imu.rate")) == 30
    rates = [message for _, channel, _, message in found if channel.topic == "/decoded/imu/rate"]
    expected = block(7)
    np.testing.assert_array_equal(rates[7].component[2].value, expected.values[:, 2])
    assert rates[7].component[2].name == "z"
    assert rates[7].unit == "rad/s"
    assert rates[7].first_ns == expected.t_ns[0]


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_cut_anywhere_every_whole_chunk_is_kept(
    tmp_path_factory: pytest.TempPathFactory, whole: Whole, data: st.DataObject
):
    ends = [end for end, _ in whole.chunks]
    near = st.sampled_from(ends).flatmap(lambda end: st.integers(end - 12, end + 12))
    cut = data.draw(st.integers(0, len(whole.data) - 1) | near)
    path = tmp_path_factory.getbasetemp() / "cut.mcap"
    path.write_bytes(whole.data[:cut])
    if cut < ends[0]:  # the start record is in the first chunk
        with pytest.raises(RunError) as caught:
            LogReader(path)
        assert "nothing can be read" in str(caught.value) or "empty" in str(caught.value) or "MCAP" in str(caught.value)
        return
    reader = LogReader(path)
    assert reader.start == START
    assert reader.damage
    kept = [counts for end, counts in whole.chunks if end <= cut]
    messages = sum(counts.get("/raw/can0", 0) for counts in kept)
    if messages:
        same_frames(Frames.concat("can0", [batch("can0", k) for k in range(messages)]), reader.frames("can0"))
    messages = sum(counts.get("/decoded/imu/rate", 0) for counts in kept)
    if messages:
        same_blocks(Block.concat([block(k) for k in range(messages)]), reader.blocks()["imu.rate"])
    assert (reader.stop is None) == (not any("/lacet/stop" in counts for counts in kept))
    out = path.with_name("recovered.mcap")
    damage = recover(path, out, overwrite=True)
    assert damage == reader.damage
    again = LogReader(out)
    assert again.stop is not None
    assert (again.sources(), again.channels()) == (reader.sources(), reader.channels())
    assert set(damage) <= set(again.damage)  # what was lost stays known
    for source in again.sources():
        same_frames(reader.frames(source), again.frames(source))
    with out.open("rb") as file:
        assert make_reader(file, validate_crcs=True).get_summary() is not None


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_a_wrong_byte_costs_its_chunk_and_is_told(
    tmp_path_factory: pytest.TempPathFactory, whole: Whole, data: st.DataObject
):
    at = data.draw(st.integers(0, len(whole.data) - 1))
    wrong = bytearray(whole.data)
    wrong[at] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.getbasetemp() / "wrong.mcap"
    path.write_bytes(wrong)
    reader = LogReader(path)
    got = [bytes(frame.payload) for frame in reader.frames("can0")]
    expected = [bytes(frame.payload) for k in range(30) for frame in batch("can0", k)]
    where = {payload: i for i, payload in enumerate(expected)}
    indices = [where[payload] for payload in got]  # KeyError: something that never was recorded
    assert all(a < b for a, b in pairwise(indices))
    assert len(got) >= len(expected) - 40  # the two rounds of one chunk
    rates = reader.blocks().get("imu.rate")
    assert rates is not None
    known = np.concatenate([block(k).values for k in range(30)])
    assert np.isin(rates.values, known).all()
    whole_stop = reader.stop is not None and reader.start == START
    if len(got) < len(expected) or len(rates) < 300 or not whole_stop:
        assert reader.damage


def test_a_wrong_length_does_not_leap_over_good_chunks(tmp_path: Path, whole: Whole):
    """For every record of the file: its length grown by 64 bytes and by 16 KiB."""
    position = 8
    while position + 9 < len(whole.data):
        for byte, bit in ((1, 0x40), (2, 0x40)):
            wrong = bytearray(whole.data)
            wrong[position + byte] ^= bit
            path = tmp_path / "wrong.mcap"
            path.write_bytes(wrong)
            reader = LogReader(path)
            assert len(reader.frames("can0")) >= 560, (position, byte)
            assert reader.damage, (position, byte)
        position += 9 + int.from_bytes(whole.data[position + 1 : position + 9], "little")


def test_the_chunk_that_defines_a_topic_may_be_lost(tmp_path: Path, whole: Whole):
    """In an unfinished file, which has no index to repeat the definitions: the later chunks keep their meaning."""
    first = whole.chunks[1][0]
    wrong = bytearray(whole.data[: whole.chunks[10][0]])
    wrong[first - 20] ^= 0xFF
    path = tmp_path / "wrong.mcap"
    path.write_bytes(wrong)
    reader = LogReader(path)
    assert len(reader.frames("can0")) == 20 * sum(counts["/raw/can0"] for _, counts in whole.chunks[2:11])
    assert len(reader.blocks()["imu.rate"]) == 10 * sum(counts["/decoded/imu/rate"] for _, counts in whole.chunks[2:11])


def test_two_lost_chunks_are_named(tmp_path: Path, whole: Whole):
    wrong = bytearray(whole.data)
    for k in (4, 9):
        wrong[whole.chunks[k][0] - 20] ^= 0xFF
    path = tmp_path / "wrong.mcap"
    path.write_bytes(wrong)
    reader = LogReader(path)
    damage = "\n".join(reader.damage)
    assert damage.count("left out") == 2
    assert list(reader.batches("can0"))
    assert len(reader.holes["can0"]) == 2
    lost = whole.chunks[4][1]["/raw/can0"] + whole.chunks[9][1]["/raw/can0"]
    (line,) = [line for line in damage.splitlines() if "are missing" in line]
    assert line.startswith("/raw/can0, ")
    assert f"{lost} of 30 messages of each are missing: " in line
