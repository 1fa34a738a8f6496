"""Simulated measurement: sensors' own rates and clocks, latency, zeros, gains, noise, faults and time stamps.

The motion is computed once (`simulate.run`); measuring it again with another seed is cheap. The same seed gives the
same samples, channel by channel: one more sensor in a rig does not change the noise of the others.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.rig import Rig, Sensor
from lacet.daq.run import Run, Signal
from lacet.simulate.hidden import Hidden
from lacet.simulate.kinds import SHORT
from lacet.simulate.motion import CarMotion
from lacet.simulate.sensors import felt

Array = NDArray[np.float64]
START_NS = 1_780_300_800_000_000_000
"""Default start of a simulated run: 2026-06-01 08:00 UTC [ns since the Unix epoch]."""


@dataclass(frozen=True)
class Timing:
    """Errors of the sensors' clocks and delays of their samples.

    `drift_ppm` : 1 σ of each sensor clock's rate error; `jitter` : largest arrival delay beyond the latency by kind of
    bus [s] (delays are exponential with a third of it as mean, truncated there, and keep the order of samples);
    `phase` : whether each sensor starts at a random time within its first period instead of at 0.
    """

    drift_ppm: float = 20.0
    jitter: Mapping[str, float] = field(default_factory=lambda: {"can": 0.0, "serial": 0.004, "udp": 0.003})
    phase: bool = True


IDEAL = Timing(0.0, {}, False)
"""Perfect clocks and no jitter."""


@dataclass(frozen=True)
class Sheet:
    """Selection of the sensor sheet's tolerances that a simulated measurement draws at random.

    One zero a component and run, one gain a family and corner, one latency error a sensor. Gains and latencies belong
    to the instruments: with the same `seed` they are the same in every run.
    """

    zeros: bool = True
    gains: bool = False
    latencies: bool = False
    seed: int = 0


def _rng(seed: int, *words: str) -> np.random.Generator:
    return np.random.default_rng([seed & 0xFFFFFFFFFFFFFFFF, *(zlib.crc32(word.encode()) for word in words)])


def interpolate(values: Array, rate: float, t: Array) -> Array:
    """Cubic (four-point Lagrange) interpolation of (N, k) samples taken at `rate` from time 0, at times `t` (M,)."""
    at = np.asarray(t) * rate
    i = np.clip(np.floor(at).astype(int), 1, len(values) - 3)
    u = (at - i)[:, None]
    a, b, c, d = (values[i + j] for j in (-1, 0, 1, 2))
    return (
        -u * (u - 1) * (u - 2) / 6 * a
        + (u + 1) * (u - 1) * (u - 2) / 2 * b
        - (u + 1) * u * (u - 2) / 2 * c
        + (u + 1) * u * (u - 1) / 6 * d
    )


def applies(fault: Hidden, channel: str, column: str) -> bool:
    """Whether a sensor fault acts on a column: its place is a part (``imu``), family, channel or column."""
    where = SHORT.get(fault.where or "", fault.where)
    return where in (column, channel, CHANNELS[channel].family, channel.split(".")[0])


def wrong_latency(channel: str, faults: Sequence[Hidden]) -> float:
    """Latency of a channel in excess of the rig's, by its faults [s]."""
    return sum(f.size for f in faults if f.effect == "sensor_latency" and applies(f, channel, channel))


def gain_error(channel: str, rig: Rig, sheet: Sheet) -> float:
    """A channel's draw from its gain tolerance, 0 when the sheet draws none."""
    if not sheet.gains:
        return 0.0
    return rig.tolerance(channel, "gain") * float(_rng(sheet.seed, "gain", channel).standard_normal())


def zero_error(channel: str, column: str, rig: Rig, seed: int, sheet: Sheet) -> float:
    """A column's draw from its zero tolerance [its unit] in the run of a seed, 0 when the sheet draws none."""
    if not sheet.zeros:
        return 0.0
    return rig.tolerance(channel, "zero") * float(_rng(seed, "zero", column).standard_normal())


def drawn(rig: Rig, seed: int, sheet: Sheet) -> dict[str, dict[str, float]]:
    """All random sensor errors of the run of a seed: zeros by column, gains by channel, latencies [s] by sensor."""
    channels = [channel for sensor in rig.sensors for channel in sensor.channels]
    columns = [(channel, column) for channel in channels for column in CHANNELS[channel].columns]
    return {
        "zeros": {column: zero_error(channel, column, rig, seed, sheet) for channel, column in columns},
        "gains": {channel: gain_error(channel, rig, sheet) for channel in channels},
        "latencies": {sensor.name: latency_error(sensor, rig, sheet) for sensor in rig.sensors},
    }


def latency_error(sensor: Sensor, rig: Rig, sheet: Sheet) -> float:
    """A sensor's draw from its latency tolerance [s], 0 when the sheet draws none."""
    if not sheet.latencies:
        return 0.0
    draw = _rng(sheet.seed, "latency", sensor.name).standard_normal()
    return rig.tolerance(sensor.channels[0], "latency") * float(draw)


def sensed(
    channel: str, values: Array, t: Array, rig: Rig, seed: int, faults: Sequence[Hidden], sheet: Sheet, noise: float
) -> Array:
    """Sampled values with gain, zero, drift and noise; angles wrapped as the instrument sends them.

    `values` : (M, k) ideal signals at run times `t` (M,) [s]; `noise` : in multiples of the rig's σ.
    """
    info = CHANNELS[channel]
    out = values.copy()
    for j, column in enumerate(info.columns):
        on = [f for f in faults if applies(f, channel, column)]
        gain = sum(f.size for f in on if f.effect == "sensor_gain") + gain_error(channel, rig, sheet)
        zero = sum(f.size for f in on if f.effect == "sensor_zero") + zero_error(channel, column, rig, seed, sheet)
        drift = sum(f.size for f in on if f.effect == "sensor_drift")
        out[:, j] = out[:, j] * (1.0 + gain) + zero + drift / 60.0 * t
    if noise:
        out += noise * rig.noise(channel) * _rng(seed, "noise", channel).standard_normal(out.shape)
    if info.family == "wheel.angle":
        out = np.mod(out, 2.0 * np.pi)
    elif channel == "imu.attitude":
        out[:, 2] = np.mod(out[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return out


def measure(
    motion: CarMotion,
    rig: Rig,
    seed: int = 0,
    *,
    faults: Sequence[Hidden] | None = None,
    sheet: Sheet = Sheet(),
    noise: float = 1.0,
    timing: Timing = Timing(),
    start_ns: int = START_NS,
) -> dict[str, Block]:
    """The samples of a simulated run as received: one block a channel, at each sensor's own rate and clock.

    `faults` : sensor faults, by default those of the motion; `sheet` : which tolerances are drawn; `noise` : white
    noise in multiples of the rig's σ, 0 for none; `start_ns` : stamp of run time 0. A block's `t_ns` is the arrival:
    physical instant + latency + jitter; a latency fault gives older values at the same stamps. `device_ns` is the
    sensor's own clock (own origin, own rate) where it has one: on serial lines and UDP, and wherever the rig has
    ``clock = "device"``. Channels of one sensor share their stamps.
    """
    chosen = [f for f in (motion.hidden if faults is None else faults) if f.of_sensor]
    ideal = felt(motion, rig, chosen)
    out: dict[str, Block] = {}
    for sensor in rig.sensors:
        late = {channel: wrong_latency(channel, chosen) for channel in sensor.channels}
        window = max(0.0, *late.values()), motion.t[-1] + min(0.0, *late.values())
        latency = sensor.latency + latency_error(sensor, rig, sheet)
        for rate in sorted({CHANNELS[channel].rate for channel in sensor.channels}):
            t, stamps, device = _stamps(window, sensor, rig, rate, latency, seed, timing, start_ns)
            for channel in (c for c in sensor.channels if CHANNELS[c].rate == rate):
                felt_at = interpolate(ideal[channel], motion.rate, t - late[channel])
                values = sensed(channel, felt_at, t, rig, seed, chosen, sheet, noise)
                out[channel] = Block(channel, stamps, values, np.zeros(len(t), np.uint8), device)
    return {channel: out[channel] for channel in CHANNELS if channel in out}


def _stamps(
    window: tuple[float, float],
    sensor: Sensor,
    rig: Rig,
    rate: float,
    latency: float,
    seed: int,
    timing: Timing,
    start_ns: int,
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64] | None]:
    """Physical instants (M,) [s] within a window of the run, arrival stamps and device stamps [ns]."""
    rng = _rng(seed, "clock", sensor.name)
    pace = 1.0 + timing.drift_ppm * 1e-6 * rng.standard_normal()
    phase = rng.uniform(0.0, 1.0) / rate if timing.phase else 0.0
    origin = int(rng.integers(0, 3_600_000_000_000))
    skipped = int(np.ceil((window[0] - phase) * rate * pace - 1e-9))
    count = int(np.floor((window[1] - phase) * rate * pace + 1e-9)) + 1
    ticks = np.arange(max(0, skipped), count) / rate
    t = phase + ticks / pace
    kind = rig.buses[sensor.bus].kind if sensor.bus else ""
    limit = timing.jitter.get(kind, 0.0)
    late = np.minimum(rng.exponential(limit / 3.0, len(t)), limit) if limit > 0.0 else np.zeros(len(t))
    arrival = np.maximum.accumulate(t + latency + late)
    stamps = start_ns + np.round(arrival * 1e9).astype(np.int64)
    has_clock = sensor.clock == "device" or kind in ("serial", "udp")
    device = origin + np.round(ticks * 1e9).astype(np.int64) if has_clock else None
    return t, stamps, device


def exchange_run(
    motion: CarMotion,
    rig: Rig,
    seed: int = 0,
    *,
    rate: float = 250.0,
    faults: Sequence[Hidden] | None = None,
    sheet: Sheet = Sheet(),
    noise: float = 1.0,
    **fields: Any,
) -> Run:
    """A simulated run with all channels on one time base of `rate` [Hz], as in an exchange table.

    Latencies, zeros and noise (multiples of the rig's σ) as in `measure`, without clocks and jitter; the table starts
    when every sensor has a sample. `fields` : further fields of the run, e.g. ``notes``.
    """
    chosen = [f for f in (motion.hidden if faults is None else faults) if f.of_sensor]
    ideal = felt(motion, rig, chosen)
    sensors = {channel: sensor for sensor in rig.sensors for channel in sensor.channels}
    latencies = {
        channel: sensor.latency + latency_error(sensor, rig, sheet) + wrong_latency(channel, chosen)
        for channel, sensor in sensors.items()
    }
    late, early = max(0.0, *latencies.values()), min(0.0, *latencies.values())
    first, last = np.ceil(late * rate), np.floor((motion.t[-1] + early) * rate)
    t = np.arange(first, last + 1) / rate
    signals: dict[str, Signal] = {}
    for channel, latency in latencies.items():
        felt_at = interpolate(ideal[channel], motion.rate, t - latency)
        values = sensed(channel, felt_at, t - latency, rig, seed, chosen, sheet, noise)
        signals[channel] = Signal(t, values, np.zeros(len(t), np.uint8))
    declared: dict[str, Any] = {
        "name": motion.manoeuvre,
        "vehicle": motion.car.name,
        "manoeuvre": motion.manoeuvre,
        "rig": rig.name,
        "wheel_reference": rig.wheel_reference,
        "brakes": motion.brakes,
    }
    return Run(signals=signals, **{**declared, **fields})
