"""Digest of all blocks of a run, which only a holder of every block can compute."""

from __future__ import annotations

import hashlib
from typing import Any


class RunDigest:
    """SHA-256 over all blocks of a run, taken channel by channel; blocks of one channel are added in sequence.

    It is not in the manifest: an acknowledgement that carries it comes from a worker that has the run.
    """

    def __init__(self) -> None:
        self._channels: dict[str, Any] = {}

    def add(self, channel: str, message: bytes) -> None:
        """Add the next block of a channel."""
        found = self._channels.setdefault(channel, hashlib.sha256())
        found.update(len(message).to_bytes(8, "little"))
        found.update(message)

    def hexdigest(self) -> str:
        """The digest of what was added, as hexadecimal text."""
        whole = hashlib.sha256()
        for channel, found in sorted(self._channels.items()):
            whole.update(f"{channel} {found.hexdigest()}\n".encode())
        return whole.hexdigest()
