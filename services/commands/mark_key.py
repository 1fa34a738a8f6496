"""Markers from the terminal of a recording: the Enter key, with what was typed before it as the text."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_WAIT = 0.2  # s; how soon the thread sees that the recording is over


@contextmanager
def marks_by_key(mark: Callable[[str], object], descriptor: int | None = None) -> Iterator[bool]:
    """While it lasts, each line typed calls `mark` with its text; yields whether there is a terminal to type in.

    A recording in the background reads nothing, and one whose terminal goes does not end by that.

    Parameters
    ----------
    descriptor : the terminal; standard input by default.
    """
    with suppress(OSError, ValueError):  # closed, or none
        descriptor = sys.stdin.fileno() if descriptor is None else descriptor
    if (
        not hasattr(signal, "SIGTTIN")
        or descriptor is None
        or not os.isatty(descriptor)
        or threading.current_thread() is not threading.main_thread()
    ):
        yield False
        return
    # A read from the background would stop the whole recording; so it fails instead, and nothing is read.
    before = signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    stop = threading.Event()
    thread = threading.Thread(target=_read, args=(descriptor, mark, stop), name="mark-key", daemon=True)
    thread.start()
    try:
        yield True
    finally:
        stop.set()
        thread.join(2.0)
        signal.signal(signal.SIGTTIN, before)


def _read(descriptor: int, mark: Callable[[str], object], stop: threading.Event) -> None:
    typed = b""
    while not stop.is_set():
        try:
            ready, _, _ = select.select([descriptor], [], [], _WAIT)
            if not ready:
                continue
            if os.tcgetpgrp(descriptor) != os.getpgrp():
                stop.wait(_WAIT)
                continue
            data = os.read(descriptor, 4096)
        except OSError:  # the terminal has gone
            return
        if not data:
            return
        *lines, typed = (typed + data).split(b"\n")
        for line in lines:
            mark(line.decode(errors="replace"))
