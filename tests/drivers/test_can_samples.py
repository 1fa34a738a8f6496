"""Samples of several messages: what is missing, wrong, foreign or out of order."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.blocks import Flag
from lacet.daq.frames import Frames
from lacet.drivers import open_driver
from tests.drivers.driver_cases import decode_all, plausible_blocks, same_blocks

IGEL = open_driver("igel", "can0", {"corners": ["fl"]})
SENT = plausible_blocks(IGEL, 6, 1)
FRAMES = list(IGEL.encode(SENT))


def decode(frames):
    return decode_all(IGEL, Frames.from_iter("can0", frames))


def test_three_frames_a_sample_in_order():
    assert [frame.ident for frame in FRAMES[:6]] == [0x110, 0x111, 0x112] * 2
    assert [frame.payload[4] & 0xF for frame in FRAMES[2::3]] == list(range(6))


@pytest.mark.parametrize("part", [0, 1, 2])
@pytest.mark.parametrize("sample", [0, 2, 5])
def test_one_frame_missing(sample, part):
    got, counts = decode([frame for i, frame in enumerate(FRAMES) if i != 3 * sample + part])
    for block in got.values():
        expected = [0] * 6
        expected[sample] = Flag.INCOMPLETE
        assert block.flags.tolist() == expected
        assert np.isnan(block.values[sample]).all()
        assert np.isfinite(np.delete(block.values, sample, axis=0)).all()
    # The incomplete sample is not counted as lost as well.
    assert (counts["incomplete"], counts["lost"], counts["samples"]) == (1, 0, 6)


def test_stamp_of_the_first_frame():
    late = [frame._replace(t_ns=frame.t_ns + 150_000 * (i % 3)) for i, frame in enumerate(FRAMES)]
    got, _ = decode(late)
    np.testing.assert_array_equal(got["wheel.fl.angle"].t_ns, SENT["wheel.fl.angle"].t_ns)


@pytest.mark.parametrize("i", range(3))
@pytest.mark.parametrize("bit", [0, 17, 44])
def test_one_bit_wrong_anywhere_spoils_the_whole_sample(i, bit):
    payload = bytearray(FRAMES[3 + i].payload)
    payload[bit // 8] ^= 1 << bit % 8
    got, counts = decode([*FRAMES[: 3 + i], FRAMES[3 + i]._replace(payload=bytes(payload)), *FRAMES[4 + i :]])
    for block in got.values():
        assert block.flags.tolist() == [0, Flag.CHECKSUM, 0, 0, 0, 0]
        assert np.isnan(block.values[1]).all()
    assert (counts["bad_checksum"], counts["lost"]) == (1, 0)


@pytest.mark.parametrize("length", [0, 3, 5, 7, 8, 64])
def test_a_frame_of_the_wrong_length(length):
    wrong = FRAMES[4]._replace(payload=FRAMES[4].payload.ljust(64, b"\0")[:length])
    got, counts = decode([*FRAMES[:4], wrong, *FRAMES[5:]])
    assert got["wheel.fl.force"].flags.tolist() == [0, Flag.INCOMPLETE, 0, 0, 0, 0]
    assert (counts["bad_length"], counts["incomplete"]) == (1, 1)


def test_foreign_frames_are_passed_over():
    foreign = [FRAMES[0]._replace(ident=ident) for ident in (0, 0x10F, 0x113, 0x120, 0x7FF, 2**29 - 1)]
    mixed = [frame for pair in zip(FRAMES, foreign * 3, strict=True) for frame in pair]
    got, counts = decode(mixed)
    clean, clean_counts = decode(FRAMES)
    same_blocks(got, clean)
    assert counts == clean_counts


def test_a_mixture_of_two_samples_is_caught():
    got, counts = decode([FRAMES[0], FRAMES[4], FRAMES[5], *FRAMES[6:]])
    assert got["wheel.fl.force"].flags.tolist() == [Flag.CHECKSUM, 0, 0, 0, 0]
    assert counts["bad_checksum"] == 1


def test_a_sample_is_delivered_with_its_last_frame():
    state = IGEL.start()
    for i, frame in enumerate(FRAMES[:3]):
        blocks, state = IGEL.decode(Frames.from_iter("can0", [frame]), state)
        assert len(blocks) == (4 if i == 2 else 0)


def test_states_are_values():
    batch = Frames.from_iter("can0", FRAMES[:4])
    _, state = IGEL.decode(batch, IGEL.start())
    rest = Frames.from_iter("can0", FRAMES[4:])
    first, _ = IGEL.decode(rest, state)
    again, _ = IGEL.decode(rest, state)
    same_blocks({block.channel: block for block in first}, {block.channel: block for block in again})


def test_the_wheel_angle_runs_round():
    block = SENT["wheel.fl.angle"]
    turning = np.linspace(-20, 20, 6)[:, None]
    sent = {**SENT, "wheel.fl.angle": type(block)("wheel.fl.angle", block.t_ns, turning, block.flags)}
    got, _ = decode_all(IGEL, IGEL.encode(sent))
    angle = got["wheel.fl.angle"].values
    assert ((angle >= 0) & (angle < 2 * np.pi)).all()
    assert np.abs(np.exp(1j * angle) - np.exp(1j * turning)).max() < 5e-5
    assert not got["wheel.fl.angle"].flags.any()


def test_each_laser_answers_for_itself():
    lasers = open_driver("lasers", "can1")
    sent = plausible_blocks(lasers, 4, 2)
    block = sent["laser.rl.hub"]
    sent["laser.rl.hub"] = type(block)(block.channel, block.t_ns, np.full((4, 1), np.nan), block.flags)
    got, counts = decode_all(lasers, lasers.encode(sent))
    assert (got["laser.rl.hub"].flags == Flag.STATUS).all()
    assert not got["laser.rl.ground"].flags.any()
    assert counts["bad_status"] == 4


def test_lasers_and_correvit_share_a_bus():
    lasers, correvit = open_driver("lasers", "can1"), open_driver("correvit", "can1")
    a, b = lasers.encode(plausible_blocks(lasers, 5, 2)), correvit.encode(plausible_blocks(correvit, 5, 2))
    both = Frames.concat("can1", [a, b])
    for driver, own in ((lasers, a), (correvit, b)):
        same_blocks(decode_all(driver, both)[0], decode_all(driver, own)[0])
        assert decode_all(driver, both)[1]["received"] == len(own)
