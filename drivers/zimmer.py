"""Driver of the Zimmer wheel cameras on UDP at 100 Hz. Wire format: ``docs/wires/zimmer.md``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from lacet.daq.blocks import Block, Flag
from lacet.daq.channels import CORNERS
from lacet.daq.frames import Frames
from lacet.drivers.framework.base import Driver
from lacet.drivers.framework.counters import add
from lacet.drivers.framework.crc import CRC32
from lacet.drivers.framework.options import check_options, corner_map
from lacet.drivers.framework.records import Part, Record, Records, RecordSensor, RecordState

STEP = 5e-5
"""Raw step of every angle [rad]."""


class Zimmer(RecordSensor, Driver):
    """Driver of the Zimmer cameras: steer and camber angle of each wheel, one datagram a set of pictures."""

    name: str = "zimmer"
    record = Record(b"", 4, 8, CRC32, crc_from=0)

    def __init__(
        self,
        bus: str,
        options: Mapping[str, object] | None = None,
        folder: Path | None = None,
        documents: Mapping[str, str] | None = None,
    ) -> None:
        check_options(self.name, options or {}, ("corners",))
        self.bus = bus
        corners = corner_map(self.name, options or {}, CORNERS)
        self.parts = tuple(
            Part(f"camera.{corners[corner]}.{angle}", 2 * i + j, 1, STEP)
            for i, corner in enumerate(CORNERS)
            if corner in corners
            for j, angle in enumerate(("steer", "camber"))
        )
        self.channels = tuple(part.channel for part in self.parts)
        self.documents = {}

    def start(self) -> RecordState:
        """State before the first datagram."""
        state = super().start()
        return replace(state, ledger=add(state.ledger, incomplete=0, bad_length=0))

    def decode(self, frames: Frames, state: RecordState) -> tuple[list[Block], RecordState]:
        """Blocks of a batch of datagrams; one of the wrong length is a sample flagged `INCOMPLETE`."""
        length = self.record.length
        whole = frames.lengths == length
        rows = np.zeros((len(frames), length), np.uint8)
        rows[whole] = frames.data[frames.offset[:-1][whole][:, None] + np.arange(length)]
        faults = np.where(self.record.crc_right(rows), 0, Flag.CHECKSUM).astype(np.uint8)
        faults[~whole] = Flag.INCOMPLETE
        blocks, state = self.samples(Records(rows, frames.t_ns, faults), state)
        wrong = np.count_nonzero(~whole)
        ledger = add(state.ledger, received=len(frames), incomplete=wrong, bad_length=wrong)
        return blocks, replace(state, ledger=ledger)

    def finish(self, state: RecordState) -> tuple[list[Block], RecordState]:
        """Blocks of the datagrams held back."""
        return self.samples(self.none(), state, ended=True)
