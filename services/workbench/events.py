"""Server-sent events: every event published goes to every page that listens."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator
from typing import Any

WAITING = 500
"""Largest number of events waiting for a slow page; beyond it the oldest are dropped and the page must reload."""
BEAT = 10.0
"""Period of empty lines that keep a silent connection alive [s]."""


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

    async def stream(self, first: list[tuple[str, Any]] | None = None) -> AsyncIterator[str]:
        """The stream of one page's events, beginning with `first`."""
        queue: asyncio.Queue[str | None] = asyncio.Queue(WAITING)
        with self._lock:
            if self._closed:
                return
            self._pages[queue] = asyncio.get_running_loop()
        try:
            yield "retry: 1000\n\n"
            for event, data in first or []:
                yield f"event: {event}\ndata: {json.dumps(data, ensure_ascii=False)}\n\n"
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
