"""Sub-commands as processes of their own, as a user starts them. Never forked: Zenoh does not survive that."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
LACET = "lacet.services.commands.__main__"
"""The module that is the command line."""
PATIENCE = 60.0
"""Longest that a command may take to end, or to say something, on a busy machine [s]."""


class Command:
    """A running ``lacet`` sub-command; `text()` is what it has printed so far; `under` is what starts it.

    `module` is another command line in the place of lacet's own.
    """

    def __init__(self, name: str, *args: object, cwd: Path, under: tuple[str, ...] = (), module: str = LACET):
        self.log = cwd / f"{name}-{time.monotonic_ns()}.txt"
        search = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        with self.log.open("wb") as out:
            self.process = subprocess.Popen(
                [*under, sys.executable, "-m", module, name, *map(str, args)],
                cwd=cwd,
                stdout=out,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONPATH": search},
            )

    def text(self) -> str:
        """Standard output and error so far."""
        return self.log.read_text()

    def wait(self, timeout: float = PATIENCE) -> int:
        """The exit code."""
        try:
            return self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"still running after {timeout:g} s:\n{self.text()}") from None

    def wait_for(self, text: str, timeout: float = PATIENCE) -> None:
        """Wait until it has printed `text`."""
        until = time.monotonic() + timeout
        while text not in self.text():
            if self.process.poll() is not None or time.monotonic() > until:
                raise AssertionError(f"'{text}' not in:\n{self.text()}")
            time.sleep(0.02)


@contextlib.contextmanager
def commands() -> Iterator[list[Command]]:
    """Kills what is left of the commands put into the list."""
    running: list[Command] = []
    try:
        yield running
    finally:
        for command in running:
            if command.process.poll() is None:
                command.process.kill()
                command.process.wait(10.0)
