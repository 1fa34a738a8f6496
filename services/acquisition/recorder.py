"""Recorder, the live loop: wires → queue → log of raw frames → decoder → log of blocks and bus."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any, Protocol

import numpy as np

from lacet.daq.blocks import Block, Flag
from lacet.daq.bus.marks import mark_text
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.formats.events import EventKind, RunEvent
from lacet.daq.formats.log import LogWriter
from lacet.daq.formats.wire import Losses, Tally
from lacet.daq.frames import Frames
from lacet.daq.rig import Bus
from lacet.services.acquisition.bus_load import BusLoad
from lacet.services.acquisition.host_clock import HostClock, short_synchronisation, synchronisation
from lacet.services.acquisition.intake import QUEUE_FRAMES, Intake
from lacet.services.acquisition.log_medium import STALL_SECONDS, LogMedium
from lacet.services.acquisition.run_log import RunLog, Split
from lacet.services.acquisition.sensor_monitor import SensorMonitor, SensorStatus, Watched
from lacet.services.acquisition.transports.base import Receiver

BATCH = 0.05
"""Duration of a batch of frames that are decoded and written together [s]: a sample waits for half of it on average. A
batch costs some 6 ms of processor time however few its frames are."""
MOST_MARKS = 50
"""Most markers that are set within one batch: somebody who asks for more gets no answer."""
SHOWN_MARKS = 100
"""Number of the last markers that are in the ledger of each second; the log has them all."""


class LiveDecoder(Protocol):
    """Interface of the decoder that the loop needs (`services.acquisition.stream_decoder.Decoder`)."""

    def feed(self, frames: Frames) -> list[Block]:
        """Blocks completed by the batch."""
        ...

    @property
    def watched(self) -> Sequence[Watched]:
        """The sensors that it decodes."""
        ...

    def finish(self) -> list[Block]:
        """Blocks of incomplete data at the end."""
        ...

    @property
    def failures(self) -> Mapping[str, str]:
        """Sensor → what its driver failed with, of those that are no longer decoded."""
        ...

    def losses(self) -> Losses:
        """Losses so far, by bus, then cause."""
        ...

    def ledger(self) -> Losses:
        """All counts so far, by bus, then name."""
        ...


@dataclass
class Health:
    """State of a recording in the last second.

    Attributes
    ----------
    seconds : time since the start [s].
    frames : bus → frames/s received.
    samples : channel → samples/s.
    losses : source → cause → number since the start.
    down : buses whose wire is not open.
    waiting : number of frames in the queue.
    sensors : sensor → what it does.
    disk_seconds : time until the disk is full but for a reserve [s].
    rates : sensor → samples/s of the channel that is farthest from its nominal rate, and that rate, where it is known.
    load : bus → part of the time in which it is busy, at most, where its bit rate is known.
    clock : how the machine's clock is synchronised, in a word or two.
    listened : whether anybody receives the blocks; None without the bus, and before the first block.
    marks : the last markers that were set, in their order.
    """

    seconds: float
    frames: dict[str, float]
    samples: dict[str, float]
    losses: dict[str, dict[str, int]]
    down: list[str]
    waiting: int
    sensors: Mapping[str, SensorStatus] = field(default_factory=dict)
    disk_seconds: float = float("inf")
    rates: Mapping[str, tuple[float, float | None]] = field(default_factory=dict)
    load: Mapping[str, float] = field(default_factory=dict)
    clock: str = ""
    listened: bool | None = None
    marks: Sequence[RunEvent] = ()


@dataclass
class Summary:
    """Totals of a finished recording: `frames` and `samples` by bus and channel, `losses` by source and cause.

    `files` : the log's files, in their order.
    """

    reason: str
    seconds: float
    frames: dict[str, int]
    samples: dict[str, int]
    losses: dict[str, dict[str, int]]
    log_error: str | None = None
    tallies: dict[str, Tally] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)


class Recorder:
    """Recorder of a run, which only `stop` ends: no dead link, failing bus or full disk does.

    Parameters
    ----------
    receivers : one for each bus.
    decoder : decoder of frames into blocks.
    log : open log, the first file of the run; closed by `run`.
    publisher : publisher on the bus; None for none.
    axes : channel → axes where the rig declares others than the vocabulary (as given to the log).
    notify : called with plain sentences for the user.
    report : called once a second.
    queue_frames : capacity of the queue.
    clock : the machine's clock.
    medium : maker of the watcher of a log's file.
    split : when to go on in a new file.
    intake : readers of the receivers that were started before, with their queue and clock.
    buses : of the rig, for their load.
    resumed_ns : last time of the part that was recorded before [ns], where the recording goes on after it broke off.
    """

    def __init__(
        self,
        receivers: Sequence[Receiver],
        decoder: LiveDecoder,
        log: LogWriter,
        publisher: RunPublisher | None = None,
        *,
        axes: Mapping[str, str] | None = None,
        notify: Callable[[str], None] = print,
        report: Callable[[Health], None] = lambda health: None,
        queue_frames: int = QUEUE_FRAMES,
        clock: HostClock | None = None,
        medium: Callable[[Path], LogMedium] = LogMedium,
        split: Split | None = None,
        resumed_ns: int | None = None,
        intake: Intake | None = None,
        buses: Mapping[str, Bus] | None = None,
    ):
        self._intake = intake or Intake(receivers, notify, clock, queue_frames)
        self.queue, self.readers, self._clock = self._intake.queue, self._intake.readers, self._intake.clock
        self._decoder = decoder
        self._log = RunLog(log, axes or {}, notify, self._clock, medium, split)
        self._publisher = publisher
        self._notify = notify
        self._report = report
        self._clock_steps = 0
        self._published_bytes = 0
        self._load = BusLoad(dict(buses or {}))
        self._monitor = SensorMonitor(decoder.watched, time.monotonic())
        self._failed: set[str] = set()
        self._begun_ns = self._clock.now_ns()
        self._marks: deque[RunEvent] = deque(maxlen=MOST_MARKS)
        self._mark_numbers = itertools.count(1)
        self._marked: deque[RunEvent] = deque(maxlen=SHOWN_MARKS)
        if publisher is not None:
            publisher.on_mark = self._mark_asked
        self._due = 0.0
        self._reported = 0.0, Counter[str](), Counter({c: t.samples for c, t in self._log.channels.items()})
        self._after_break: set[str] = set()
        if resumed_ns is not None:
            self._resume(resumed_ns)

    def run(
        self,
        stop: Event,
        duration: float | None = None,
        until_idle: float | None = None,
        on_ready: Callable[[], None] = lambda: None,
    ) -> Summary:
        """Record until `stop` is set, `duration` [s] is over, or no frame came for `until_idle` [s] after the first.

        Parameters
        ----------
        on_ready : called once every wire is open for the first time.

        Returns
        -------
        Summary : totals; the log is closed and the manifest is published.

        Raises
        ------
        BaseException : a bug in a reader; the log is closed with that reason.
        """
        started = time.monotonic()
        self._intake.start()
        self._log.start()
        with contextlib.ExitStack() as stack:
            stack.push(lambda *exception: self._log.abandon(*exception))
            try:
                reason = self._loop(stop, started, duration, until_idle, on_ready)
            finally:
                self._intake.stop()
            self._work(self.queue.drain())
            self._blocks_out(self._decoder.finish())
            self._second(started)
            return self._finish(reason, started)

    def _resume(self, last_ns: int) -> None:
        """Say and store that the recording broke off; what came meanwhile is missing before the first samples."""
        self._after_break = {channel for one in self._decoder.watched for channel in one.rates}
        seconds = (self._begun_ns - last_ns) / 1e9
        text = f"the recording broke off and goes on here: what came within {seconds:.1f} s is lost"
        self._notify(text)
        self._log.event(RunEvent(self._begun_ns, EventKind.LOG, "", "resumed", text))

    def mark(self, text: str, where: str = "terminal") -> RunEvent | None:
        """Set a marker, now; it is stored within a batch. From any thread.

        Parameters
        ----------
        text : what is marked; a number is made for none.
        where : ``terminal`` or ``bus``.

        Returns None when too many wait to be stored.
        """
        if len(self._marks) == MOST_MARKS:
            return None
        text = mark_text(text) or f"mark {next(self._mark_numbers)}"
        event = RunEvent(self._clock.now_ns(), EventKind.MARK, "", where, text)
        self._marks.append(event)
        return event

    def _mark_asked(self, text: str) -> dict[str, Any] | None:
        event = self.mark(text, "bus")
        return {"text": event.text, "seconds": (event.t_ns - self._begun_ns) / 1e9} if event else None

    def _store_marks(self) -> None:
        while self._marks:
            event = self._marks.popleft()
            self._log.event(event)
            self._marked.append(event)
            self._notify(f"marker '{event.text}' at {(event.t_ns - self._begun_ns) / 1e9:.1f} s")

    def _loop(
        self,
        stop: Event,
        started: float,
        duration: float | None,
        until_idle: float | None,
        on_ready: Callable[[], None],
    ) -> str:
        ready = False
        last_frame: float | None = None
        next_report = started + 1.0
        while True:
            batch = self._gather()
            now = time.monotonic()
            if batch:
                last_frame = now
                self._work(batch)
            self._watch_clock()
            self._watch_drivers()
            self._watch_sensors()
            self._watch_wires()
            self._store_marks()
            self._log.tick(self.losses)
            if (held_up := time.monotonic() - now) > STALL_SECONDS:
                self._notify(f"the recording was held up for {held_up:.1f} s; what came in meanwhile waits in memory")
            for reader in self.readers:
                if reader.fault is not None:
                    raise reader.fault
            if not ready and all(reader.up.is_set() for reader in self.readers):
                ready = True
                on_ready()
            if now >= next_report:
                next_report = max(next_report + 1.0, now)
                self._second(started)
            if stop.is_set():
                return "stopped"
            if duration is not None and now - started >= duration:
                return f"duration of {duration:g} s is over"
            if until_idle is not None and last_frame is not None and now - last_frame >= until_idle:
                return f"nothing came for {until_idle:g} s"

    def _gather(self) -> list[Frames]:
        """All frames received since the last time, which is one batch time ago or the work on the last batch."""
        # Sleeping and then draining the queue costs less than waking up for every item.
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = max(self._due, time.monotonic()) + BATCH
        return self.queue.drain()

    def _work(self, batch: list[Frames]) -> None:
        for source in dict.fromkeys(frames.source for frames in batch):
            frames = Frames.concat(source, [part for part in batch if part.source == source])
            self._log.store(frames)
            self._load.add(frames)
            self._blocks_out(self._decoder.feed(frames))

    def _blocks_out(self, blocks: list[Block]) -> None:
        self._monitor.take(blocks, time.monotonic())
        for block in blocks:
            if not len(block):
                continue
            if block.channel in self._after_break:
                self._after_break.remove(block.channel)
                flags = block.flags.copy()
                flags[0] |= np.uint8(Flag.GAP)
                block = Block(block.channel, block.t_ns, block.values, flags, block.device_ns)
            message = self._log.store(block)
            if self._publisher is not None:
                self._published_bytes += len(message)
                self._publisher.put_block(block.channel, message, len(block))

    def _watch_clock(self) -> None:
        for step in self._clock.steps[self._clock_steps :]:
            self._clock_steps += 1
            seconds = step.step_ns / 1e9
            text = (
                f"the clock of this machine was set by {seconds:+.3f} s; the stamps of the run go on without that, the "
                "sensors' clocks are not concerned"
            )
            self._notify(text)
            self._log.event(RunEvent(step.t_ns, EventKind.HOST_CLOCK, "", "stepped", text))

    def _watch_drivers(self) -> None:
        for name, failure in self._decoder.failures.items():
            if name not in self._failed:
                self._failed.add(name)
                text = f"sensor {name}: its driver failed: {failure}"
                self._notify(f"{text}; its bytes are recorded: correct it, then lacet decode")
                self._log.event(RunEvent(self._clock.now_ns(), EventKind.SENSOR, name, "failed", text))

    def _watch_sensors(self) -> None:
        for name, status in self._monitor.check(time.monotonic()):
            self._notify(f"sensor {name}: {status}")
            self._log.event(RunEvent(self._clock.now_ns(), EventKind.SENSOR, name, status.state, f"{name}: {status}"))

    def _watch_wires(self) -> None:
        for reader in self.readers:
            while reader.events:
                self._log.event(reader.events.popleft())

    def losses(self) -> dict[str, dict[str, int]]:
        """The loss ledger: bus (or channel, for losses of the disk) → cause → number since the start."""
        out: dict[str, Counter[str]] = {}
        for reader in self.readers:
            out[reader.receiver.source] = Counter(reader.losses())
        for source, number in self.queue.dropped.items():
            out.setdefault(source, Counter())["queue"] += number
        for source, number in self._monitor.hidden_losses().items():
            out.setdefault(source, Counter())["lost_unseen"] += number
        for source, causes in (*self._decoder.losses().items(), *self._log.losses.items()):
            out.setdefault(source, Counter()).update(causes)
        return {source: {c: n for c, n in sorted(causes.items()) if n} for source, causes in out.items() if +causes}

    def _second(self, started: float) -> None:
        now = time.monotonic()
        before, frames, samples = self._reported
        seconds = now - started
        received = Counter({reader.receiver.source: reader.received for reader in self.readers})
        decoded = Counter({channel: tally.samples for channel, tally in self._log.channels.items()})
        span = max(seconds - before, 1e-9)
        self._reported = (seconds, received, decoded)
        rates = {name: (number - samples[name]) / span for name, number in sorted(decoded.items())}
        health = Health(
            seconds,
            {name: (number - frames[name]) / span for name, number in received.items()},
            rates,
            self.losses(),
            [reader.receiver.source for reader in self.readers if not (reader.up.is_set() or reader.stopping)],
            self.queue.held,
            self._monitor.status,
            self._log.seconds_to_full(self._published_bytes),
            self._monitor.rates(rates),
            self._load.take(span),
            short_synchronisation(synchronisation()),
            None if self._publisher is None else self._publisher.listened,
            tuple(self._marked),
        )
        if self._publisher is not None:
            try:
                self._publisher.put_ledger(_ledger(health, self._decoder.ledger()))
            except Exception as error:
                self._notify(f"bus: {error}; recording goes on")
        self._report(health)

    def _finish(self, reason: str, started: float) -> Summary:
        losses = self.losses()
        if self._publisher is not None:
            self._publisher.on_mark = None  # no marker is answered that would not be stored
        self._watch_clock()
        self._watch_drivers()
        self._watch_wires()
        self._store_marks()
        self._log.watch_medium()
        text = f"a power cut could have cost {self._log.power_cut_seconds:.2f} s of the recording at most"
        self._log.event(RunEvent(self._clock.now_ns(), EventKind.LOG, "", "stop", text))
        text = f"the clock of this machine is {synchronisation()}"
        self._log.event(RunEvent(self._clock.now_ns(), EventKind.HOST_CLOCK, "", "stop", text))
        if self._log.error is not None:
            reason = f"{reason}; the log is not complete: {self._log.error}"
        frames = {name: tally.samples for name, tally in self._log.sources.items()}
        samples = {name: tally.samples for name, tally in sorted(self._log.channels.items())}
        self._log.close(reason, losses)
        if self._publisher is not None:
            self._publisher.finish(losses, dict(self._log.sources))
        seconds = time.monotonic() - started
        return Summary(
            reason, seconds, frames, samples, self.losses(), self._log.error, dict(self._log.channels), self._log.paths
        )


def _ledger(health: Health, counts: Losses) -> dict[str, Any]:
    return {
        "format": "lacet-ledger 1",
        "seconds": round(health.seconds, 3),
        "frames_per_second": {name: round(rate, 1) for name, rate in health.frames.items()},
        "samples_per_second": {name: round(rate, 1) for name, rate in health.samples.items()},
        "losses": health.losses,
        "counts": counts,
        "down": health.down,
        "queue": health.waiting,
        "load": {name: round(load, 3) for name, load in health.load.items()},
        "clock": health.clock,
        "sensors": {
            name: {"state": status.state.value, "detail": status.detail, "channels": list(status.channels)}
            for name, status in health.sensors.items()
        },
        "marks": [{"t_ns": mark.t_ns, "text": mark.text} for mark in health.marks],
    }
