"""The interface of a driver: pure functions from frames to blocks and back. No clock, no socket, no thread."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from lacet.daq.blocks import Block
from lacet.daq.frames import Frames

State = Any
"""A driver's memory between batches: an immutable value of its own type. ``counts(state)`` reads its ledger."""


class Driver(Protocol):
    """A driver: decoder and encoder of one kind of sensor on one bus.

    Any split of the same frames into batches gives the same samples. Nothing in a payload ever raises: what cannot be
    used becomes a flagged sample or a counted loss.
    """

    name: str
    """Driver name as used in rig files."""
    channels: tuple[str, ...]
    """Channels this instance produces."""
    documents: dict[str, str]
    """File name → full text of each file this instance read its layout from (a DBC); empty where there is none."""

    def start(self) -> State:
        """State before the first frame."""
        ...

    def decode(self, frames: Frames, state: State) -> tuple[list[Block], State]:
        """Decode a batch; at most one block a channel, in time order."""
        ...

    def finish(self, state: State) -> tuple[list[Block], State]:
        """End of the stream: what was still waiting becomes flagged samples or counted losses."""
        ...

    def counts(self, state: State) -> dict[str, int]:
        """The loss ledger so far: ``received``, ``samples`` and losses by cause (``bad_checksum``, ``lost`` …)."""
        ...

    def encode(self, blocks: Mapping[str, Block], counter: int = 0) -> Frames:
        """The frames a sensor would have sent for these samples (all channels on the same stamps).

        Its sample counters begin with `counter`.
        """
        ...
