"""Blocks and spoilt frames that the driver tests share."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.frames import Frames
from lacet.drivers.framework.base import Driver

PLAUSIBLE = {
    "wheel.force": (-15_000, 15_000),
    "wheel.moment": (-3_000, 3_000),
    "wheel.angle": (0, 6.283),
    "wheel.speed": (-120, 120),
    "imu.accel": (-40, 40),
    "imu.rate": (-2, 2),
    "imu.attitude": (-1.5, 1.5),
    "laser.ground": (0.1, 1.2),
    "laser.hub": (0.05, 0.6),
    "camera.steer": (-0.7, 0.7),
    "camera.camber": (-0.2, 0.2),
    "correvit.speed": (-70, 70),
    "suspension.travel": (-0.15, 0.15),
    "damper.travel": (-0.15, 0.15),
    "damper.force": (-8_000, 8_000),
    "pushrod.force": (-15_000, 15_000),
    "hub.load": (0, 15_000),
    "hub.accel": (-300, 300),
    "scale.load": (0, 15_000),
    "shaft.torque": (-3_000, 3_000),
    "brake.torque": (-3_000, 3_000),
    "brake.pressure": (0, 2e7),
    "steering.angle": (-12, 12),
    "steering.torque": (-50, 50),
    "engine.speed": (0, 800),
    "engine.throttle": (0, 1),
    "car.speed": (-70, 70),
    "car.longitudinal_accel": (-20, 20),
    "car.lateral_accel": (-20, 20),
    "car.vertical_accel": (-40, 40),
    "car.roll_rate": (-2, 2),
    "car.pitch_rate": (-2, 2),
    "car.yaw_rate": (-2, 2),
    "gnss.latitude": (-1.5, 1.5),
    "gnss.longitude": (-3.1, 3.1),
    "gnss.altitude": (-100, 4_000),
    "gnss.speed": (0, 70),
    "gnss.course": (0, 6.283),
}
"""Range of each channel family on a car, SI units."""
START_NS = 1_700_000_000_000_000_000


def plausible_blocks(driver: Driver, n: int, seed: int, device: bool = False) -> dict[str, Block]:
    """Random samples within the range of each channel, on strictly increasing stamps; no flags."""
    rng = np.random.default_rng(seed)
    blocks = {}
    t_ns = START_NS + np.cumsum(rng.integers(1_000_000, 11_000_000, n))
    device_ns = np.cumsum(rng.integers(1_000, 11_000, n)) * 1000 if device else None
    for name in driver.channels:
        channel = CHANNELS[name]
        low, high = PLAUSIBLE[channel.family]
        values = rng.uniform(low, high, (n, channel.width))
        blocks[name] = Block(name, t_ns, values, np.zeros(n, np.uint8), device_ns)
    return blocks


def spoil(frames: Frames, rng: np.random.Generator, ident_pool: Sequence[int] = ()) -> Frames:
    """Drop, repeat, shorten, lengthen, swap and bit-flip frames, each with some probability; add foreign ones."""
    out = []
    for frame in frames:
        fate = rng.random()
        payload = bytearray(frame.payload)
        if fate < 0.06:
            continue
        if fate < 0.12 and payload:
            payload[rng.integers(len(payload))] ^= 1 << int(rng.integers(8))
        elif fate < 0.15:
            payload = payload[: rng.integers(len(payload) + 1)]
        elif fate < 0.17:
            payload += rng.bytes(int(rng.integers(1, 40)))
        elif fate < 0.19:
            out.append(frame)
        elif fate < 0.22:
            ident = int(rng.choice(ident_pool)) if len(ident_pool) else 0
            out.append(frame._replace(ident=ident, payload=rng.bytes(int(rng.integers(70)))))
        out.append(frame._replace(payload=bytes(payload)))
        if fate > 0.97 and len(out) > 1:
            out[-1], out[-2] = out[-2], out[-1]
    return Frames.from_iter(frames.source, out)


def decode_split(driver: Driver, frames: Frames, cuts: Iterable[int]) -> tuple[dict[str, Block], dict[str, int]]:
    """Decode in batches that end at `cuts`; all samples by channel, and the ledger."""
    state = driver.start()
    found: dict[str, list[Block]] = {}
    edges = [0, *sorted(cut for cut in cuts if cut < len(frames)), len(frames)]
    for a, b in itertools.pairwise(edges):
        blocks, state = driver.decode(frames[a:b], state)
        assert len({block.channel for block in blocks}) == len(blocks)
        for block in blocks:
            found.setdefault(block.channel, []).append(block)
    blocks, state = driver.finish(state)
    for block in blocks:
        found.setdefault(block.channel, []).append(block)
    return {name: Block.concat(parts) for name, parts in found.items()}, driver.counts(state)


def decode_all(driver: Driver, frames: Frames) -> tuple[dict[str, Block], dict[str, int]]:
    """Decode in one batch."""
    return decode_split(driver, frames, ())


def same_blocks(a: dict[str, Block], b: dict[str, Block]) -> None:
    """Assert that two decodings are equal to the last bit."""
    assert set(a) == set(b)
    for name, block in a.items():
        other = b[name]
        np.testing.assert_array_equal(block.t_ns, other.t_ns, err_msg=name)
        np.testing.assert_array_equal(block.flags, other.flags, err_msg=name)
        np.testing.assert_array_equal(block.values, other.values, err_msg=name)
        if block.device_ns is None or other.device_ns is None:
            assert block.device_ns is other.device_ns
        else:
            np.testing.assert_array_equal(block.device_ns, other.device_ns, err_msg=name)


def same_frames(a: Frames, b: Frames) -> None:
    """Assert that two batches are equal to the last bit."""
    for field in ("t_ns", "ident", "offset", "data"):
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field), err_msg=field)
