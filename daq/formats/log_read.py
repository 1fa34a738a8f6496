"""Reader of run logs: complete, unfinished, truncated or damaged ones, as a whole or piece by piece.

A run that goes on in further files (`formats.run_files`) is read as one, whichever of them is named.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from lacet.daq.blocks import Block
from lacet.daq.errors import RunError, UsageError, nearest
from lacet.daq.formats.array_messages import joined_block, samples_in
from lacet.daq.formats.events import RunEvent, event_from_bytes
from lacet.daq.formats.mcap_read import McapScan
from lacet.daq.formats.run_files import GOES_ON, RunScan, files_of_run
from lacet.daq.formats.wire import (
    Manifest,
    StartRecord,
    StopRecord,
    Tally,
    WireError,
    block_from_bytes,
    frames_from_bytes,
    manifest_from_bytes,
    start_from_bytes,
    stop_from_bytes,
)
from lacet.daq.frames import Frames
from lacet.daq.schema import lacet_pb2 as pb
from lacet.daq.topics import DECODED, EVENTS, MANIFEST, META_RECOVERED, META_START, RAW, START, STOP

_Record = TypeVar("_Record")

PIECE_SECONDS = 20.0
"""Stretch of a log whose messages are joined before more are read [s]: thousands of small arrays cost memory."""

_SHOWN = 3
"""Topics that a line on missing messages names."""


class LogReader:
    """Reader of the log of one run, complete or damaged, in all its files.

    Parameters
    ----------
    path : the log, or any file of the run.
    alone : read that file only; what is in the files before it then counts as missing.

    Attributes
    ----------
    path : the file.
    files : the files of the run, by number; `path` alone as a rule.
    start : the start record; where it is lost, one reconstructed from the rest, with a line in `damage`.
    stop : the stop record, None when the file has none.
    manifest : number and checksum of the messages stored, None when the log was not closed.
    damage : losses, one line each; empty for a complete log. Reading may add to it.
    holes : bus → log times [ns] of the batches of raw frames around those missing, of what was read so far.

    Raises
    ------
    RunError : the file does not exist, is no MCAP file, or holds nothing of a lacet log.
    """

    def __init__(self, path: str | os.PathLike[str], alone: bool = False):
        self.path = Path(path)
        self.files = {1: self.path} if alone else files_of_run(self.path)
        self._scan = _scan(self.path, self.files)
        self.damage: list[str] = self._scan.damage
        self.holes: dict[str, dict[int, int]] = defaultdict(dict)
        self._topics: dict[str, list[int]] = defaultdict(list)
        for number in self._scan.contents:
            self._topics[self._scan.channels[number].topic].append(number)
        if not any(topic.startswith((RAW, DECODED, "/lacet/")) for topic in self._topics):
            topics = ", ".join(sorted(self._topics)[:8]) or "none"
            if self._scan.damage or not self._scan.finished:
                raise RunError(path, ["cut off or damaged before the first whole record: nothing can be read from it"])
            raise RunError(path, [f"an MCAP file, but not a lacet log (its topics: {topics}); give one made by lacet"])
        self.manifest: Manifest | None = self._one(MANIFEST, manifest_from_bytes)
        self.stop: StopRecord | None = self._one(STOP, stop_from_bytes)
        self.start: StartRecord = self._one(START, start_from_bytes) or self._made_up_start()
        self.damage += self._gaps()
        if self.stop is None:
            self.damage.append("no stop record: the recording was not closed; what came after the last chunk is lost")
        elif self.stop.reason.startswith(GOES_ON):
            self.damage.append(f"the run {self.stop.reason}, which is missing: put it beside {self.path.name}")
        elif not self._scan.finished:
            self.damage.append("the index at the end is missing or damaged; no data is lost by that")
        self.damage += self._scan.metadata.get(META_RECOVERED, {}).values()

    def sources(self) -> list[str]:
        """Buses with raw frames, in alphabetical order."""
        return sorted(topic.removeprefix(RAW) for topic in self._topics if topic.startswith(RAW))

    def channels(self) -> list[str]:
        """Channels with decoded blocks, in alphabetical order."""
        names = (topic.removeprefix(DECODED) for topic in self._topics if topic.startswith(DECODED))
        return sorted(name.replace("/", ".") for name in names)

    def frames(self, source: str) -> Frames:
        """All raw frames of one bus, in the order recorded.

        Raises
        ------
        UsageError : the log has no frames of that bus.
        """
        if RAW + source not in self._topics:
            known = self.sources()
            raise UsageError(
                f"{self.path}: no frames of '{source}'{nearest(source, known)}; recorded: {', '.join(known) or 'none'}"
            )
        return Frames.concat(source, self.batches(source))

    @property
    def last_ns(self) -> int:
        """The latest log time [ns]."""
        return max((held.last_ns for held in self._scan.contents.values()), default=0)

    def held(self, before: Manifest) -> Manifest | None:
        """Number and checksum of the messages of this file and those before it; None where some in between are missing.

        `before` : of the files before this one.
        """
        tallies = dict(before.channels), dict(before.sources)
        for message in self._scan.messages(self._numbers(t for t in self._topics if t.startswith((RAW, DECODED)))):
            topic = self._scan.channels[message.channel].topic
            try:
                if topic.startswith(RAW):
                    name, kind, samples = topic.removeprefix(RAW), tallies[1], samples_in(pb.RawFrames, message.data)
                else:
                    name, kind = topic.removeprefix(DECODED).replace("/", "."), tallies[0]
                    samples = samples_in(pb.DecodedBlock, message.data)
            except WireError:
                return None
            tally = kind.get(name, Tally())
            if message.sequence != tally.messages:
                return None
            kind[name] = tally.add(message.data, samples)
        return Manifest(self.start.run_id, *tallies)

    def batches(self, source: str) -> Iterator[Frames]:
        """Raw frames of one bus batch by batch, in the order recorded; several buses may be read side by side."""
        return (item for _, item in self._items([RAW + source]) if isinstance(item, Frames))

    def span(self, source: str) -> tuple[int, int]:
        """Least and largest log time of the batches of one bus [ns]."""
        held = [self._scan.contents[number] for number in self._topics[RAW + source]]
        return min(one.first_ns for one in held), max(one.last_ns for one in held)

    def blocks(self, channels: Iterable[str] | None = None, between: tuple[int, int] | None = None) -> dict[str, Block]:
        """Decoded samples joined by channel, in the order recorded; of all channels unless some are named.

        `between` : only the samples stamped from the first to before the second time [ns]. No more of the file is read
        than the chunks around them, as long as the stamps of the messages do not step back.
        """
        parts: dict[str, list[Block]] = defaultdict(list)
        if between is None:
            for piece in self.pieces(PIECE_SECONDS, channels):
                for name, block in piece.items():
                    parts[name].append(block)
        else:
            for _, block in self._stamped_blocks(channels, between):
                if len(inside := _within(block, *between)):
                    parts[block.channel].append(inside)
        return {channel: Block.concat(parts.pop(channel)) for channel in sorted(parts)}

    def pieces(self, seconds: float, channels: Iterable[str] | None = None) -> Iterator[dict[str, Block]]:
        """Decoded samples piece by piece, each of so many seconds by the messages' log times; none is left out.

        Joined by channel, the pieces are `blocks`; no more than one is in memory.
        """
        names = self.channels() if channels is None else channels
        refused: dict[str, tuple[int, str]] = {}
        held: dict[str, list[bytes]] = defaultdict(list)
        first = None
        for message in self._scan.messages(self._numbers(map(_topic, names))):
            if first is not None and abs(message.log_ns - first) >= 1e9 * seconds:
                yield _joined(held, refused)
                held.clear()
                first = None
            first = message.log_ns if first is None else first
            held[self._scan.channels[message.channel].topic].append(message.data)
        if held:
            yield _joined(held, refused)
        self._note_refused(refused)

    def events(self) -> list[RunEvent]:
        """The events of the recording, in the order recorded."""
        found, refused = list[RunEvent](), dict[str, tuple[int, str]]()
        for message in self._scan.messages(self._numbers([EVENTS])):
            try:
                found.append(event_from_bytes(message.data))
            except WireError as error:
                _refuse(refused, EVENTS, error)
        self._note_refused(refused)
        return found

    def _stamped_blocks(
        self, channels: Iterable[str] | None, between: tuple[int, int] | None = None
    ) -> Iterator[tuple[int, Block]]:
        """Blocks of some channels, or of all, with the log times of their messages."""
        names = self.channels() if channels is None else channels
        for log_ns, item in self._items(map(_topic, names), between):
            if isinstance(item, Block):
                yield log_ns, item

    def messages(self) -> Iterator[tuple[int, Frames | Block]]:
        """Frame batches and blocks one by one as recorded, each with its log time [ns], for replay."""
        yield from self._items(self._topics)

    def block_messages(self) -> Iterator[tuple[str, bytes]]:
        """Channel and `DecodedBlock` message of every block, as stored and so with the same checksum."""
        topics = [topic for topic in self._topics if topic.startswith(DECODED)]
        for message in self._scan.messages(self._numbers(topics)):
            yield self._scan.channels[message.channel].topic.removeprefix(DECODED).replace("/", "."), message.data

    def _items(
        self, topics: Iterable[str], between: tuple[int, int] | None = None
    ) -> Iterator[tuple[int, Frames | Block]]:
        refused: dict[str, tuple[int, str]] = {}
        before: dict[str, tuple[int, int]] = {}
        for message in self._scan.messages(self._numbers(topics), between=between):
            topic = self._scan.channels[message.channel].topic
            try:
                if topic.startswith(RAW):
                    number, log_ns = before.get(topic, (message.sequence - 1, message.log_ns))
                    if message.sequence > number + 1:
                        self.holes[topic.removeprefix(RAW)][log_ns] = message.log_ns
                    before[topic] = message.sequence, message.log_ns
                    yield message.log_ns, frames_from_bytes(message.data)[0]
                elif topic.startswith(DECODED):
                    yield message.log_ns, block_from_bytes(message.data)[0]
            except WireError as error:
                _refuse(refused, topic, error)
        self._note_refused(refused)

    def _note_refused(self, refused: Mapping[str, tuple[int, str]]) -> None:
        """Add what could not be used to `damage`: topic → number of messages, and why the first."""
        for topic, (number, why) in refused.items():
            line = f"{topic}: {number} messages cannot be used ({why})"
            if line not in self.damage:
                self.damage.append(line)

    def _numbers(self, topics: Iterable[str]) -> Iterator[int]:
        """Ids of the channels of some topics."""
        return (number for topic in topics for number in self._topics.get(topic, ()))

    def _one(self, topic: str, read: Callable[[bytes], _Record]) -> _Record | None:
        """The last message of a topic, None when none can be read."""
        *_, found = (None, *self._scan.messages(self._numbers([topic]), last=True))
        try:
            return read(found.data) if found else None
        except WireError as error:
            self.damage.append(f"{topic}: {error}")
        return None

    def _made_up_start(self) -> StartRecord:
        known = self._scan.metadata.get(META_START, {})
        self.damage.append("the start record is lost: the rig file and its documents must be given anew")
        started = known.get("started_ns", "")
        first = min((held.first_ns for held in self._scan.contents.values()), default=0)
        return StartRecord(
            run_id=known.get("run_id", ""),
            started_ns=int(started) if started.lstrip("-").isdigit() else first,
            vehicle=known.get("vehicle", ""),
            manoeuvre=known.get("manoeuvre", ""),
            wheel_reference=known.get("wheel_reference", "contact"),
            brakes=known.get("brakes", "unknown"),
            notes=known.get("notes", ""),
            software=known.get("software", ""),
        )

    def _gaps(self) -> list[str]:
        """Messages missing according to the numbering or the manifest."""
        expected: dict[str, int] = {}
        if self.manifest is not None:
            expected |= {DECODED + name.replace(".", "/"): t.messages for name, t in self.manifest.channels.items()}
            expected |= {RAW + name: tally.messages for name, tally in self.manifest.sources.items()}
        names = expected.keys() | {topic for topic in self._topics if topic.startswith((RAW, DECODED))}
        found: list[tuple[str, int, list[tuple[int, int]]]] = []
        for topic in sorted(names, key=lambda topic: (not topic.startswith(RAW), topic)):
            runs = sorted(run for number in self._topics.get(topic, ()) for run in self._scan.contents[number].runs)
            end = expected.get(topic, max((stop for _, stop in runs), default=0))
            if missing := _missing(runs, end):
                found.append((topic, end, missing))
        return _by_hole(found)


def _scan(path: Path, files: dict[int, Path]) -> McapScan | RunScan:
    try:
        size = path.stat().st_size
        scan = McapScan.of(path) if list(files) == [1] else RunScan(files)
    except FileNotFoundError as error:
        beside = [file.name for file in path.parent.glob("*.mcap")] if path.parent.is_dir() else []
        raise RunError(path, [f"there is no such file{nearest(path.name, beside)}"]) from error
    except OSError as error:
        raise RunError(path, [f"cannot be read: {error.strerror}"]) from error
    if not size:
        raise RunError(path, ["the file is empty: the recording broke off before anything was written"])
    if not scan.contents and not scan.finished and not scan.channels:
        with path.open("rb") as file:
            if not file.read(8).startswith(b"\x89MCAP"):
                raise RunError(path, ["not an MCAP file; give a log recorded by lacet (.mcap)"])
    return scan


def _topic(channel: str) -> str:
    """Topic of a channel's decoded blocks."""
    return DECODED + channel.replace(".", "/")


def _joined(messages: Mapping[str, Sequence[bytes]], refused: dict[str, tuple[int, str]]) -> dict[str, Block]:
    """Blocks by channel from messages by topic; those that cannot be used are counted in `refused`."""
    found: dict[str, list[Block]] = defaultdict(list)
    for topic, data in messages.items():
        try:
            blocks = [joined_block(data)]
        except WireError:  # one by one, to leave out those that cannot be used
            blocks = list(_usable(topic, data, refused))
        for block in blocks:
            found[block.channel].append(block)
    return {name: found[name][0] if len(found[name]) == 1 else Block.concat(found[name]) for name in sorted(found)}


def _usable(topic: str, messages: Sequence[bytes], refused: dict[str, tuple[int, str]]) -> Iterator[Block]:
    for data in messages:
        try:
            yield block_from_bytes(data)[0]
        except WireError as error:
            _refuse(refused, topic, error)


def _refuse(refused: dict[str, tuple[int, str]], topic: str, error: WireError) -> None:
    number, why = refused.get(topic, (0, str(error)))
    refused[topic] = (number + 1, why)


def _within(block: Block, start_ns: int, stop_ns: int) -> Block:
    """The samples of a block stamped from the first to before the second time [ns]."""
    inside = (block.t_ns >= start_ns) & (block.t_ns < stop_ns)
    if inside.all():
        return block
    device = None if block.device_ns is None else block.device_ns[inside]
    return Block(block.channel, block.t_ns[inside], block.values[inside], block.flags[inside], device)


def _missing(runs: list[list[int]], end: int) -> list[tuple[int, int]]:
    """Stretches (first, one after the last) of the numbers below `end` that are in none of the sorted `runs`."""
    out, after = [], 0
    for begin, stop in (*runs, (end, end)):
        if after < min(begin, end):
            out.append((after, min(begin, end)))
        after = max(after, stop)
    return out


def _by_hole(found: Sequence[tuple[str, int, list[tuple[int, int]]]]) -> list[str]:
    """Lines on topics, the number of their messages, and the stretches missing: one for those with the same holes."""
    alike: list[list[tuple[str, int, list[tuple[int, int]]]]] = []
    for one in found:
        for group in alike:
            others = group[0][2]
            if len(others) == len(one[2]) and all(
                a < d and c < b for (a, b), (c, d) in zip(one[2], others, strict=True)
            ):
                group.append(one)
                break
        else:
            alike.append([one])
    lines: list[str] = []
    for group in alike:
        topics = ", ".join(topic for topic, *_ in group[:_SHOWN])
        topics += f" and {len(group) - _SHOWN} more" if len(group) > _SHOWN else ""
        number = _from_to([sum(stop - first for first, stop in missing) for *_, missing in group])
        widest = [
            (min(one[2][k][0] for one in group), max(one[2][k][1] for one in group)) for k in range(len(group[0][2]))
        ]
        of_each = " of each" if len(group) > 1 else ""
        end = _from_to([end for _, end, _ in group])
        lines.append(f"{topics}: {number} of {end} messages{of_each} are missing: {_ranges(widest)}")
    return lines


def _from_to(numbers: Sequence[int]) -> str:
    """``4 to 5``, or ``4`` where all are alike."""
    least, most = min(numbers), max(numbers)
    return str(least) if least == most else f"{least} to {most}"


def _ranges(stretches: list[tuple[int, int]]) -> str:
    """``3, 7–9`` for 3, 7, 8, 9."""
    texts = [str(a) if b == a + 1 else f"{a}–{b - 1}" for a, b in stretches[:6]]
    return ", ".join(texts) + (" …" if len(stretches) > 6 else "")
