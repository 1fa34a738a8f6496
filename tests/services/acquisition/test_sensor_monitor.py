"""What a sensor does is seen within a second, by name, on a clock of the test's own."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from lacet.daq.blocks import Block, Flag
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.events import EventKind
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.drivers import open_driver
from lacet.services.acquisition.recorder import Health, Recorder
from lacet.services.acquisition.sensor_monitor import SensorMonitor, SensorState, Watched
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.render.live_line import live_text
from tests.support.correvit_wire import CORREVIT, CorrevitWire

T0 = 1_700_000_000_000_000_000
BATCH = 0.1
WHEELS = tuple(f"wheel.{corner}.{what}" for corner in ("fl", "fr") for what in ("force", "angle", "speed"))
SENSORS = (
    Watched("wheels", "can0", dict.fromkeys(WHEELS, 500.0), numbered=True),
    Watched("lasers", "can1", {"laser.fl.hub": 250.0}),
    Watched("correvit", "can1", {"correvit.speed": 250.0}),
    Watched("imu", "serial0", {"imu.rate": 200.0}),
    Watched("gnss", "serial1", {"gnss.speed": None}),
)
NOISE = {"wheel.force": (1.0, 30.0), "wheel.speed": (0.005, 0.01), "correvit.speed": (0.01, 0.02)}


class Bench:
    """A car with five sensors whose samples a test may alter, in time of its own."""

    def __init__(self, seed: int = 0):
        self.now = 0.0
        self.monitor = SensorMonitor(SENSORS, 0.0)
        self.told: list[tuple[float, str, SensorState, str]] = []
        self.rng = np.random.default_rng(seed)
        self.speed = 20.0
        self.sent: dict[str, int] = {}

    def run(self, seconds: float, alter: Callable[[str, Block], Sequence[Block]] = lambda channel, block: [block]):
        """Go on for a time; `alter` gets each channel's samples and gives those that come."""
        for _ in range(round(seconds / BATCH)):
            self.now = round(self.now + BATCH, 6)
            for one in SENSORS:
                for channel in one.rates:
                    block = self.block(channel)
                    self.monitor.take([b for b in alter(channel, block) if len(b)], self.now)
            self.told += [(self.now, name, s.state, str(s)) for name, s in self.monitor.check(self.now)]

    def block(self, channel: str) -> Block:
        one = CHANNELS[channel]
        rate = 10.0 if channel == "gnss.speed" else one.rate
        n = round(BATCH * rate)
        t = (self.now - BATCH) + (np.arange(n) + 0.5) / rate
        step, sigma = NOISE.get(one.family, (1e-4, 5e-4))
        level = {"wheel.speed": self.speed / 0.3, "correvit.speed": self.speed, "gnss.speed": self.speed}
        mean = (t * self.speed / 0.3) % 6.28 if one.family == "wheel.angle" else level.get(one.family, 0.0) + 0.0 * t
        if self.speed == 0.0:
            sigma = 0.0
        values = np.rint((mean[:, None] + self.rng.normal(0.0, sigma, (n, one.width))) / step) * step
        t_ns = T0 + np.rint(t * 1e9).astype(np.int64)
        device = t_ns - T0 + 5 * 10**9 if channel.startswith("imu") else None
        return Block(channel, t_ns + self.rng.integers(0, 1_000_000, n), values, np.zeros(n, np.uint8), device)


def only(sensor: str, change: Callable[[Block], Sequence[Block]]) -> Callable[[str, Block], Sequence[Block]]:
    """Alter the channels whose name begins so."""
    return lambda channel, block: change(block) if channel.startswith(sensor) else [block]


def part(block: Block, index) -> Block:
    device = None if block.device_ns is None else block.device_ns[index]
    return Block(block.channel, block.t_ns[index], block.values[index], block.flags[index], device)


def test_a_car_that_drives_and_stands_says_nothing():
    bench = Bench()
    bench.run(12.0)
    bench.speed = 0.0
    bench.run(8.0)
    bench.speed = 20.0
    bench.run(8.0)
    assert bench.told == []
    assert {s.state for s in bench.monitor.status.values()} == {SensorState.RUNNING}
    assert bench.monitor.hidden_losses() == {}


FAULTS = {
    "silent": ("laser", lambda block: [], "lasers", SensorState.SILENT, "silent (nothing for 0.5 s)"),
    "one wheel silent": ("wheel.fl", lambda block: [], "wheels", SensorState.SILENT, "wheel.fl: nothing for 0.5 s"),
    "slow": ("laser", lambda block: [part(block, slice(None, None, 2))], "lasers", SensorState.SLOW, "instead of 250"),
    "babbling": ("correvit", lambda block: [block, block], "correvit", SensorState.BABBLING, "instead of 250"),
    "stuck": (
        "wheel.fl.force", lambda block: [Block(block.channel, block.t_ns, 0.0 * block.values + 7.0, block.flags)],
        "wheels", SensorState.STUCK, "wheel.fl.force: x, y, z stands still in the moving car",
    ),
    "stuck angle": (
        "wheel.fr.angle", lambda block: [Block(block.channel, block.t_ns, 0.0 * block.values + 7.0, block.flags)],
        "wheels", SensorState.STUCK, "wheel.fr.angle: value stands still in the moving car",
    ),
    "clock": (
        "imu", lambda block: [Block(block.channel, block.t_ns, block.values, block.flags, block.device_ns + 10**9)],
        "imu", SensorState.CLOCK, "it jumped by +1.000 s",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_seen_within_a_second_by_name_and_so_is_its_end(fault):
    prefix, change, sensor, state, text = FAULTS[fault]
    bench = Bench()
    bench.run(12.0)
    bench.run(2.0, only(prefix, change))
    when, name, found, said = bench.told[0]
    assert (name, found) == (sensor, state)
    assert text in said
    assert when - 12.0 <= 1.0 + 1e-6
    bench.run(6.0)
    ends = [told for told in bench.told if told[2] == SensorState.RUNNING]
    assert {told[1] for told in bench.told} == {sensor}
    if state != SensorState.CLOCK:  # the clock jumps back then
        assert len(bench.told) == 2
        assert ends[0][0] - 14.0 <= 2.2


@pytest.mark.parametrize("step", [5, 10, 15, 19, 40, -5, -10, -15, -19, -40])
@pytest.mark.parametrize("jitter", [1, 5])
def test_a_step_of_a_sensor_s_clock_is_seen_within_a_second(step: int, jitter: int):
    bench = Bench(seed=step % 7)

    def late(block: Block, by_ms: int = 0) -> list[Block]:
        delays = bench.rng.integers(0, 1_000_000 * jitter, len(block))
        t_ns = np.maximum.accumulate(block.device_ns + T0 - 5 * 10**9 + delays)
        return [Block(block.channel, t_ns, block.values, block.flags, block.device_ns + by_ms * 1_000_000)]

    bench.run(12.0, only("imu", late))
    assert bench.told == []
    bench.run(4.0, only("imu", lambda block: late(block, step)))
    when, name, state, said = bench.told[0]
    assert (name, state) == ("imu", SensorState.CLOCK)
    assert when - 12.0 <= 1.0 + 1e-6
    size = float(said.split("jumped by ")[1].split(" s")[0])
    assert abs(1e3 * size - step) <= 2.0
    assert [told[2] for told in bench.told[1:]] == [SensorState.RUNNING]


def test_lost_samples_and_late_ones_are_no_steps_of_a_clock():
    bench = Bench()

    def worn(block: Block) -> list[Block]:
        came = bench.rng.random(len(block)) > 0.02
        came[0] = True
        kept = part(block, came)
        gap = np.where(np.concatenate(([False], ~came[:-1]))[came], np.uint8(Flag.GAP), np.uint8(0))
        late = 4_000_000 if 9.0 < bench.now < 12.0 else 0
        return [Block(kept.channel, kept.t_ns + late, kept.values, gap, kept.device_ns)]

    bench.run(20.0, only("imu", worn))
    assert bench.told == []


def test_a_sensor_that_never_came_is_named_after_a_second():
    bench = Bench()
    bench.run(1.2, only("laser", lambda block: []))
    assert [told[1:] for told in bench.told] == [("lasers", SensorState.SILENT, "silent (nothing has come yet)")]
    assert bench.told[0][0] <= 1.1


def test_samples_that_were_held_back_are_no_babbling():
    """A reader stalls for 3 s, then everything comes at once."""
    bench = Bench()
    bench.run(8.0)
    held: list[Block] = []
    bench.run(3.0, only("imu", lambda block: held.append(block) or []))
    bench.run(0.1, only("imu", lambda block: [Block.concat([*held, block])]))
    bench.run(4.0)
    assert [(name, state) for _, name, state, _ in bench.told] == [
        ("imu", SensorState.SILENT), ("imu", SensorState.RUNNING),
    ]  # fmt: skip


def test_a_learned_rate_is_watched_too():
    bench = Bench()
    bench.run(8.0)
    bench.run(3.0, only("gnss", lambda block: []))
    assert [(name, state) for _, name, state, _ in bench.told] == [("gnss", SensorState.SILENT)]


@pytest.mark.parametrize("lost", [16, 48, 160])
def test_losses_that_a_counter_of_four_bits_hides_are_counted(lost):
    bench = Bench()
    bench.run(5.0)
    # All later samples of one wheel are `lost` numbers on: they come that much later than their count says.
    gone = {channel: lost for channel in WHEELS if ".fl." in channel}

    def late(channel: str, block: Block) -> list[Block]:
        n = min(gone.get(channel, 0), len(block))
        if n:
            gone[channel] -= n
        return [part(block, slice(n, None))]

    bench.run(3.0, late)
    assert bench.monitor.hidden_losses() == {"can0": lost}
    assert [told for told in bench.told if told[2] != SensorState.RUNNING and lost < 100] == []
    bench.run(5.0)
    assert bench.monitor.hidden_losses() == {"can0": lost}


@pytest.mark.parametrize("every", [2, 5])
def test_another_rate_is_no_hidden_loss(every):
    bench = Bench()
    bench.run(8.0, only("wheel", lambda block: [part(block, slice(None, None, every))]))
    assert bench.monitor.hidden_losses() == {}


def test_a_rate_three_times_the_nominal_in_batches_of_any_length_is_no_hidden_loss():
    bench = Bench()
    rest: dict[str, Block] = {}

    def fast(channel: str, block: Block) -> list[Block]:
        if not channel.startswith("wheel"):
            return [block]
        t_ns = block.t_ns[0] + np.arange(3 * len(block)) * 2_000_000 // 3
        flags = np.zeros(len(t_ns), np.uint8)
        came = Block(channel, t_ns, block.values.repeat(3, 0), flags)
        whole = Block.concat([rest[channel], came] if channel in rest else [came])
        n = len(whole) - int(bench.rng.integers(0, 120))
        rest[channel] = part(whole, slice(n, None))
        return [part(whole, slice(n))]

    bench.run(8.0, fast)
    assert bench.monitor.hidden_losses() == {}


def test_a_delay_that_passes_is_no_loss():
    bench = Bench()
    bench.run(5.0)
    bench.run(0.2, lambda channel, block: [Block(channel, block.t_ns + 60_000_000, block.values, block.flags)])
    bench.run(5.0)
    assert bench.monitor.hidden_losses() == {}


RIG = (
    """
format = "lacet-rig 1"
name = "bench"
wheel_reference = "hub"
[bus.can0]
kind = "can"
[[sensor]]
name = "lasers"
driver = "lasers"
bus = "can0"
channels = ["laser.*"]
axes = "body"
position_from_wheel_centre = [0.0, 0.0, 0.30]
"""
    + CORREVIT
)


def test_the_states_are_in_the_log_the_ledger_and_the_live_line(tmp_path: Path):
    rig, told, seen, wire = Rig.parse(RIG), list[str](), list[Health](), CorrevitWire(batch=50)
    log = LogWriter(tmp_path / "run.mcap", StartRecord("r", T0, "", rig.text))
    recorder = Recorder([wire], Decoder(rig), log, notify=told.append, report=seen.append)
    summary = recorder.run(Event(), duration=1.9)
    assert "sensor lasers: silent (nothing has come yet)" in told
    assert any(line.startswith("sensor correvit: babbling (") for line in told)
    reader = LogReader(tmp_path / "run.mcap")
    states = {(one.name, one.state) for one in reader.events() if one.kind == EventKind.SENSOR}
    assert states == {("lasers", "silent"), ("correvit", "babbling")}
    assert seen[-1].sensors["lasers"].state == SensorState.SILENT
    line = live_text(seen[-1]).splitlines()[1]
    assert re.fullmatch(r"  lasers SILENT 0/250; correvit BABBLING \d+/250", line), line
    # What babbles is recorded whole.
    assert summary.frames == {"can0": wire.sent}
    assert summary.samples["correvit.speed"] == wire.sent


def test_a_driver_that_fails_ends_its_own_sensor_and_not_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Anybody may have written it: all frames are stored, and what other drivers decode of the same bus."""
    rig, told, wire = Rig.parse(RIG), list[str](), CorrevitWire()
    batches = itertools.count()

    def fails(self: object, frames: Frames, state: object) -> tuple[list[Block], object]:
        if next(batches) == 3:
            raise KeyError("a frame that nobody thought of")
        return [], state

    monkeypatch.setattr(type(open_driver("lasers", "can0")), "decode", fails)
    log = LogWriter(tmp_path / "run.mcap", StartRecord("r", T0, "", rig.text))
    summary = Recorder([wire], Decoder(rig), log, notify=told.append).run(Event(), duration=1.0)
    assert summary.frames == {"can0": wire.sent}
    assert summary.samples["correvit.speed"] == wire.sent
    assert 0 < summary.losses["can0"]["driver_failed"] < wire.sent
    said = [line for line in told if "driver failed" in line]
    assert said == [line for line in said if line.startswith("sensor lasers: its driver failed: KeyError: 'a frame")]
    assert len(said) == 1
    states = [(one.name, one.state) for one in LogReader(tmp_path / "run.mcap").events() if one.state == "failed"]
    assert states == [("lasers", "failed")]
    assert next(batches) == 4  # it is not asked again
