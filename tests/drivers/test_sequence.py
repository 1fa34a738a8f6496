"""Frames repeated or out of order on the way: counted as what they are, each sample used once and in its place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.blocks import Flag
from lacet.daq.frames import Frame, Frames
from lacet.drivers import open_driver
from tests.drivers.driver_cases import decode_all, decode_split, plausible_blocks, same_blocks

N = 60
CORNERS = {"igel": {"corners": ["fl"]}, "lasers": {"corners": ["fl"]}}
NAMES = ("igel", "lasers", "zimmer")
every_driver = pytest.mark.parametrize("name", NAMES)


def sent(name: str):
    """The driver, its frames one sample after the other, frames a sample, and what they are when nothing happens."""
    driver = open_driver(name, "bus", CORNERS.get(name, {}))
    frames = list(driver.encode(plausible_blocks(driver, N, 4)))
    return driver, frames, len(frames) // N, decode_all(driver, Frames.from_iter("bus", frames))[0]


def received(frames: Sequence[Frame], order: Sequence[int]) -> Frames:
    """Frames in another order, some twice, stamped as they arrive."""
    stamps = sorted(frame.t_ns for frame in frames)
    stamps += [stamps[-1] + 1000 * i for i in range(1, 1 + len(order))]
    return Frames.from_iter("bus", [frames[i]._replace(t_ns=stamps[k]) for k, i in enumerate(order)])


def joined(samples: Sequence[Sequence[int]]) -> list[int]:
    return [i for sample in samples for i in sample]


def same_values(got, clean):
    for channel, block in got.items():
        np.testing.assert_array_equal(block.values, clean[channel].values)
        assert not block.flags.any()
        assert (np.diff(block.t_ns) >= 0).all()


@every_driver
@pytest.mark.parametrize("what", ["one frame", "one sample", "every frame", "every sample", "a sample later"])
def test_what_comes_twice_is_used_once_and_counted(name, what):
    driver, frames, size, clean = sent(name)
    order = list(range(len(frames)))
    samples = [order[i : i + size] for i in range(0, len(order), size)]
    order = {
        "one frame": order[:31] + order[30:],
        "one sample": joined(samples[:21] + samples[20:]),
        "every frame": [i for i in order for _ in range(2)],
        "every sample": joined([s for s in samples for _ in range(2)]),
        "a sample later": joined([*samples[:22], samples[20], *samples[22:]]),
    }[what]
    got, counts = decode_all(driver, received(frames, order))
    same_values(got, clean)
    assert counts["repeated"] == len(order) - len(frames)
    assert (counts["lost"], counts["samples"], counts["reordered"]) == (0, N, 0)
    assert counts.get("restarts", 0) == counts.get("incomplete", 0) == 0


@every_driver
@pytest.mark.parametrize("by", [1, 2, 3])
def test_a_late_sample_is_put_in_its_place(name, by):
    driver, frames, size, clean = sent(name)
    samples = [list(range(i, i + size)) for i in range(0, len(frames), size)]
    late = samples.pop(20)
    samples.insert(20 + by, late)
    got, counts = decode_all(driver, received(frames, joined(samples)))
    same_values(got, clean)
    assert (counts["lost"], counts["samples"], counts["reordered"], counts["repeated"]) == (0, N, 1, 0)


@every_driver
def test_neighbours_exchanged_all_the_time(name):
    driver, frames, size, clean = sent(name)
    samples = [list(range(i, i + size)) for i in range(0, len(frames), size)]
    samples[1:-1:2], samples[2:-1:2] = samples[2:-1:2], samples[1:-1:2]
    got, counts = decode_all(driver, received(frames, joined(samples)))
    same_values(got, clean)
    assert (counts["lost"], counts["samples"]) == (0, N)
    assert counts["reordered"] >= (N - 2) // 2


@pytest.mark.parametrize(
    ("order", "always"),
    [
        *((order, False) for order in ([0, 2, 1], [1, 0, 2], [2, 1, 0], [0, 1, 3, 2, 4, 5], [0, 1, 3, 4, 2, 5])),
        *((order, True) for order in ([0, 2, 1], [1, 0, 2], [0, 1, 3, 2, 4, 5], [0, 1, 3, 4, 2, 5])),
    ],
)
def test_frames_out_of_order_make_whole_samples(order, always):
    driver, frames, size, clean = sent("igel")
    assert size == 3
    width = len(order)
    where = range(0, len(frames), width) if always else [30]
    shuffled = list(range(len(frames)))
    for begin in where:
        shuffled[begin : begin + width] = [begin + i for i in order]
    got, counts = decode_all(driver, received(frames, shuffled))
    same_values(got, clean)
    assert (counts["lost"], counts["incomplete"], counts["bad_checksum"], counts["repeated"]) == (0, 0, 0, 0)
    assert counts["reordered"] > 0


@every_driver
@pytest.mark.parametrize("lost", [1, 3, 14])
def test_a_loss_stays_a_loss(name, lost):
    driver, frames, size, clean = sent(name)
    kept = frames[: 20 * size] + frames[(20 + lost) * size :]
    got, counts = decode_all(driver, Frames.from_iter("bus", kept))
    assert (counts["lost"], counts["repeated"], counts["reordered"]) == (lost, 0, 0)
    for channel, block in got.items():
        assert np.flatnonzero(block.flags).tolist() == [20]
        assert block.flags[20] == Flag.GAP
        np.testing.assert_array_equal(block.values[20:], clean[channel].values[20 + lost :])


@every_driver
@settings(max_examples=30, deadline=None)
@given(
    fates=st.lists(st.sampled_from(["", "", "", "twice", "lost", "late", "again"]), min_size=40, max_size=120),
    cuts=st.lists(st.integers(0, 240), max_size=12),
)
def test_the_result_does_not_depend_on_the_batches(name, fates, cuts):
    driver, frames, _, _ = sent(name)
    order: list[int] = []
    for i, fate in enumerate(fates[: len(frames)]):
        order += [] if fate == "lost" else [i, i] if fate == "twice" else [i]
        if fate == "late" and len(order) > 1:
            order[-1], order[-2] = order[-2], order[-1]
        if fate == "again" and i >= 3:
            order.append(i - 3)
    stream = received(frames, order)
    whole, counts = decode_all(driver, stream)
    for split in (cuts, range(1, len(stream))):
        parts, split_counts = decode_split(driver, stream, split)
        same_blocks(whole, parts)
        assert counts == split_counts


def test_a_sample_is_held_back_no_longer_than_needed():
    driver, frames, size, _ = sent("igel")
    kept = frames[: 20 * size] + frames[21 * size :]
    _, state = driver.decode(Frames.from_iter("bus", kept[: 20 * size]), driver.start())
    found = []
    for i in range(20, 26):
        blocks, state = driver.decode(Frames.from_iter("bus", kept[i * size : (i + 1) * size]), state)
        found.append(len(blocks[0]) if blocks else 0)
    assert found == [0, 0, 0, 4, 1, 1]
