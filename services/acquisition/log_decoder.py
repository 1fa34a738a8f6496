"""Decoder of a whole log in windows of time, in a memory that does not grow with the log.

Messages are written in the order of windows of `WINDOW_NS`, in each window buses, then channels, by name. What a bus or
channel has in a window is one message; a stamp that steps back belongs to the window reached before it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Block
from lacet.daq.formats.log import LogReader, LogWriter
from lacet.daq.frames import Frames
from lacet.daq.pauses import Stamps
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.acquisition.unseen_losses import UnseenLosses

WINDOW_NS = 100_000_000
"""Duration of the messages written [ns]."""

STEP = 50
"""Windows decoded at a time."""

HOLD = 10
"""Windows held back for samples of which frames are still to come."""

LARGEST = 200_000
"""Most frames of one bus decoded at a time, half a minute of a full one, and most late samples that are kept. Stamps
that jump by more put a run's rest into one window, which is then written in parts."""

Late = Mapping[tuple[str, int], Block]
"""Channel and window → samples that were complete only after the window was written."""


class LogDecoder:
    """Decoder of the raw frames of one log into another, window by window.

    A sample can wait for its frames longer than windows are held back: the last one of a sensor that falls silent in
    the middle of it, until the end of the log. It is then written late, and kept in `late`; a second decoder that is
    given it writes it in its place.

    Parameters
    ----------
    reader : the log read.
    decoder : decoder of its rig, at its start.
    known : samples that will come late, of an earlier decoder of the same log.
    between : stamps from which and before which frames are decoded [ns]; None for all.
    """

    def __init__(
        self,
        reader: LogReader,
        decoder: Decoder,
        known: Late | None = None,
        between: tuple[int, int] | None = None,
    ):
        self._decoder = decoder
        self._unseen = UnseenLosses(reader, decoder)
        self._known = dict(known or {})
        self._sources = [_Source(name, _within(reader.batches(name), between)) for name in reader.sources()]
        spans = [reader.span(name) for name in reader.sources()]
        self._span = between or (min(first for first, _ in spans), max(last for _, last in spans))
        self._open: dict[tuple[bool, str], _Windows] = defaultdict(_Windows)  # not written yet: buses, then channels
        self._front = np.iinfo(np.int64).min  # windows before this one are written
        self._late: dict[tuple[str, int], list[Block]] = defaultdict(list)
        self._late_samples = 0
        self.samples: dict[str, int] = {}
        """Number of samples by channel."""
        self.stamps: dict[str, Stamps] = defaultdict(Stamps)
        """Stamps of each channel [s], from the first frame on."""
        self.last_ns = 0
        """Latest stamp of a frame [ns]."""

    @property
    def late(self) -> Late:
        """Samples that came after their window was written; none where they are too many to be kept."""
        few = self._late_samples <= LARGEST
        return {key: Block.concat(blocks) for key, blocks in self._late.items()} if few else {}

    def write_to(self, writer: LogWriter) -> Iterator[float]:
        """Decode everything and store frames and blocks; yield the fraction done."""
        first_ns, last_ns = self._span
        waiting = [source for source in self._sources if source.filled()]
        while waiting:
            limit = min(source.next_window for source in waiting) + STEP
            for source in waiting:
                frames, numbers = source.before(limit)
                if frames is not None:
                    self.last_ns = max(self.last_ns, int(frames.t_ns.max()))
                    self._open[False, source.name].append(frames, numbers)
                    before = self._lost(source.name)
                    blocks = self._decoder.feed(frames)
                    self._unseen.note(blocks, source.name, self._lost(source.name) - before)
                    self._add(blocks)
            waiting = [source for source in waiting if source.filled()]
            if waiting:  # else the samples of `finish` come first
                self._write(writer, limit - HOLD)
                yield min(1.0, max(0.0, (limit * WINDOW_NS - first_ns) / max(1, last_ns - first_ns)))
        self._add(self._decoder.finish())
        self._write(writer, None)
        yield 1.0

    def _lost(self, source: str) -> int:
        """Samples of a bus that its counters show to be lost, so far; not counted where no frames are missing."""
        return self._decoder.ledger()[source].get("lost", 0) if self._unseen.may_be(source) else 0

    def _add(self, blocks: list[Block]) -> None:
        """Take over decoded blocks, and keep those that are late."""
        for block in blocks:
            name, windows = block.channel, self._open[True, block.channel]
            self.samples[name] = self.samples.get(name, 0) + len(block)
            self.stamps[name].add((block.t_ns - self._span[0]) / 1e9)
            numbers = windows.number(block.t_ns)
            late = int(np.searchsorted(numbers, self._front))
            for begin, end in pairwise(_edges(numbers[:late])):
                key = name, int(numbers[begin])
                if key in self._known:  # written in its place
                    continue
                part = _cut(block, begin, end)
                windows.append(part, numbers[begin:end])
                self._late_samples += end - begin
                if self._late_samples <= LARGEST:
                    self._late[key].append(part)
            if late < len(numbers):
                windows.append(_cut(block, late, len(numbers)), numbers[late:])

    def _write(self, writer: LogWriter, before: int | None) -> None:
        """Store the windows before one, or all."""
        end = np.iinfo(np.int64).max if before is None else before
        for (name, window), block in self._known.items():
            if self._front <= window < end:
                self._open[True, name].insert(block, window)
        ready = []
        for key, windows in self._open.items():
            item, numbers = windows.take(end)
            if item is not None:
                edges = _edges(numbers)
                messages = writer.messages(item, edges)
                ready += [(int(numbers[edges[i]]), key, i, message) for i, message in enumerate(messages)]
        for *_, message in sorted(ready, key=lambda entry: entry[:3]):
            writer.write(message)
        self._front = max(self._front, end)


class _Windows:
    """Frames of one bus, or samples of one channel, in order, with the window of each."""

    def __init__(self) -> None:
        self.top = np.iinfo(np.int64).min
        self.items: list[tuple[Frames | Block, NDArray[np.int64]]] = []

    def number(self, t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Windows of the next stamps: never before the one reached."""
        numbers = np.maximum.accumulate(np.maximum(t_ns // WINDOW_NS, self.top))
        self.top = int(numbers[-1])
        return numbers

    def append(self, item: Frames | Block, numbers: NDArray[np.int64]) -> None:
        """Add at the end what has these windows."""
        self.items.append((item, numbers))

    def insert(self, block: Block, window: int) -> None:
        """Add samples at the end of a window."""
        rest = _Windows()
        rest.items, self.items = self.items, []
        found, numbers = rest.take(window + 1)
        if found is not None:
            self.append(found, numbers)
        self.append(block, np.full(len(block), window))
        self.items += rest.items

    def take(self, before: int) -> tuple[Any, NDArray[np.int64]]:
        """What has a window before one, joined, with its windows; None when there is nothing."""
        taken: list[tuple[Frames | Block, NDArray[np.int64]]] = []
        while self.items:
            item, numbers = self.items[0]
            end = int(np.searchsorted(numbers, before))
            if end < len(numbers):
                if end:
                    taken.append((_cut(item, 0, end), numbers[:end]))
                    self.items[0] = _cut(item, end, len(numbers)), numbers[end:]
                break
            taken.append(self.items.pop(0))
        if not taken:
            return None, np.zeros(0, np.int64)
        return _joined([item for item, _ in taken]), np.concatenate([numbers for _, numbers in taken])


class _Source:
    """Frames of one bus, read as far as they are needed."""

    def __init__(self, name: str, batches: Iterator[Frames]):
        self.name = name
        self._batches = batches
        self._read = _Windows()

    def filled(self) -> bool:
        """Whether there are any more frames; some are read then."""
        if not self._read.items:
            self._fill(np.iinfo(np.int64).max, 1)
        return bool(self._read.items)

    @property
    def next_window(self) -> int:
        """Window of the next frame."""
        return int(self._read.items[0][1][0])

    def before(self, limit: int) -> tuple[Frames | None, NDArray[np.int64]]:
        """Frames of the windows before one, `LARGEST` or a batch more at a time, and their windows."""
        self._fill(limit, LARGEST - sum(len(numbers) for _, numbers in self._read.items))
        return self._read.take(limit)

    def _fill(self, limit: int, most: int) -> None:
        """Read until a window is reached, or so many frames or a batch more are read."""
        new: list[Frames] = []
        top = self._read.top
        while top < limit and most > 0 and (batch := next(self._batches, None)) is not None:
            if len(batch):
                new.append(batch)
                most -= len(batch)
                top = max(top, int(batch.t_ns.max()) // WINDOW_NS)
        if new:
            frames = Frames.concat(self.name, new)
            self._read.append(frames, self._read.number(frames.t_ns))


def _within(batches: Iterator[Frames], between: tuple[int, int] | None) -> Iterator[Frames]:
    """The frames from the first to the last one that is stamped between two times [ns], the second not included."""
    for frames in batches:
        if between is None:
            yield frames
        elif len(inside := np.flatnonzero((frames.t_ns >= between[0]) & (frames.t_ns < between[1]))):
            yield frames[int(inside[0]) : int(inside[-1]) + 1]


def _edges(numbers: NDArray[np.int64]) -> list[int]:
    """Where the stretches of equal numbers begin, and the end; empty for none."""
    if not len(numbers):
        return []
    return [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), len(numbers)]


def _cut(item: Frames | Block, begin: int, end: int) -> Any:
    """A stretch of frames or samples."""
    if isinstance(item, Frames):
        return item[begin:end]
    device = None if item.device_ns is None else item.device_ns[begin:end]
    return Block(item.channel, item.t_ns[begin:end], item.values[begin:end], item.flags[begin:end], device)


def _joined(items: list[Any]) -> Any:
    """Frames of one bus, or samples of one channel, end to end."""
    if len(items) == 1:
        return items[0]
    return Frames.concat(items[0].source, items) if isinstance(items[0], Frames) else Block.concat(items)
