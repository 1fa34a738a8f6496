"""``lacet export``: export a log for general viewers."""

from __future__ import annotations

import argparse
import fnmatch
import os
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from google.protobuf.timestamp_pb2 import Timestamp
from rich.console import Console
from rich.progress import track

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import RunError, UsageError, nearest
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.mcap_write import McapWriter
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.schema import lacet_pb2 as pb

HELP = "write a log that general viewers can plot, one message a sample"
DESCRIPTION = """\
Write the decoded channels of a log as MCAP with one message a sample, for viewers that plot single numbers
(Foxglove, Lichtblick, PlotJuggler, Rerun): topic /wheel/fl/force, fields x, y, z; /laser/fl/hub, field value.
lacet's own logs store blocks of samples, which are 15 times smaller and faster.

  lacet export --rows run.mcap -o rows.mcap
  lacet export --rows run.mcap -o rows.mcap --channels 'wheel.*.force' imu.accel

Exit code 3 when the log is damaged: what is whole is exported."""

_ROWS_A_CHUNK = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("log", metavar="LOG", type=Path, help="log with decoded channels (.mcap)")
    parser.add_argument(
        "--rows", action="store_true", required=True, help="one message a sample (the only form so far)"
    )
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, required=True, help="file to write (.mcap)")
    parser.add_argument("--channels", metavar="NAME", nargs="+", default=["*"], help="channels, * stands for anything")
    parser.add_argument("--force", action="store_true", help="replace OUT if it exists")


def run(args: argparse.Namespace) -> int:
    """Export one log."""
    if args.output.exists() and (not args.force or args.output.samefile(args.log)):
        raise UsageError(f"{args.output} exists: give another name" + ("" if args.force else ", or --force"))
    reader = LogReader(args.log)
    if not reader.channels():
        raise RunError(args.log, ["raw frames only: run 'lacet decode' first"])
    blocks = reader.blocks(_chosen(reader, args.channels))
    part = args.output.with_name(args.output.name + ".part")
    try:
        write_rows(part, blocks)
        os.replace(part, args.output)
    finally:
        part.unlink(missing_ok=True)
    for line in reader.damage:
        print(f"damaged: {line}")
    samples = {name: len(block) for name, block in blocks.items()}
    print(f"{args.output}: {sum(samples.values()):,} samples of {len(samples)} channels")
    write_result(args.json, "export", {"output": args.output, "samples": samples, "damage": list(reader.damage)})
    return WITH_LOSSES if reader.damage else DONE


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


def _chosen(reader: LogReader, patterns: list[str]) -> list[str]:
    known = reader.channels()
    chosen = [name for name in known if any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)]
    for pattern in patterns:
        if not fnmatch.filter(known, pattern):
            raise UsageError(f"{reader.path}: no channel '{pattern}'{nearest(pattern, known)}; has {', '.join(known)}")
    return chosen
