"""Server-sent events: every event published goes to every page that listens; the study's folder is watched for some."""

from __future__ import annotations

import asyncio
import json
import os
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

WAITING = 500
"""Largest number of events waiting for a slow page; beyond it the oldest are dropped and the page must reload."""
BEAT = 10.0
"""Period of empty lines that keep a silent connection alive [s]."""
PERIOD = 0.7
"""Period of the checks of the folder [s]."""
_PARTS = ("versions", "diagnoses", "effects", "runs", "raw")


class Events:
    """A publisher of events from any thread to any number of pages."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pages: dict[asyncio.Queue[str | None], asyncio.AbstractEventLoop] = {}
        self._closed = False

    def publish(self, event: str, data: Any) -> None:
        """Send an event to all pages, without waiting."""
        text = f"event: {event}\ndata: {json.dumps(data, ensure_ascii=False)}\n\n"
        with self._lock:
            for queue, loop in self._pages.items():
                loop.call_soon_threadsafe(_put, queue, text)

    def close(self) -> None:
        """End every page's stream, when the server stops."""
        with self._lock:
            self._closed = True
            for queue, loop in self._pages.items():
                loop.call_soon_threadsafe(_put, queue, None)

    @property
    def listening(self) -> int:
        """Number of pages that listen."""
        return len(self._pages)

    async def stream(self, first: Callable[[], Any]) -> AsyncIterator[str]:
        """The stream of one page's events, beginning with ``hello``.

        `first` : gives its data once the page listens, so that what happens after it is an event.
        """
        queue: asyncio.Queue[str | None] = asyncio.Queue(WAITING)
        with self._lock:
            if self._closed:
                return
            self._pages[queue] = asyncio.get_running_loop()
        try:
            yield f"retry: 1000\nevent: hello\ndata: {json.dumps(first(), ensure_ascii=False)}\n\n"
            while True:
                try:
                    text = await asyncio.wait_for(queue.get(), BEAT)
                except TimeoutError:
                    text = ": here\n\n"
                if text is None:
                    return
                yield text
        finally:
            with self._lock:
                self._pages.pop(queue, None)


def _put(queue: asyncio.Queue[str | None], text: str | None) -> None:
    while queue.full():
        queue.get_nowait()
        text = 'event: study\ndata: {"missed": true}\n\n' if text is not None else None
    queue.put_nowait(text)


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
