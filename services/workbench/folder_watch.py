"""Watch on the study's folder, so that pages are notified of changes by another page or the command line."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from lacet.services.workbench.events import Events

PERIOD = 0.7
"""Period of the checks of the folder [s]."""
_PARTS = ("versions", "diagnoses", "effects", "runs", "raw")


def state_of(folder: Path) -> dict[str, tuple[tuple[str, int, int], ...]]:
    """Part of the study → its files with time of change [ns] and size."""
    out: dict[str, tuple[tuple[str, int, int], ...]] = {}
    for part in ("study", *_PARTS):
        place = folder if part == "study" else folder / part
        found: list[tuple[str, int, int]] = []
        try:
            with os.scandir(place) as entries:
                for entry in entries:
                    if (
                        entry.is_file()
                        and not entry.name.endswith((".tmp", ".part"))
                        and (part != "study" or entry.name in ("study.json", "rig.toml", "vehicle.toml"))
                    ):
                        about = entry.stat()
                        found.append((entry.name, about.st_mtime_ns, about.st_size))
        except OSError:  # not created yet, or being moved
            pass
        out[part] = tuple(sorted(found))
    return out


class Watch:
    """Thread that publishes ``study`` events with the parts that changed."""

    def __init__(self, folder: Path, events: Events):
        self._folder, self._events = folder, events
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._poll, name="lacet-watch", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join(2.0)

    def _poll(self) -> None:
        before = state_of(self._folder)
        while not self._stop.wait(PERIOD):
            now = state_of(self._folder)
            if changed := [part for part in now if now[part] != before[part]]:
                self._events.publish("study", {"changed": changed})
            before = now
