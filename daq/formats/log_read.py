"""Reader of run logs: complete, unfinished, truncated or damaged ones."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

from mcap.records import Message

from lacet.daq.blocks import Block
from lacet.daq.errors import RunError, UsageError, nearest
from lacet.daq.formats.mcap_read import McapScan, Stored
from lacet.daq.formats.mcap_write import McapWriter
from lacet.daq.formats.wire import (
    Manifest,
    StartRecord,
    StopRecord,
    WireError,
    block_from_bytes,
    frames_from_bytes,
    manifest_from_bytes,
    start_from_bytes,
    start_to_bytes,
    stop_from_bytes,
    stop_to_bytes,
)
from lacet.daq.frames import Frames
from lacet.daq.schema import lacet_pb2 as pb
from lacet.daq.topics import DECODED, MANIFEST, META_RECOVERED, META_START, META_STOP, RAW, START, STOP


class LogReader:
    """Reader of one run log, complete or damaged.

    Attributes
    ----------
    path : the file.
    start : the start record; where it is lost, one reconstructed from the rest, with a line in `damage`.
    stop : the stop record, None when the file has none.
    manifest : number and checksum of the messages stored, None when the log was not closed.
    damage : losses, one line each; empty for a complete log. Reading may add to it.

    Raises
    ------
    RunError : the file does not exist, is no MCAP file, or holds nothing of a lacet log.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        self._scan = _scan(self.path)
        self.damage: list[str] = self._scan.damage
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

    def batches(self, source: str) -> Iterator[Frames]:
        """Raw frames of one bus batch by batch, in the order recorded; several buses may be read side by side."""
        return (item for _, item in self._items([RAW + source]) if isinstance(item, Frames))

    def span(self, source: str) -> tuple[int, int]:
        """Least and largest log time of the batches of one bus [ns]."""
        held = [self._scan.contents[number] for number in self._topics[RAW + source]]
        return min(one.first_ns for one in held), max(one.last_ns for one in held)

    def blocks(self, channels: Iterable[str] | None = None) -> dict[str, Block]:
        """Decoded samples joined by channel, in the order recorded; of all channels unless some are named."""
        names = self.channels() if channels is None else channels
        parts: dict[str, list[Block]] = defaultdict(list)
        for _, item in self._items([DECODED + name.replace(".", "/") for name in names]):
            if isinstance(item, Block):
                parts[item.channel].append(item)
        return {channel: Block.concat(parts.pop(channel)) for channel in sorted(parts)}

    def messages(self) -> Iterator[tuple[int, Frames | Block]]:
        """Frame batches and blocks one by one as recorded, each with its log time [ns], for replay."""
        yield from self._items(self._topics)

    def _items(self, topics: Iterable[str]) -> Iterator[tuple[int, Frames | Block]]:
        refused: dict[str, tuple[int, str]] = {}
        for message in self._stored(topics):
            topic = self._scan.channels[message.channel].topic
            try:
                if topic.startswith(RAW):
                    yield message.log_ns, frames_from_bytes(message.data)[0]
                elif topic.startswith(DECODED):
                    yield message.log_ns, block_from_bytes(message.data)[0]
            except WireError as error:
                number, why = refused.get(topic, (0, str(error)))
                refused[topic] = (number + 1, why)
        for topic, (number, why) in refused.items():
            line = f"{topic}: {number} messages cannot be used ({why})"
            if line not in self.damage:
                self.damage.append(line)

    def _stored(self, topics: Iterable[str], last: bool = False) -> Iterator[Stored]:
        return self._scan.messages((number for topic in topics for number in self._topics.get(topic, ())), last)

    def _one(self, topic: str, read):
        """The last message of a topic, None when none can be read."""
        *_, found = (None, *self._stored([topic], last=True))
        try:
            return found and read(found.data)
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
        lines = []
        for topic in sorted(names):
            runs = sorted(run for number in self._topics.get(topic, ()) for run in self._scan.contents[number].runs)
            end = expected.get(topic, max((stop for _, stop in runs), default=0))
            missing = _missing(runs, end)
            if missing:
                number = sum(stop - first for first, stop in missing)
                lines.append(f"{topic}: {number} of {end} messages are missing: {_ranges(missing)}")
        return lines


def recover(path: str | os.PathLike[str], out: str | os.PathLike[str], *, overwrite: bool = False) -> list[str]:
    """Write every complete record of a damaged log into a new, finished one, and return the losses.

    The messages are the same bytes; a missing stop record is reconstructed; the new log's `damage` repeats that of the
    old one.

    Raises
    ------
    RunError : nothing can be read from `path`.
    UsageError : `out` is `path`, or exists and is not to be overwritten.
    """
    target = Path(out)
    if target.exists() and (not overwrite or target.samefile(path)):
        raise UsageError(f"{target} exists: give another name")
    reader = LogReader(path)
    scan = reader._scan
    for _ in reader.messages():  # detects complete records that cannot be used
        pass
    writer = McapWriter(target, overwrite)
    try:
        writer.metadata(META_START, scan.metadata.get(META_START, {"run_id": reader.start.run_id}))
        if START not in reader._topics:
            writer.message(START, pb.StartRecord, start_to_bytes(reader.start), max(0, reader.start.started_ns), 0)
        segment = 0
        for m in scan.messages():
            if m.segment != segment:  # chunks keep their boundaries
                writer.flush()
                segment = m.segment
            channel = scan.channels[m.channel]
            message = Message(m.channel, m.log_ns, m.data, m.publish_ns, m.sequence)
            writer.copy(channel, scan.schemas.get(channel.schema_id), message)
        stop = reader.stop
        if stop is None:
            last = max((held.last_ns for held in scan.contents.values()), default=0)
            stop = StopRecord(last, "recovered: the recording was not closed", _counts(reader))
            writer.message(STOP, pb.StopRecord, stop_to_bytes(stop), last, 0)
        writer.metadata(META_STOP, {"stopped_ns": str(stop.stopped_ns), "reason": stop.reason})
        if reader.damage:
            lines = {f"{i:03}": line for i, line in enumerate(reader.damage)}
            writer.metadata(META_RECOVERED, lines)
        writer.finish()
    finally:
        writer.abandon()
    return list(reader.damage)


def _counts(reader: LogReader) -> dict[str, int]:
    counts: dict[str, int] = defaultdict(int)
    for _, item in reader.messages():
        counts[item.channel if isinstance(item, Block) else item.source] += len(item)
    return dict(counts)


def _scan(path: Path) -> McapScan:
    try:
        size = path.stat().st_size
        scan = McapScan.of(path)
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


def _missing(runs: list[list[int]], end: int) -> list[tuple[int, int]]:
    """Stretches (first, one after the last) of the numbers below `end` that are in none of the sorted `runs`."""
    out, after = [], 0
    for begin, stop in (*runs, (end, end)):
        if after < min(begin, end):
            out.append((after, min(begin, end)))
        after = max(after, stop)
    return out


def _ranges(stretches: list[tuple[int, int]]) -> str:
    """``3, 7–9`` for 3, 7, 8, 9."""
    texts = [str(a) if b == a + 1 else f"{a}–{b - 1}" for a, b in stretches[:6]]
    return ", ".join(texts) + (" …" if len(stretches) > 6 else "")
