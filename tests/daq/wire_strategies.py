"""Batches and blocks of every kind, and what it means that two are the same."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.formats import wire
from lacet.daq.formats.array_messages import EARLIEST_NS, LATEST_NS
from lacet.daq.frames import Frames

NS = st.integers(EARLIEST_NS, LATEST_NS)
COUNT = st.integers(0, 2**63)
LOSSES = st.dictionaries(st.text(), st.dictionaries(st.text(), COUNT, max_size=3), max_size=3)
TEXTS = st.dictionaries(st.text(), st.text(), max_size=3)
TALLIES = st.dictionaries(st.text(), st.builds(wire.Tally, COUNT, COUNT, st.integers(0, 2**32 - 1)), max_size=3)


@st.composite
def frames(draw: st.DrawFn) -> Frames:
    row = st.tuples(st.just(""), NS, st.integers(0, 2**32 - 1), st.binary(max_size=70))
    batch = Frames.from_iter(draw(st.text(max_size=5)), draw(st.lists(row, max_size=8)))
    start = draw(st.integers(0, len(batch)))
    sliced = Frames(batch.source, batch.t_ns[start:], batch.ident[start:], batch.offset[start:], batch.data)
    return draw(st.sampled_from([batch, sliced]))  # a view whose offsets do not begin at 0 as well


@st.composite
def blocks(draw: st.DrawFn) -> Block:
    channel = CHANNELS[draw(st.sampled_from(sorted(CHANNELS)))]
    n = draw(st.integers(0, 6))
    stamps = st.lists(NS, min_size=n, max_size=n).map(lambda x: np.array(x, np.int64))
    numbers = st.lists(st.floats(), min_size=n * channel.width, max_size=n * channel.width)
    values = np.array(draw(numbers), float).reshape(n, channel.width)
    flags = np.array(draw(st.lists(st.integers(0, 255), min_size=n, max_size=n)), np.uint8)
    return Block(channel.name, draw(stamps), values, flags, draw(st.none() | stamps))


def same_frames(a: Frames, b: Frames) -> None:
    assert a.source == b.source
    np.testing.assert_array_equal(a.t_ns, b.t_ns)
    np.testing.assert_array_equal(a.ident, b.ident)
    np.testing.assert_array_equal(a.offset - a.offset[0], b.offset - b.offset[0])
    np.testing.assert_array_equal(a.data[a.offset[0] : a.offset[-1]], b.data[b.offset[0] : b.offset[-1]])


def same_blocks(a: Block, b: Block) -> None:
    assert a.channel == b.channel
    np.testing.assert_array_equal(a.t_ns, b.t_ns)
    np.testing.assert_array_equal(a.values, b.values)
    np.testing.assert_array_equal(a.flags, b.flags)
    assert (a.device_ns is None) == (b.device_ns is None)
    if a.device_ns is not None and b.device_ns is not None:
        np.testing.assert_array_equal(a.device_ns, b.device_ns)
