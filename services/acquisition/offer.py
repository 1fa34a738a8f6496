"""Offer of a closed log on the bus: the run is published again, whole, for workers that do not have it yet."""

from __future__ import annotations

from collections.abc import Callable

import zenoh

from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.spool import Spool
from lacet.daq.errors import LacetError, RunError
from lacet.daq.formats.array_messages import samples_in
from lacet.daq.formats.log import LogReader
from lacet.daq.rig import Rig
from lacet.daq.schema import lacet_pb2 as pb

UNNAMED = "car"
"""Name of the car of a log without a rig that can be read."""


def car_of(log: LogReader) -> str:
    """The car's name in keys without certificates: that of the rig."""
    try:
        return Rig.parse(log.start.rig_text, "rig of the run").name
    except LacetError:
        return UNNAMED


def keep_blocks(publisher: RunPublisher, log: LogReader, rest: Callable[[], None] = lambda: None) -> None:
    """Give a publisher the blocks of a log, to answer requests with; `rest` is called after each."""
    for channel, message in log.block_messages():
        publisher.keep_block(channel, message, samples_in(pb.DecodedBlock, message))
        rest()


def offer(
    session: zenoh.Session,
    car: str,
    log: LogReader,
    spool: Spool,
    notify: Callable[[str], None],
    rest: Callable[[], None] = lambda: None,
) -> RunPublisher:
    """A publisher of all blocks of a log, under the run's own name: nothing is sent until it is asked for.

    `rest` is called after each block that is read.

    Raises
    ------
    RunError : the log holds no decoded blocks, or others than its manifest names.
    """
    if not log.start.run_id:
        raise RunError(log.path, ["the start record is lost, and with it the run's name"])
    if not log.channels():
        raise RunError(log.path, ["no decoded channels: make them with `lacet decode`"])
    publisher = RunPublisher(session, car, log.start, spool, notify=notify)
    try:
        keep_blocks(publisher, log, rest)
        losses = log.manifest.losses if log.manifest is not None else {}
        sources = log.manifest.sources if log.manifest is not None else {}
        manifest = publisher.finish(losses, dict(sources))
        if log.manifest is not None and dict(log.manifest.channels) != dict(manifest.channels):
            raise RunError(log.path, ["its blocks are not those of its manifest: `lacet recover` says what is lost"])
    except BaseException:
        publisher.close()
        raise
    return publisher
