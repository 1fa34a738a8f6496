"""A log opened as a run: stamps on the clock that the rig asks for, faults told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.blocks import Block, Flag
from lacet.daq.errors import RunError
from lacet.daq.formats.log import LogWriter, StartRecord
from lacet.daq.formats.open_run import open_run
from lacet.daq.frames import Frames
from lacet.daq.run import Run

T0 = 1_700_000_000 * 10**9
RIG = """
format = "lacet-rig 1"
name = "bench"
wheel_reference = "hub"
[[sensor]]
name = "imu"
channels = ["imu.*"]
position = [0.0, 0.0, 0.0]
clock = "{clock}"
"""


def log(path: Path, block: Block, clock: str = "device") -> Path:
    start = StartRecord("r", T0, "", RIG.format(clock=clock), vehicle="406", manoeuvre="sine", brakes="off")
    with LogWriter(path, start, overwrite=True) as writer:
        writer.write_block(block)
    return path


def late_block(n: int = 6000) -> tuple[np.ndarray, Block]:
    """Samples at 200 Hz handed over every 16 ms."""
    true = T0 + np.arange(n) * 5_000_000
    arrival = -(-(true + 500_000) // 16_000_000) * 16_000_000
    values = np.sin((true - T0)[:, None] / 1e9 * np.ones(3))
    return true, Block(
        "imu.rate", arrival, values, np.zeros(n, np.uint8), np.rint((true - T0) * (1 - 4e-5)).astype(int)
    )


def test_device_clock_of_the_rig(tmp_path: Path):
    true, block = late_block()
    run = open_run(log(tmp_path / "sine.mcap", block))
    signal = run.signals["imu.rate"]
    assert len(signal.t) == len(true)
    assert (np.diff(signal.t) > 0).all()
    assert np.std(signal.t - (true - T0) / 1e9) < 50e-6
    assert (run.name, run.vehicle, run.manoeuvre, run.brakes, run.wheel_reference) == (
        "sine", "406", "sine", "off", "contact",
    )  # fmt: skip
    assert run.problems == ()


def test_arrivals_that_share_a_stamp_are_spread_and_said(tmp_path: Path):
    true, block = late_block()
    run = open_run(log(tmp_path / "sine.mcap", block, "arrival"))
    signal = run.signals["imu.rate"]
    assert len(signal.t) == len(true) == 6000
    assert (np.diff(signal.t) > 0).all()
    (line,) = run.problems
    assert line.startswith("imu.rate (4,125 of 6,000): samples that came together, with one stamp, are spread over")
    assert 'clock = "device" in the row imu of the rig' in line


def test_wrong_stamps_and_jumps_are_told(tmp_path: Path):
    true, block = late_block()
    assert block.device_ns is not None
    device = block.device_ns.copy()
    device[1000] += 10**10
    device[4000:] -= 15 * 10**9
    flags = block.flags.copy()
    flags[2000] = Flag.CHECKSUM
    run = open_run(log(tmp_path / "sine.mcap", Block("imu.rate", block.t_ns, block.values, flags, device)))
    text = "\n".join(run.problems)
    assert "1 samples with a wrong device stamp" in text
    assert "jumped at sample 4000" in text
    signal = run.signals["imu.rate"]
    assert (np.diff(signal.t) > 0).all()
    kept = np.searchsorted(true - T0, np.rint(signal.t[signal.usable] * 1e9) - 3_000_000)
    assert len(np.unique(kept)) >= len(true) - 10


def test_a_clock_that_cannot_be_followed_is_told_and_flagged(tmp_path: Path):
    """A bent clock, 100 ms off in the middle: where no line fits, samples are left out."""
    true, block = late_block(24_000)
    assert block.device_ns is not None
    bend = np.rint(1e8 * np.sin(np.pi * np.linspace(0.0, 1.0, len(true)))).astype(int)
    path = log(tmp_path / "r.mcap", Block("imu.rate", block.t_ns, block.values, block.flags, block.device_ns + bend))
    run = open_run(path)
    signal = run.signals["imu.rate"]
    assert len(signal.t) == len(true)
    assert any("its clock does not run evenly" in line for line in run.problems)
    assert not any("samples that came together" in line for line in run.problems)
    kept = signal.usable
    # Where the clock is right by its arrivals the samples kept are, too, whatever the run's beginning is.
    off = signal.t[kept] - (true[kept] - T0) / 1e9
    assert np.ptp(off) < 0.02
    assert np.count_nonzero(kept) > 1_000
    assert np.count_nonzero(~kept) > 0


def test_a_fast_clock_is_followed_and_told(tmp_path: Path):
    true, block = late_block()
    device = np.rint((true - T0) * 1.002).astype(int)
    run = open_run(log(tmp_path / "r.mcap", Block("imu.rate", block.t_ns, block.values, block.flags, device)))
    assert any("ppm off" in line for line in run.problems)
    signal = run.signals["imu.rate"]
    assert signal.usable.all()
    assert np.std(signal.t - (true - T0) / 1e9) < 50e-6


def steady_run(path: Path, true: np.ndarray) -> Run:
    """The run of a wheel that samples at these instants, read with the clock ``steady``."""
    arrival = np.maximum.accumulate(true + np.random.default_rng(0).integers(0, 5_000_000, len(true)))
    rig = RIG.replace("imu.*", "wheel.fl.*").replace('"imu"', '"hub"').replace("{clock}", "steady")
    start = StartRecord("r", T0, "", rig, vehicle="406", manoeuvre="sine", brakes="off")
    with LogWriter(path, start, overwrite=True) as writer:
        writer.write_block(Block("wheel.fl.force", arrival, np.zeros((len(true), 3)), np.zeros(len(true), np.uint8)))
    return open_run(path)


def test_a_steady_rate_that_is_none_is_told_and_flagged(tmp_path: Path):
    number = np.arange(60_000)
    run = steady_run(tmp_path / "r.mcap", T0 + number * 2_000_000 + np.rint(1e8 * (number / 60_000) ** 2).astype(int))
    assert any("its rate is not constant" in line for line in run.problems)
    assert 0 < np.count_nonzero(run.signals["wheel.fl.force"].usable) < 60_000


def test_a_loss_that_the_counter_does_not_show_is_told_and_flagged(tmp_path: Path):
    number = np.arange(12_000) + 160 * (np.arange(12_000) >= 7_000)
    true = T0 + number * 2_000_000
    run = steady_run(tmp_path / "r.mcap", true)
    signal = run.signals["wheel.fl.force"]
    assert any("160 samples that the counter does not show" in line for line in run.problems)
    assert np.flatnonzero(signal.flags & int(Flag.GAP)).tolist() == [7_000]
    assert np.max(np.abs(signal.t - (true - true[0]) / 1e9)) < 1e-3


def test_a_capture_is_no_run(tmp_path: Path):
    with LogWriter(tmp_path / "raw.mcap", StartRecord("r", T0)) as writer:
        writer.write_frames(Frames.from_iter("can0", [("can0", T0, 1, b"x")]))
    with pytest.raises(RunError, match="lacet decode"):
        open_run(tmp_path / "raw.mcap")
