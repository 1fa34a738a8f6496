"""``lacet decode``: blocks from raw frames."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from daq.errors import RunError, UsageError, nearest
from daq.log import LogReader, LogWriter
from daq.rig import Rig
from services.decoding import Decoder, closing_record, decode_frames, write_decoded
from services.result import DONE, WITH_LOSSES, write_result

HELP = "rebuild the decoded channels of a log or capture from its raw frames"
DESCRIPTION = """\
Decode the raw frames of a log or capture with the drivers of its rig, and write a log that holds both.

The raw bytes are the truth: after mending a rig file, a DBC or a driver, decode again. The rig and the files it uses
are those recorded in the log, unless others are given. The same input gives the same bytes.

  lacet decode capture.mcap -o run.mcap
  lacet decode run.mcap -o again.mcap --rig mended.toml
  lacet decode run.mcap -o again.mcap --dbc mended/igel.dbc

Exit code 3 when samples were lost, a channel of the rig never came, or the input is damaged."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("raw", metavar="RAW", type=Path, help="log or capture with raw frames (.mcap)")
    parser.add_argument("-o", "--output", metavar="LOG", type=Path, required=True, help="log to write (.mcap)")
    parser.add_argument("--rig", metavar="FILE", help="rig file to use instead of the one recorded")
    parser.add_argument(
        "--dbc",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="file to use for the recorded one of its name",
    )
    parser.add_argument("--force", action="store_true", help="replace LOG if it exists")


def run(args: argparse.Namespace) -> int:
    """Decode one log."""
    if args.output.exists() and (not args.force or args.output.samefile(args.raw)):
        raise UsageError(f"{args.output} exists: give another name" + ("" if args.force else ", or --force"))
    reader = LogReader(args.raw)
    if not reader.sources():
        raise RunError(args.raw, ["no raw frames in it: there is nothing to decode"])
    decoder = open_decoder(reader, args.rig, args.dbc)
    part = args.output.with_name(args.output.name + ".part")
    try:
        with _progress() as progress:
            task = progress.add_task("read", total=1.0)
            frames = [reader.frames(source) for source in reader.sources()]
            progress.update(task, completed=0.2, description="decode")
            blocks = decode_frames(decoder, frames)
            progress.update(task, completed=0.4, description="write")
            axes = {name: sensor.axes for sensor in decoder.rig.sensors for name in sensor.channels}
            with LogWriter(part, _start(reader, decoder), axes=axes, overwrite=True) as writer:
                for fraction in write_decoded(writer, frames, blocks):
                    progress.update(task, completed=0.4 + 0.6 * fraction)
                last_ns = max((int(batch.t_ns.max()) for batch in frames if len(batch)), default=0)
                writer.close(closing_record(reader, decoder, last_ns))
        os.replace(part, args.output)
    finally:
        part.unlink(missing_ok=True)
    ledger, losses = decoder.ledger(), decoder.losses()
    absent = [name for name in decoder.channels if name not in blocks]
    _report(args, reader, {name: len(block) for name, block in blocks.items()}, ledger, losses, absent)
    return WITH_LOSSES if losses or absent or reader.damage else DONE


def open_decoder(reader: LogReader, rig_file: str | None, documents: list[Path]) -> Decoder:
    """The decoder for a log: its own rig and documents, unless others are given.

    Next to a rig file that is given, the files it names win over the recorded ones.

    Raises
    ------
    LacetError : no rig is known, or a file has faults, or fits nothing that the rig uses.
    """
    recorded = dict(reader.start.documents)
    if rig_file is not None:
        rig = Rig.load(rig_file)
        recorded = {k: text for k, text in recorded.items() if rig.folder is None or not (rig.folder / k).exists()}
    elif reader.start.rig_text:
        rig = Rig.parse(reader.start.rig_text, f"rig of {reader.path}")
    else:
        raise RunError(reader.path, ["no rig is recorded in it; give one with --rig FILE"])
    given = {path.name: _text(path) for path in documents}
    decoder = Decoder(rig, recorded | given)
    for name in given:
        if name not in decoder.documents:
            known = ", ".join(sorted(decoder.documents)) or "none"
            raise UsageError(f"--dbc: no driver uses '{name}'{nearest(name, decoder.documents)} (used: {known})")
    if not decoder.channels:
        raise RunError(rig_file or reader.path, ["no sensor of the rig has both a driver and a bus: nothing to decode"])
    return decoder


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--dbc {path}: {getattr(error, 'strerror', None) or 'not UTF-8 text'}") from error


def _start(reader: LogReader, decoder: Decoder):
    extra = dict(reader.start.extra)
    if reader.damage:
        extra["damage"] = "\n".join(reader.damage)
    documents = {**reader.start.documents, **decoder.documents}
    return replace(
        reader.start,
        rig_text=decoder.rig.text,
        wheel_reference=decoder.rig.wheel_reference,
        documents=documents,
        extra=extra,
    )


def _progress() -> Progress:
    return Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())


def _report(
    args: argparse.Namespace,
    reader: LogReader,
    samples: dict[str, int],
    ledger: dict[str, dict[str, int]],
    losses: dict[str, dict[str, int]],
    absent: list[str],
) -> None:
    for line in reader.damage:
        print(f"damaged: {line}")
    for source, causes in ledger.items():
        rest = {cause: number for cause, number in causes.items() if number and cause != "received"}
        text = ", ".join(f"{number:,} {cause.replace('_', ' ')}" for cause, number in rest.items())
        print(f"{source}: {causes['received']:,} frames; {text or 'nothing decoded'}")
    for name in absent:
        print(f"{name}: no samples came")
    lost = sum(sum(causes.values()) for causes in losses.values())
    print(f"{args.output}: {sum(samples.values()):,} samples of {len(samples)} channels, {lost:,} lost")
    write_result(
        args.json,
        "decode",
        {
            "log": args.output,
            "samples": samples,
            "ledger": ledger,
            "losses": losses,
            "absent": absent,
            "damage": list(reader.damage),
        },
    )
