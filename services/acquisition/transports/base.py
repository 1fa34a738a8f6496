"""What every transport is: a receiver that gives stamped `Frames`, a sender that puts `Frames` on a wire."""

from __future__ import annotations

from typing import Protocol

from lacet.daq.frames import Frames


class Receiver(Protocol):
    """One wire, listened to.

    Attributes
    ----------
    source : bus name as in the rig file; the `source` of every frame it gives.
    warnings : what a user should know about this wire (a receive buffer clipped by the system …), plain sentences.
    """

    source: str
    warnings: list[str]

    def open(self) -> None:
        """Open the wire; OSError when it is not there (it may be tried again)."""
        ...

    def read(self, timeout: float) -> Frames:
        """Frames that came, stamped on receipt [ns], waiting up to `timeout` [s]; may be empty.

        Raises
        ------
        OSError : the link went down or the device was unplugged; `close`, then `open` again.
        """
        ...

    def losses(self) -> dict[str, int]:
        """Frames lost on this wire since the receiver was made, by cause: ``kernel``, ``malformed``, ``overrun`` …"""
        ...

    def close(self) -> None:
        """Release the wire; may be called twice."""
        ...


class Sender(Protocol):
    """One wire, spoken on.

    Attributes
    ----------
    source : bus name.
    unsent : frames that nobody was there to take, or that the wire refused.
    endpoint : where a receiver finds it, in the notation of `services.acquisition.transports.endpoints`.
    sees_receivers : whether `has_room` knows how far the receivers are, or `send` itself waits for them.
    """

    source: str
    unsent: int
    endpoint: str
    sees_receivers: bool

    def open(self) -> None:
        """Open the wire; OSError when that cannot be."""
        ...

    def send(self, frames: Frames) -> None:
        """Put frames on the wire, in order, as fast as it takes them; their stamps play no part."""
        ...

    def has_room(self) -> bool:
        """Whether a receiver that keeps up would lose nothing if more were sent now (True where that is unknown)."""
        ...

    def close(self) -> None:
        """Release the wire; may be called twice."""
        ...
