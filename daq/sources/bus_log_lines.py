"""Lines of text logs of a bus as python-can's readers need them.

Its reader of candump logs ends at the first line that is no frame; that of ASC logs takes every stamp from the start.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

_FRAME = re.compile(
    r"\s*\(\d+\.\d+\)\s+\S+\s+([0-9A-F]{3}|[0-9A-F]{8})#(R[0-9A-F]?|(#[0-9A-F])?([0-9A-F]{2})*)(\s+[RT])?\s*",
    re.IGNORECASE,
)
"""A line as candump writes it: stamp, interface, identifier, data (of CAN FD behind its flags), direction."""
_STAMPED = re.compile(r"(\s*)(\d+\.\d+)(\s.*)", re.DOTALL)
"""A line of an ASC log that has a stamp: frames, and events of other kinds."""
_ERROR = 0x20000000
"""Bit of an identifier that SocketCAN sets in error frames."""
_SHOWN = 40
"""Characters of a line that are shown."""


class _Lines(io.StringIO):
    """A text log as a stream of lines for a reader of python-can, which iterates over it more than once."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._stream = path.open(encoding="utf-8", errors="replace")

    def __iter__(self) -> Iterator[str]:  # type: ignore[override]
        return self._kept(self._stream)

    def _kept(self, lines: Iterable[str]) -> Iterator[str]:
        """The lines as the reader gets them."""
        raise NotImplementedError

    def close(self) -> None:
        self._stream.close()
        super().close()


class CandumpLines(_Lines):
    """A candump log read line by line, without error frames, lines that are no frames, and a last line that is cut off.

    `unreadable` : lines left out that are no frames; `first` : number and text of the first of them.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.unreadable = 0
        self.first = ""

    def _kept(self, lines: Iterable[str]) -> Iterator[str]:
        for number, line in enumerate(lines, 1):
            found = _FRAME.fullmatch(line)
            if found is None:
                if line.endswith("\n") and line.strip():
                    self._leave_out(number, line.strip())
            elif line.endswith("\n") and not int(found[1], 16) & _ERROR:
                yield line

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


class AscLines(_Lines):
    """An ASC log line by line, with stamps from its start [s] also where its header says that each is from the last."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._relative = False
        self._time = 0.0

    def _kept(self, lines: Iterable[str]) -> Iterator[str]:
        for line in lines:
            if line.lstrip()[:5].lower() == "base ":
                self._relative = "timestamps relative" in " ".join(line.lower().split())
            elif self._relative and (found := _STAMPED.fullmatch(line)):
                self._time += float(found[2])
                yield f"{found[1]}{self._time:.9f}{found[3]}"
                continue
            yield line
