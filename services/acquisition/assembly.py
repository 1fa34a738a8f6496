"""Assembly: one run in the course of reception over the bus, from its start record to its log."""

from __future__ import annotations

import heapq
import os
import time
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

from lacet.daq.blocks import Block
from lacet.daq.bus.digest import RunDigest
from lacet.daq.bus.listener import ANSWER, Message, unpack_blocks
from lacet.daq.bus.session import Keys
from lacet.daq.bus.spool import BLOCK_RATE, MOST_BLOCKS, Spool
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import LacetError
from lacet.daq.formats.log import LogWriter, StopRecord
from lacet.daq.formats.wire import Manifest, StartRecord, Tally, WireError, block_from_bytes, manifest_from_bytes
from lacet.daq.rig import Rig

REQUEST = 2000
"""Most blocks in one request: about 1.4 MB of a full rig."""
NEAR = 100
"""Most blocks between two gaps that are requested at once."""
AHEAD = 100
"""Blocks by which a number may be ahead of the time recorded: those of a recorder that catches up at once."""


class Phase(Enum):
    """Phase of a run's reception."""

    RECORDING = "recording"
    FETCHING = "fetching"
    INCOMPLETE = "incomplete"


class Assembly:
    """One run in the course of reception over the bus.

    Parameters
    ----------
    start : its start record, from the run's holder.
    folder : folder of its blocks until the log is written.

    Attributes
    ----------
    phase : recorded at present, missing blocks being fetched, or closed without all of them.
    silent : time without a message of use while the router could be reached [s].
    asked : the request that is not answered yet, as (channel, first block); None for none.
    asked_at : when [s, monotonic].
    pause : time to the next request [s].
    no_room : whether a block could not be stored for want of room.
    fetched : number of blocks that had to be requested.
    notes : faults, as plain sentences.
    """

    def __init__(self, keys: Keys, start: StartRecord, folder: Path):
        self.keys = keys
        self.start = start
        self.manifest: Manifest | None = None
        self.phase = Phase.RECORDING
        self.silent = 0.0
        self.asked: tuple[str, int] | None = None
        self.asked_at = 0.0
        self.pause = 0.0
        self.no_room = False
        self.fetched = 0
        self.notes: list[str] = []
        self._spool = Spool(folder, memory=0)
        self._requested = ("", -1)

    def take(self, message: Message) -> None:
        """Process a message: blocks, the manifest when it is an answer, or any sign of life."""
        if message.kind == "blocks" and message.requested:
            self._take_fetched(message)
        elif message.kind == "answered":
            self.asked = None if self.asked == (message.name, message.sequence) else self.asked
        elif message.kind == "manifest" and message.requested:
            self._take_manifest(message.payload)
        elif self.phase is Phase.RECORDING:
            self.silent = 0.0
            if message.kind == "block":
                self._take_live(message)

    def _take_live(self, message: Message) -> None:
        try:
            block, number = block_from_bytes(message.payload)
        except WireError as error:
            self.note(f"a block that cannot be read: {error}")
            return
        if not len(block) or (block.channel, number) != (message.name, message.sequence):
            self.note(f"{message.name}: a block without samples, or under a wrong name or number")
        elif number > AHEAD + BLOCK_RATE * 1e-9 * abs(int(block.t_ns[-1]) - self.start.started_ns):
            self.note(f"{message.name}: a block with the number {number}, which no run has after that time")
        else:
            self._store(message.name, number, message.payload)

    def _take_fetched(self, message: Message) -> None:
        if self.manifest is None or (tally := self.manifest.channels.get(message.name)) is None:
            return
        for number, block in unpack_blocks(message):
            if number < tally.messages and self._store(message.name, number, block):
                self.fetched += 1
                self.silent = self.pause = 0.0

    def _store(self, channel: str, number: int, message: bytes) -> bool:
        """Whether the block is new and stored."""
        if not 0 <= number < MOST_BLOCKS or self._spool.read(channel, number) is not None:
            return False
        stored = self._spool.add(channel, number, message)
        self.no_room |= not stored
        return stored

    def _take_manifest(self, payload: bytes) -> None:
        """The end of the run: missing blocks are fetched from now on."""
        try:
            manifest = manifest_from_bytes(payload)
        except WireError as error:
            self.note(f"a manifest that cannot be read: {error}")
            return
        for channel, tally in manifest.channels.items():
            if channel not in CHANNELS or tally.messages > MOST_BLOCKS:
                self.note(f"a manifest that no run has: {tally.messages} blocks of {channel[:80]!r}")
                return
        if self.phase is Phase.RECORDING or manifest != self.manifest:
            self.manifest, self.phase, self.silent, self.pause = manifest, Phase.FETCHING, 0.0, 0.0

    def reopen(self) -> None:
        """Continue a run that was closed incomplete: its recorder was heard again."""
        self.phase, self.silent, self.asked, self.notes = Phase.RECORDING, 0.0, None, []

    def note(self, text: str) -> None:
        """Add a plain sentence, unless it is noted already, or there are a hundred."""
        if text not in self.notes and len(self.notes) < 100:
            self.notes.append(text)

    def waits(self) -> bool:
        """Whether a request is not answered yet."""
        return self.asked is not None and time.monotonic() - self.asked_at < ANSWER + 5.0

    def missing(self) -> dict[str, list[tuple[int, int]]]:
        """Channel → ranges (first, last) of missing block numbers, as far as is known."""
        ends = self._ends()
        gaps = {name: self._spool.gaps(name, end) for name, end in ends.items()}
        return {name: spans for name, spans in gaps.items() if spans}

    def _ends(self) -> dict[str, int]:
        if self.manifest is not None:
            return {name: tally.messages for name, tally in self.manifest.channels.items()}
        return {name: self._spool.end(name) for name in self._spool.names()}

    def request(self) -> tuple[str, int, int] | None:
        """The next blocks to request after those requested last: channel, first and last; None when all are here.

        What is nowhere kept is therefore asked for in turn with the rest.
        """
        channels = sorted(self._ends().items())
        last_channel, last_number = self._requested
        later = [
            (name, last_number + 1 if name == last_channel else 0, end)
            for name, end in channels
            if name >= last_channel
        ]
        for name, begin, end in (*later, *((name, 0, end) for name, end in channels)):
            if begin < end and (spans := self._spool.gaps(name, end, begin)):
                first, last = spans[0]
                for from_, to in spans[1:]:  # near gaps at once: what lies between comes again, which costs less
                    if to - first >= REQUEST or from_ - last > NEAR:
                        break
                    last = to
                last = min(last, first + REQUEST - 1)
                self._requested = name, last
                return name, first, last
        return None

    def digest(self) -> str | None:
        """The digest of all blocks; None when a channel's checksum is wrong, whose blocks are then fetched again."""
        assert self.manifest is not None
        digest, wrong = RunDigest(), False
        for name, expected in self.manifest.channels.items():
            tally = Tally()
            for number, message in self._spool.messages(name):
                if number < expected.messages:
                    tally = tally.add(message, 0)
                    digest.add(name, message)
            if (tally.messages, tally.checksum) != (expected.messages, expected.checksum):
                self.note(f"{name}: the blocks that came were not those that were sent; all were asked for again")
                self._spool.discard(name)
                wrong = True
        return None if wrong else digest.hexdigest()

    def write(self, path: Path, complete: bool) -> None:
        """Write the run as a log of decoded blocks: a complete file or none, and on the disk when this returns."""
        draft = path.with_name(path.name + ".part")
        axes = recorded_axes(self.start)
        losses = self.manifest.losses if self.manifest is not None else {}
        names = self._spool.names() if self.manifest is None else list(self.manifest.channels)
        try:
            with LogWriter(draft, self.start, axes=axes, overwrite=True) as log:
                end_ns = self.start.started_ns
                streams = [self._blocks(name) for name in names]
                for block in heapq.merge(*streams, key=lambda block: int(block.t_ns[0])):
                    log.write_block(block)
                    end_ns = max(end_ns, int(block.t_ns[-1]))
                reason = "assembled from the bus" if complete else "assembled from the bus, not complete"
                log.close(StopRecord(end_ns, reason, {}, losses))
            with draft.open("rb") as file:
                os.fsync(file.fileno())
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)

    def _blocks(self, channel: str) -> Iterator[Block]:
        end = self._ends()[channel]
        for sequence, message in self._spool.messages(channel):
            if sequence >= end:
                return
            try:
                block, _ = block_from_bytes(message)
            except WireError as error:
                self.note(f"{channel}, block {sequence}: {error}")
                continue
            if len(block) and block.channel == channel:
                yield block

    def close(self) -> None:
        """Release the space of the run's blocks."""
        self._spool.close()


def recorded_axes(start: StartRecord) -> dict[str, str]:
    """Channel → axes that the rig in a start record declares; empty when its text cannot be read."""
    try:
        rig = Rig.parse(start.rig_text, "rig of the run")
    except (LacetError, RecursionError):
        return {}
    return {channel: sensor.axes for sensor in rig.sensors for channel in sensor.channels}
