"""Values that stand still in a moving car although counter and checksum are right: a stuck sensor.

A constant value is no fault by itself: a coarse signal is constant on a straight, a switch for minutes, every signal
of few bits at rest. A signal is judged only while the car moves, by the speeds of *other* instruments, and only if it
is noisy: successive values go up and down by its own noise, whatever is driven. Noise does not pause.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS
from lacet.daq.run import Signal

STUCK_SECONDS = 0.5
"""Duration from which a value that does not change in a moving car is stuck [s]: the shortest one that matters to a fit
at 6 Hz, and some hundred samples of noise at the rates of the instruments."""

WINDOW_SAMPLES = 50
"""Samples over which noise is judged, at least, as many as in `STUCK_SECONDS` at 100 Hz: slower signals need longer."""

NOISE_SHARE = 0.1
"""Share of samples at which a noisy signal turns back, at least: white noise of half a step or more turns back at a
third to two thirds of them, a motion of 2 Hz sampled at 100 Hz at 4 %."""

QUIET_SHARE = 0.1
"""Share of the windows in which a noisy signal may turn back less often: in fast motion it follows that."""

LEARNED = 10
"""Windows in a moving car from which a signal is known to be noisy."""

MOVING = 1.0
"""Speed from which the car moves [m/s]: ten times what a Correvit or a wheel sensor shows at rest."""

SPEEDS = {"correvit.speed": 1.0, "car.speed": 1.0, "gnss.speed": 1.0, "wheel.speed": 0.3}
"""Families of channels that show whether the car moves; factor to a speed [m/s], that of a wheel a rolling radius."""


TWINS = 2
"""Least number of instruments of the same kind at other corners by whose noise one that never changes is judged."""


@dataclass(frozen=True)
class NoiseCount:
    """Changes of a signal over windows of a number of samples.

    `changes`, `turns` (W, k) : samples in the window that differ from the one before, and at which the signal turns
    back; by window and component.
    """

    changes: NDArray[np.int64]
    turns: NDArray[np.int64]


def window_length(rate: float) -> int:
    """Samples of a window at a rate [Hz]."""
    return max(WINDOW_SAMPLES, int(np.ceil(STUCK_SECONDS * rate)))


def noise_count(values: NDArray[np.float64], length: int) -> NoiseCount:
    """The changes of a signal (N, k) in windows of so many samples; a rest shorter than a window is left out."""
    step = np.diff(values, axis=0, prepend=values[:1])
    direction = np.sign(step)
    # The direction last taken: of a constant stretch the one before it.
    at = np.where(direction != 0.0, np.arange(len(values))[:, None], 0)
    held = np.take_along_axis(direction, np.maximum.accumulate(at, axis=0), axis=0)
    turns = np.zeros(values.shape, bool)
    turns[1:] = (direction[1:] != 0.0) & (held[:-1] != 0.0) & (direction[1:] != held[:-1])
    windows = len(values) // length
    shape = windows, length, values.shape[1]
    return NoiseCount(
        (direction[: windows * length] != 0.0).reshape(shape).sum(axis=1),
        turns[: windows * length].reshape(shape).sum(axis=1),
    )


def is_noisy(turns: NDArray[np.int64], length: int) -> NDArray[np.bool_]:
    """(k,) whether a signal is known to be noisy by the windows (W, k) in which the car moved and it did not stand."""
    if len(turns) < LEARNED:
        return np.zeros(turns.shape[1], bool)
    return np.quantile(turns, QUIET_SHARE, axis=0) >= NOISE_SHARE * length


def moves(signals: Mapping[str, Signal], channel: str, t: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) whether the car moves at times [s], by the median of the speeds of other instruments; False without any."""
    mine = instrument(channel)
    speeds = []
    for name, signal in signals.items():
        factor = SPEEDS.get(CHANNELS[name].family)
        good = signal.usable
        if factor is None or instrument(name) == mine or np.count_nonzero(good) < 2:
            continue
        speed = factor * np.linalg.norm(signal.values[good], axis=1)
        speeds.append(np.interp(t, signal.t[good], speed, left=0.0, right=0.0))
    return np.median(speeds, axis=0) > MOVING if speeds else np.zeros(len(t), bool)


def stuck_samples(signals: Mapping[str, Signal], channel: str) -> NDArray[np.bool_]:
    """(N,) samples of a channel of a whole run at which a component stands still in a moving car."""
    signal = signals[channel]
    out = np.zeros(len(signal.t), bool)
    good = np.flatnonzero(signal.usable)
    length = window_length(CHANNELS[channel].rate)
    if len(good) < length * LEARNED:
        return out
    values, t = signal.values[good], signal.t[good]
    constant = _constant(values, t, length)
    if not constant.any():
        return out
    if (turning := _turning(signals, channel, t)) is not None:
        out[good[constant[:, 0] & turning]] = True
        return out
    moving = moves(signals, channel, t)
    count = noise_count(values, length)
    windows = len(count.turns)
    inside = moving[: windows * length].reshape(windows, length).all(axis=1)
    for component in np.flatnonzero(constant.any(axis=0)):
        still = constant[:, component]
        if still.all() and _twins_are_noisy(signals, channel, int(component)):
            out[good[moving]] = True
            continue
        varied = ~still[: windows * length].reshape(windows, length).any(axis=1)
        if is_noisy(count.turns[inside & varied][:, [component]], length)[0]:
            out[good[still & moving]] = True
    return out


def _twins_are_noisy(signals: Mapping[str, Signal], channel: str, component: int) -> bool:
    """Whether the same quantity of instruments of the same kind is noisy in the moving car, at `TWINS` other corners.

    A component that keeps its value for the whole run shows no noise of its own. Its twins are of its resolution.
    """
    family, corner = CHANNELS[channel].family, CHANNELS[channel].corner
    noisy: list[bool] = []
    for name, signal in signals.items():
        other = CHANNELS[name]
        if corner is None or other.family != family or other.corner == corner:
            continue
        good = signal.usable
        values, t = signal.values[good][:, [component]], signal.t[good]
        length = window_length(other.rate)
        windows = len(values) // length
        inside = moves(signals, name, t)[: windows * length].reshape(windows, length).all(axis=1)
        count = noise_count(values, length)
        noisy.append(bool(is_noisy(count.turns[inside & (count.changes[:, 0] > 0)], length)[0]))
    return len(noisy) >= TWINS and all(noisy)


def _constant(values: NDArray[np.float64], t: NDArray[np.float64], length: int) -> NDArray[np.bool_]:
    """(N, k) samples of stretches in which a component keeps its value for a window and for `STUCK_SECONDS`."""
    out = np.zeros(values.shape, bool)
    for component in range(values.shape[1]):
        begins = np.flatnonzero(np.diff(values[:, component], prepend=np.nan) != 0.0)
        ends = np.append(begins[1:], len(values))
        long = (ends - begins >= length) & (t[ends - 1] - t[begins] >= STUCK_SECONDS)
        out[:, component] = np.repeat(long, ends - begins)
    return out


def _turning(signals: Mapping[str, Signal], channel: str, t: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """(N,) whether the wheel turns whose angle a channel is: that needs no noise to change. None for other channels."""
    speed = signals.get(channel.replace(".angle", ".speed"))
    if CHANNELS[channel].family != "wheel.angle" or speed is None or not speed.usable.any():
        return None
    found = np.interp(t, speed.t[speed.usable], np.abs(speed.values[speed.usable, 0]))
    return SPEEDS["wheel.speed"] * found > MOVING


@cache
def instrument(channel: str) -> tuple[str, str | None]:
    """What a channel is measured by: its instrument, at its corner."""
    return channel.partition(".")[0], CHANNELS[channel].corner
