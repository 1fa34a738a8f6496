"""Link of a recorder to the bus: a router of its own, that of another recorder at the same address, or one elsewhere.

A link that cannot be made, or is lost, is tried again as long as the recorder runs.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import zenoh

from lacet.daq.bus.credentials import Credentials
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import open_session
from lacet.daq.errors import UsageError

AGAIN = 1.0
"""Time between attempts to make a link [s]."""
WAIT = 1.0
"""Longest time of one attempt to reach a router [s]."""


class Link:
    """Link of publishers to the router at `endpoint`.

    Parameters
    ----------
    serve : be the router there; where another recorder is it already, be its client, and its successor when it ends.
    notify : called with plain sentences for the user.

    Attributes
    ----------
    session : the session at present.
    """

    def __init__(
        self,
        endpoint: str,
        serve: bool,
        credentials: Credentials | None = None,
        notify: Callable[[str], None] = print,
    ):
        self._endpoint, self._serve = endpoint, serve
        self._credentials = credentials
        self._notify = notify
        self._stop = threading.Event()
        self._publishers: list[RunPublisher] = []
        self._guest = False
        found = self._attempt()
        self._isolated = found is None
        self.session = open_session() if found is None else found
        self._thread = threading.Thread(target=self._keep, name="bus-link", daemon=True)
        self._thread.start()

    def add(self, publisher: RunPublisher) -> None:
        """Move this publisher, made at `session`, to every session that takes its place."""
        self._publishers.append(publisher)
        if publisher.session is not self.session:
            publisher.move(self.session)

    def remove(self, publisher: RunPublisher) -> None:
        """Move this publisher no more; it is closed next."""
        self._publishers.remove(publisher)

    @property
    def made(self) -> bool:
        """Whether there is a session with a router, present or coming back, or of its own."""
        return not self._isolated

    def close(self) -> None:
        """End the attempts and close the session; publishers are closed before."""
        self._stop.set()
        self._thread.join(5.0)
        self.session.close()

    def _attempt(self) -> zenoh.Session | None:
        """A session with a router, if one is to be had; says so when there is none for the first time."""
        try:
            if not self._serve:
                return open_session((), (self._endpoint,), WAIT, self._credentials)
            try:
                session = open_session((self._endpoint,), credentials=self._credentials)
                self._guest = False
            except UsageError:
                session = open_session((), (reachable(self._endpoint),), WAIT, self._credentials)
                if not self._guest:
                    self._notify(f"bus: another recorder is the router at {self._endpoint}; its router is used")
                self._guest = True
        except UsageError as error:
            if not self._stop.is_set() and not self._publishers:
                self._notify(f"RECORDING WITHOUT THE BUS, which is tried again every {AGAIN:g} s: {error}")
            return None
        return session

    def _keep(self) -> None:
        while not self._stop.wait(AGAIN):
            orphan = self._guest and not self.session.info.routers_zid()
            if not (self._isolated or orphan) or (session := self._attempt()) is None:
                continue
            old, self.session, self._isolated = self.session, session, False
            for publisher in list(self._publishers):
                publisher.move(session)
            old.close()
            self._notify("bus: linked")


def reachable(endpoint: str) -> str:
    """The address of a router on this machine that listens at `endpoint`, on any address or on one."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
