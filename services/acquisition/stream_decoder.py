"""Decoder of raw frames into blocks by a rig's drivers, for the live recorder, batch by batch, and for whole logs."""

from __future__ import annotations

import traceback
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import RigError
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.wire import StopRecord
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig, Sensor
from lacet.drivers import open_driver
from lacet.drivers.framework.base import Driver, Reader, State
from lacet.services.acquisition.sensor_monitor import Watched

NO_LOSS = frozenset(
    {
        "received",
        "samples",
        "saturated",
        "bad_status",
        "restarts",
        "skipped_bytes",
        "repeated",
        "reordered",
        "unknown_ident",
        "no_driver",
        "no_neighbour",
        "other_sender",
    }
)
"""Entries of a ledger that are no losses in transit of what a sensor sent."""


@dataclass
class _Wired:
    """A sensor of the rig with its driver and the driver's state."""

    sensor: Sensor
    driver: Driver
    state: State
    failure: str = ""
    """What its driver failed with; nothing is decoded by it from then on."""
    unread: int = 0
    """Frames of its bus from then on."""


class Decoder:
    """Decoder of a rig's frames by the drivers of its sensors.

    Parameters
    ----------
    rig : sensors without a driver or a bus are left out.
    documents : file name → text, recorded with a run; they take precedence over files on disk.
    own : drivers of the user's own by name, which have been trusted.

    Raises
    ------
    LacetError : a driver is unknown, or its options or documents have faults.
    """

    def __init__(self, rig: Rig, documents: Mapping[str, str] | None = None, own: Mapping[str, type] | None = None):
        self.rig = rig
        self._wired: list[_Wired] = []
        faults: list[str] = []
        self.documents: dict[str, str] = {}
        """File name → full text of every file that the drivers use."""
        for sensor in rig.sensors:
            if sensor.driver is None or sensor.bus is None:
                continue
            try:
                driver = open_driver(sensor.driver, sensor.bus, sensor.options, rig.folder, documents, own)
            except RigError as cause:  # whose place is the driver: say which row of which file
                faults += [f"sensor {sensor.name}.{fault}" for fault in cause.faults]
                continue
            self._wired.append(_Wired(sensor, driver, driver.start()))
            self.documents |= driver.documents
        if faults:
            raise RigError(rig.path, faults)
        self._received: dict[str, int] = defaultdict(int)
        self.unseen: dict[str, int] = defaultdict(int)
        """Bus → samples lost that no counter shows, where they are known by other means; in the ledger too."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that the drivers can decode and the rig lists."""
        return tuple(name for wired in self._wired for name in wired.driver.channels if name in wired.sensor.channels)

    @property
    def notes(self) -> list[str]:
        """What is doubtful in the layouts of the drivers and in the frames so far, a sentence each."""
        return [
            f"sensor {wired.sensor.name}: {note}"
            for wired in self._wired
            for note in (*wired.driver.notes, *self._remarks(wired))
        ]

    @property
    def watched(self) -> tuple[Watched, ...]:
        """The sensors with a driver; rates are those of the channels, where the driver is not for any sender's."""
        return tuple(
            Watched(
                wired.sensor.name,
                wired.sensor.bus or "",
                {
                    name: None if isinstance(wired.driver, Reader) else CHANNELS[name].rate
                    for name in wired.driver.channels
                    if name in wired.sensor.channels
                },
                numbered=wired.sensor.clock == "steady",
            )
            for wired in self._wired
        )

    def feed(self, frames: Frames) -> list[Block]:
        """Blocks of a batch of one bus, whose next batch continues it."""
        self._received[frames.source] += len(frames)
        blocks: list[Block] = []
        for wired in self._wired:
            if wired.sensor.bus == frames.source:
                blocks += self._decoded(wired, lambda driver, state: driver.decode(frames, state))
                wired.unread += len(frames) if wired.failure else 0
        return blocks

    def finish(self) -> list[Block]:
        """Blocks at the end of the stream, from samples with frames missing."""
        blocks: list[Block] = []
        for wired in self._wired:
            blocks += self._decoded(wired, lambda driver, state: driver.finish(state))
        return blocks

    @property
    def failures(self) -> dict[str, str]:
        """Sensor → what its driver failed with, of those that are no longer decoded."""
        return {wired.sensor.name: wired.failure for wired in self._wired if wired.failure}

    def ledger(self) -> dict[str, dict[str, int]]:
        """Counts so far by bus: ``received`` frames, ``samples``, and by cause those lost or not used.

        ``unknown_ident`` counts frames of a CAN bus that no driver decodes; ``no_driver`` frames of a bus without one;
        ``driver_failed`` frames from the batch on in which a driver raised an exception.
        """
        out: dict[str, dict[str, int]] = {}
        for source in sorted({*self._received, *(wired.sensor.bus or "" for wired in self._wired)}):
            drivers = [wired for wired in self._wired if wired.sensor.bus == source]
            sums: dict[str, int] = defaultdict(int)
            for wired in drivers:
                for cause, number in self._counts(wired).items():
                    sums[cause] += number
                if wired.failure:
                    sums["driver_failed"] += wired.unread
            bus = self.rig.buses.get(source)
            total = self._received[source]
            if not drivers:
                sums["no_driver"] = total
            elif bus is not None and bus.kind == "can":
                sums["unknown_ident"] = max(0, total - sums["received"])
            if self.unseen[source]:
                sums["lost_unseen"] = self.unseen[source]
            out[source] = {**sums, "received": total}
        return out

    def losses(self) -> dict[str, dict[str, int]]:
        """The entries of `ledger` that are losses, without zeros."""
        rows = {
            source: {cause: number for cause, number in causes.items() if number and cause not in NO_LOSS}
            for source, causes in self.ledger().items()
        }
        return {source: causes for source, causes in rows.items() if causes}

    @staticmethod
    def _remarks(wired: _Wired) -> tuple[str, ...]:
        """Remarks of a driver so far; none of one that cannot say them."""
        try:
            return tuple(wired.driver.remarks(wired.state))
        except Exception as error:
            wired.failure = wired.failure or _place_of(error)
            return ()

    @staticmethod
    def _counts(wired: _Wired) -> Mapping[str, int]:
        """Counts of a driver so far; none of one that cannot say them."""
        try:
            return wired.driver.counts(wired.state)
        except Exception as error:
            wired.failure = wired.failure or _place_of(error)
            return {}

    @staticmethod
    def _decoded(wired: _Wired, step: Callable[[Driver, State], tuple[list[Block], State]]) -> list[Block]:
        """The blocks that the rig lists, of one step of a driver; none once it has failed.

        A driver may be anybody's: what others decode goes on, and so does the recording of all raw frames.
        """
        if wired.failure:
            return []
        try:
            blocks, wired.state = step(wired.driver, wired.state)
        except Exception as error:
            wired.failure = _place_of(error)
            return []
        return [block for block in blocks if block.channel in wired.sensor.channels and len(block)]


def _place_of(error: Exception) -> str:
    """An exception in a line, with the place where it was raised."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(place.filename).name}, line {place.lineno})"


def decode_frames(decoder: Decoder, frames: list[Frames]) -> dict[str, Block]:
    """Blocks by channel of whole buses, decoded to the end. Raises RuntimeError where a driver failed."""
    parts: dict[str, list[Block]] = defaultdict(list)
    for batch in frames:
        for block in decoder.feed(batch):
            parts[block.channel].append(block)
    for block in decoder.finish():
        parts[block.channel].append(block)
    if decoder.failures:
        raise RuntimeError("; ".join(f"{sensor}: {text}" for sensor, text in decoder.failures.items()))
    return {channel: Block.concat(blocks) for channel, blocks in parts.items()}


def closing_record(reader: LogReader, decoder: Decoder, last_ns: int) -> StopRecord:
    """The stop record of a decoded log: that of the raw log, with the losses of decoding."""
    losses = {source: dict(causes) for source, causes in (reader.stop.losses if reader.stop else {}).items()}
    for source, causes in decoder.losses().items():
        losses.setdefault(source, {}).update(causes)
    if reader.stop is None:
        return StopRecord(last_ns, "decoded from a recording that was not closed", {}, losses)
    return replace(reader.stop, counts={}, losses=losses)
