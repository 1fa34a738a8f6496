"""Readers of raw bus logs: candump, BLF, ASC and TRC through python-can, MDF bus logs through asammdf."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lacet.daq.can_signal import row_width
from lacet.daq.frames import EXTENDED
from lacet.daq.sources.blf_containers import WholeContainers
from lacet.daq.sources.bus_log_lines import AscLines, CandumpLines
from lacet.daq.sources.clock_steps import ClockSteps, Stamped
from lacet.daq.sources.mdf import BUS_CHANNEL
from lacet.daq.sources.source import fault

if TYPE_CHECKING:
    from can.io.generic import MessageReader

FRAMES = 1 << 17
"""Frames that are read at a time."""
_LATEST = 4e9
"""Stamps beyond are no times [s]: the year 2096."""
_LONGEST_LINE = 4096
"""Bytes at the end of a text log that hold its last line."""
_STEPS = 3
"""Steps of a clock that a sentence lists."""
_PRINTED = re.compile(
    r"\s*(\([^)]*\))?\s*\w+\s+(?:[RT]X\s+\S+\s+\S+\s+)?[0-9A-F]{3,8}\s+\[\d+\]\s+(?:[0-9A-F]{2}(?:\s|$)|remote)", re.I
)
"""A line of candump without ``-L``: stamp or none, bus, identifier, length in brackets, bytes."""
_CANDUMP = re.compile(r"^\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]+#")
SUFFIXES = {".blf": "BLF", ".asc": "ASC", ".trc": "TRC"}


class Step(NamedTuple):
    """A clock put back: `bus` in the log, when on the stamps that go on, `t` [s], and by how much, `size` [s]."""

    bus: str
    t: float
    size: float


@dataclass
class Beside:
    """What a bus log has beside its data frames.

    Attributes
    ----------
    steps : steps back of its clock.
    errors, remote : number of error frames and of remote frames.
    zero_ns : instant of stamp 0 [ns since the Unix epoch].
    not_asked : number of data frames of each bus that was not asked for.
    """

    steps: list[Step] = field(default_factory=list)
    errors: int = 0
    remote: int = 0
    zero_ns: int = 0
    not_asked: dict[str, int] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """What is not decoded or played, a sentence each."""
        kinds = {"error": self.errors, "remote": self.remote}
        counts = [f"{count:,} {kind} frame{'s' if count > 1 else ''}" for kind, count in kinds.items() if count]
        out = [f"{' and '.join(counts)} of the log are not used"] if counts else []
        return out + [
            f"bus {name} of the log is none of the rig's: {count:,} frames are not used (with --as {name}=BUS they are)"
            for name, count in self.not_asked.items()
        ]


@dataclass(frozen=True)
class BusFrames:
    """Frames of a bus log.

    `t` (N,) s as stamped; `ident` (N,) with `EXTENDED`; `bus` (N,) index in `buses`; `lengths` (N,) bytes; `rows`
    (N, W) payloads in whole words, filled with zeros; `start_ns` instant of time 0 by the log's header [ns since the
    Unix epoch], 0 where the stamps say it, or nothing does.
    """

    t: NDArray[np.float64]
    ident: NDArray[np.uint32]
    bus: NDArray[np.int64]
    buses: tuple[str, ...]
    lengths: NDArray[np.int64]
    rows: NDArray[np.uint8]
    start_ns: int = 0

    def of(self, which: NDArray[Any]) -> BusFrames:
        """Some of the frames: `which` (N,) whether, or their places in the order wanted."""
        return BusFrames(
            self.t[which], self.ident[which], self.bus[which], self.buses, self.lengths[which], self.rows[which],
            self.start_ns,
        )  # fmt: skip


def form_not_read(path: Path) -> str:
    """What to do about frames that a tool wrote in a form that is not read; empty for any other file."""
    try:
        with path.open("rb") as stream:
            begin = stream.read(4096).decode("utf-8", "replace").lstrip("\ufeff")
    except OSError:
        return ""
    first = next((line for line in begin.splitlines() if line.strip()), "")
    if found := _PRINTED.match(first):
        stamps = "" if found[1] else ", without stamps, which cannot be had from it"
        return (
            f"this is what candump prints on a screen{stamps}; record with candump -L, whose lines are "
            "(1600000000.000000) can0 123#0011223344556677"
        )
    if first.lower().startswith("timestamp,arbitration_id,"):
        made = path.with_suffix(".log").name
        return f"this is a CSV of frames by python-can; convert it: python -m can.logconvert {path.name} {made}"
    return ""


def bus_kind(path: Path) -> str:
    """Kind of raw bus log by suffix and contents, ``candump``, ``BLF``, ``ASC``, ``TRC``; empty for none."""
    suffix = path.suffix.lower()
    try:
        with path.open("rb") as stream:
            begin = stream.read(4096)
    except OSError:
        return ""
    if begin.startswith(b"LOGG"):
        return "BLF"
    text = begin.decode("utf-8", "replace")
    lines = [line for line in text.splitlines() if line.strip()]
    if lines and _CANDUMP.match(lines[0]):
        return "candump"
    if text.startswith(";$FILEVERSION") or (suffix == ".trc" and lines and lines[0].startswith(";")):
        return "TRC"
    if suffix == ".asc" and re.match(r"(date|base|//|begin)", text.lstrip(), re.IGNORECASE):
        return "ASC"
    return ""


def read_frames(
    path: Path, kind: str, damage: list[str] | None = None, beside: Beside | None = None
) -> Iterator[BusFrames]:
    """Frames of a text or BLF log, `FRAMES` at a time, with stamps that go on where its clock was put back.

    What is lost, and such steps, are added to `damage`, one line each; the steps and the frames of other kinds to
    `beside`. Raises RunError with the place of what cannot be read.
    """
    import can  # here, for it takes a while to load

    readers: dict[str, Callable[[Any], MessageReader]] = {
        "candump": can.CanutilsLogReader, "BLF": can.BLFReader, "ASC": can.ASCReader, "TRC": can.TRCReader,
    }  # fmt: skip
    buses: dict[str, int] = {}
    held: list[Any] = []
    read = errors = remote = 0
    cut, behind, warned = _cut_short(path, kind), "", list[str]()
    lines = CandumpLines(path) if kind == "candump" else AscLines(path) if kind == "ASC" else None
    ordered = _InOrder()
    containers: WholeContainers | None = None
    try:
        if kind == "BLF":
            containers = WholeContainers(path, lambda: ordered.since_first(held))
        opened = containers or lines or str(path)
        with _warnings_in(warned), readers[kind](opened) as reader:
            for message in reader:
                if message.is_error_frame or message.is_remote_frame:
                    read += 1
                    errors += message.is_error_frame
                    remote += not message.is_error_frame
                    continue
                if not (abs(message.timestamp) < _LATEST and 0 <= message.arbitration_id < EXTENDED):
                    raise ValueError(f"identifier {message.arbitration_id:#x} at {message.timestamp} s")
                if len(held) >= FRAMES:
                    yield from ordered.of(_packed(held, buses, lines))
                    held = []
                held.append(message)
                read += 1
            if cut and kind == "TRC":
                held = held[:-1]  # of the line that is not whole
    except Exception as cause:  # the readers raise exceptions of many kinds for what is no frame
        behind = f"frame {read + 1} of this {kind} log cannot be read: {str(cause) or type(cause).__name__}"
        if not cut:
            yield from ordered.of(_packed(held, buses, lines) if held else None, last=True)
            raise fault(path, behind) from None
    final = list(ordered.of(_packed(held, buses, lines) if held else None, last=True))
    if damage is not None:
        left_out = lines.damage if lines else ""
        found = [
            cut, *(f"{path.name}: {line}" for line in (containers.damage if containers else ())),
            behind and f"{path.name}: {behind}; it ends there", left_out and f"{path.name}: {left_out}",
            *ordered.lines(path), _warnings_text(path, warned),
        ]  # fmt: skip
        damage += [line for line in found if line and line not in damage]
    if beside is not None:
        beside.steps += ordered.steps
        beside.errors += errors + (lines.error_frames if isinstance(lines, CandumpLines) else 0)
        beside.remote += remote
    yield from final


class _InOrder:
    """The frames of a log in the order of the file, with stamps that go on where its clock was put back."""

    def __init__(self) -> None:
        self._clock = ClockSteps()
        self._numbers: dict[str, int] = {}
        self._waiting: BusFrames | None = None
        self._first = np.nan

    @property
    def steps(self) -> list[Step]:
        """The steps back so far."""
        names = list(self._numbers)
        return [Step(names[bus], t, size) for bus, t, size in self._clock.found]

    def of(self, frames: BusFrames | None, last: bool = False) -> Iterator[BusFrames]:
        """The frames that come next, or nothing as long as it takes to see how the stamps go on."""
        parts = [one for one in (self._waiting, frames) if one is not None]
        if not parts:
            return
        joined = parts[0]
        if len(parts) > 1:
            joined = _joined(parts, tuple(dict.fromkeys(name for part in parts for name in part.buses)))
        if np.isnan(self._first):
            self._first = float(joined.t[0])
        waited = 0 if self._waiting is None else len(self._waiting.t)
        numbers = np.array([self._numbers.setdefault(name, len(self._numbers)) for name in joined.buses])
        new = slice(waited, None)
        t = self._clock.feed(Stamped(joined.t[new], joined.ident[new], numbers[joined.bus[new]]), last)
        self._waiting = joined.of(np.arange(len(t), len(joined.t))) if len(t) < len(joined.t) else None
        if len(t):
            yield replace(joined if self._waiting is None else joined.of(np.arange(len(t))), t=t)

    def since_first(self, held: Sequence[Any]) -> float:
        """Stamp of the last of the messages that come next, from the log's first stamp on [s]."""
        if not held:
            return 0.0
        return float(held[-1].timestamp - (held[0].timestamp if np.isnan(self._first) else self._first))

    def lines(self, path: Path) -> list[str]:
        """The steps of each bus in a sentence, with their sizes and places."""
        out: list[str] = []
        for name in self._numbers:
            mine = [f"by {size:.3f} s after {t - self._first:.2f} s" for bus, t, size in self.steps if bus == name]
            if mine:
                more = f" and {len(mine) - _STEPS} times more" if len(mine) > _STEPS else ""
                bus = f"bus {name}: " if len(self._numbers) > 1 else ""
                some = ", ".join(mine[:_STEPS]) + more
                out.append(f"{path.name}: {bus}its clock is put back {some}; the stamps go on as if it had not been")
        return out


def _cut_short(path: Path, kind: str) -> str:
    """That a log ends before its end, in a sentence; empty where nothing shows it."""
    import can

    size = path.stat().st_size
    with path.open("rb") as stream:
        if kind == "BLF":
            said = can.BLFReader(stream).file_size
            return f"{path.name}: cut short: {size:,} of {said:,} bytes, which its header says" if size < said else ""
        stream.seek(max(0, size - _LONGEST_LINE))
        last = stream.read().rpartition(b"\n")[2].strip()
    whole = not last or last.lower().startswith(b"end")  # the end of an ASC log
    return "" if whole else f"{path.name}: its last line is not whole (cut short?), and its frame is left out"


@contextmanager
def _warnings_in(found: list[str]) -> Iterator[None]:
    """Context of reading a log: what the reader warns of is added to a list, and not printed."""
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: found.append(record.getMessage())
    logger = logging.getLogger("can.io")
    passed_on, logger.propagate = logger.propagate, False
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = passed_on


def _warnings_text(path: Path, warned: Sequence[str]) -> str:
    """Warnings of a reader in a sentence; empty without any."""
    return f"{path.name}: its reader warns {len(warned)} times, the first: {warned[0].strip()}" if warned else ""


def _packed(messages: list[Any], buses: dict[str, int], lines: object) -> BusFrames:
    count = len(messages)
    data = [bytes(message.data) for message in messages]
    lengths = np.fromiter(map(len, data), np.int64, count)
    width = row_width(int(lengths.max(initial=1)))
    joined = b"".join(one.ljust(width, b"\0") for one in data)
    bus = [buses.setdefault(str(m.channel if m.channel is not None else ""), len(buses)) for m in messages]
    return BusFrames(
        np.fromiter((m.timestamp for m in messages), float, count),
        np.fromiter((m.arbitration_id | (EXTENDED if m.is_extended_id else 0) for m in messages), np.uint32, count),
        np.array(bus), tuple(buses), lengths, np.frombuffer(joined, np.uint8).reshape(count, width),
        lines.start_ns if isinstance(lines, AscLines) else 0,
    )  # fmt: skip


def is_bus_log(mdf: Any) -> bool:
    """Whether an open MDF file holds raw frames of a bus."""
    return BUS_CHANNEL in mdf.channels_db


def read_mdf_frames(
    path: Path, mdf: Any, damage: list[str] | None = None, beside: Beside | None = None
) -> Iterator[BusFrames]:
    """Frames of an MDF bus log in order of their stamps, at most `FRAMES` of each group at a time.

    Stamps of a group go on where its clock was put back, which is added to `damage` and `beside` as by `read_frames`.

    Recorders write a group for each bus, each kind of frame or each direction: a piece holds the frames of all groups
    up to one time, so that it shows on which buses a message is.
    """
    orders = [_InOrder() for _ in mdf.channels_db[BUS_CHANNEL]]
    groups = [_group_frames(path, mdf, group) for group, _ in mdf.channels_db[BUS_CHANNEL]]
    readers = [_in_order(frames, ordered) for frames, ordered in zip(groups, orders, strict=True)]
    held = [(reader, piece) for reader in readers for piece in islice(reader, 1)]
    while held:
        until = np.min([piece.t.max() for _, piece in held])
        yield _by_time([piece.of(~(piece.t > until)) for _, piece in held])  # of damaged stamps (NaN) all
        rest = [(reader, piece.of(piece.t > until)) for reader, piece in held]
        held = [(reader, piece) for reader, later in rest for piece in ([later] if len(later.t) else islice(reader, 1))]
    for ordered in orders:
        if damage is not None:
            damage += [line for line in ordered.lines(path) if line not in damage]
        if beside is not None:
            beside.steps += ordered.steps


def _in_order(pieces: Iterator[BusFrames], ordered: _InOrder) -> Iterator[BusFrames]:
    """The frames of one group with stamps that go on."""
    for piece in pieces:
        yield from ordered.of(piece)
    yield from ordered.of(None, last=True)


def _by_time(parts: Sequence[BusFrames]) -> BusFrames:
    """Frames of several groups as one, in order of their stamps."""
    joined = _joined(parts, tuple(sorted({name for part in parts for name in part.buses}, key=int)))
    return joined.of(np.argsort(joined.t, kind="stable"))


def _joined(parts: Sequence[BusFrames], buses: tuple[str, ...]) -> BusFrames:
    """Frames end to end, of these buses."""
    bus = np.concatenate([np.array([buses.index(name) for name in part.buses])[part.bus] for part in parts])
    width = max(part.rows.shape[1] for part in parts)
    rows = np.concatenate([_widened(part.rows, width) for part in parts])
    t, ident, lengths = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "ident", "lengths"))
    return BusFrames(t, ident, bus, buses, lengths, rows, parts[0].start_ns)


def _widened(rows: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Payloads (N, W) as rows of `width` bytes, filled with zeros."""
    return np.pad(rows, ((0, 0), (0, width - rows.shape[1])))


def _group_frames(path: Path, mdf: Any, group: int) -> Iterator[BusFrames]:
    """Frames of a group of an MDF bus log, `FRAMES` at a time."""
    count = int(mdf.groups[group].channel_group.cycles_nr)
    for start in range(0, count, FRAMES):
        size = min(FRAMES, count - start)

        def column(name: str, start: int = start, size: int = size) -> Any:
            return mdf.get(f"{BUS_CHANNEL}.{name}", group=group, record_offset=start, record_count=size, raw=True)

        try:
            ident = column("ID")
            rows = np.asarray(column("DataBytes").samples)
            rows = rows.reshape(len(rows), -1).astype(np.uint8)
            lengths = np.asarray(column("DataLength").samples, np.int64)
            bus = np.asarray(column("BusChannel").samples, np.int64)
            try:
                extended = np.asarray(column("IDE").samples, bool)
            except Exception:  # a log of 11-bit identifiers alone need not have this channel
                extended = np.asarray(ident.samples) > 0x7FF
        except Exception as cause:  # truncated data make asammdf raise what it likes
            raise fault(path, f"frames of group {group} cannot be read from {start} on: {cause}") from None
        names, which = np.unique(bus, return_inverse=True)
        bare = np.asarray(ident.samples, np.uint32) & np.uint32(0x1FFFFFFF)
        yield BusFrames(
            np.asarray(ident.timestamps, float), bare | np.where(extended, np.uint32(EXTENDED), np.uint32(0)),
            which, tuple(str(one) for one in names), lengths, _widened(rows, row_width(rows.shape[1])),
        )  # fmt: skip
