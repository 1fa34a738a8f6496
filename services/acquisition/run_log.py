"""Log of a run that is being recorded: its files one after the other, and what the disk could not store."""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from lacet.daq.blocks import Block
from lacet.daq.errors import UsageError
from lacet.daq.formats.events import EventKind, RunEvent
from lacet.daq.formats.log import CHUNK_SECONDS, DISK, LogWriteError, LogWriter, StopRecord
from lacet.daq.formats.run_files import BROKE_OFF, GOES_ON, PART, next_path
from lacet.daq.formats.wire import Losses, Manifest, Tally, block_to_bytes, frames_to_bytes
from lacet.daq.frames import Frames
from lacet.services.acquisition.host_clock import HostClock
from lacet.services.acquisition.log_medium import RESERVE_BYTES, ROOM_BYTES, LogMedium

_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}
_SIZES = {"MB": 1e6, "GB": 1e9}
LEAST_SECONDS = 1.0
"""Shortest file of a run that is split [s]: each begins with the texts of rig and vehicle."""
LEAST_BYTES = 1_000_000
"""Smallest file of a run that is split [bytes], for the same reason."""


@dataclass(frozen=True)
class Split:
    """When a recording goes on in a new file: after a time [s], or from a size on [bytes]."""

    seconds: float = float("inf")
    size: float = float("inf")

    @staticmethod
    def parse(text: str) -> Split:
        """The split given by an option: ``10min``, ``30s``, ``1h``, ``500MB``, ``1GB``. Raises UsageError."""
        found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-zA-Z]+)", text.strip())
        if found and (unit := _UNITS.get(found[2])) and float(found[1]) * unit >= LEAST_SECONDS:
            return Split(seconds=float(found[1]) * unit)
        if found and (unit := _SIZES.get(found[2])) and float(found[1]) * unit >= LEAST_BYTES:
            return Split(size=float(found[1]) * unit)
        raise UsageError(
            f"--split {text}: give a time ({', '.join(_UNITS)}) of 1 s and more or a size ({', '.join(_SIZES)}) of "
            "1 MB and more, for example 10min or 1GB"
        )

    def due(self, seconds: float, size: float) -> bool:
        """Whether a file of this age [s] and size [bytes] is to be followed by another."""
        return seconds >= self.seconds or size >= self.size


class RunLog:
    """The files of a recorded run, of which one is open, or none while the disk has no room.

    Messages are numbered on from file to file, stored or not, as they are on the bus.

    Parameters
    ----------
    log : the first file, open.
    axes : channel → axes where the rig declares others than the vocabulary (as given to the log).
    notify : called with plain sentences for the user.
    clock : the machine's clock.
    medium : maker of the watcher of a log's file.
    split : when to go on in a new file.
    """

    def __init__(
        self,
        log: LogWriter,
        axes: Mapping[str, str],
        notify: Callable[[str], None],
        clock: HostClock,
        medium: Callable[[Path], LogMedium] = LogMedium,
        split: Split | None = None,
    ):
        self.error: str | None = None
        """Why nothing more is stored for good; None without a fault."""
        self.paths = [log.path]
        """The files, in their order."""
        before = log.manifest()
        self.channels: dict[str, Tally] = dict(before.channels)
        """Blocks so far by channel."""
        self.sources: dict[str, Tally] = dict(before.sources)
        """Batches of frames so far by bus."""
        self._log, self._axes, self._notify, self._clock, self._split = log, dict(axes), notify, clock, split or Split()
        self._part = int(log.start.extra.get(PART, "1"))
        self._first = log.path if self._part == 1 else log.path.with_stem(log.path.stem.rpartition("-")[0])
        self._open_medium = medium
        self._medium = medium(log.path)
        self._begun_ns = clock.now_ns()
        self._closed_bytes = 0
        self._closed_for_room = False
        self._longest = 0.0
        self._unstored: Counter[str] = Counter()

    def start(self) -> None:
        """Begin to force what is written to the medium."""
        self._medium.start()

    def store(self, item: Frames | Block) -> bytes:
        """Store a batch of frames or a block; returns its message, which has the same number on the bus."""
        if isinstance(item, Frames):
            name, tallies = item.source, self.sources
        else:
            name, tallies = item.channel, self.channels
        tally = tallies.get(name, Tally())
        message = b""
        if self._closed_for_room:
            self._unstored[name] += len(item)
        else:
            try:
                message = self._log.write_frames(item) if isinstance(item, Frames) else self._log.write_block(item)
            except LogWriteError as error:
                self._failed(error)
        if not message:
            if isinstance(item, Frames):
                message = frames_to_bytes(item, tally.messages)
            else:
                message = block_to_bytes(item, tally.messages, self._axes.get(name))
        tallies[name] = tally.add(message, len(item))
        return message

    def event(self, event: RunEvent) -> None:
        """Store an event."""
        try:
            if self._log.error is None and not self._closed_for_room:
                self._log.write_event(event)
        except LogWriteError as error:
            self._failed(error)

    def tick(self, losses: Callable[[], Losses]) -> None:
        """Pass on what is written, watch the medium and its room, and go on in a new file when that is due.

        `losses` : the run's losses so far, for the end of a file.
        """
        try:
            if self._log.error is None and not self._closed_for_room:
                self._log.tick(self._clock.now_ns())
        except LogWriteError as error:
            self._failed(error)
        self.watch_medium()
        if self.error is None:
            self._watch_room(losses)
            self._watch_split(losses)

    def watch_medium(self) -> None:
        """Say and store what the medium did."""
        self._medium.check()
        while self._medium.messages:
            state, text = self._medium.messages.popleft()
            self._notify(text)
            self.event(RunEvent(self._clock.now_ns(), EventKind.LOG, "", state, text))

    @property
    def losses(self) -> dict[str, dict[str, int]]:
        """Samples and frames that no file took, by channel and source."""
        out = {name: Counter(causes) for name, causes in self._log.losses.items()}
        for name, number in self._unstored.items():
            out.setdefault(name, Counter())[DISK] += number
        return {name: dict(causes) for name, causes in out.items()}

    @property
    def power_cut_seconds(self) -> float:
        """What a power cut could have lost at most [s]."""
        return max(self._longest, self._medium.longest) + CHUNK_SECONDS

    def seconds_to_full(self, beside: int) -> float:
        """Time until the disk is full but for a reserve [s]; `beside` : bytes put there beside the log."""
        return self._medium.seconds_to_full(self._closed_bytes + self._medium.size() + beside)

    def close(self, reason: str, losses: Losses) -> None:
        """Write the end of the run and close; one that is closed for want of room stays so."""
        try:
            self._log.close(self._stop(reason, losses))
        except LogWriteError as error:
            self._failed(error)
        self._medium.stop()
        if self.error is None and self._medium.failed:
            self.error = f"{self._log.path} was removed or replaced, or its disk reported an error"

    def abandon(self, *exception: object) -> None:
        """Close with an exception as the reason; without one do nothing, since the log is closed."""
        if (error := exception[1]) is not None:
            text = f"{BROKE_OFF}{type(error).__name__}: {error}".strip(": ")
            with contextlib.suppress(LogWriteError):  # the exception already raised is reported instead
                self._log.close(self._stop(text, {}))
        self._medium.stop()

    def _stop(self, reason: str, losses: Losses) -> StopRecord:
        stored = {name: number - self._unstored[name] for name, number in self._log.counts.items()}
        return StopRecord(self._clock.now_ns(), reason, stored, losses)

    def _watch_room(self, losses: Callable[[], Losses]) -> None:
        """Close the log while there is room for its end; go on in a new file when there is room again."""
        free = self._medium.free()
        if not self._closed_for_room and free < RESERVE_BYTES:
            reason = f"less than {RESERVE_BYTES / 1e6:.0f} MB were free on the disk"
            self._notify(
                f"{reason}: THE LOG {self._log.path} IS CLOSED; publishing goes on. When there is room for "
                f"{ROOM_BYTES / 1e6:.0f} MB more, recording goes on in a new file"
            )
            self.event(RunEvent(self._clock.now_ns(), EventKind.LOG, "", "closed", reason))
            try:
                self._log.close(self._stop(reason, losses()))
            except LogWriteError as error:
                self._failed(error)
            self._closed_for_room = True
        elif self._closed_for_room and free > RESERVE_BYTES + ROOM_BYTES and (log := self._next_file()) is not None:
            self._go_on_in(log)
            self._notify(f"there is room again: recording goes on in {log.path}")

    def _watch_split(self, losses: Callable[[], Losses]) -> None:
        """Go on in a new file when the open one is long or large enough; it is open before the old one is closed."""
        age = (self._clock.now_ns() - self._begun_ns) / 1e9
        if self._closed_for_room or not self._split.due(age, self._medium.size()):
            return
        if (log := self._next_file()) is None:
            return
        try:
            self._log.close(self._stop(f"{GOES_ON}{log.path.name}", losses()))
        except LogWriteError as error:
            log.close()
            self._failed(error)
            return
        self._go_on_in(log)
        self._notify(f"recording goes on in {log.path}")

    def _next_file(self) -> LogWriter | None:
        """The next file, open; None when it cannot be made."""
        start = replace(self._log.start, extra={**self._log.start.extra, PART: str(self._part + 1)})
        try:
            log = LogWriter(
                next_path(self._first, self._part + 1),
                start,
                axes=self._axes,
                after=Manifest(start.run_id, self.channels, self.sources),
            )
        except LogWriteError as error:
            self._failed(error)
            return None
        log.events = self._log.events
        return log

    def _go_on_in(self, log: LogWriter) -> None:
        medium = self._open_medium(log.path)
        medium.follow(self._medium)
        self._closed_bytes += self._medium.size()
        self._medium.stop()
        self._longest = max(self._longest, self._medium.longest)
        self._log, self._medium = log, medium
        self._medium.start()
        self.paths.append(log.path)
        self._part, self._closed_for_room, self._begun_ns = self._part + 1, False, self._clock.now_ns()

    def _failed(self, error: LogWriteError) -> None:
        if self.error is None:
            self.error = str(error)
            self._notify(f"THE LOG CANNOT BE WRITTEN ANY FURTHER; publishing goes on. {error}")
