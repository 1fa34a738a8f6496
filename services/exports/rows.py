"""A log's decoded channels with one message a sample, for viewers that plot single numbers."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from google.protobuf.timestamp_pb2 import Timestamp
from rich.console import Console
from rich.progress import track

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import RunError
from lacet.daq.formats.mcap_write import McapWriter
from lacet.daq.schema import lacet_pb2 as pb

_ROWS_A_CHUNK = 4096


def write_rows(path: Path, blocks: Mapping[str, Block]) -> None:
    """Write one `Sample` message a sample to a new MCAP file, in time order. Raises RunError when the disk fails."""
    names = list(blocks)
    if not names:
        return
    stamps = np.concatenate([blocks[name].t_ns for name in names])
    which = np.repeat(np.arange(len(names)), [len(blocks[name]) for name in names])
    index = np.concatenate([np.arange(len(blocks[name])) for name in names])
    order = np.argsort(stamps, kind="stable")
    rows = zip(stamps[order].tolist(), which[order].tolist(), index[order].tolist(), strict=True)
    columns = {name: [blocks[name].values.tolist(), blocks[name].flags.tolist()] for name in names}
    console = Console(stderr=True)
    try:
        writer = McapWriter(path, overwrite=True)
        try:
            shown = track(rows, "write", len(order), console=console, transient=True, disable=not sys.stderr.isatty())
            for number, (t_ns, k, i) in enumerate(shown):
                name = names[k]
                values, flags = columns[name]
                message = sample(name, t_ns, values[i], flags[i])
                topic = "/" + name.replace(".", "/")
                writer.message(topic, pb.Sample, message.SerializeToString(deterministic=True), max(0, t_ns), i)
                if number % _ROWS_A_CHUNK == _ROWS_A_CHUNK - 1:
                    writer.flush()
            writer.finish()
        finally:
            writer.abandon()
    except OSError as error:
        raise RunError(path, [f"cannot be written: {error.strerror}"]) from error


def sample(channel: str, t_ns: int, values: list[float], flags: int) -> pb.Sample:
    """The message of one sample for viewers."""
    about = CHANNELS[channel]
    seconds, nanos = divmod(t_ns, 10**9)
    message = pb.Sample(timestamp=Timestamp(seconds=seconds, nanos=nanos), flags=flags, unit=about.unit)
    for component, value in zip(about.components or ("value",), values, strict=True):
        setattr(message, component, value)
    return message
