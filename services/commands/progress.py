"""Progress of a long task as one line: rewritten in place on a terminal, a new line from time to time elsewhere."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType

from rich.console import Console
from rich.status import Status

from lacet.services.progress import AnyStep, ServiceStage
from lacet.services.render.progress import overdue, sentence, with_time
from lacet.services.timing.job_time import JobTime

PERIOD = 5.0
"""Period of the lines where the output is not a terminal [s]."""


class Line:
    """Progress line on standard error: share of the job done, time left, and the latest text.

    Parameters
    ----------
    job : name of the job, which begins each line where the output is not a terminal.
    period : time between two such lines, and before the first [s].
    clock : monotonic time [s].
    """

    def __init__(self, job: str = "", period: float = PERIOD, clock: Callable[[], float] = time.monotonic):
        self._job, self._period, self._clock = job, period, clock
        self._console = Console(stderr=True, highlight=False, markup=False)
        self._status = Status(self, console=self._console) if self._console.is_terminal else None
        self._time = JobTime(clock)
        self._text = ""
        self._shown = clock()

    def show(self, text: str) -> None:
        """Replace the line."""
        self._text = text
        if self._status is None and self._clock() - self._shown >= self._period:
            self._shown = self._clock()
            with _reader_may_go():
                print(f"{self._job}: {self}" if self._job else str(self), file=sys.stderr, flush=True)

    def progress(self, step: AnyStep) -> None:
        """Replace the line by the sentence of a computation's step."""
        self._time.step(step)
        if step.stage != ServiceStage.PLANNED:
            self.show(sentence(step))

    def notify(self, text: str) -> None:
        """Print a sentence that is not replaced."""
        with _reader_may_go():
            if self._status is not None:
                self._console.print(text)
            else:
                print(text, file=sys.stderr, flush=True)

    def __str__(self) -> str:
        """The line as it is now."""
        now = self._time.estimate()
        if now is None:
            return self._text
        return overdue(self._text, now.passed) if now.overdue else with_time(self._text, now.share, now.remaining)

    __rich__ = __str__
    """The terminal's line is written anew several times a second, so that the time left runs down within a stage."""

    def __enter__(self) -> Line:
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            with _reader_may_go():
                self._status.stop()
        self._time.end(done=kind is None)


@contextmanager
def _reader_may_go() -> Iterator[None]:
    """What is written to a terminal or pipe that has gone is discarded from then on: the job does not depend on it."""
    try:
        yield
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
