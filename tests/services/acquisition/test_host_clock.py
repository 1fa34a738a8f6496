"""The recording machine's clock is set in mid-run: no stamp follows, it is named, and no sensor is blamed."""

from __future__ import annotations

import os
import time
from pathlib import Path
from threading import Event as Flag

import numpy as np
import pytest

from lacet.daq.formats.events import EventKind
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.formats.log_run import build_run
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.drivers import open_driver
from lacet.services.acquisition.host_clock import (
    STEP_NS,
    HostClock,
    describe_synchronisation,
    synchronisation,
    time_sources,
)
from lacet.services.acquisition.recorder import Recorder
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.workspace.decode import decode_log
from tests.drivers.driver_cases import plausible_blocks

T0 = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
RIG = """
format = "lacet-rig 1"
name = "bench"
wheel_reference = "hub"
[bus.can0]
kind = "can"
[[sensor]]
name = "wheels"
driver = "igel"
bus = "can0"
channels = ["wheel.*"]
axes = "carrier"
clock = "steady"
"""


class Machine:
    """Two clocks that a test moves, and a host clock that reads them."""

    def __init__(self) -> None:
        self.time, self.offset = 0, T0
        self.clock = HostClock(lambda: self.time + self.offset, lambda: self.time)

    def receive(self, *ages_ns: int, before: int = 0) -> np.ndarray:
        """Stamps made of frames that arrived so long ago, the first `before` of them before the last step."""
        stamps = [self.time - age + (self.was if i < before else self.offset) for i, age in enumerate(ages_ns)]
        frames = Frames.from_iter("can0", [("can0", t, 1, b"") for t in stamps])
        return self.clock.without_steps(frames).t_ns - T0

    def step(self, by_ns: int) -> None:
        self.was, self.offset = self.offset, self.offset + by_ns


@pytest.mark.parametrize("step", [-3600 * SECOND, -SECOND, -50_000_000, 50_000_000, SECOND, 86_400 * SECOND])
def test_stamps_go_on_through_a_step(step):
    machine = Machine()
    machine.time = SECOND
    assert machine.receive(2_000_000, 1_000_000).tolist() == [SECOND - 2_000_000, SECOND - 1_000_000]
    machine.step(step)
    machine.time += 10_000_000
    # Of one batch, frames stamped before the step and after it.
    ages = 8_000_000, 6_000_000, 2_000_000, 1_000_000
    assert machine.receive(*ages, before=2).tolist() == [machine.time - age for age in ages]
    machine.time += 5 * SECOND
    assert machine.receive(3_000_000).tolist() == [machine.time - 3_000_000]
    assert machine.clock.now_ns() == T0 + machine.time
    (found,) = machine.clock.steps
    assert found.step_ns == step
    assert found.t_ns - T0 == pytest.approx(SECOND + 10_000_000, abs=1)


def test_what_is_smaller_than_a_step_stays_in_the_stamps():
    machine = Machine()
    machine.step(STEP_NS // 2)
    machine.time = SECOND
    assert machine.receive(0).tolist() == [SECOND + STEP_NS // 2]
    assert machine.clock.steps == ()


def test_a_busy_machine_does_not_make_a_step():
    """Between reading one clock and the other 50 ms go by, once."""
    times = iter([0, 0, 1000, 1_000_000_000, 1_050_000_000, 1_050_001_000, 1_050_002_000, 1_050_003_000])
    walls = iter([T0, T0 + 1_050_000_000, T0 + 1_050_001_500])
    clock = HostClock(lambda: next(walls), lambda: next(times))
    assert abs(clock.now_ns() - T0 - 1_050_001_500) < 2_000
    assert clock.steps == ()


class Wire:
    """A bus whose frames come from a list, one batch a read, in the time of a machine."""

    def __init__(self, machine: Machine, batches: list[Frames], step: tuple[int, int], done: Flag) -> None:
        self.source, self.warnings = "can0", list[str]()
        self._machine, self._batches, self._step, self._done = machine, batches, step, done
        self._read = 0

    def open(self) -> None:
        pass

    def read(self, timeout: float) -> Frames:
        if self._read == len(self._batches):
            self._done.set()
            return Frames.empty("can0")
        batch = self._batches[self._read]
        self._machine.time = int(batch.t_ns[-1])
        if self._read == self._step[0]:
            self._machine.step(self._step[1])
        self._read += 1
        return Frames(batch.source, batch.t_ns + self._machine.offset, batch.ident, batch.offset, batch.data)

    def losses(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        pass


@pytest.mark.parametrize("step", [-2 * SECOND, 300_000_000])
def test_a_run_through_a_step_of_the_machine_is_whole_and_names_the_machine(tmp_path: Path, step: int):
    driver = open_driver("igel", "can0")
    blocks = plausible_blocks(driver, 1000, 3)
    t_ns = np.arange(1, 1001, dtype=np.int64) * 2_000_000
    frames = driver.encode({name: type(b)(name, t_ns, b.values, b.flags) for name, b in blocks.items()})
    machine, done, told = Machine(), Flag(), list[str]()
    batches = [frames[i : i + 120] for i in range(0, len(frames), 120)]
    path, rig = tmp_path / "run.mcap", Rig.parse(RIG)
    log = LogWriter(path, StartRecord("r", T0, "", rig.text))
    wire = Wire(machine, batches, (50, step), done)
    Recorder([wire], Decoder(rig), log, notify=told.append, clock=machine.clock).run(done)
    assert any(f"the clock of this machine was set by {step / 1e9:+.3f} s" in line for line in told)
    reader = LogReader(path)
    assert reader.damage == []
    stepped, stopped = (one for one in reader.events() if one.kind == EventKind.HOST_CLOCK)
    assert (stepped.state, stopped.state) == ("stepped", "stop")
    np.testing.assert_array_equal(reader.frames("can0").t_ns, frames.t_ns + T0)
    run = build_run("run", reader.start, reader.blocks())
    assert run.problems == ()
    assert all(signal.usable.all() for signal in run.signals.values())
    decode_log(path, tmp_path / "again.mcap")
    assert LogReader(tmp_path / "again.mcap").events() == reader.events()


CHRONY = "A29FC87B,time.example.org,3,1763000000.1,-0.000012345,0.000001,0.000034567,1.5,0.0,0.1,0.01,0.002,64,Normal"


def test_what_the_time_comes_from_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """chronyc's answer, and a clock of which the machine's own, 37 s ahead, takes the place."""
    program = tmp_path / "chronyc"
    program.write_text(f'#!/bin/sh\n[ "$*" = "-c tracking" ] && echo "{CHRONY}"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (tmp_path / "ptp0").touch()
    (tmp_path / "names" / "ptp0").mkdir(parents=True)
    (tmp_path / "names" / "ptp0" / "clock_name").write_text("NIC clock\n")
    real = time.clock_gettime_ns
    opened = list[int]()

    def read(clock: int) -> int:
        opened.append(~(clock >> 3))  # the file of the device, which must be open
        os.fstat(opened[-1])
        return real(time.CLOCK_REALTIME) + 37 * 10**9

    monkeypatch.setattr(time, "clock_gettime_ns", read)
    chrony, clock = time_sources(tmp_path, tmp_path / "names")
    assert chrony == "chrony follows time.example.org (stratum 3), -0.012 ms off, 0.035 ms in the long run, normal"
    assert clock.startswith(("ptp0 (NIC clock) is +37.0", "ptp0 (NIC clock) is +36.99"))
    assert opened
    assert chrony in synchronisation()


def test_a_clock_that_is_none_is_said_and_no_chrony_is_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert time_sources(tmp_path) == []
    (tmp_path / "ptp0").touch()  # no clock of the kernel
    (said,) = time_sources(tmp_path)
    assert said == "ptp0 (unnamed) cannot be read: Invalid argument"


def test_how_far_the_clock_can_be_trusted_is_said_in_words():
    assert describe_synchronisation(0x40, 0, 16_000_000, 16_000_000) == "not synchronised"
    said = "synchronised, offset -0.012 ms, error 0.035 ms, at most 1.2 ms"
    assert describe_synchronisation(0x2001, -12_000, 1200, 35) == said
    assert describe_synchronisation(0x0001, -12, 1200, 35) == said
    assert synchronisation().startswith(("synchronised", "not synchronised", "unknown"))
