"""Messages in a stream of bytes: any chunks, any garbage, against a scanner that goes byte by byte."""

from __future__ import annotations

import itertools

import crccheck.crc
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.blocks import Block, Flag
from lacet.daq.frames import Frames
from lacet.drivers import open_driver
from lacet.drivers.sagem import HEAD, LENGTH, _scan
from tests.drivers.driver_cases import decode_all, plausible_blocks, same_blocks

DRIVER = open_driver("sagem", "serial0")


def message(counter: int, clock: int, fill: bytes = b"") -> bytes:
    """A good message built by hand; `fill` replaces the values."""
    body = HEAD[2:] + counter.to_bytes(2, "little") + clock.to_bytes(4, "little") + fill[:18].ljust(18, b"\1")
    return HEAD[:2] + body + crccheck.crc.Crc16CcittFalse.calc(body).to_bytes(2, "little")


def byte_by_byte(data: bytes) -> list[tuple[int, bool]]:
    """What the page says: search, believe the CRC, after a wrong one go on at the second byte."""
    found: list[tuple[int, bool]] = []
    suspect = None
    at = 0
    while at + LENGTH <= len(data):
        if suspect is not None and at >= suspect + LENGTH:
            found.append((suspect, False))
            suspect = None
        piece = data[at : at + LENGTH]
        if piece[:4] != HEAD:
            at += 1
        elif crccheck.crc.Crc16CcittFalse.calc(piece[2:28]).to_bytes(2, "little") == piece[28:]:
            found.append((at, True))
            suspect = None
            at += LENGTH
        else:
            suspect = at if suspect is None else suspect
            at += 1
    if suspect is not None:
        found.append((suspect, False))
    return found


good_messages = st.builds(message, st.integers(0, 65535), st.integers(0, 2**32 - 1), st.binary(max_size=18))
pieces = st.one_of(
    good_messages,
    good_messages.flatmap(lambda m: st.integers(0, LENGTH - 1).map(lambda n: m[:n])),
    good_messages.flatmap(lambda m: st.integers(0, LENGTH * 8 - 1).map(lambda b: flip(m, b))),
    # False heads in front of, and inside, good messages.
    st.builds(lambda m, n: HEAD[:n] + m, good_messages, st.integers(1, 4)),
    good_messages.map(lambda m: message(1, 2, HEAD + m)),
    st.builds(lambda a, n, b: a[:n] + b, good_messages, st.integers(4, 29), good_messages),
    st.binary(max_size=40),
    st.sampled_from([HEAD, HEAD * 3, HEAD[:1], HEAD[:2], HEAD[:3], b""]),
)
streams = st.lists(pieces, max_size=12).map(b"".join)


def flip(data: bytes, bit: int) -> bytes:
    out = bytearray(data)
    out[bit // 8] ^= 1 << bit % 8
    return bytes(out)


def chunks_of(data: bytes, cuts: list[int]) -> Frames:
    """The stream in pieces, stamped with a tenth of the place of their first bytes: they can be told apart."""
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return Frames.from_iter("serial0", [("", a // 10, 0, data[a:b]) for a, b in itertools.pairwise(edges)])


@settings(max_examples=300, deadline=None)
@given(data=streams)
def test_same_messages_as_byte_by_byte(data):
    found, good, _ = _scan(np.frombuffer(data, np.uint8), ended=True)
    assert list(zip(found.tolist(), good.tolist(), strict=True)) == byte_by_byte(data)


@settings(max_examples=200, deadline=None)
@given(data=streams, cuts=st.lists(st.integers(0, 500), max_size=25))
def test_any_chunks_give_the_same_samples(data, cuts):
    """One chunk a batch against the whole: values, flags, clock, ledger; stamps are those of the first byte's chunk."""
    one_stamp = Frames.from_iter("serial0", [("", 0, 0, data)])
    whole, counts = decode_all(DRIVER, one_stamp)
    chunks = chunks_of(data, cuts)
    state = DRIVER.start()
    parts: dict[str, list[Block]] = {}
    for i in range(len(chunks)):
        blocks, state = DRIVER.decode(chunks[i : i + 1], state)
        for block in blocks:
            parts.setdefault(block.channel, []).append(block)
    blocks, state = DRIVER.finish(state)
    for block in blocks:
        parts.setdefault(block.channel, []).append(block)
    assert DRIVER.counts(state) == counts
    assert counts["received"] == len(data)
    starts = np.array([at for at, _ in byte_by_byte(data)], int)
    stamps = chunks.t_ns[np.searchsorted(chunks.offset, starts, side="right") - 1]
    joined = {name: Block.concat(items) for name, items in parts.items()}
    if counts["repeated"] or counts["reordered"]:  # then not every message is a sample in its turn
        stamps = next(iter(joined.values())).t_ns if joined else stamps
    same_blocks(joined, {n: Block(n, stamps, block.values, block.flags, block.device_ns) for n, block in whole.items()})
    bytes_of_good = LENGTH * sum(good for _, good in byte_by_byte(data))
    assert counts["skipped_bytes"] == len(data) - bytes_of_good


@settings(max_examples=100, deadline=None)
@given(
    noise=st.lists(st.one_of(st.binary(max_size=20), st.sampled_from([HEAD, HEAD[:3], HEAD + b"\0" * 9])), max_size=4)
)
def test_no_good_message_behind_garbage_is_lost(noise):
    sent = plausible_blocks(DRIVER, 6, 1, device=True)
    encoded = DRIVER.encode(sent)
    data = b"".join((noise[i % len(noise)] if noise else b"") + encoded.frame(i).payload for i in range(len(encoded)))
    got, counts = decode_all(DRIVER, Frames.from_iter("serial0", [("", 5, 0, data)]))
    for name, block in got.items():
        good = (block.flags & np.uint8(Flag.CHECKSUM)) == 0
        assert np.abs(block.values[good] - sent[name].values).max() <= 0.00101
    assert counts["lost"] == 0


def test_a_message_is_delivered_as_soon_as_its_last_byte_is_there():
    data = message(1, 1)
    blocks, state = DRIVER.decode(Frames.from_iter("s", [("", 1, 0, data[:-1])]), DRIVER.start())
    assert not blocks
    blocks, _ = DRIVER.decode(Frames.from_iter("s", [("", 2, 0, data[-1:])]), state)
    assert [block.t_ns.tolist() for block in blocks] == [[1], [1], [1]]


def test_the_clock_is_unwrapped_and_broken_messages_do_not_move_it():
    broken = flip(message(2, 7), 8 * 7)
    data = message(0, 2**32 - 3000) + message(1, 2**32 - 1) + broken + message(3, 9999) + message(4, 15_000)
    got, counts = decode_all(DRIVER, Frames.from_iter("s", [("", 1, 0, data)]))
    block = got["imu.rate"]
    assert block.device_ns is not None
    steps = np.diff(block.device_ns) // 1000
    assert steps.tolist() == [2999, 0, 10_000, 5001]
    assert block.flags.tolist() == [0, 0, Flag.CHECKSUM, 0, 0]
    assert counts["lost"] == 0
    back, _ = decode_all(
        DRIVER, Frames.from_iter("s", [("", 1, 0, message(5, 9000) + message(6, 8000) + message(7, 9000))])
    )
    assert back["imu.rate"].flags.tolist() == [0, Flag.CLOCK, 0]


def test_a_restart_is_not_sixty_thousand_losses():
    data = message(5000, 10_000) + message(0, 15_000) + message(1, 20_000)
    got, counts = decode_all(DRIVER, Frames.from_iter("s", [("", 1, 0, data)]))
    assert got["imu.accel"].flags.tolist() == [0, Flag.GAP, 0]
    assert (counts["lost"], counts["restarts"]) == (0, 1)
