"""Progress of a long task as one line: rewritten in place on a terminal, a new line from time to time elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.status import Status

from lacet.services.progress import AnyStep
from lacet.services.render.progress import sentence

PERIOD = 5.0
"""Period of the lines where the output is not a terminal [s]."""


class Line:
    """Progress line on standard error, showing the latest text."""

    def __init__(self, period: float = PERIOD):
        self._period = period
        self._console = Console(stderr=True, highlight=False, markup=False)
        self._status = Status("", console=self._console) if self._console.is_terminal else None
        self._shown = time.monotonic()

    def show(self, text: str) -> None:
        """Replace the line."""
        if self._status is not None:
            self._status.update(text)
        elif time.monotonic() - self._shown >= self._period:
            self._shown = time.monotonic()
            print(text, file=sys.stderr, flush=True)

    def progress(self, step: AnyStep) -> None:
        """Replace the line by the sentence of a computation's step."""
        self.show(sentence(step))

    def notify(self, text: str) -> None:
        """Print a sentence that is not replaced."""
        if self._status is not None:
            self._console.print(text)
        else:
            print(text, file=sys.stderr, flush=True)

    def __enter__(self) -> Line:
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            self._status.stop()
