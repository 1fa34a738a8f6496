"""Every record survives the wire unchanged, and foreign bytes are refused with a reason."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.formats import wire
from lacet.daq.formats.array_messages import block_to_messages, frames_to_messages, joined_block
from lacet.daq.frames import Frames
from lacet.daq.schema import lacet_pb2 as pb
from tests.daq.wire_strategies import COUNT, LOSSES, NS, TALLIES, TEXTS, blocks, frames, same_blocks, same_frames


@given(frames(), COUNT)
def test_frames_come_back(batch: Frames, sequence: int):
    back, number = wire.frames_from_bytes(wire.frames_to_bytes(batch, sequence))
    assert number == sequence
    same_frames(batch, back)
    assert (back.t_ns.dtype, back.ident.dtype, back.offset.dtype, back.data.dtype) == (
        np.int64,
        np.uint32,
        np.int64,
        np.uint8,
    )


@given(blocks(), COUNT)
def test_blocks_come_back(block: Block, sequence: int):
    back, number = wire.block_from_bytes(wire.block_to_bytes(block, sequence))
    assert number == sequence
    same_blocks(block, back)
    assert (back.t_ns.dtype, back.values.dtype, back.flags.dtype) == (np.int64, np.float64, np.uint8)


@given(blocks())
def test_packed_by_hand_is_what_protobuf_packs(block: Block):
    """Parse and serialize again: protobuf finds every field that was appended by hand, and no other."""
    data = wire.block_to_bytes(block, 3)
    message = pb.DecodedBlock.FromString(data)
    assert len(message.SerializeToString()) == len(data)
    assert message.unit == CHANNELS[block.channel].unit


@given(blocks(), frames(), COUNT, st.lists(st.integers(0, 8)))
def test_many_messages_at_once_are_as_one_by_one(block: Block, batch: Frames, sequence: int, cuts: list[int]):
    edges = sorted({0, len(block), *(cut for cut in cuts if cut < len(block))})
    device = block.device_ns
    alone = [
        Block(
            block.channel, block.t_ns[a:b], block.values[a:b], block.flags[a:b], None if device is None else device[a:b]
        )
        for a, b in pairwise(edges)
    ]
    expected = [wire.block_to_bytes(one, sequence + i, "body") for i, one in enumerate(alone)]
    assert block_to_messages(block, edges, sequence, "body") == expected
    if expected:
        same_blocks(joined_block(expected), block)
    edges = sorted({0, len(batch), *(cut for cut in cuts if cut < len(batch))})
    expected = [wire.frames_to_bytes(batch[a:b], sequence + i) for i, (a, b) in enumerate(pairwise(edges))]
    assert frames_to_messages(batch, edges, sequence) == expected


@given(st.builds(wire.StartRecord, st.text(), NS, st.text(), st.text(), TEXTS, notes=st.text(), extra=TEXTS))
def test_start_comes_back(record: wire.StartRecord):
    assert wire.start_from_bytes(wire.start_to_bytes(record)) == record


@given(st.builds(wire.StopRecord, NS, st.text(), st.dictionaries(st.text(), COUNT, max_size=3), LOSSES))
def test_stop_comes_back(record: wire.StopRecord):
    assert wire.stop_from_bytes(wire.stop_to_bytes(record)) == record


@given(st.builds(wire.Manifest, st.text(), TALLIES, TALLIES, LOSSES))
def test_manifest_comes_back(manifest: wire.Manifest):
    assert wire.manifest_from_bytes(wire.manifest_to_bytes(manifest)) == manifest


@given(st.builds(wire.Document, st.text(), st.text(), st.text(), COUNT))
def test_document_comes_back(document: wire.Document):
    assert wire.document_from_bytes(wire.document_to_bytes(document)) == document


@given(st.dictionaries(st.text(), st.text(), min_size=2, max_size=6))
def test_bytes_do_not_depend_on_the_order_of_a_map(texts: dict[str, str]):
    backwards = dict(reversed(texts.items()))
    one, two = (wire.start_to_bytes(wire.StartRecord("r", 1, extra=extra)) for extra in (texts, backwards))
    assert one == two


@given(st.binary(max_size=200))
def test_foreign_bytes_are_refused_or_read(data: bytes):
    for read in (
        wire.frames_from_bytes,
        wire.block_from_bytes,
        wire.start_from_bytes,
        wire.stop_from_bytes,
        wire.manifest_from_bytes,
        wire.document_from_bytes,
    ):
        try:
            read(data)
        except wire.WireError as error:
            assert str(error)  # noqa: PT017


def test_parts_that_do_not_fit_together_are_refused():
    message = pb.RawFrames(source="can0", delta_ns=[0, 1], ident=[1, 2], length=[3, 3], data=b"12345")
    with pytest.raises(wire.WireError, match="5 bytes"):
        wire.frames_from_bytes(message.SerializeToString())
    unknown = pb.DecodedBlock(channel="wheel.xx.force")
    with pytest.raises(wire.WireError, match="vocabulary"):
        wire.block_from_bytes(unknown.SerializeToString())
