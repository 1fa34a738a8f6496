"""What holds for every driver: the test walks the folder and finds its own subjects."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lacet.drivers
from lacet.daq.blocks import UNUSABLE, Block, Flag
from lacet.daq.channels import CHANNELS, STANDARD
from lacet.daq.errors import RigError, UsageError
from lacet.daq.frames import Frames
from lacet.drivers import known_drivers, open_driver
from tests.drivers.driver_cases import (
    PLAUSIBLE,
    decode_all,
    decode_split,
    plausible_blocks,
    same_blocks,
    same_frames,
    spoil,
)
from tests.support.places import HOME

READ_ONLY = ("dbc", "nmea", "ubx")
"""Drivers that only read and have tests of their own."""
NAMES = sorted(set(known_drivers()) - set(READ_ONLY))
NO_VALUE = UNUSABLE & ~(Flag.RANGE | Flag.CLOCK)
every_driver = pytest.mark.parametrize("name", NAMES)
seeds = st.integers(0, 2**32 - 1)


def idents(driver, n=4):
    return np.unique(driver.encode(plausible_blocks(driver, n, 0)).ident).tolist()


def test_every_page_has_its_driver_and_every_driver_its_page():
    pages = {path.stem for path in (HOME / "docs/wires").glob("*.md")} - {"README"}
    assert pages == set(known_drivers()) - {"dbc"}  # which has no wire format of its own: docs/rig.md


def test_between_them_the_drivers_produce_all_that_the_papers_instruments_measure():
    produced = [channel for name in NAMES for channel in open_driver(name, "bus").channels]
    assert sorted(channel for channel in produced if channel in STANDARD) == sorted(STANDARD)


def test_a_new_driver_finds_the_range_of_its_channels_here():
    assert {channel.family for channel in CHANNELS.values()} == set(PLAUSIBLE)


@every_driver
def test_is_pure(name):
    """No clock, socket, thread or file handle at import: only these modules are reached from a driver's file."""
    allowed = {"__future__", "collections", "dataclasses", "typing", "pathlib", "numpy", "functools", "lacet"}
    tree = ast.parse(Path(lacet.drivers.__path__[0], f"{name}.py").read_text(encoding="utf-8"))
    roots = {
        alias.name.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
    }
    froms = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert roots | {module.split(".")[0] for module in froms} <= allowed
    assert {module.split(".")[1] for module in froms if module.startswith("lacet.")} <= {"daq", "drivers"}


@every_driver
def test_declares_itself(name):
    driver = open_driver(name, "some bus")
    assert driver.name == name
    assert driver.channels
    assert set(driver.channels) <= set(CHANNELS)
    assert all(file and text for file, text in driver.documents.items())
    assert driver.encode(plausible_blocks(driver, 2, 1)).source == "some bus"
    # What was recorded wins over what lies on disk, so a driver can be made again from a log.
    again = open_driver(name, "some bus", documents=driver.documents, folder=Path("nowhere"))
    same_frames(driver.encode(plausible_blocks(driver, 3, 1)), again.encode(plausible_blocks(driver, 3, 1)))


@every_driver
def test_refuses_unknown_options(name):
    with pytest.raises(RigError, match=r"baudd.*not an option"):
        open_driver(name, "bus", {"baudd": 3})


@every_driver
@settings(max_examples=25, deadline=None)
@given(n=st.integers(0, 40), seed=seeds, device=st.booleans())
def test_encode_then_decode(name, n, seed, device):
    driver = open_driver(name, "bus")
    sent = plausible_blocks(driver, n, seed, device)
    frames = driver.encode(sent)
    assert (np.diff(frames.t_ns) >= 0).all()
    got, counts = decode_all(driver, frames)
    assert set(got) == (set(sent) if n else set())
    for channel, block in got.items():
        np.testing.assert_array_equal(block.t_ns, sent[channel].t_ns)
        assert not block.flags.any()
        # Rounding must drown in the noise that the channel is designed for: below a third of it at the very worst.
        error = block.values - sent[channel].values
        if channel.endswith(".angle"):
            error = (error + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(error).max() <= CHANNELS[channel].noise / 3
        if block.device_ns is not None:
            clock = sent[channel].device_ns if device else sent[channel].t_ns // 1000 * 1000
            np.testing.assert_array_equal(np.diff(block.device_ns), np.diff(clock))
    assert counts["lost"] == 0
    assert counts["samples"] * len(driver.channels) >= n
    # What was decoded encodes to the same bytes: no value drifts by being passed on.
    if n:
        same_frames(driver.encode(got), frames)


@every_driver
@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_flagged_and_missing_values_are_sent_as_not_valid(name, seed):
    driver = open_driver(name, "bus")
    rng = np.random.default_rng(seed)
    n = 12
    sent = plausible_blocks(driver, n, seed)
    for channel, block in sent.items():
        values, flags = block.values.copy(), block.flags.copy()
        kind = rng.integers(0, 4, n)
        values[kind == 1, rng.integers(values.shape[1])] = np.nan
        marks = [Flag.CHECKSUM, Flag.STATUS, Flag.INCOMPLETE, Flag.RANGE, Flag.MISSING, Flag.CLOCK]
        flags[kind == 2] = rng.choice([int(mark) for mark in marks])
        flags[kind == 3] = Flag.GAP
        sent[channel] = Block(channel, block.t_ns, values, flags)
    got, counts = decode_all(driver, driver.encode(sent))
    for channel, block in got.items():
        bad = np.isnan(sent[channel].values).any(axis=1) | ((sent[channel].flags & np.uint8(UNUSABLE)) != 0)
        assert (block.flags[bad] & Flag.STATUS).all()
        assert np.isnan(block.values[bad]).all()
    assert counts["bad_checksum"] == 0


@every_driver
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("huge", [1e9, np.inf])
def test_values_out_of_range_saturate(name, sign, huge):
    driver = open_driver(name, "bus")
    sent = plausible_blocks(driver, 3, 0)
    running = {channel for channel in sent if channel.endswith((".angle", ".attitude"))}
    for channel in set(sent) - running:
        sent[channel] = Block(
            channel, sent[channel].t_ns, np.full_like(sent[channel].values, sign * huge), np.zeros(3, np.uint8)
        )
    got, counts = decode_all(driver, driver.encode(sent))
    for channel in set(sent) - running:
        assert (got[channel].flags == Flag.RANGE).all()
        assert np.isfinite(got[channel].values).all()
    assert counts["saturated"] > 0
    for channel in running:
        assert not got[channel].flags.any()
    same_frames(driver.encode(got), driver.encode(sent))


@every_driver
@settings(max_examples=20, deadline=None)
@given(seed=seeds, cuts=st.lists(st.integers(0, 150), max_size=20))
def test_any_split_gives_the_same_samples(name, seed, cuts):
    driver = open_driver(name, "bus")
    rng = np.random.default_rng(seed)
    frames = spoil(driver.encode(plausible_blocks(driver, 12, seed)), rng, [*idents(driver), 0x7FF])
    whole, counts = decode_all(driver, frames)
    split, split_counts = decode_split(driver, frames, cuts)
    same_blocks(whole, split)
    assert counts == split_counts
    one_by_one, counts_of_one = decode_split(driver, frames, range(1, len(frames)))
    same_blocks(whole, one_by_one)
    assert counts == counts_of_one


@every_driver
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_no_bytes_raise(name, data):
    driver = open_driver(name, "bus")
    known = idents(driver)
    payloads = data.draw(st.lists(st.tuples(st.sampled_from([*known, 0, 2**29]), st.binary(max_size=70)), max_size=20))
    frames = Frames.from_iter("bus", [("bus", i, ident, payload) for i, (ident, payload) in enumerate(payloads)])
    blocks, counts = decode_all(driver, frames)
    for block in blocks.values():
        without = (block.flags & np.uint8(NO_VALUE)) != 0
        assert np.isnan(block.values[without]).all()
        assert np.isfinite(block.values[~without]).all()
    assert all(count >= 0 for count in counts.values())


@every_driver
@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_spoilt_streams_are_accounted_for(name, seed):
    """Every sample that is delivered as good is one that was sent; the ledger agrees with the flags."""
    driver = open_driver(name, "bus")
    if not driver.counts(driver.start()).keys() >= {"received", "samples", "lost", "bad_checksum", "bad_status"}:
        pytest.fail("the ledger lacks an entry that every driver has")
    sent = plausible_blocks(driver, 40, seed)
    frames = driver.encode(sent)
    keep = np.random.default_rng(seed).random(len(frames)) > 0.1
    kept = Frames.from_iter("bus", [frame for frame, kept in zip(frames, keep, strict=True) if kept])
    got, counts = decode_all(driver, kept)
    clean, _ = decode_all(driver, frames)
    for channel, block in got.items():
        good = (block.flags & np.uint8(UNUSABLE)) == 0
        at = np.searchsorted(clean[channel].t_ns, block.t_ns[good])
        same = (clean[channel].values[at] == block.values[good]).all(axis=1)
        # A CRC of 8 bits lets one wrong mixture of two samples in 256 pass.
        assert np.count_nonzero(~same) <= 1
    assert counts["samples"] > 0


@every_driver
@pytest.mark.parametrize("k", [1, 2, 7, 14])
def test_lost_samples_are_counted_and_marked(name, k):
    driver = open_driver(name, "bus")
    sent = plausible_blocks(driver, 40, 5)
    frames = driver.encode(sent)
    stamps = next(iter(sent.values())).t_ns
    gone = stamps[10 : 10 + k]
    kept = Frames.from_iter("bus", [frame for frame in frames if frame.t_ns not in gone])
    got, counts = decode_all(driver, kept)
    units = counts["samples"] // (40 - k)
    assert counts["lost"] == k * units
    for block in got.values():
        np.testing.assert_array_equal(np.flatnonzero(block.flags), [10])
        assert block.flags[10] == Flag.GAP
        assert np.isfinite(block.values).all()


@every_driver
def test_channels_that_travel_together_must_come_together(name):
    driver = open_driver(name, "bus")
    sent = plausible_blocks(driver, 3, 0)
    if len(sent) > 1:
        first = driver.channels[0]
        with pytest.raises(UsageError, match="travel in one message"):
            driver.encode({channel: block for channel, block in sent.items() if channel != first})
        late = Block(first, sent[first].t_ns + 1, sent[first].values, sent[first].flags)
        with pytest.raises(UsageError, match="different stamps"):
            driver.encode({**sent, first: late})
    assert len(driver.encode({})) == 0


def test_unknown_driver_names_the_nearest():
    with pytest.raises(UsageError, match="did you mean 'igel'"):
        open_driver("igle", "can0")


@pytest.mark.parametrize("name", [name for name in NAMES if ".fl." in " ".join(open_driver(name, "b").channels)])
def test_corners(name):
    plain = open_driver(name, "bus")
    swapped = open_driver(name, "bus", {"corners": ["fr", "fl", "rl", "rr"]})
    frames = plain.encode(plausible_blocks(plain, 5, 3))
    right, _ = decode_all(plain, frames)
    wrong, _ = decode_all(swapped, frames)
    assert sorted(swapped.channels) == sorted(plain.channels)
    for channel, block in right.items():
        other = (
            channel.translate(str.maketrans("", ""))
            .replace(".fl.", ".XX.")
            .replace(".fr.", ".fl.")
            .replace(".XX.", ".fr.")
        )
        np.testing.assert_array_equal(block.values, wrong[other].values)
    rear = open_driver(name, "bus", {"corners": ["rl", "rr"]})
    some, _ = decode_all(rear, frames)
    assert set(some) == {channel for channel in right if ".r" in channel[:10]}
    same_blocks(some, {channel: right[channel] for channel in some})
    same_frames(rear.encode(some), plain.encode(some)) if name != "zimmer" else None
    with pytest.raises(RigError) as caught:
        open_driver(name, "bus", {"corners": ["fl", "fl", "lf", "rr"]})
    assert len(caught.value.faults) == 2
    with pytest.raises(RigError, match="give a list"):
        open_driver(name, "bus", {"corners": "fl"})
