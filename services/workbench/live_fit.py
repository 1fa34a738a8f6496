"""Live fit for the page: `lacet live` as a process of its own, whose lines go to the pages as events."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from lacet.daq.bus.credentials import Credentials
from lacet.daq.errors import UsageError
from lacet.services.workbench.events import Events

AGAIN = 2.0
"""Time after which a process that ended is started again [s]."""
UNWATCHED = 30.0
"""Time without any page after which the process is ended [s]."""
TURN = 0.2
"""Period of the checks of the process [s]."""
LARGEST = 1 << 20
"""Longest line that is read [characters]."""


class LiveFitProcess:
    """The fit of the recording heard at a router, begun when a page asks for it, and again when it dies.

    Parameters
    ----------
    folder : the study's; without a version of a model the base model is fitted.
    endpoint : the router; None where the workbench listens to none.
    """

    def __init__(self, folder: Path, endpoint: str | None, credentials: Credentials | None, events: Events):
        self._folder, self._endpoint, self._credentials, self._events = folder, endpoint, credentials, events
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._wanted: list[str] | None = None
        self._wanted_as: tuple[list[str], int | None] | None = None
        self._process: subprocess.Popen[str] | None = None
        self._state: dict[str, Any] | None = None
        self._why = ""
        self._thread: threading.Thread | None = None

    def ask(self, target: float, version: int | None) -> dict[str, Any]:
        """Begin the fit to a target [% of the value], or anew where target or model version are others.

        Returns the present state. Raises UsageError for a target that is none, and without a router.
        """
        if not 0.0 < target < 100.0:
            raise UsageError("the target is a per cent between 0 and 100")
        if self._endpoint is None:
            raise UsageError("no recording is listened to: start lacet ui with the recorder's address (--connect)")
        command = [sys.executable, "-m", "lacet", "live", "--lines", "--target", f"{target:g}"]
        command += ["--connect", self._endpoint]
        command += [] if self._credentials is None else ["--keys", str(self._credentials.folder)]
        # The version is read by the process itself; here it makes another command of another one.
        command += [] if version is None else [str(self._folder)]
        with self._lock:
            if (command, version) != self._wanted_as:
                self._wanted, self._wanted_as = command, (command, version)
                self._state, self._why = None, "the fit begins"
                self._end()
            if self._thread is None:
                self._thread = threading.Thread(target=self._keep, name="lacet-live-fit", daemon=True)
                self._thread.start()
        return self.payload()

    def payload(self) -> dict[str, Any]:
        """The last second's state, as a line of `lacet live` has it, and `note` on the process, empty while it runs."""
        with self._lock:
            return {"state": self._state, "note": self._why}

    def close(self) -> None:
        """End the process and the thread."""
        self._stop.set()
        with self._lock:
            self._end()
        if self._thread is not None:
            self._thread.join(5.0)

    def _end(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.kill()

    def _keep(self) -> None:
        """The thread: keep the process running while a page is there."""
        watched, begun = time.monotonic(), -AGAIN
        while not self._stop.wait(TURN):
            now = time.monotonic()
            watched = now if self._events.listening else watched
            with self._lock:
                process, wanted = self._process, self._wanted
                over = process is None or process.poll() is not None
                if now - watched > UNWATCHED:
                    self._wanted = self._wanted_as = None
                    self._end()
                elif over and wanted is not None and now - begun > AGAIN:
                    begun = now
                    self._process = self._begun(wanted)

    def _begun(self, command: list[str]) -> subprocess.Popen[str]:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        threading.Thread(target=self._read, args=(process,), name="lacet-live-fit-lines", daemon=True).start()
        return process

    def _read(self, process: subprocess.Popen[str]) -> None:
        """Pass on a process's lines until it ends."""
        assert process.stdout is not None
        while line := process.stdout.readline(LARGEST):
            try:
                found = json.loads(line)
            except ValueError:
                continue
            with self._lock:
                if process is self._process:
                    self._state, self._why = found, ""
            self._events.publish("live-fit", self.payload())
        process.wait()
        with self._lock:
            if process is self._process and self._wanted is not None and not self._stop.is_set():
                self._why = "the fit has ended and begins again; the recording is not affected"
        if not self._stop.is_set():
            self._events.publish("live-fit", self.payload())
