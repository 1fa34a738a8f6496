"""Bounded queue between several producers (reader threads, bus callbacks) and one consumer.

It never blocks a producer, as a device and a network do not wait: items beyond its capacity are dropped and counted.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from typing import Generic, TypeVar

T = TypeVar("T")


class BoundedQueue(Generic[T]):
    """A first-in-first-out queue, bounded by the number of frames (or whatever `count` counts) it holds.

    Parameters
    ----------
    capacity : largest sum of its items' `count`; an empty queue accepts one item larger than that, so that no item is
        undeliverable by its size alone.

    Attributes
    ----------
    dropped : source → sum of `count` dropped because the queue was full.
    high_water : the largest sum it ever held.
    """

    def __init__(self, capacity: int):
        if capacity < 1:
            raise ValueError(f"capacity {capacity}: must be at least 1")
        self.capacity = capacity
        self.high_water = 0
        self._items: deque[tuple[T, int]] = deque()
        self._held = 0
        self._dropped: Counter[str] = Counter()
        self._closed = False
        self._ready = threading.Condition(threading.Lock())

    def put(self, item: T, source: str = "", count: int = 1, reserve: int = 0) -> bool:
        """Append `item`, which counts as `count`; False when it was dropped (full or closed). Never blocks.

        `reserve` is room beyond the capacity for items that others must not displace.
        """
        with self._ready:
            if self._closed or (self._items and self._held + count > self.capacity + reserve):
                self._dropped[source] += count
                return False
            self._items.append((item, count))
            self._held += count
            self.high_water = max(self.high_water, self._held)
            self._ready.notify()
            return True

    def get(self, timeout: float | None = None) -> T | None:
        """The oldest item, removed, waiting up to `timeout` [s] (None: for ever); None when there is none."""
        with self._ready:
            if not self._ready.wait_for(lambda: self._items or self._closed, timeout) or not self._items:
                return None
            item, count = self._items.popleft()
            self._held -= count
            return item

    def drain(self) -> list[T]:
        """All items, removed, oldest first, without waiting."""
        with self._ready:
            items = [item for item, _ in self._items]
            self._items.clear()
            self._held = 0
            return items

    def close(self) -> None:
        """Accept no more items and wake every waiting `get`; items inside can still be removed."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    @property
    def held(self) -> int:
        """Sum of the `count` of the items inside."""
        return self._held

    @property
    def dropped(self) -> dict[str, int]:
        """Source → sum of `count` dropped so far."""
        with self._ready:
            return dict(self._dropped)

    def __len__(self) -> int:
        return len(self._items)
