"""Interface of a driver: pure functions from frames to blocks and back; no clock, socket or thread."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from lacet.daq.blocks import Block
from lacet.daq.errors import UsageError
from lacet.daq.frames import Frames

State = Any
"""State of a driver between batches: an immutable value of its own type. ``counts(state)`` reads its ledger."""


class Driver(Protocol):
    """A driver: decoder and encoder of one kind of sensor on one bus.

    The samples do not depend on how frames are split into batches. No payload raises an exception: unusable data become
    a flagged sample or a counted loss.
    """

    name: str
    """Driver name as used in rig files."""
    channels: tuple[str, ...]
    """Channels this instance produces."""
    documents: dict[str, str]
    """File name → full text of each file that this instance has its layout from (a DBC); empty where there is none."""

    notes: tuple[str, ...] = ()
    """What is doubtful in the layout of this instance, a sentence each."""

    def start(self) -> State:
        """State before the first frame."""
        ...

    def decode(self, frames: Frames, state: State) -> tuple[list[Block], State]:
        """Blocks of a batch, at most one a channel, in time order, and the state after it."""
        ...

    def finish(self, state: State) -> tuple[list[Block], State]:
        """Blocks at the end of the stream: incomplete data become flagged samples or counted losses."""
        ...

    def counts(self, state: State) -> dict[str, int]:
        """The loss ledger: ``received``, ``samples`` and losses by cause (``bad_checksum``, ``lost`` …)."""
        ...

    def remarks(self, state: State) -> tuple[str, ...]:
        """What is doubtful in the frames so far, a sentence each."""
        return ()

    def encode(self, blocks: Mapping[str, Block], counter: int = 0) -> Frames:
        """The frames that a sensor would send for these samples (all channels on the same stamps).

        Its sample counters begin with `counter`.
        """
        ...


class Reader(Driver):
    """Base of drivers that only read: nothing is held at the end of the stream, and nothing is encoded."""

    def finish(self, state: State) -> tuple[list[Block], State]:
        """No blocks."""
        return [], state

    def encode(self, blocks: Mapping[str, Block], counter: int = 0) -> Frames:
        """Raises UsageError."""
        raise UsageError(
            f"driver '{self.name}' only reads, and what its wire carries is not simulated. Write tables instead: "
            "--format parquet"
        )
