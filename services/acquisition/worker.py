"""Worker: it assembles runs from the bus, requests missing blocks, and processes complete runs."""

from __future__ import annotations

import heapq
import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any

from lacet.daq.blocks import Block
from lacet.daq.bus.listener import BusListener, Message
from lacet.daq.bus.session import Keys
from lacet.daq.bus.spool import Spool
from lacet.daq.errors import LacetError
from lacet.daq.formats.log import LogWriter, StopRecord
from lacet.daq.formats.result import plain
from lacet.daq.formats.wire import (
    Manifest,
    StartRecord,
    WireError,
    block_from_bytes,
    manifest_from_bytes,
    start_from_bytes,
)
from lacet.daq.rig import Rig

RESULT = "result.json"
PATIENCE = 10.0
"""Silence after which a recorder is asked for a sign of life, and a run without a manifest is closed [s]."""
DEADLINE = 30.0
"""Longest time to fetch missing blocks, from the manifest on [s]."""

OnRun = Callable[[Path], dict[str, Any]]
"""Processing of an assembled run: path of its log → entries of the result."""


@dataclass(frozen=True)
class RunResult:
    """Outcome of one run at a worker.

    Attributes
    ----------
    path : the log; None when the start record was not received.
    complete : whether the log holds everything that the recorder published, checksums included.
    missing : channel → ranges (first, last) of missing block numbers.
    notes : plain sentences: what is missing and why.
    work : the result of `OnRun`, or ``{"error": …}``.
    """

    run_id: str
    rig: str
    path: Path | None
    complete: bool
    missing: dict[str, list[tuple[int, int]]]
    notes: list[str]
    work: dict[str, Any]

    def payload(self) -> dict[str, Any]:
        """Content of ``result.json``."""
        return {
            "run_id": self.run_id,
            "rig": self.rig,
            "log": None if self.path is None else self.path.name,
            "complete": self.complete,
            "missing": {name: [list(span) for span in spans] for name, spans in self.missing.items()},
            "notes": self.notes,
            "result": self.work,
        }


class Assembly:
    """One run in the course of reception over the bus.

    Parameters
    ----------
    folder : folder of its blocks until the log is written.
    deadline : longest time to fetch missing blocks, from the manifest on [s].

    Attributes
    ----------
    last_heard : time of its last message [s, monotonic].
    until : end of fetching [s, monotonic]; None before the manifest.
    notes : faults, as plain sentences.
    """

    def __init__(self, keys: Keys, folder: Path, deadline: float = DEADLINE):
        self.keys = keys
        self._deadline = deadline
        self.start: StartRecord | None = None
        self.manifest: Manifest | None = None
        self.last_heard = time.monotonic()
        self.until: float | None = None
        self.notes: list[str] = []
        self._spool = Spool(folder)
        self._fetched = 0

    def take(self, message: Message) -> None:
        """Process a message: a start record, a block or the manifest."""
        self.last_heard = time.monotonic()
        try:
            if message.kind == "block":
                self._spool.add(message.name, message.sequence, message.payload)
            elif message.kind == "start" and self.start is None:
                self.start = start_from_bytes(message.payload)
            elif message.kind == "manifest":
                self.take_manifest(message.payload)
        except WireError as error:
            self.note(f"a {message.kind} that cannot be read: {error}")

    def take_manifest(self, payload: bytes) -> None:
        """Process the manifest, the end of the run: missing blocks are fetched from now on, for `deadline` [s]."""
        self.manifest = manifest_from_bytes(payload)
        if self.until is None:
            self.until = time.monotonic() + self._deadline

    def note(self, text: str) -> None:
        """Add a plain sentence, unless it is noted already."""
        if text not in self.notes:
            self.notes.append(text)

    def missing(self) -> dict[str, list[tuple[int, int]]]:
        """Channel → ranges (first, last) of missing block numbers, as far as is known."""
        if self.manifest is not None:
            ends = {name: tally.messages for name, tally in self.manifest.channels.items()}
        else:
            ends = {name: self._spool.end(name) for name in self._spool.names()}
        gaps = {name: self._spool.gaps(name, end) for name, end in ends.items()}
        return {name: spans for name, spans in gaps.items() if spans}

    def fetch(self, listener: BusListener) -> None:
        """Request missing blocks from the recorder once, and again those of channels with a wrong checksum."""
        if self.start is None and (payload := listener.fetch(self.keys, "start")) is not None:
            self.start = start_from_bytes(payload)
        for channel, spans in self.missing().items():
            for first, last in spans:
                for sequence, message in listener.fetch_blocks(self.keys, channel, first, last):
                    self._spool.add(channel, sequence, message)
                    self._fetched += 1
                    self.last_heard = time.monotonic()
        for channel in self.wrong():
            self.note(f"{channel}: the blocks that came were not those that were sent; all were asked for again")
            self._spool.discard(channel)

    def wrong(self) -> list[str]:
        """Channels that have every block, but not the manifest's checksum."""
        if self.manifest is None:
            return []
        incomplete = self.missing()
        return [
            name
            for name, tally in self.manifest.channels.items()
            if name not in incomplete and self._spool.checksum(name) != tally.checksum
        ]

    @property
    def complete(self) -> bool:
        """Whether everything published has been received."""
        return self.start is not None and self.manifest is not None and not self.missing() and not self.wrong()

    @property
    def fetched(self) -> int:
        """Number of blocks that had to be requested."""
        return self._fetched

    def write(self, path: Path) -> None:
        """Write the run as a log of decoded blocks: a complete file or none."""
        assert self.start is not None
        draft = path.with_name(path.name + ".part")
        axes = recorded_axes(self.start)
        losses = self.manifest.losses if self.manifest is not None else {}
        with LogWriter(draft, self.start, axes=axes, chunk_seconds=1.0, overwrite=True) as log:
            end_ns = self.start.started_ns
            streams = [self._blocks(name) for name in self._spool.names()]
            for block in heapq.merge(*streams, key=lambda block: int(block.t_ns[0])):
                log.write_block(block)
                end_ns = max(end_ns, int(block.t_ns[-1]))
            reason = "assembled from the bus" if self.complete else "assembled from the bus, not complete"
            log.close(StopRecord(end_ns, reason, {}, losses))
        os.replace(draft, path)

    def _blocks(self, channel: str) -> Iterator[Block]:
        for sequence, message in self._spool.messages(channel):
            try:
                yield block_from_bytes(message)[0]
            except WireError as error:
                self.note(f"{channel}, block {sequence}: {error}")

    def close(self) -> None:
        """Release the space of the run's blocks."""
        self._spool.close()


def recorded_axes(start: StartRecord) -> dict[str, str]:
    """Channel → axes that the rig in a start record declares; empty when its text cannot be read."""
    try:
        rig = Rig.parse(start.rig_text, "rig of the run")
    except LacetError:
        return {}
    return {channel: sensor.axes for sensor in rig.sensors for channel in sensor.channels}


class Worker:
    """Worker that receives runs from the bus, assembles and processes each, and publishes the results.

    Parameters
    ----------
    folder : folder of logs and results; may be empty.
    name : this worker's name on the bus.
    on_run : processing of an assembled run.
    patience, deadline : see `PATIENCE`, `DEADLINE` [s].
    notify : called with plain sentences for the user.
    """

    def __init__(
        self,
        listener: BusListener,
        folder: Path,
        name: str,
        on_run: OnRun,
        *,
        patience: float = PATIENCE,
        deadline: float = DEADLINE,
        notify: Callable[[str], None] = print,
    ):
        self._listener = listener
        self._folder = folder
        self._name = name
        self._on_run = on_run
        self._patience = patience
        self._deadline = deadline
        self._notify = notify
        self._runs: dict[Keys, Assembly] = {}
        self._done: set[Keys] = set()
        folder.mkdir(parents=True, exist_ok=True)

    def run(self, stop: Event, once: bool = False) -> list[RunResult]:
        """Work until `stop` is set, or after one run when `once`."""
        results: list[RunResult] = []
        while not stop.is_set():
            message = self._listener.get(0.1)
            if message is not None:
                self._take(message)
                continue  # waiting messages first
            for assembly in [a for a in self._runs.values() if self._is_over(a)]:
                results.append(self._close(assembly, stop))
                if once:
                    return results
        return results

    def _take(self, message: Message) -> None:
        if message.keys in self._done or message.kind == "result":
            return
        if message.kind == "gone" and message.keys not in self._runs:
            return
        if message.keys not in self._runs:
            self._runs[message.keys] = Assembly(message.keys, self._folder, self._deadline)
            self._notify(f"run {message.keys.run}: listening")
        self._runs[message.keys].take(message)

    def _is_over(self, assembly: Assembly) -> bool:
        """Whether the run has ended: its manifest has come, or its recorder has gone without one."""
        if assembly.manifest is not None:
            return True
        if time.monotonic() - assembly.last_heard < self._patience:
            return False
        payload = self._listener.fetch(assembly.keys, "manifest", timeout=1.0)
        if payload is not None:
            assembly.take_manifest(payload)
            return True
        if self._listener.fetch(assembly.keys, "start", timeout=1.0) is not None:
            assembly.last_heard = time.monotonic()  # the recorder is alive and has nothing to send
            return False
        return True

    def _close(self, assembly: Assembly, stop: Event) -> RunResult:
        until = assembly.until or time.monotonic()
        pause = 0.1
        while not assembly.complete and not stop.is_set():
            try:
                assembly.fetch(self._listener)
            except LacetError as error:
                assembly.note(str(error))
            if assembly.complete or time.monotonic() > until:
                break
            stop.wait(pause)
            pause = min(2.0, 2.0 * pause)
        result = self._assembled(assembly)
        self._listener.acknowledge(
            assembly.keys, self._name, {"run_id": result.run_id, "complete": result.complete, "notes": result.notes}
        )
        for note in result.notes:
            self._notify(f"run {result.run_id}: {note}")
        if result.path is not None:
            self._notify(
                f"run {result.run_id}: {'complete' if result.complete else 'NOT complete'}, "
                f"{assembly.fetched} blocks fetched, written to {result.path}"
            )
            try:
                result.work.update(self._on_run(result.path))
            except LacetError as error:
                result.work["error"] = str(error)
                self._notify(f"run {result.run_id}: {error}")
        text = json.dumps(plain(result.payload()), indent=1, ensure_ascii=False) + "\n"
        self._listener.publish_result(assembly.keys, self._name, text)
        (self._folder / RESULT).write_text(text, encoding="utf-8")
        self._done.add(assembly.keys)
        del self._runs[assembly.keys]
        assembly.close()
        return result

    def _assembled(self, assembly: Assembly) -> RunResult:
        complete, missing = assembly.complete, assembly.missing()
        notes = list(assembly.notes)
        if assembly.manifest is None:
            notes.append("the recorder went away without a manifest: what it recorded after the last block is not here")
        notes += [
            f"{name}: missing blocks {', '.join(f'{a}' if a == b else f'{a} to {b}' for a, b in spans)}"
            for name, spans in missing.items()
        ]
        notes += [f"{name}: the checksum is wrong" for name in assembly.wrong()]
        start, path = assembly.start, None
        if start is None:
            notes.append("the start record was not to be had: nothing can be written")
        else:
            path = self._folder / f"{assembly.keys.run}.mcap"
            assembly.write(path)
            notes += [note for note in assembly.notes if note not in notes]
        run_id = start.run_id if start is not None else assembly.keys.run
        return RunResult(run_id, assembly.keys.rig, path, complete, missing, notes, {})
