"""Driver of the Sagem inertial unit on a serial line at 200 Hz. Wire format: ``docs/wires/sagem.md``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Block, Flag
from lacet.daq.frames import Frames
from lacet.drivers.framework.base import Driver
from lacet.drivers.framework.counters import add
from lacet.drivers.framework.crc import CRC16_CCITT_FALSE
from lacet.drivers.framework.lines import rest_of
from lacet.drivers.framework.options import check_options
from lacet.drivers.framework.records import Part, Record, Records, RecordSensor, RecordState

SYNC = b"\xa5\x5a"
LENGTH = 30
TYPE = 0x01
HEAD = SYNC + bytes((LENGTH, TYPE))


class Sagem(RecordSensor, Driver):
    """Driver of the Sagem: specific force, angular rate and attitude, one message a sample in a stream of bytes.

    A message is found by its first four bytes and verified by its CRC. After a false or corrupt one the search resumes
    at its second byte, so that no good message behind it is lost. A corrupt message becomes a flagged sample unless a
    good one begins inside it.
    """

    name: str = "sagem"
    record = Record(HEAD, 2, 9, CRC16_CCITT_FALSE, crc_from=len(SYNC))
    parts = (
        Part("imu.accel", 0, 3, 0.002),
        Part("imu.rate", 3, 3, 1e-4),
        Part("imu.attitude", 6, 3, 1e-4, wraps=True),
    )

    def __init__(
        self,
        bus: str,
        options: Mapping[str, object] | None = None,
        folder: Path | None = None,
        documents: Mapping[str, str] | None = None,
    ) -> None:
        check_options(self.name, options or {}, ())
        self.bus = bus
        self.channels = tuple(part.channel for part in self.parts)
        self.documents = {}

    def start(self) -> RecordState:
        """State before the first byte."""
        state = super().start()
        return replace(state, ledger=add(state.ledger, incomplete=0, skipped_bytes=0))

    def decode(self, frames: Frames, state: RecordState) -> tuple[list[Block], RecordState]:
        """Blocks of the messages completed by a batch of reads; a sample has the stamp of the read of its first byte.

        In the ledger ``received`` and ``skipped_bytes`` (outside valid messages) count bytes.
        """
        stream = Frames.concat(self.bus, [state.waiting, frames])
        received = int(frames.offset[-1] - frames.offset[0])
        found, good, hold = _scan(stream.data)
        read = np.searchsorted(stream.offset, found, side="right") - 1
        rows = stream.data[found[:, None] + np.arange(LENGTH)]
        faults = np.where(good, 0, Flag.CHECKSUM).astype(np.uint8)
        blocks, state = self.samples(Records(rows, stream.t_ns[read], faults), state)
        skipped = hold - LENGTH * int(np.count_nonzero(good))
        ledger = add(state.ledger, received=received, skipped_bytes=skipped)
        return blocks, replace(state, waiting=rest_of(stream, hold), ledger=ledger)

    def finish(self, state: RecordState) -> tuple[list[Block], RecordState]:
        """Blocks at the end of the stream: corrupt messages are samples; a truncated one counts ``incomplete``."""
        stream = state.waiting
        found, good, _ = _scan(stream.data, ended=True)
        rows = stream.data[found[:, None] + np.arange(LENGTH)]
        read = np.searchsorted(stream.offset, found, side="right") - 1
        faults = np.where(good, 0, Flag.CHECKSUM).astype(np.uint8)
        blocks, state = self.samples(Records(rows, stream.t_ns[read], faults), state, ended=True)
        skipped = len(stream.data) - LENGTH * int(np.count_nonzero(good))
        done = int(found[-1]) + LENGTH if len(found) else 0
        cut = int(stream.data[done:].tobytes().find(HEAD) >= 0)
        ledger = add(state.ledger, skipped_bytes=skipped, incomplete=cut)
        return blocks, replace(state, waiting=Frames.empty(self.bus), ledger=ledger)


def _scan(data: NDArray[np.uint8], ended: bool = False) -> tuple[NDArray[np.int64], NDArray[np.bool_], int]:
    """Messages of a stream, as one pass from left to right would find them.

    Returns
    -------
    found : (N,) first bytes of the good messages, and of the corrupt ones inside which no good one begins.
    good : (N,) whether the CRC is right.
    hold : bytes before this one are finished with; the rest is kept until more arrive (unless `ended`).
    """
    heads = np.flatnonzero(data[: max(0, len(data) - len(HEAD) + 1)] == HEAD[0])
    for i in range(1, len(HEAD)):
        heads = heads[data[heads + i] == HEAD[i]]
    whole = heads[heads + LENGTH <= len(data)]
    rows = data[whole[:, None] + np.arange(LENGTH)]
    right = Sagem.record.crc_right(rows)
    good = _first_come(whole[right])
    end = int(good[-1]) + LENGTH if len(good) else 0
    broken = whole[~right]
    # No message begins inside a good one.
    before = np.searchsorted(good, broken, side="right") - 1
    broken = broken[(before < 0) | (broken >= good[before] + LENGTH)] if len(good) else broken
    # A good message that begins inside a broken one shows that its head was false, or that bytes of it are missing.
    after = np.searchsorted(good, broken)
    follower = np.append(good, np.iinfo(np.int64).max)[after]
    broken = _first_come(broken[follower - broken >= LENGTH])
    hold = len(data)
    if not ended:
        begun = heads[(heads + LENGTH > len(data)) & (heads >= end)]
        hold = int(begun[0]) if len(begun) else max(end, len(data) - _begun_head(data))
        if len(broken) and broken[-1] + LENGTH > hold:  # a good message may still begin inside it
            hold = int(broken[-1])
            broken = broken[:-1]
    found = np.concatenate((good, broken))
    order = np.argsort(found, kind="stable")
    return found[order], np.repeat([True, False], [len(good), len(broken)])[order], hold


def _first_come(starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Ascending message starts without those that lie inside an earlier kept one; the loop is over overlaps only."""
    keep = np.ones(len(starts), bool)
    last = None
    for i in np.flatnonzero(np.diff(starts) < LENGTH):
        if keep[i]:
            last = starts[i]
        if last is not None and starts[i + 1] - last < LENGTH:
            keep[i + 1] = False
    return starts[keep]


def _begun_head(data: NDArray[np.uint8]) -> int:
    """Length of the longest prefix of a head at the end of the stream [byte]."""
    tail = data[-(len(HEAD) - 1) :].tobytes()
    return max((n for n in range(1, len(HEAD)) if tail.endswith(HEAD[:n])), default=0)
