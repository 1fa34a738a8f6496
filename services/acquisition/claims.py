"""Claims of workers on runs, by which several workers share runs and each run is fitted once.

A worker that has nothing to do claims a run (liveliness token ``claim``), waits for others' claims and results, and
works on it (token ``working``) when its name is the first. Tokens go with their worker: the run is then free again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from lacet.daq.bus.listener import BusListener, Message
from lacet.daq.bus.session import Keys, chunk

SETTLE = 0.5
"""Time for others' claims and results to come [s]."""
TAKE_OVER = 15.0
"""Time after which a run is taken though a worker with an earlier name, which does not begin, claims it [s]."""
LONGEST_WORK = 3600.0
"""Time after which another worker's run without a result counts as free again [s]."""
MOST_CLAIMS = 1000
"""Most runs whose claims are kept."""


class Claims:
    """Claims of this worker and of others.

    Parameters
    ----------
    name : this worker's name on the bus.
    clock : time [s, monotonic].
    """

    def __init__(self, listener: BusListener, name: str, clock: Callable[[], float] = time.monotonic):
        self._listener = listener
        self._name = chunk(name)
        self._clock = clock
        self._claimed: dict[Keys, dict[str, float]] = {}
        self._working: dict[Keys, dict[str, float]] = {}
        self._current: Keys | None = None
        self._since = 0.0
        self._tokens: list[Any] = []
        listener.watch_claims()

    def take(self, message: Message) -> None:
        """Process another worker's claim, or its end."""
        if message.name == self._name:
            return
        found = self._claimed if message.kind in ("claimed", "unclaimed") else self._working
        if message.kind in ("claimed", "working"):
            if len(found) < MOST_CLAIMS:
                found.setdefault(message.keys, {})[message.name] = self._clock()
        elif (names := found.get(message.keys)) is not None:
            names.pop(message.name, None)
            if not names:
                del found[message.keys]

    def _taken(self, keys: Keys) -> bool:
        """Whether another worker is at work on a run."""
        return any(self._clock() - since < LONGEST_WORK for since in self._working.get(keys, {}).values())

    def next(self, waiting: Iterable[Keys]) -> Keys | None:
        """The waiting run to work on now; None while claims are undecided, or others work on all of them."""
        runs = [keys for keys in waiting if not self._taken(keys)]
        if self._current not in runs:
            self.release()
            if runs:  # one that nobody claims, before others
                keys = next((keys for keys in runs if keys not in self._claimed), runs[0])
                self._current, self._since = keys, self._clock()
                self._tokens = [self._listener.declare_token(keys, "claim", self._name)]
                self._listener.ask(keys, "result", "*")
            return None
        waited = self._clock() - self._since
        first = min({self._name, *self._claimed.get(self._current, ())})
        if waited < SETTLE or (first != self._name and waited < TAKE_OVER):
            return None
        self._tokens.append(self._listener.declare_token(self._current, "working", self._name))
        return self._current

    def release(self) -> None:
        """Give the present run up, finished or not."""
        for token in self._tokens:
            token.undeclare()
        self._current, self._tokens = None, []
