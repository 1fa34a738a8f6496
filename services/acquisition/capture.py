"""Simulated captures: samples encoded as the sensors' bytes, in frames bus by bus."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.errors import UsageError
from lacet.daq.formats.events import RunEvent
from lacet.daq.formats.log import LogWriter
from lacet.daq.formats.wire import StartRecord, StopRecord
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.drivers import open_driver
from lacet.simulate import CarMotion

BATCH_NS = 50_000_000
"""Duration of the batches of frames in a capture [ns], as a recorder's."""


def encode_rig(blocks: Mapping[str, Block], rig: Rig) -> tuple[dict[str, Frames], dict[str, str]]:
    """Encode blocks with the drivers of a rig.

    Returns
    -------
    frames : by bus, all sensors of a bus merged in the order of their stamps.
    documents : file name → text of the files that the drivers used (DBC).

    Raises
    ------
    UsageError : a sensor of the rig has no driver.
    """
    parts: dict[str, list[Frames]] = {}
    documents: dict[str, str] = {}
    for sensor in rig.sensors:
        if sensor.driver is None or sensor.bus is None:
            raise UsageError(
                f"rig {rig.name}: sensor {sensor.name} has no driver and bus, so it has no bytes to capture; "
                "give it both, or write tables: --format parquet"
            )
        driver = open_driver(sensor.driver, sensor.bus, sensor.options, rig.folder)
        parts.setdefault(sensor.bus, []).append(driver.encode({c: blocks[c] for c in sensor.channels if c in blocks}))
        documents |= driver.documents
    return {bus: merged(bus, frames) for bus, frames in parts.items()}, documents


def merged(source: str, parts: Iterable[Frames]) -> Frames:
    """Frames of several senders on one bus, in the order of their stamps; of equal stamps the first sender's first."""
    joined = Frames.concat(source, parts)
    order = np.argsort(joined.t_ns, kind="stable")
    lengths = joined.lengths[order]
    offset = np.concatenate(([0], np.cumsum(lengths))).astype(np.int64)
    take = np.arange(offset[-1]) + np.repeat(joined.offset[:-1][order] - offset[:-1], lengths)
    return Frames(source, joined.t_ns[order], joined.ident[order], offset, joined.data[take])


def simulated_start(name: str, motion: CarMotion, rig: Rig, vehicle_text: str, start_ns: int) -> StartRecord:
    """The start record of a simulated run, without the documents of the drivers."""
    when = datetime.fromtimestamp(start_ns / 1e9, UTC)
    return StartRecord(
        run_id=f"{when:%Y%m%dT%H%M%SZ}-{name}",
        started_ns=start_ns,
        vehicle_text=vehicle_text,
        rig_text=rig.text,
        vehicle=motion.car.name,
        manoeuvre=motion.manoeuvre,
        wheel_reference=rig.wheel_reference,
        brakes=motion.brakes,
        notes="simulated",
        software="lacet simulate",
    )


def write_capture(
    path: Path,
    frames: Mapping[str, Frames],
    start: StartRecord,
    overwrite: bool = False,
    events: Iterable[RunEvent] = (),
) -> None:
    """Write a capture: start record, raw frames in order of time, events, stop record.

    Raises RunError when it exists.
    """
    ends = [int(batch.t_ns[-1]) for batch in frames.values() if len(batch)]
    last = max(ends, default=start.started_ns)
    edges = np.arange(start.started_ns, last + BATCH_NS + 1, BATCH_NS)
    cuts = {bus: np.searchsorted(batch.t_ns, edges) for bus, batch in frames.items()}
    with LogWriter(path, start, overwrite=overwrite) as writer:
        for i in range(len(edges) - 1):
            for bus, batch in frames.items():
                writer.write_frames(batch[int(cuts[bus][i]) : int(cuts[bus][i + 1])])
        for event in events:
            writer.write_event(event)
        counts = {bus: len(batch) for bus, batch in frames.items()}
        writer.close(StopRecord(last, "stopped", counts))
