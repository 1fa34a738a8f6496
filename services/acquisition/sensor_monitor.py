"""State of each sensor while it is recorded, by name and within a second: silent, slow, babbling, stuck, clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import UNUSABLE, Block, Flag
from lacet.daq.channels import CHANNELS
from lacet.daq.clock import ALIKE_NS, SHOWN_NS, STEP_NS, UNSEEN
from lacet.daq.stuck import LEARNED, MOVING, SPEEDS, instrument, is_noisy, noise_count, window_length

SILENCE = 0.5
"""Time without a sample from which a sensor is silent [s]; slower ones are after `MISSED` samples."""
MISSED = 5
"""Samples that a slow sensor may miss before it is silent."""
FIRST = 1.0
"""Time from the start of the recording in which every sensor should have been heard [s]."""
RATE_SECONDS = 0.8
"""Time over which a rate is measured [s]: a wrong one is seen within a second, with batches of 0.1 s."""
RATE_SAMPLES = 50
"""Samples over which a rate is measured, at least: one sample more or less is 2 %."""
RATE_TOLERANCE = 0.2
"""Fraction by which a rate may differ from the nominal one: half a batch at each end of `RATE_SECONDS` is 0.12."""
LEARNING = 3.0
"""Time over which the rate of a sensor is learned for which none is known [s]."""
CATCHING_UP = 10.0
"""Longest pause whose samples, delivered at once, are not babbling [s], as `daq.clock.LEVEL_NS`."""
CLEARED = 1.0
"""Time without the fault after which a sensor is running again [s]."""
LEVEL_NS = 500_000_000
"""Stretch of which the least delay is taken [ns]: a step of a clock is seen within two of them."""
INTERVALS = 50
"""Intervals between a sensor's own stamps of which the median is the usual one."""
USUAL = 3
"""Stretches from which it is known how the least delay usually changes: by nothing, unless the rate is another."""


class SensorState(StrEnum):
    """State of a sensor; where several apply, the first in this list."""

    SILENT = "silent"
    BABBLING = "babbling"
    SLOW = "slow"
    STUCK = "stuck"
    CLOCK = "clock"
    WAITING = "waiting"
    RUNNING = "running"


@dataclass(frozen=True)
class Watched:
    """A sensor to be watched: its channels with their nominal rates [Hz], None for those that are to be learned.

    `numbered` : whether a counter that may hide losses gives its stamps (``clock = "steady"``).
    """

    name: str
    bus: str
    rates: Mapping[str, float | None]
    numbered: bool = False


@dataclass(frozen=True)
class SensorStatus:
    """State of a sensor, what it is seen by, and the channels concerned."""

    state: SensorState
    detail: str = ""
    channels: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.state}{f' ({self.detail})' if self.detail else ''}"


class SensorMonitor:
    """Monitor of the sensors of a rig by the blocks that their drivers deliver; it has no clock of its own.

    Parameters
    ----------
    sensors : those that are recorded.
    now : time of the start [s], on the scale of all later times.
    """

    def __init__(self, sensors: Iterable[Watched], now: float):
        self._sensors = {one.name: one for one in sensors}
        self._begun = now
        self._channels = {
            channel: _Channel(channel, rate, now)
            for one in self._sensors.values()
            for channel, rate in one.rates.items()
        }
        self._speeds: dict[str, float] = {}
        self._status = {name: SensorStatus(SensorState.WAITING) for name in self._sensors}
        self._cleared: dict[str, float] = {}
        # The samples of one instrument at one corner are lost together.
        firsts = {
            (one.name, instrument(channel)): channel
            for one in self._sensors.values()
            for channel in list(one.rates)[::-1]
            if one.numbered
        }
        self._numbered = set(firsts.values())

    @property
    def status(self) -> Mapping[str, SensorStatus]:
        """State of each sensor by name."""
        return dict(self._status)

    def rates(self, samples: Mapping[str, float]) -> dict[str, tuple[float, float | None]]:
        """Sensor → samples/s of the channel that is farthest from its nominal or learned rate, and that rate [1/s].

        `samples` : channel → samples/s.
        """
        out: dict[str, tuple[float, float | None]] = {}
        for name, one in self._sensors.items():
            found = [(samples.get(channel, 0.0), self._channels[channel].rate) for channel in one.rates]
            out[name] = max(found, key=lambda pair: abs(pair[0] / pair[1] - 1.0) if pair[1] else 0.0)
        return out

    def hidden_losses(self) -> dict[str, int]:
        """Bus → lost samples that four-bit counters hide, found by the arrival times of those received."""
        out: dict[str, int] = {}
        for one in self._sensors.values():
            lost = sum(self._channels[channel].level.lost for channel in one.rates if channel in self._numbered)
            out[one.bus] = out.get(one.bus, 0) + max(0, lost)
        return {bus: number for bus, number in out.items() if number}

    def take(self, blocks: Sequence[Block], now: float) -> None:
        """Process the blocks of a batch."""
        for block in blocks:
            family = CHANNELS[block.channel].family
            if family in SPEEDS and len(good := _usable(block)):
                self._speeds[block.channel] = SPEEDS[family] * float(np.linalg.norm(good[-1]))
        for block in blocks:
            channel = self._channels.get(block.channel)
            if channel is not None and len(block):
                channel.take(block, now, self._moves(block.channel), block.channel in self._numbered)

    def check(self, now: float) -> list[tuple[str, SensorStatus]]:
        """The sensors whose state has changed, and their new ones."""
        changed = []
        for name, one in self._sensors.items():
            found = self._found(one, now)
            before = self._status[name]
            if found.state == SensorState.RUNNING and before.state not in (SensorState.RUNNING, SensorState.WAITING):
                if now < self._cleared.setdefault(name, now + CLEARED):
                    continue
            else:
                self._cleared.pop(name, None)
            self._status[name] = found
            if (found.state != before.state and before.state != SensorState.WAITING) or (
                before.state == SensorState.WAITING and found.state not in (SensorState.WAITING, SensorState.RUNNING)
            ):
                changed.append((name, found))
        return changed

    def _found(self, one: Watched, now: float) -> SensorStatus:
        states: dict[SensorState, dict[str, str]] = {}
        for channel in one.rates:
            state, detail = self._channels[channel].state(now, self._begun)
            states.setdefault(state, {})[channel] = detail
        worst = next(state for state in SensorState if state in states)
        if worst == SensorState.WAITING and SensorState.RUNNING in states:
            worst = SensorState.RUNNING
        if worst in (SensorState.WAITING, SensorState.RUNNING):
            return SensorStatus(worst)
        named = states[worst]
        parts = sorted({_part(channel) for channel in named}) if worst != SensorState.STUCK else sorted(named)
        whole = len(named) == len(one.rates)
        detail = next(iter(named.values()))
        return SensorStatus(worst, detail if whole else f"{', '.join(parts)}: {detail}", tuple(named))

    def _moves(self, channel: str) -> bool:
        """Whether the car moves, by other instruments; a wheel's angle is asked of the wheel's speed."""
        if CHANNELS[channel].family == "wheel.angle":
            return self._speeds.get(channel.replace(".angle", ".speed"), 0.0) > MOVING
        mine = instrument(channel)
        others = [speed for name, speed in self._speeds.items() if instrument(name) != mine]
        return bool(others) and float(np.median(others)) > MOVING


@dataclass
class _Level:
    """Least delay of the arrivals against a sensor's own time, stretch by stretch, and the samples that it misses."""

    lost: int = 0
    jump_ns: int = 0
    number: int = 0
    origin_ns: int = 0
    level: int | None = None
    least: int | None = None
    since_ns: int = 0
    steps: deque[int] = field(default_factory=lambda: deque[int](maxlen=8))
    device_ns: int | None = None
    usual_ns: int = 0
    intervals: deque[int] = field(default_factory=lambda: deque[int](maxlen=INTERVALS))
    shown: tuple[list[int], list[int]] = field(default_factory=lambda: ([], []))

    def forget(self) -> None:
        """Begin anew."""
        self.level = self.least = None
        self.number = 0
        self.steps.clear()

    def numbered(self, block: Block, period_ns: float) -> None:
        """Follow samples of a constant rate; after a loss that the counter shows the numbering begins anew."""
        gaps = np.flatnonzero(block.flags & np.uint8(Flag.GAP))
        t_ns = block.t_ns
        if len(gaps):
            self.forget()
            t_ns = t_ns[gaps[-1] :]
        if not self.number:
            self.origin_ns = int(t_ns[0])
        lag = t_ns - self.origin_ns - np.rint((self.number + np.arange(len(t_ns))) * period_ns).astype(np.int64)
        self.number += len(t_ns)
        step = self._step(lag, t_ns)
        values = UNSEEN * period_ns
        nominal = not self.steps or abs(np.median(self.steps)) <= RATE_TOLERANCE * LEVEL_NS
        if nominal and abs(step) > 0.75 * values:  # at another rate a stretch longer by a batch would be a step
            self.lost += UNSEEN * round(step / values)

    def by_device(self, block: Block, device_ns: NDArray[np.int64]) -> None:
        """Follow a device clock; of steps too small to be distinguished from delays those that its own stamps show."""
        good = (block.flags & np.uint8(UNUSABLE & ~Flag.RANGE & ~Flag.STATUS)) == 0
        if not good.any():
            return
        device = device_ns[good]
        intervals = np.diff(device, prepend=device[0] if self.device_ns is None else self.device_ns)
        if self.usual_ns:
            lost = (block.flags[good] & np.uint8(Flag.GAP)) != 0
            further = np.where(lost, 0, intervals - self.usual_ns)
            self.shown[1].extend(further[np.abs(further) >= SHOWN_NS].tolist())
        self.intervals.extend(intervals.tolist())
        self.device_ns = int(device[-1])
        begun = self.since_ns
        step = self._step((block.t_ns - device_ns)[good], block.t_ns[good])
        seen = any(
            abs(step + size) <= ALIKE_NS and 2 * abs(step + size) < abs(size) for part in self.shown for size in part
        )
        self.jump_ns = step if abs(step) > STEP_NS or seen else 0
        if self.since_ns != begun:
            self.shown = (self.shown[1], [])
            if len(self.intervals) == INTERVALS:
                self.usual_ns = int(np.median(self.intervals))

    def _step(self, lag: NDArray[np.int64], t_ns: NDArray[np.int64]) -> int:
        """The step of the least delay from the stretch before to the one that ends here, beyond the usual one; or 0."""
        least = int(lag.min())
        if self.least is None:
            self.least, self.since_ns = least, int(t_ns[0])
            return 0
        if abs(int(t_ns[-1]) - self.since_ns) < LEVEL_NS:
            self.least = min(self.least, least)
            return 0
        ended, self.least, self.since_ns = self.least, least, int(t_ns[0])
        step = 0
        if self.level is not None:
            if len(self.steps) >= USUAL:  # a rate that is not the nominal one is no loss
                step = ended - self.level - int(np.median(self.steps))
            self.steps.append(ended - self.level)
        self.level = ended
        return step


class _Channel:
    """What is known of one channel."""

    def __init__(self, name: str, rate: float | None, now: float):
        self.name, self.rate = name, rate
        self.heard: float | None = None
        self.first = now
        self.level = _Level()
        self._came: deque[tuple[float, int, float]] = deque()  # time, samples, samples owed before it
        self._owed = 0.0
        self._learned_samples = 0
        self._length = window_length(CHANNELS[name].rate)
        self._last: NDArray[np.float64] | None = None
        self._still = np.zeros(CHANNELS[name].width, np.int64)
        self._window: list[NDArray[np.float64]] = []
        self._window_moves = True
        self._turns: deque[NDArray[np.int64]] = deque(maxlen=400)
        self._stuck = np.zeros(CHANNELS[name].width, bool)
        self._clock_until = -math.inf
        self._clock_detail = ""

    def take(self, block: Block, now: float, moves: bool, numbered: bool) -> None:
        """Process a block."""
        n = len(block)
        if self.heard is None or now - self.heard > max(SILENCE, MISSED / (self.rate or math.inf)):
            self.first = now  # a rate is measured from here
            if self.heard is None or now - self.heard > CATCHING_UP:
                self._owed = 0.0
            self._came.clear()
            self._learned_samples = 0
        previous = self.heard if self.heard is not None else now
        if self.rate is None:
            self._learned_samples += n
            if now - self.first >= LEARNING:
                self.rate = self._learned_samples / (now - self.first)
        else:
            limit = CATCHING_UP * self.rate
            before = self._owed + self.rate * (now - previous)
            self._came.append((now, n, min(before, limit)))
            self._owed = min(limit, max(0.0, before - n))
        self.heard = now
        self._values(_usable(block), moves)
        if numbered:
            self.level.numbered(block, 1e9 / CHANNELS[self.name].rate)
        elif block.device_ns is not None:
            self.level.by_device(block, block.device_ns)
            if self.level.jump_ns:
                self._clock(now, f"it jumped by {-self.level.jump_ns / 1e9:+.3f} s")
        if (block.flags & np.uint8(Flag.CLOCK)).any():
            self._clock(now, "it stands or goes back")

    def _clock(self, now: float, detail: str) -> None:
        self._clock_until, self._clock_detail = now + CLEARED, detail

    def _values(self, values: NDArray[np.float64], moves: bool) -> None:
        """Follow how long each component has kept its value, and how noisy it is in the moving car."""
        if not len(values):
            return
        before = values[:1] if self._last is None else self._last
        changed = np.diff(values, axis=0, prepend=before) != 0.0
        after = len(values) - 1 - np.where(changed.any(axis=0), len(values) - 1 - changed[::-1].argmax(axis=0), -1)
        self._still = np.where(changed.any(axis=0), after, self._still + len(values)) if moves else 0 * self._still
        self._last = values[-1:]
        self._window.append(values)
        self._window_moves &= moves
        if sum(map(len, self._window)) >= self._length:
            count = noise_count(np.concatenate(self._window)[: self._length], self._length)
            if self._window_moves and count.changes.any() and not self._stuck.any():
                self._turns.append(count.turns[0])
            self._window, self._window_moves = [], True
        long = self._still >= self._length
        if long.any():
            if CHANNELS[self.name].family != "wheel.angle":
                long &= is_noisy(np.array(self._turns), self._length) if len(self._turns) >= LEARNED else False
            self._stuck |= long
        self._stuck &= self._still > 0

    def state(self, now: float, begun: float) -> tuple[SensorState, str]:
        """State of the channel, and by what it is seen."""
        if self.heard is None:
            return (SensorState.SILENT, "nothing has come yet") if now - begun >= FIRST else (SensorState.WAITING, "")
        quiet = now - self.heard
        if quiet >= max(SILENCE, MISSED / self.rate if self.rate else CATCHING_UP):
            return SensorState.SILENT, f"nothing for {quiet:.1f} s"
        if self.rate is not None and (found := self._rate_fault(now, self.rate)):
            return found
        if self._stuck.any():
            names = CHANNELS[self.name].components or ("value",)
            which = ", ".join(name for name, stuck in zip(names, self._stuck, strict=True) if stuck)
            return SensorState.STUCK, f"{which} stands still in the moving car"
        if now < self._clock_until:
            return SensorState.CLOCK, self._clock_detail
        return SensorState.RUNNING, ""

    def _rate_fault(self, now: float, rate: float) -> tuple[SensorState, str] | None:
        span = max(RATE_SECONDS, RATE_SAMPLES / rate)
        while len(self._came) > 1 and self._came[1][0] <= now - span:
            self._came.popleft()
        if not self._came or self._came[0][0] > now - span + 0.5 * RATE_TOLERANCE * span:
            return None  # it has not run for so long
        over = self._came[-1][0] - self._came[0][0]
        samples = sum(n for _, n, _ in self._came) - self._came[0][1]
        if over < 0.5 * span:
            return None
        if samples > (1.0 + RATE_TOLERANCE) * rate * over + self._came[0][2]:
            return SensorState.BABBLING, f"{samples / over:.0f} samples/s instead of {rate:.0f}"
        if samples < (1.0 - RATE_TOLERANCE) * rate * over:
            return SensorState.SLOW, f"{samples / over:.0f} samples/s instead of {rate:.0f}"
        return None


def _usable(block: Block) -> NDArray[np.float64]:
    return block.values[(block.flags & np.uint8(UNUSABLE)) == 0]


def _part(channel: str) -> str:
    """Instrument and corner of a channel, ``wheel.fl``."""
    name, corner = instrument(channel)
    return f"{name}.{corner}" if corner else channel
