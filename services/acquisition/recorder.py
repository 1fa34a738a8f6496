"""Recorder, the live loop: wires → queue → log of raw frames → decoder → log of blocks and bus."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event
from typing import Any, Protocol

from lacet.daq.blocks import Block
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.formats.events import EventKind, RunEvent
from lacet.daq.formats.log import CHUNK_SECONDS, DISK, LogWriteError, LogWriter, StopRecord
from lacet.daq.formats.wire import Losses, Tally, block_to_bytes, frames_to_bytes
from lacet.daq.frames import Frames
from lacet.services.acquisition.host_clock import HostClock, synchronisation
from lacet.services.acquisition.log_medium import RESERVE_BYTES, ROOM_BYTES, STALL_SECONDS, LogMedium
from lacet.services.acquisition.sensor_monitor import SensorMonitor, SensorStatus, Watched
from lacet.services.acquisition.transports.base import Receiver
from lacet.services.acquisition.transports.reader import Reader

BATCH = 0.1
"""Duration of a batch of frames that are decoded and written together [s]."""
QUEUE_FRAMES = 60_000
"""Capacity of the queue in frames: some eight seconds of a full rig."""


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
    """

    seconds: float
    frames: dict[str, float]
    samples: dict[str, float]
    losses: dict[str, dict[str, int]]
    down: list[str]
    waiting: int
    sensors: Mapping[str, SensorStatus] = field(default_factory=dict)
    disk_seconds: float = float("inf")


@dataclass
class Summary:
    """Totals of a finished recording: `frames` and `samples` by bus and channel, `losses` by source and cause."""

    reason: str
    seconds: float
    frames: dict[str, int]
    samples: dict[str, int]
    losses: dict[str, dict[str, int]]
    log_error: str | None = None
    tallies: dict[str, Tally] = field(default_factory=dict)


class Recorder:
    """Recorder of a run, which only `stop` ends: no dead link, failing bus or full disk does.

    Parameters
    ----------
    receivers : one for each bus.
    decoder : decoder of frames into blocks.
    log : open log; closed by `run`.
    publisher : publisher on the bus; None for none.
    axes : channel → axes where the rig declares others than the vocabulary (as given to the log).
    notify : called with plain sentences for the user.
    report : called once a second.
    queue_frames : capacity of the queue.
    clock : the machine's clock.
    medium : maker of the watcher of a log's file.
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
    ):
        self.queue: BoundedQueue[Frames] = BoundedQueue(queue_frames)
        self._clock = clock or HostClock()
        self.readers = [Reader(receiver, self.queue, notify, self._clock) for receiver in receivers]
        self._decoder = decoder
        self._log = log
        self._publisher = publisher
        self._axes = dict(axes or {})
        self._notify = notify
        self._report = report
        self._log_error: str | None = None
        self._clock_steps = 0
        self._open_medium = medium
        self._medium = medium(log.path)
        self._first_path = log.path
        self._part = 1
        self._closed_for_room = False
        self._unstored: Counter[str] = Counter()
        self._published_bytes = 0
        self._monitor = SensorMonitor(decoder.watched, time.monotonic())
        self._frames: dict[str, Tally] = {}
        self._blocks: dict[str, Tally] = {}
        self._reported: tuple[float, Counter[str], Counter[str]] = (0.0, Counter(), Counter())

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
        BaseException : a bug in a reader or a driver; the log is closed with that reason.
        """
        started = time.monotonic()
        for reader in self.readers:
            reader.start()
        self._medium.start()
        with contextlib.ExitStack() as stack:
            stack.callback(lambda: self._medium.stop())
            stack.push(lambda *exception: self._log.__exit__(*exception))  # an exception closes it with its reason
            try:
                reason = self._loop(stop, started, duration, until_idle, on_ready)
            finally:
                for reader in self.readers:
                    reader.stop()
                for reader in self.readers:
                    reader.join()
            self._work(self.queue.drain())
            self._blocks_out(self._decoder.finish())
            self._second(started)
            return self._finish(reason, started)

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
            self._tick()
            self._watch_clock()
            self._watch_sensors()
            self._watch_wires()
            self._watch_medium()
            self._watch_room()
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
        """All frames received within one batch time."""
        until = time.monotonic() + BATCH
        out: list[Frames] = []
        while (remaining := until - time.monotonic()) > 0.0:
            # Sleeping and then draining the queue costs less than waking up for every item.
            time.sleep(remaining)
            out += self.queue.drain()
        return out

    def _work(self, batch: list[Frames]) -> None:
        for source in dict.fromkeys(frames.source for frames in batch):
            frames = Frames.concat(source, [part for part in batch if part.source == source])
            tally = self._frames.get(source, Tally())
            self._frames[source] = tally.add(self._store_frames(frames, tally.messages), len(frames))
            self._blocks_out(self._decoder.feed(frames))

    def _blocks_out(self, blocks: list[Block]) -> None:
        self._monitor.take(blocks, time.monotonic())
        for block in blocks:
            if not len(block):
                continue
            tally = self._blocks.get(block.channel, Tally())
            message = self._store_block(block, tally.messages)
            self._blocks[block.channel] = tally.add(message, len(block))
            if self._publisher is not None:
                self._published_bytes += len(message)
                self._publisher.put_block(block.channel, message, len(block))

    def _store_frames(self, frames: Frames, sequence: int) -> bytes:
        if self._closed_for_room:
            self._unstored[frames.source] += len(frames)
            return frames_to_bytes(frames, sequence)
        try:
            stored = self._log.write_frames(frames)
            return stored if self._part == 1 else frames_to_bytes(frames, sequence)
        except LogWriteError as error:
            self._log_failed(error)
            return frames_to_bytes(frames, sequence)

    def _store_block(self, block: Block, sequence: int) -> bytes:
        if self._closed_for_room:
            self._unstored[block.channel] += len(block)
        else:
            try:
                stored = self._log.write_block(block)
                if self._part == 1:  # later files number their own messages
                    return stored
            except LogWriteError as error:  # the block is still published, with the same number
                self._log_failed(error)
        return block_to_bytes(block, sequence, self._axes.get(block.channel))

    def _tick(self) -> None:
        try:
            if self._log.error is None and not self._closed_for_room:
                self._log.tick(self._clock.now_ns())
        except LogWriteError as error:
            self._log_failed(error)

    def _watch_clock(self) -> None:
        for step in self._clock.steps[self._clock_steps :]:
            self._clock_steps += 1
            seconds = step.step_ns / 1e9
            text = (
                f"the clock of this machine was set by {seconds:+.3f} s; the stamps of the run go on without that, the "
                "sensors' clocks are not concerned"
            )
            self._notify(text)
            self._event(RunEvent(step.t_ns, EventKind.HOST_CLOCK, "", "stepped", text))

    def _watch_sensors(self) -> None:
        for name, status in self._monitor.check(time.monotonic()):
            self._notify(f"sensor {name}: {status}")
            self._event(RunEvent(self._clock.now_ns(), EventKind.SENSOR, name, status.state, f"{name}: {status}"))

    def _watch_wires(self) -> None:
        for reader in self.readers:
            while reader.events:
                self._event(reader.events.popleft())

    def _watch_medium(self) -> None:
        self._medium.check()
        while self._medium.messages:
            state, text = self._medium.messages.popleft()
            self._notify(text)
            self._event(RunEvent(self._clock.now_ns(), EventKind.LOG, "", state, text))

    def _watch_room(self) -> None:
        """Close the log while there is room for its end; go on in a new file when there is room again."""
        if self._log_error is not None:
            return
        free = self._medium.free()
        if not self._closed_for_room and free < RESERVE_BYTES:
            reason = f"less than {RESERVE_BYTES / 1e6:.0f} MB were free on the disk"
            self._notify(
                f"{reason}: THE LOG {self._log.path} IS CLOSED; publishing goes on. When there is room for "
                f"{ROOM_BYTES / 1e6:.0f} MB more, recording goes on in a new file"
            )
            self._event(RunEvent(self._clock.now_ns(), EventKind.LOG, "", "closed", reason))
            try:
                self._log.close(StopRecord(self._clock.now_ns(), reason, {}, self.losses()))
            except LogWriteError as error:
                self._log_failed(error)
            self._closed_for_room = True
        elif self._closed_for_room and free > RESERVE_BYTES + ROOM_BYTES:
            self._next_file()

    def _next_file(self) -> None:
        first = self._first_path
        path = first.with_stem(f"{first.stem}-{self._part + 1}")
        start = replace(self._log.start, extra={**self._log.start.extra, "part": str(self._part + 1)})
        try:
            log = LogWriter(path, start, axes=self._axes)
        except LogWriteError as error:
            self._log_failed(error)
            return
        self._medium.stop()
        self._log, self._medium = log, self._open_medium(path)
        self._medium.start()
        self._part, self._closed_for_room = self._part + 1, False
        self._notify(f"there is room again: recording goes on in {path}")

    def _event(self, event: RunEvent) -> None:
        """Store an event in the log."""
        try:
            if self._log.error is None and not self._closed_for_room:
                self._log.write_event(event)
        except LogWriteError as error:
            self._log_failed(error)

    def _log_failed(self, error: LogWriteError) -> None:
        if self._log_error is None:
            self._log_error = str(error)
            self._notify(f"THE LOG CANNOT BE WRITTEN ANY FURTHER; publishing goes on. {error}")

    def losses(self) -> dict[str, dict[str, int]]:
        """The loss ledger: bus (or channel, for losses of the disk) → cause → number since the start."""
        out: dict[str, Counter[str]] = {}
        for reader in self.readers:
            out[reader.receiver.source] = Counter(reader.losses())
        for source, number in self.queue.dropped.items():
            out.setdefault(source, Counter())["queue"] += number
        for source, number in self._unstored.items():
            out.setdefault(source, Counter())[DISK] += number
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
        decoded = Counter({channel: tally.samples for channel, tally in self._blocks.items()})
        span = max(seconds - before, 1e-9)
        self._reported = (seconds, received, decoded)
        health = Health(
            seconds,
            {name: (number - frames[name]) / span for name, number in received.items()},
            {name: (number - samples[name]) / span for name, number in sorted(decoded.items())},
            self.losses(),
            [reader.receiver.source for reader in self.readers if not (reader.up.is_set() or reader.stopping)],
            self.queue.held,
            self._monitor.status,
            self._medium.seconds_to_full(self._medium.size() + self._published_bytes),
        )
        if self._publisher is not None:
            try:
                self._publisher.put_ledger(_ledger(health, self._decoder.ledger()))
            except Exception as error:
                self._notify(f"bus: {error}; recording goes on")
        self._report(health)

    def _finish(self, reason: str, started: float) -> Summary:
        losses = self.losses()
        self._watch_clock()
        self._watch_wires()
        self._watch_medium()
        text = f"a power cut could have cost {self._medium.longest + CHUNK_SECONDS:.2f} s of the recording at most"
        self._event(RunEvent(self._clock.now_ns(), EventKind.LOG, "", "stop", text))
        text = f"the clock of this machine is {synchronisation()}"
        self._event(RunEvent(self._clock.now_ns(), EventKind.HOST_CLOCK, "", "stop", text))
        if self._log_error is not None:
            reason = f"{reason}; the log is not complete: {self._log_error}"
        frames = {name: tally.samples for name, tally in self._frames.items()}
        samples = {name: tally.samples for name, tally in sorted(self._blocks.items())}
        try:
            self._log.close(
                StopRecord(self._clock.now_ns(), reason, {}, losses)
            )  # which may be closed for want of room
        except LogWriteError as error:
            self._log_failed(error)
            losses = self.losses()
        self._medium.stop()
        if self._publisher is not None:
            self._publisher.finish(losses, dict(self._frames))
        if self._log_error is None and self._medium.failed:
            self._log_error = f"{self._log.path} was removed or replaced, or its disk reported an error"
        seconds = time.monotonic() - started
        return Summary(reason, seconds, frames, samples, losses, self._log_error, self._blocks)


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
        "sensors": {
            name: {"state": status.state.value, "detail": status.detail, "channels": list(status.channels)}
            for name, status in health.sensors.items()
        },
    }
