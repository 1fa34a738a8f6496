"""Recovery of a damaged log: its complete records in a new, finished one."""

from __future__ import annotations

import os
from collections import defaultdict
from pathlib import Path

from mcap.records import Message

from lacet.daq.blocks import Block
from lacet.daq.errors import UsageError
from lacet.daq.formats.log_read import LogReader
from lacet.daq.formats.mcap_write import McapWriter
from lacet.daq.formats.wire import StopRecord, start_to_bytes, stop_to_bytes
from lacet.daq.schema import lacet_pb2 as pb
from lacet.daq.topics import META_RECOVERED, META_START, META_STOP, START, STOP


def recover(path: str | os.PathLike[str], out: str | os.PathLike[str], *, overwrite: bool = False) -> list[str]:
    """Write every complete record of a damaged log into a new, finished one, and return the losses.

    The messages are the same bytes; a missing stop record is reconstructed; the new log's `damage` repeats that of the
    old one.

    Raises
    ------
    RunError : nothing can be read from `path`.
    UsageError : `out` is `path`, or exists and is not to be overwritten.
    """
    target = Path(out)
    if target.exists() and (not overwrite or target.samefile(path)):
        raise UsageError(f"{target} exists: give another name")
    reader = LogReader(path)
    scan = reader._scan
    for _ in reader.messages():  # detects complete records that cannot be used
        pass
    writer = McapWriter(target, overwrite)
    try:
        writer.metadata(META_START, scan.metadata.get(META_START, {"run_id": reader.start.run_id}))
        if START not in reader._topics:
            writer.message(START, pb.StartRecord, start_to_bytes(reader.start), max(0, reader.start.started_ns), 0)
        segment = 0
        for m in scan.messages():
            if m.segment != segment:  # chunks keep their boundaries
                writer.flush()
                segment = m.segment
            channel = scan.channels[m.channel]
            message = Message(m.channel, m.log_ns, m.data, m.publish_ns, m.sequence)
            writer.copy(channel, scan.schemas.get(channel.schema_id), message)
        stop = reader.stop
        if stop is None:
            last = max((held.last_ns for held in scan.contents.values()), default=0)
            stop = StopRecord(last, "recovered: the recording was not closed", counts_of(reader))
            writer.message(STOP, pb.StopRecord, stop_to_bytes(stop), last, 0)
        writer.metadata(META_STOP, {"stopped_ns": str(stop.stopped_ns), "reason": stop.reason})
        if reader.damage:
            lines = {f"{i:03}": line for i, line in enumerate(reader.damage)}
            writer.metadata(META_RECOVERED, lines)
        writer.finish()
    finally:
        writer.abandon()
    return list(reader.damage)


def counts_of(reader: LogReader) -> dict[str, int]:
    """Frames by source and samples by channel that are in a log, whatever its stop record says."""
    counts: dict[str, int] = defaultdict(int)
    for _, item in reader.messages():
        counts[item.channel if isinstance(item, Block) else item.source] += len(item)
    return dict(counts)
