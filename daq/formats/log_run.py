"""Runs from logs: decoded blocks as signals, stamped by the sensor's clock where the rig declares it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lacet.daq.blocks import UNUSABLE, Block, Flag
from lacet.daq.channels import CHANNELS
from lacet.daq.clock import LEVEL_NS, MAX_DRIFT, MISFIT_NS, fit_clock, steady_stamps
from lacet.daq.errors import RigError, RunError
from lacet.daq.formats.events import EventKind, RunEvent
from lacet.daq.formats.log_read import LogReader
from lacet.daq.formats.wire import StartRecord
from lacet.daq.rig import Rig
from lacet.daq.run import BRAKES, Mark, Run, Signal
from lacet.daq.shared_stamps import spread
from lacet.daq.stuck import STUCK_SECONDS, stuck_samples


def read_run(path: Path) -> Run:
    """The run of a log: its decoded channels as signals.

    Stamps are the arrivals; for sensors with ``clock = "device"`` in the recorded rig the device clock, and for those
    with ``clock = "steady"`` the sample's number times the channel's period, on the lower envelope of the arrivals.
    Samples that share an arrival, for they came in one read, are spread over the time since the one before it. No
    latency is removed.

    Raises
    ------
    RunError : no log, or one without decoded channels.
    """
    reader = LogReader(path)
    blocks = reader.blocks()
    if not any(len(block) for block in blocks.values()):
        remedy = "it holds raw frames only: run 'lacet decode' first" if reader.sources() else "it holds no samples"
        raise RunError(path, [remedy, *reader.damage])
    name = next(iter(reader.files.values())).stem
    return build_run(name, reader.start, blocks, reader.damage, reader.events())


def damage_of_raw_log(start: StartRecord) -> list[str]:
    """Damage of the raw log that a log was decoded from, one line each."""
    return [f"the raw log was damaged: {line}" for line in start.extra.get("damage", "").splitlines()]


def build_run(
    name: str,
    start: StartRecord,
    blocks: Mapping[str, Block],
    damage: Sequence[str] = (),
    events: Sequence[RunEvent] = (),
    start_ns: int | None = None,
) -> Run:
    """A run from decoded blocks by channel, at least one with samples, their start record, and what happened.

    `start_ns` : where its time begins [ns since the Unix epoch]; None for the earliest sample.
    """
    problems = [*damage, *damage_of_raw_log(start)]
    problems += start.extra.get("imported", "").splitlines()
    rig = _rig(name, start, problems)
    stamps, kept = _stamped(rig, blocks, problems)
    if start_ns is None:
        start_ns = _earliest(stamps)
    signals = {channel: _signal(block, stamps[channel], start_ns, problems) for channel, block in kept.items()}
    signals = {channel: signal for channel, signal in signals.items() if len(signal.t)}
    stuck = {channel: stuck_samples(signals, channel) for channel in signals}
    for channel, samples in stuck.items():
        if samples.any():
            signals[channel] = _without_stuck(channel, signals[channel], samples, problems)
    return Run(
        name=name,
        signals=signals,
        vehicle=start.vehicle,
        manoeuvre=start.manoeuvre,
        rig=rig.name if rig else "",
        wheel_reference=start.wheel_reference,
        brakes=start.brakes if start.brakes in BRAKES else "unknown",
        notes=start.notes,
        vehicle_text=start.vehicle_text,
        rig_text=start.rig_text,
        problems=tuple(problems),
        marks=tuple(Mark((e.t_ns - start_ns) / 1e9, e.text) for e in events if e.kind == EventKind.MARK),
    )


def begin_ns(start: StartRecord, blocks: Mapping[str, Block]) -> int:
    """Where the time of the run of these blocks begins (`build_run`) [ns since the Unix epoch]."""
    problems: list[str] = []
    return _earliest(_stamped(_rig("", start, problems), blocks, problems)[0])


def _earliest(stamps: Mapping[str, np.ndarray]) -> int:
    return min(int(t.min()) for t in stamps.values() if len(t))


def _stamped(
    rig: Rig | None, blocks: Mapping[str, Block], problems: list[str]
) -> tuple[dict[str, np.ndarray], dict[str, Block]]:
    """Stamps of every channel by the clock that the rig declares, and the blocks with flags where a clock is wrong."""
    kept = dict(blocks)
    stamps: dict[str, np.ndarray] = {}
    without: dict[str, None] = {}
    shared: dict[str, list[str]] = {}
    for channel, block in blocks.items():
        sensor = rig.sensor_of(channel) if rig else None
        stamps[channel] = block.t_ns
        if sensor is not None and sensor.clock == "device":
            if block.device_ns is None:
                without[sensor.name] = None
            else:
                stamps[channel], kept[channel] = _on_device_clock(block, block.device_ns, problems)
        elif sensor is not None and sensor.clock == "steady":
            stamps[channel], kept[channel] = _at_steady_rate(block, problems)
        if sensor is None or sensor.clock != "device" or stamps[channel] is block.t_ns:
            stamps[channel], count = spread(stamps[channel], 1e9 / CHANNELS[channel].rate)
            if count:
                of = sensor.name if sensor else ""
                shared.setdefault(_better_clock(block, of), []).append(f"{channel} ({count:,} of {len(block):,})")
    problems += [
        f"{', '.join(those)}: samples that came together, with one stamp, are spread over the time since the one "
        f"before{remedy}"
        for remedy, those in shared.items()
    ]
    if without:
        problems.append(
            f"{', '.join(without)}: the rig asks for the device clock, the log has none: stamps are arrivals"
        )
    return stamps, kept


def _better_clock(block: Block, sensor: str) -> str:
    """How samples that came together would have better stamps, for the message; empty where no rig says."""
    if not sensor:
        return ""
    if block.device_ns is not None:
        return f'; clock = "device" in the row {sensor} of the rig stamps them by their own clock'
    return f'; if their rate is constant, clock = "steady" in the row {sensor} of the rig stamps them better'


def _rig(name: str, start: StartRecord, problems: list[str]) -> Rig | None:
    if not start.rig_text:
        return None
    try:
        return Rig.parse(start.rig_text, f"rig of {name}")
    except RigError as error:
        problems.append(f"the recorded rig cannot be used, so all stamps are arrivals: {'; '.join(error.faults)}")
        return None


def _on_device_clock(block: Block, device_ns: np.ndarray, problems: list[str]) -> tuple[np.ndarray, Block]:
    """Stamps by the fitted device clock, and the block with flags where that clock is wrong."""
    # Incomplete samples have no reading of the clock.
    read = np.flatnonzero((block.flags & int(Flag.CHECKSUM | Flag.INCOMPLETE)) == 0)
    if not len(read):
        return block.t_ns, block
    gap = (block.flags[read] & int(Flag.GAP)) != 0
    fit = fit_clock(block.t_ns[read], device_ns[read], gap=gap)
    t_ns, flags = block.t_ns.copy(), block.flags.copy()
    t_ns[read] = fit.stamps
    wrong, doubtful = read[fit.outliers], read[fit.doubtful]
    t_ns[wrong] = block.t_ns[wrong]
    flags[np.concatenate((wrong, doubtful))] |= np.uint8(Flag.CLOCK)
    if len(doubtful):
        problems.append(_doubtful(block, len(doubtful), "its clock does not run evenly"))
    if abs(fit.drift) > MAX_DRIFT:
        problems.append(
            f"{block.channel}: its clock is {fit.drift * 1e6:+.0f} ppm off, more than a quartz clock; stamps follow it"
        )
    if len(wrong):
        problems.append(f"{block.channel}: {len(wrong)} samples with a wrong device stamp are left out")
    problems += [
        f"{block.channel}: a clock jumped at sample {jump}; it is fitted anew from there" for jump in read[fit.jumps]
    ]
    return t_ns, Block(block.channel, block.t_ns, block.values, flags, block.device_ns)


def _at_steady_rate(block: Block, problems: list[str]) -> tuple[np.ndarray, Block]:
    """Stamps of samples at a constant rate, and the block with flags where samples were lost or stamps do not fit."""
    gaps = (block.flags & int(Flag.GAP)) != 0
    found = steady_stamps(block.t_ns, gaps, 1e9 / CHANNELS[block.channel].rate)
    flags = block.flags.copy()
    flags[list(found.losses)] |= np.uint8(Flag.GAP)
    flags[found.doubtful] |= np.uint8(Flag.CLOCK)
    for sample, lost in found.losses.items():
        what = f"{lost} samples that the counter does not show were lost before" if lost else "the clock jumped at"
        problems.append(f"{block.channel}: {what} sample {sample}; it is numbered anew from there")
    if len(found.doubtful):
        problems.append(_doubtful(block, len(found.doubtful), "its rate is not constant"))
    return found.stamps, Block(block.channel, block.t_ns, block.values, flags, block.device_ns)


def _doubtful(block: Block, count: int, cause: str) -> str:
    return (
        f"{block.channel}: {count} samples are left out: for {LEVEL_NS / 1e9:.0f} s and more every one of them arrived "
        f"over {MISFIT_NS / 1e6:.0f} ms after its stamp, so {cause}"
    )


def _without_stuck(channel: str, signal: Signal, stuck: np.ndarray, problems: list[str]) -> Signal:
    """The signal with the samples flagged at which it stands still in a moving car."""
    t = signal.t[stuck]
    begins = np.flatnonzero(np.diff(t, prepend=-np.inf) > STUCK_SECONDS)
    ends = np.append(begins[1:], len(t)) - 1
    where = ", ".join(f"{t[a]:.1f} to {t[b]:.1f} s" for a, b in zip(begins[:3], ends[:3], strict=True))
    more = f" and {len(begins) - 3} times more" if len(begins) > 3 else ""
    problems.append(
        f"{channel}: its value stands still in the moving car ({where}{more}), so those samples are left out; "
        "check the sensor"
    )
    return replace(signal, flags=signal.flags | np.where(stuck, np.uint8(Flag.STUCK), np.uint8(0)))


def _signal(block: Block, t_ns: np.ndarray, start_ns: int, problems: list[str]) -> Signal:
    """Signal with times in seconds since the run's start; samples not later than all before them are dropped."""
    usable = (block.flags & int(UNUSABLE)) == 0
    # Unusable samples do not affect the order of usable ones: they are kept where they fit between them.
    low, high = np.iinfo(np.int64).min, np.iinfo(np.int64).max
    good = usable & _later(np.where(usable, t_ns, low))
    before = np.maximum.accumulate(np.where(good, t_ns, low))
    after = np.minimum.accumulate(np.where(good, t_ns, high)[::-1])[::-1]
    good |= ~usable & (before < t_ns) & (t_ns < after)
    good &= usable | _later(np.where(good, t_ns, low))
    dropped = int(np.count_nonzero(usable & ~good))
    if dropped:
        problems.append(f"{block.channel}: {dropped} samples not later than the one before are left out")
    if good.all():
        return Signal((t_ns - start_ns) / 1e9, block.values, block.flags)
    return Signal((t_ns[good] - start_ns) / 1e9, block.values[good], block.flags[good])


def _later(t_ns: np.ndarray) -> np.ndarray:
    """(N,) whether each stamp is later than all before it."""
    return np.concatenate((np.ones(min(1, len(t_ns)), bool), t_ns[1:] > np.maximum.accumulate(t_ns)[:-1]))
