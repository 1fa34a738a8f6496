"""Interfaces of the transports: a receiver that reads stamped `Frames`, a sender that writes `Frames` to a wire."""

from __future__ import annotations

from typing import Protocol

from lacet.daq.frames import Frames


class Receiver(Protocol):
    """Receiver of the frames of one wire.

    Attributes
    ----------
    source : bus name as in the rig file; the `source` of every frame received.
    warnings : sentences for the user about this wire (a receive buffer limited by the system …).
    """

    source: str
    warnings: list[str]

    def open(self) -> None:
        """Open the wire. Raises OSError when it is absent; may be called again."""
        ...

    def read(self, timeout: float) -> Frames:
        """Frames received, stamped on receipt [ns], waiting up to `timeout` [s]; may be empty.

        Raises
        ------
        OSError : the link went down or the device was unplugged; `close`, then `open` again.
        """
        ...

    def losses(self) -> dict[str, int]:
        """Frames lost on this wire since the receiver exists, by cause: ``kernel``, ``malformed``, ``overrun`` …"""
        ...

    def close(self) -> None:
        """Release the wire; may be called twice."""
        ...


class Sender(Protocol):
    """Sender of frames on one wire.

    Attributes
    ----------
    source : bus name.
    unsent : number of frames without a receiver, or refused by the wire.
    endpoint : address for receivers, in the notation of `services.acquisition.transports.endpoints`.
    sees_receivers : whether `has_room` measures the receivers' backlog, or `send` itself waits for them.
    """

    source: str
    unsent: int
    endpoint: str
    sees_receivers: bool

    def open(self) -> None:
        """Open the wire. Raises OSError when that is impossible."""
        ...

    def send(self, frames: Frames) -> None:
        """Send frames, in order, as fast as the wire accepts them; their stamps are ignored."""
        ...

    def has_room(self) -> bool:
        """Whether receivers that keep up can accept more now without loss (True where that is unknown)."""
        ...

    def close(self) -> None:
        """Release the wire; may be called twice."""
        ...
