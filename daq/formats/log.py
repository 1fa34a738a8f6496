"""Writer of run logs: MCAP files, each readable up to its last whole chunk after a crash or a full disk.

A run is one file as a rule, or goes on in further ones (`formats.run_files`).

Topics: ``/raw/<source>``, ``/decoded/<channel with slashes>``, ``/lacet/start``, ``/lacet/stop``, ``/lacet/manifest``,
``/lacet/events``.
The page ``docs/log.md`` describes the format. `LogReader` and `recover` of `formats.log_read` and `formats.log_recover`
are offered here too.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.errors import RunError
from lacet.daq.formats.array_messages import block_to_messages, frames_to_messages
from lacet.daq.formats.events import RunEvent, event_to_bytes
from lacet.daq.formats.log_read import LogReader
from lacet.daq.formats.log_recover import recover
from lacet.daq.formats.mcap_write import McapWriter
from lacet.daq.formats.run_files import PART
from lacet.daq.formats.wire import (
    Manifest,
    StartRecord,
    StopRecord,
    Tally,
    manifest_to_bytes,
    start_to_bytes,
    stop_to_bytes,
)
from lacet.daq.frames import Frames
from lacet.daq.schema import lacet_pb2 as pb
from lacet.daq.topics import EVENTS, MANIFEST, META_START, META_STOP, START, STOP, decoded_topic, raw_topic

__all__ = ["LogReader", "LogWriteError", "LogWriter", "StartRecord", "StopRecord", "recover"]

DISK = "disk"
"""Cause of loss under which a log counts samples and frames that it could not store."""

CHUNK_SECONDS = 0.1
"""Duration of a chunk [s]: what a killed recorder loses at most."""


class LogWriteError(RunError):
    """A log that cannot be written any further; what was recorded before remains readable."""


class LogMessage(NamedTuple):
    """A message ready to be stored: its class, bytes and number, and where its `samples` are counted."""

    topic: str
    kind: Any
    data: bytes
    log_ns: int
    name: str
    sequence: int
    samples: int
    tallies: dict[str, Tally]


class LogWriter:
    """Writer of one run log, which buffers no more than one chunk.

    A chunk is closed and passed to the operating system when it holds `chunk_bytes`, when its messages span
    `chunk_seconds`, and by `tick`; a killed process loses at most that much. The same calls give the same bytes.

    Parameters
    ----------
    path : the new file.
    start : the start record; it is on the disk when the constructor returns.
    chunk_bytes : size of a chunk before compression [bytes].
    chunk_seconds : duration of a chunk [s].
    fsync_seconds : period of forced writes to the medium [s], the most that a power failure can lose; None leaves them
        to the operating system.
    axes : channel → axes where the rig file declares others than the vocabulary.
    overwrite : replace an existing file; otherwise it is an error.
    after : what the files before this one of the run hold: messages are numbered and counted on from there.

    Raises
    ------
    LogWriteError : the file exists or cannot be made.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        start: StartRecord,
        *,
        chunk_bytes: int = 256 * 1024,
        chunk_seconds: float = CHUNK_SECONDS,
        fsync_seconds: float | None = None,
        axes: Mapping[str, str] | None = None,
        overwrite: bool = False,
        after: Manifest | None = None,
    ):
        self.path = Path(path)
        self.start = start
        self.error: LogWriteError | None = None
        """Reason why nothing more can be written; None without a fault."""
        self.closed = False
        self._axes = dict(axes or {})
        self._channels: dict[str, Tally] = dict(after.channels) if after else {}
        self._sources: dict[str, Tally] = dict(after.sources) if after else {}
        self._stored = dict(self._channels), dict(self._sources)
        self._chunk_bytes = chunk_bytes
        self._chunk_ns = round(chunk_seconds * 1e9)
        self._fsync_ns = None if fsync_seconds is None else round(fsync_seconds * 1e9)
        self.events = 0
        """Number of events so far, also of files before this one."""
        self._open_bytes = 0
        self._open_first_ns = 0
        self._last_ns = self._synced_ns = max(0, start.started_ns)
        try:
            self._file = McapWriter(self.path, overwrite)
        except FileExistsError as error:
            raise LogWriteError(path, ["the file exists: give another name, or remove it"]) from error
        except OSError as error:
            raise LogWriteError(path, [f"cannot be made: {error.strerror}; check folder and permissions"]) from error
        try:
            self._file.metadata(META_START, _start_metadata(start))
            self._put(START, pb.StartRecord, start_to_bytes(start), self._last_ns, 0)
            self.flush()
        except BaseException:
            self._file.abandon()
            raise

    def write_frames(self, frames: Frames) -> bytes:
        """Store a batch of raw frames; return the `RawFrames` message stored, empty for an empty batch.

        Raises
        ------
        LogWriteError : the disk is full or fails; now and at every further call, which is counted in `losses`.
        """
        return self.write(self.messages(frames, (0, len(frames)))[0]) if len(frames) else b""

    def write_block(self, block: Block) -> bytes:
        """Store a block; return the message stored, empty for an empty block. Raises as `write_frames`."""
        return self.write(self.messages(block, (0, len(block)))[0]) if len(block) else b""

    def write_event(self, event: RunEvent) -> None:
        """Store an event. Raises as `write_frames`."""
        self._put(EVENTS, pb.Document, event_to_bytes(event, self.start.run_id, self.events), event.t_ns, self.events)
        self.events += 1

    def messages(self, item: Frames | Block, edges: Sequence[int]) -> list[LogMessage]:
        """Messages of the stretches of a batch or a block between `edges`, none of them empty, to be given to `write`.

        They are numbered on from what is stored: all of them are to be written, in this order, before others of the
        same source or channel are made.
        """
        if isinstance(item, Frames):
            name, topic, kind, tallies = item.source, raw_topic(item.source), pb.RawFrames, self._sources
        else:
            name, topic, kind, tallies = item.channel, decoded_topic(item.channel), pb.DecodedBlock, self._channels
        number = tallies.get(name, Tally()).messages
        if isinstance(item, Frames):
            data = frames_to_messages(item, edges, number)
        else:
            data = block_to_messages(item, edges, number, self._axes.get(name))
        ends = item.t_ns[np.asarray(edges[1:]) - 1].tolist()
        return [
            LogMessage(topic, kind, message, log_ns, name, number + i, b - a, tallies)
            for i, (message, log_ns, (a, b)) in enumerate(zip(data, ends, pairwise(edges), strict=True))
        ]

    def write(self, message: LogMessage) -> bytes:
        """Store a message of `messages`, and return its bytes. Raises as `write_frames`."""
        topic, kind, data, log_ns, name, sequence, samples, tallies = message
        try:
            self._put(topic, kind, data, log_ns, sequence)
        finally:  # counted, stored or not; flush() notes what is stored
            tallies[name] = tallies.get(name, Tally()).add(data, samples)
        return data

    def tick(self, now_ns: int) -> None:
        """Close the open chunk when it is older than `chunk_seconds`; call a few times in that time.

        `now_ns` is of the clock that stamps the frames [ns].
        """
        if self._open_bytes and abs(now_ns - self._open_first_ns) >= self._chunk_ns:
            self.flush()

    def flush(self) -> None:
        """Close the open chunk and pass it to the operating system. Raises as `write_frames`."""
        self._check()
        try:
            self._file.flush()
            if self._fsync_ns is not None and self._last_ns - self._synced_ns >= self._fsync_ns:
                self._file.sync()
                self._synced_ns = self._last_ns
        except OSError as error:
            self._fail(error)
        self._stored = (dict(self._channels), dict(self._sources))
        self._open_bytes = 0

    def manifest(self) -> Manifest:
        """Number and checksum of the messages in the file, the open chunk included."""
        channels, sources = (self._channels, self._sources) if self.error is None else self._stored
        return Manifest(self.start.run_id, dict(channels), dict(sources), self.losses)

    @property
    def counts(self) -> dict[str, int]:
        """Samples or frames stored, by channel and source."""
        manifest = self.manifest()
        return {name: tally.samples for name, tally in (*manifest.channels.items(), *manifest.sources.items())}

    @property
    def losses(self) -> dict[str, dict[str, int]]:
        """Samples and frames that could not be stored, by channel and source."""
        if self.error is None:
            return {}
        lost = {
            name: tally.samples - stored.get(name, Tally()).samples
            for tallies, stored in zip((self._channels, self._sources), self._stored, strict=True)
            for name, tally in tallies.items()
        }
        return {name: {DISK: number} for name, number in lost.items() if number}

    def close(self, stop: StopRecord | None = None) -> None:
        """Write the stop record, the manifest and the index, and close. Closing again does nothing.

        Parameters
        ----------
        stop : the stop record, to which the log's counts are added; None for ``end of input`` at the last stamp.

        Raises
        ------
        LogWriteError : the disk is full or fails; the file is closed without a stop record.
        """
        if self.closed:
            return
        self.closed = True
        stop = stop or StopRecord(self._last_ns, "end of input")
        stop = StopRecord(stop.stopped_ns, stop.reason, {**self.counts, **stop.counts}, stop.losses)
        try:
            self._check()
            manifest = Manifest(self.start.run_id, self._channels, self._sources, stop.losses)
            end_ns = max(self._last_ns, stop.stopped_ns)
            self._put(STOP, pb.StopRecord, stop_to_bytes(stop), end_ns, 0)
            self._put(MANIFEST, pb.Manifest, manifest_to_bytes(manifest), end_ns, 0)
            self._file.metadata(META_STOP, {"stopped_ns": str(stop.stopped_ns), "reason": stop.reason})
            try:
                self._file.finish()
                if self._fsync_ns is not None:
                    self._file.sync()
            except OSError as error:
                self._fail(error)
        finally:
            self._file.abandon()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        with contextlib.suppress(LogWriteError):  # the exception already raised is reported instead
            self.close(StopRecord(self._last_ns, f"{type(error).__name__}: {error}".strip(": ")))

    def _put(self, topic: str, kind: Any, data: bytes, log_ns: int, sequence: int) -> None:
        self._check()
        log_ns = max(0, log_ns)
        if not self._open_bytes:
            self._open_first_ns = log_ns
        elif abs(log_ns - self._open_first_ns) >= self._chunk_ns or self._open_bytes >= self._chunk_bytes:
            self.flush()
            self._open_first_ns = log_ns
        self._file.message(topic, kind, data, log_ns, sequence)
        self._open_bytes += len(data)
        self._last_ns = max(self._last_ns, log_ns)

    def _check(self) -> None:
        if self.error is not None:
            raise self.error

    def _fail(self, error: OSError) -> None:
        self.error = LogWriteError(
            self.path,
            [
                f"writing failed: {error.strerror or error}; everything up to byte {self._file.stored} is in the file "
                "and readable. Make room or choose another disk, and start a new run"
            ],
        )
        raise self.error from error


def _start_metadata(start: StartRecord) -> dict[str, str]:
    """Metadata of the start record, for viewers that do not decode messages."""
    names = ("run_id", "started_ns", "vehicle", "manoeuvre", "wheel_reference", "brakes", "notes", "software")
    part = {PART: start.extra[PART]} if PART in start.extra else {}
    return {name: str(getattr(start, name)) for name in names} | part
