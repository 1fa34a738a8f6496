"""Files of one run: a recording that is split, or goes on after a full disk or a crash, is in several logs.

The first has the name that was given, `run.mcap`; the next ones a number, `run-2.mcap`. The metadata record at the
head of each says of which run and which part it is, so that a file that only has such a name is never taken for one.
"""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from lacet.daq.formats.mcap_read import Contents, McapScan, Stored
from lacet.daq.formats.mcap_records import BROKEN, HEAD, parse_definition
from lacet.daq.topics import MANIFEST, META_START, START, STOP

PART = "part"
"""Key of a start record's `extra`, and of the metadata at a log's head: number of the file in its run, from 2 on."""

GOES_ON = "goes on in "
"""Begin of the reason in a stop record of a file that is followed by another, whose name comes then."""

BROKE_OFF = "broke off: "
"""Begin of the reason in a stop record that an error of the program wrote."""

_HEAD_BYTES = 64 << 10  # the header and the metadata of the start, which a recorder writes first
_NUMBERED = re.compile(r"(.+)-(\d+)")


class RunPart(NamedTuple):
    """Which file of which run a log is; an empty `run_id` where that cannot be read."""

    run_id: str
    part: int


def part_of(path: Path) -> RunPart:
    """Run and number of a log, by the first records of the file."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return RunPart("", 1)
    at = len(MCAP0_MAGIC) if head.startswith(MCAP0_MAGIC) else len(head)
    while at + HEAD.size <= len(head):
        opcode, length = HEAD.unpack_from(head, at)
        at += HEAD.size
        if opcode not in (Opcode.HEADER, Opcode.METADATA):
            break
        if opcode == Opcode.METADATA:
            try:
                found = parse_definition(opcode, head[at : at + length])
            except BROKEN:
                break
            if isinstance(found, Metadata) and found.name == META_START:
                part = found.metadata.get(PART, "1")
                return RunPart(found.metadata.get("run_id", ""), int(part) if part.isdecimal() else 1)
        at += length
    return RunPart("", 1)


def files_of_run(path: Path) -> dict[int, Path]:
    """The files of the run that a log is of, by number, whichever of them is named; the log alone where it has no name.

    Only files beside the log are found: one that is missing is missing in the numbers too.
    """
    own = part_of(path)
    if path.suffix.lower() != ".mcap" or not own.run_id:
        return {1: path}
    numbered = _NUMBERED.fullmatch(path.stem)
    stem = numbered[1] if own.part > 1 and numbered else path.stem
    found = {own.part: path}
    first = path.with_stem(stem)
    if own.part > 1 and part_of(first) == RunPart(own.run_id, 1):
        found[1] = first
    for name in sorted(glob.glob(f"{glob.escape(str(path.parent / stem))}-*{glob.escape(path.suffix)}")):
        file = Path(name)
        if (found_number := _NUMBERED.fullmatch(file.stem)) and found_number[1] == stem:
            run_id, part = part_of(file)
            if run_id == own.run_id and part > 1:
                found.setdefault(part, file)
    return dict(sorted(found.items()))


def next_path(first: Path, part: int) -> Path:
    """A free name for a further file of the run whose first one is given, with its number where that is free."""
    while (path := first.with_stem(f"{first.stem}-{part}")).exists():
        part += 1
    return path


def first_files(paths: Iterable[Path]) -> list[Path]:
    """The files, less later ones of a run of which an earlier one is given."""
    paths = list(paths)
    there = {path.resolve() for path in paths}
    out: list[Path] = []
    for path in paths:
        files = files_of_run(path) if _may_be_further(path) else {1: path}
        own = part_of(path).part if len(files) > 1 else min(files)
        if not any(number < own and file.resolve() in there for number, file in files.items()):
            out.append(path)
    return out


def further_files(path: Path) -> list[Path]:
    """The other files of the run of a log."""
    if path.suffix.lower() != ".mcap":
        return []
    return [file for file in files_of_run(path).values() if not _same(file, path)]


def _may_be_further(path: Path) -> bool:
    return path.suffix.lower() == ".mcap" and _NUMBERED.fullmatch(path.stem) is not None


def _same(a: Path, b: Path) -> bool:
    return os.path.abspath(a) == os.path.abspath(b)


class RunScan:
    """Index of the files of one run, as `McapScan` is of one: messages of a topic go on from file to file.

    The run's start is that of its first file, its end that of its last one.

    Parameters
    ----------
    files : number → file, more than one or not the first.
    """

    def __init__(self, files: dict[int, Path]):
        self._scans = [McapScan.of(file) for file in files.values()]
        self.contents: dict[int, Contents] = {}
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.damage: list[str] = [f"{scan.path.name}: {line}" for scan in self._scans for line in scan.damage]
        self.finished = self._scans[-1].finished
        self._ids: list[dict[int, int]] = []  # of each file: its channel → the run's
        self._segments = [0]
        by_topic: dict[str, int] = {}
        begun = self._one_of(START, self._scans)
        ended = self._scans[-1]
        for scan in self._scans:
            ids: dict[int, int] = {}
            base = 1 << 16
            for number, held in scan.contents.items():
                topic = scan.channels[number].topic
                if (topic == START and scan is not begun) or (topic in (STOP, MANIFEST) and scan is not ended):
                    continue
                new = ids[number] = by_topic.setdefault(topic, len(by_topic) + 1)
                if new not in self.channels:
                    schema = scan.channels[number].schema_id
                    kept = schema and schema + base * len(self._ids)
                    self.channels[new] = replace(scan.channels[number], id=new, schema_id=kept)
                    if schema in scan.schemas:
                        self.schemas[kept] = replace(scan.schemas[schema], id=kept)
                self.contents.setdefault(new, Contents()).join(held)
            self._ids.append(ids)
            self._segments.append(self._segments[-1] + scan.segments)
            self.metadata = {**scan.metadata, **self.metadata}
        numbers = list(files)
        self.damage += [
            f"file {number} of the run is missing: put it beside {ended.path.name}"
            for number in range(1, numbers[-1])
            if number not in files
        ]
        for scan, after in zip(self._scans, self._scans[1:], strict=False):
            if not scan.finished:
                self.damage.append(
                    f"{scan.path.name} was not closed: the recording broke off there and goes on in {after.path.name}; "
                    "what came in between is lost"
                )

    @staticmethod
    def _one_of(topic: str, scans: Sequence[McapScan]) -> McapScan | None:
        """The first file with a message of a topic."""
        return next((s for s in scans if any(s.channels[number].topic == topic for number in s.contents)), None)

    def messages(
        self, channels: Iterable[int] | None = None, last: bool = False, between: tuple[int, int] | None = None
    ) -> Iterator[Stored]:
        """Messages of some channels, file by file; arguments as those of `McapScan.messages`."""
        wanted = self.contents.keys() if channels is None else self.contents.keys() & set(channels)
        for scan, ids, begin in list(zip(self._scans, self._ids, self._segments, strict=False)):
            own = {number for number, new in ids.items() if new in wanted}
            if not own:
                continue
            for message in scan.messages(own, last, between):
                yield message._replace(channel=ids[message.channel], segment=begin + message.segment)
