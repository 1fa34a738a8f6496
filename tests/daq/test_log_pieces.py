"""Channels read from a log by piece and by window of time are the same samples as the whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.blocks import Block
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.formats.mcap_read import McapScan

T0 = 1_700_000_000 * 10**9
NAMES = ("imu.rate", "laser.fl.hub")


def samples(channel: str, begin: int, n: int, step_ns: int) -> Block:
    t_ns = T0 + step_ns * np.arange(begin, begin + n)
    width = 3 if channel == "imu.rate" else 1
    values = np.sin(t_ns[:, None] / 1e9 + np.arange(width))
    device = t_ns - T0 if channel == "imu.rate" else None
    return Block(channel, t_ns, values, (np.arange(begin, begin + n) % 7 == 0).astype(np.uint8), device)


def write(path: Path, back: bool = False) -> Path:
    """Ten seconds of two channels; `back`: in the sixth the recorder's clock is set back by two."""
    with LogWriter(path, StartRecord("r", T0)) as log:
        for k in range(100):
            for name, n in zip(NAMES, (20, 25), strict=True):
                block = samples(name, n * k, n, 100_000_000 // n)
                t_ns = block.t_ns - 2_000_000_000 * (back and k >= 50)
                log.write_block(Block(name, t_ns, block.values, block.flags, block.device_ns))
    return path


def same(a: Block, b: Block) -> None:
    np.testing.assert_array_equal(a.t_ns, b.t_ns)
    np.testing.assert_array_equal(a.values, b.values)
    np.testing.assert_array_equal(a.flags, b.flags)
    assert (a.device_ns is None) == (b.device_ns is None)
    if a.device_ns is not None and b.device_ns is not None:
        np.testing.assert_array_equal(a.device_ns, b.device_ns)


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("seconds", [0.05, 0.73, 4.0, 100.0])
def test_pieces_joined_are_the_whole(tmp_path: Path, seconds: float, back: bool):
    reader = LogReader(write(tmp_path / "a.mcap", back))
    whole, pieces = reader.blocks(), list(reader.pieces(seconds))
    for name in NAMES:
        same(Block.concat([piece[name] for piece in pieces if name in piece]), whole[name])
    longest = max(np.ptp(block.t_ns) for piece in pieces for block in piece.values())
    assert longest <= (seconds + 0.1) * 1e9 + 2_000_000_000 * back
    assert [set(piece) for piece in reader.pieces(seconds, ["imu.rate"])] == [{"imu.rate"}] * len(pieces)


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize(
    ("start", "stop"), [(0.0, 10.0), (-5.0, 0.2), (3.31, 3.33), (3.0, 7.05), (9.95, 20.0), (11, 12)]
)
def test_a_window_is_that_of_the_whole(tmp_path: Path, start: float, stop: float, back: bool):
    reader = LogReader(write(tmp_path / "a.mcap", back))
    between = T0 + round(start * 1e9), T0 + round(stop * 1e9)
    found = reader.blocks(NAMES, between)
    for name, block in reader.blocks().items():
        inside = (block.t_ns >= between[0]) & (block.t_ns < between[1])
        assert (name in found) == inside.any()
        if inside.any():
            device = None if block.device_ns is None else block.device_ns[inside]
            same(found[name], Block(name, block.t_ns[inside], block.values[inside], block.flags[inside], device))


def test_a_window_reads_the_chunks_around_it_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    reader = LogReader(write(tmp_path / "a.mcap"))
    read: set[int] = set()
    plain = McapScan._segment

    def watched(self: McapScan, file: object, number: int) -> bytes:
        read.add(number)
        return plain(self, file, number)  # type: ignore[arg-type]

    monkeypatch.setattr(McapScan, "_segment", watched)
    assert len(reader.blocks(["imu.rate"], (T0 + 3_000_000_000, T0 + 3_300_000_000))["imu.rate"]) == 60
    assert 3 <= len(read) <= 6
    reader.blocks(["imu.rate"])
    assert len(read) > 90


def test_a_message_that_cannot_be_used_takes_no_other_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = write(tmp_path / "a.mcap")
    whole, messages = LogReader(path).blocks(), McapScan.messages

    def damaged(scan: McapScan, *args, **kwargs):
        found = list(messages(scan, *args, **kwargs))
        return (one if len(found) < 100 or i != 40 else one._replace(data=b"\xff") for i, one in enumerate(found))

    monkeypatch.setattr(McapScan, "messages", damaged)
    reader = LogReader(path)
    found = reader.blocks()
    lost = {name: len(whole[name]) - len(found[name]) for name in NAMES}
    assert sorted(lost.values()) == [0, 20]
    assert any("imu/rate: 1 messages cannot be used" in line for line in reader.damage)
