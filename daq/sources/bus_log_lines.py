"""Lines of text logs of a bus as python-can's readers need them.

Its reader of candump logs ends at the first line that is no frame; that of ASC logs passes over some silently, and
takes every stamp from the start.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path

_FRAME = re.compile(
    r"\s*\(\d+\.\d+\)\s+\S+\s+([0-9A-F]{3}|[0-9A-F]{8})#(R[0-9A-F]?|(#[0-9A-F])?([0-9A-F]{2})*)(\s+[RT])?\s*",
    re.IGNORECASE,
)
"""A line as candump writes it: stamp, interface, identifier, data (of CAN FD behind its flags), direction."""
_STAMPED = re.compile(r"(\s*)(\d+\.\d+)(\s.*)", re.DOTALL)
"""A line of an ASC log that has a stamp: frames, and events of other kinds."""
_CAN_LINE = re.compile(r"\s*\d+\.\d+\s+(?:\d+|CANFD)\s", re.IGNORECASE)
"""A line of an ASC log about a CAN channel."""
_ASC_FRAME = re.compile(
    r"\s*\d+\.\d+\s+(?:"
    r"\d+\s+(?P<ident>[0-9A-F]+)x?\s+[RT]x\w*\s+(?:r(?:\s.*)?|d\s+(?P<size>[0-9A-F]+)(?P<data>(?:\s+[0-9A-F]{1,3}(?=\s))*)(?:\s.*)?)"
    r"|CANFD\s+\d+\s+[RT]x\w*\s+(?P<fd_ident>[0-9A-F]+)x?(?:\s+\S*[^\s\d]\S*)?\s+\d\s+\d\s+[0-9A-F]+\s+(?P<fd_size>\d+)"
    r"(?P<fd_data>(?:\s+[0-9A-F]{1,3}(?!\S))*)(?:\s.*)?"
    r")",
    re.IGNORECASE | re.DOTALL,
)
"""A frame of an ASC log: of classic CAN, and of CAN FD with or without a name; its size and data."""
_CAN_EVENT = re.compile(
    r"\s*\d+\.\d+\s+(?:CANFD\s+)?\d+\s+(?:[RT]x\w*\s+)?(?:Statistic|ErrorFrame|OverloadFrame|J1939|OTP|TP)",
    re.IGNORECASE,
)
"""A line about a CAN channel that is known to be no data frame."""
_OTHER_LINE = re.compile(r"\s*(?:$|//|(?:date|base|no|internal|begin|end|previous|log|start)\b)", re.IGNORECASE)
"""A line without a stamp that belongs to an ASC log."""
_DATE = re.compile(
    r"\s*(?P<what>date|begin\s+triggerblock)\s+\w+\s+(?P<month>\w{3})\w*\s+(?P<day>\d+)\s+"
    r"(?P<hour>\d+):(?P<minute>\d+):(?P<second>\d+)(?:\.(?P<part>\d+))?\s*(?P<half>am|pm)?\s+(?P<year>\d{4})\s*",
    re.IGNORECASE,
)
"""A date of an ASC log: of the file, or of a block of frames."""
_MONTHS = {
    month: number
    for number, months in enumerate(
        "jan feb mar,mär,mrz apr may,mai jun jul aug sep oct,okt nov dec,dez".split(), 1  # noqa: SIM905
    )
    for month in months.split(",")
}  # fmt: skip
_AGREE = 1.0
"""Difference up to which the dates of an ASC log and of its first block are the same instant [s]; the block's may be
without milliseconds."""
_ERROR = 0x20000000
"""Bit of an identifier that SocketCAN sets in error frames."""
_SHOWN = 40
"""Characters of a line that are shown."""


class _Lines(io.StringIO):
    """A text log as a stream of lines for a reader of python-can, which iterates over it more than once.

    `unreadable` : lines left out that are no frames; `first` : number and text of the first of them.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.unreadable = 0
        self.first = ""
        self._stream = path.open(encoding="utf-8", errors="replace")

    def __iter__(self) -> Iterator[str]:  # type: ignore[override]
        return self._kept(self._stream)

    def _kept(self, lines: Iterable[str]) -> Iterator[str]:
        """The lines as the reader gets them."""
        raise NotImplementedError

    def _leave_out(self, number: int, line: str) -> None:
        self.unreadable += 1
        self.first = self.first or f"line {number}, '{line[:_SHOWN]}{'…' if len(line) > _SHOWN else ''}'"

    @property
    def damage(self) -> str:
        """What was left out, in words; empty for nothing."""
        if not self.unreadable:
            return ""
        are = "1 line is no frame and is" if self.unreadable == 1 else f"{self.unreadable} lines are no frames and are"
        return f"{are} left out, the first: {self.first}"

    def close(self) -> None:
        self._stream.close()
        super().close()


class CandumpLines(_Lines):
    """A candump log read line by line, without error frames, lines that are no frames, and a last line that is cut off.

    `unreadable` : lines left out that are no frames; `first` : number and text of the first of them; `error_frames` :
    how many of them.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.error_frames = 0

    def _kept(self, lines: Iterable[str]) -> Iterator[str]:
        for number, line in enumerate(lines, 1):
            found = _FRAME.fullmatch(line)
            if found is None:
                if line.endswith("\n") and line.strip():
                    self._leave_out(number, line.strip())
            elif not line.endswith("\n"):
                continue
            elif int(found[1], 16) & _ERROR:
                self.error_frames += 1
            else:
                yield line


class AscLines(_Lines):
    """An ASC log line by line, with stamps from its start [s] also where its header says that each is from the last.

    Left out are lines that are no frames and no known events, and a last line that is cut off.

    `unreadable` : lines left out that are no frames; `first` : number and text of the first of them. `start_ns` :
    instant of stamp 0 by the dates in the log, which have no time zone, as UTC [ns since the Unix epoch]; 0 until the
    first stamp, and without a date.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.start_ns = 0
        self._relative = False
        self._decimal = False
        self._time = 0.0
        self._number = 0
        self._dates: dict[str, int] = {}
        self._dated = False

    def _kept(self, lines: Iterable[str]) -> Iterator[str]:
        for line in lines:
            self._number += 1
            whole = self._whole(line)
            if whole and self._dated and not self._relative and line.endswith("\n"):  # nearly all of them
                yield line
                continue
            stamped = _STAMPED.fullmatch(line)
            if not line.endswith("\n") and not line.strip().lower().startswith("end"):
                continue
            if stamped is None:
                if not self._of_header(line):
                    self._leave_out(self._number, line.strip())
                    continue
            elif _CAN_LINE.match(line) and not whole and not _CAN_EVENT.match(line):
                self._leave_out(self._number, line.strip())
                continue
            else:
                if not self._dated:
                    self._date(float(stamped[2]))
                if self._relative:
                    self._time += float(stamped[2])
                    line = f"{stamped[1]}{self._time:.9f}{stamped[3]}"
            yield line

    def _whole(self, line: str) -> bool:
        """Whether a line is a frame with all its data."""
        found = _ASC_FRAME.fullmatch(line)
        if found is None:
            return False
        ident, size, data = found["ident"], found["size"], found["data"] or ""
        if found["fd_ident"]:
            ident, size, data = found["fd_ident"], found["fd_size"], found["fd_data"]
        if self._decimal and not (ident + "".join(data.split()) + (size or "")).isdecimal():
            return False
        if size is None:  # a remote frame
            return True
        count = int(size) if found["fd_ident"] else min(8, int(size, 10 if self._decimal else 16))
        return len(data.split()) >= count

    def _of_header(self, line: str) -> bool:
        """Whether a line without a stamp belongs to an ASC log; what it says is kept."""
        words = " ".join(line.lower().split())
        if words.startswith("base "):
            self._relative = "timestamps relative" in words
            self._decimal = words.startswith("base dec")
        elif (found := _DATE.fullmatch(line)) and found["month"].lower() in _MONTHS:
            self._dates.setdefault(found["what"].lower()[:4], _ns_of(found))
        return bool(_OTHER_LINE.match(line))

    def _date(self, first: float) -> None:
        """Take over the dates, with the first stamp of all [s].

        That of the file is the start, that of a block its first line. Where they differ it is a file that was written
        later than its frames came: the block's counts.
        """
        self._dated = True
        block = self._dates.get("begi")
        start = self._dates.get("date")
        if block is not None and (start is None or abs(start / 1e9 + first - block / 1e9) > _AGREE):
            start = block - round(first * 1e9)
        self.start_ns = start or 0


def _ns_of(found: re.Match[str]) -> int:
    """The instant of a date [ns since the Unix epoch], 0 for one that is none.

    One or two digits behind the point are milliseconds too: python-can writes them without leading zeros.
    """
    hour = int(found["hour"])
    if found["half"]:
        hour = hour % 12 + (12 if found["half"].lower() == "pm" else 0)
    part = found["part"] or "0"
    ns = int(part) * 10**6 if len(part) < 3 else int(part[:9].ljust(9, "0"))
    try:
        when = datetime(
            int(found["year"]), _MONTHS[found["month"].lower()], int(found["day"]), hour, int(found["minute"]),
            int(found["second"]), tzinfo=UTC,
        )  # fmt: skip
    except ValueError:
        return 0
    return round(when.timestamp()) * 10**9 + ns
