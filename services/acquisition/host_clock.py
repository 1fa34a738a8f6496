"""Clock of the recording machine: steps are kept out of the stamps and reported; whether it is synchronised."""

from __future__ import annotations

import ctypes
import os
import struct
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lacet.daq.frames import Frames

STEP_NS = 5_000_000
"""Change of the wall clock against the monotonic one, from one read to the next, that is a step [ns]. In the fifth of a
second between two reads neither clock drifts from the other: slewing by NTP acts on both."""

OLDEST_NS = 1_000_000_000
"""Time after a step in which frames stamped before it may still come out of the system's buffers [ns]."""

_BRACKET_NS = 200_000  # ns; longest time in which both clocks are read together, else they are read again
_TRIES = 5
_UNSYNCHRONISED, _NANOSECONDS = 0x40, 0x2000  # linux/timex.h: STA_UNSYNC, STA_NANO
_CHRONY_SECONDS = 1.0  # longest wait for chrony's answer
_TIMEX = 208  # bytes of struct timex on 64-bit Linux


@dataclass(frozen=True)
class ClockStep:
    """A step of the wall clock: time on the stamps' scale [ns], and by how much it was set forward [ns]."""

    t_ns: int
    step_ns: int


class HostClock:
    """The machine's clock without its steps: the wall clock at the start, then as the monotonic clock runs.

    Parameters
    ----------
    wall, monotonic : the clocks [ns].
    """

    def __init__(
        self, wall: Callable[[], int] = time.time_ns, monotonic: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall, self._monotonic = wall, monotonic
        self._lock = threading.Lock()
        self._offset: int | None = None
        self._steps: list[ClockStep] = []
        self._summed = 0
        self._observe()

    @property
    def steps(self) -> tuple[ClockStep, ...]:
        """The steps so far."""
        with self._lock:
            return tuple(self._steps)

    def now_ns(self) -> int:
        """The time on the stamps' scale [ns]."""
        with self._lock:
            return self._observe()

    def without_steps(self, frames: Frames) -> Frames:
        """Frames just received, their stamps without the steps of the wall clock.

        A frame stamped before a step and read after it is known by a stamp that would lie in the future otherwise.
        """
        with self._lock:
            now = self._observe()
            if not self._summed and not self._steps:
                return frames
            stamps = frames.t_ns - self._summed
            summed = self._summed
            for step in reversed(self._steps):
                if now - step.t_ns > OLDEST_NS:
                    break
                summed -= step.step_ns
                before = frames.t_ns - summed
                stamps = np.where((stamps > now) | ((before <= now) & (before > stamps)), before, stamps)
        return replace(frames, t_ns=stamps)

    def _observe(self) -> int:
        """Note a step since the last time; the time on the stamps' scale [ns]."""
        for _ in range(_TRIES):
            first = self._monotonic()
            wall = self._wall()
            if self._monotonic() - first < _BRACKET_NS:
                offset = wall - first
                break
        else:  # the machine is too busy to compare them
            return self._wall() - self._summed
        if self._offset is not None and abs(offset - self._offset) > STEP_NS:
            step = offset - self._offset
            self._summed += step
            self._steps.append(ClockStep(wall - self._summed, step))
        self._offset = offset
        return wall - self._summed


def synchronisation() -> str:
    """How far the machine's clock can be trusted, in words: the kernel's account, and what its time comes from."""
    return "; ".join([_kernel(), *time_sources()])


def _kernel() -> str:
    """The kernel's account of the synchronisation, whatever program does it."""
    buffer = ctypes.create_string_buffer(_TIMEX + 48)
    try:
        state = ctypes.CDLL(None, use_errno=True).adjtimex(buffer)
    except (OSError, AttributeError, TypeError):  # a system without it, or without a program's own library (Windows)
        state = -1
    if state < 0 or struct.calcsize("l") != 8:
        return "unknown: the system does not say"
    offset, _, largest, estimated, status = struct.unpack_from("@qqqqi", buffer.raw, 8)
    return describe_synchronisation(status, offset, largest, estimated)


def short_synchronisation(text: str) -> str:
    """What `synchronisation` says in a word or two: ``synchronised``, ``NOT SYNCHRONISED`` or ``unknown``."""
    found = text.partition(";")[0].partition(",")[0].partition(":")[0]
    return found.upper() if found.startswith("not") else found


def time_sources(devices: Path = Path("/dev"), names: Path = Path("/sys/class/ptp")) -> list[str]:
    """What this machine's time comes from, one sentence each: chrony's state, and each PTP clock against the machine's.

    Empty where there is neither. A PTP clock mostly counts atomic time, 37 s before UTC.
    """
    out = [text] if (text := _chrony()) else []
    for device in sorted(devices.glob("ptp[0-9]*")):
        try:
            name = (names / device.name / "clock_name").read_text().strip()
        except OSError:
            name = "unnamed"
        try:
            out.append(f"{device.name} ({name}) is {_ptp_offset_ns(device) / 1e9:+.6f} s from this machine's clock")
        except OSError as error:
            out.append(f"{device.name} ({name}) cannot be read: {error.strerror}")
    return out


def _ptp_offset_ns(device: Path) -> int:
    """Reading of a PTP clock less that of the machine's, at the middle of the shortest of some readings [ns]."""
    fd = os.open(device, os.O_RDONLY)
    try:
        clock = (~fd << 3) | 3  # FD_TO_CLOCKID of the kernel's documentation of PTP clocks
        readings: list[tuple[int, int]] = []
        for _ in range(_TRIES):
            before, there, after = time.time_ns(), time.clock_gettime_ns(clock), time.time_ns()
            readings.append((after - before, there - (before + after) // 2))
    finally:
        os.close(fd)
    return min(readings)[1]


def _chrony() -> str:
    """State of chrony, in words; empty where it does not run."""
    try:
        done = subprocess.run(
            ["chronyc", "-c", "tracking"], capture_output=True, text=True, timeout=_CHRONY_SECONDS, check=True
        )
        _, name, stratum, _, offset, _, rms, *_, leap = done.stdout.strip().split(",")
        return (
            f"chrony follows {name or 'nothing'} (stratum {int(stratum)}), {float(offset) * 1e3:+.3f} ms off, "
            f"{float(rms) * 1e3:.3f} ms in the long run, {leap.lower()}"
        )
    except (OSError, ValueError, subprocess.SubprocessError):
        return ""


def describe_synchronisation(status: int, offset: int, largest_us: int, estimated_us: int) -> str:
    """The state of ``adjtimex`` in words; `offset` is in ns or µs, as `status` says."""
    if status & _UNSYNCHRONISED:
        return "not synchronised"
    ms = offset / (1e6 if status & _NANOSECONDS else 1e3)
    return f"synchronised, offset {ms:+.3f} ms, error {estimated_us / 1e3:.3f} ms, at most {largest_us / 1e3:.1f} ms"
