"""``lacet decode``: decode raw frames into blocks."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.services.commands.progress import Line
from lacet.services.progress import planned
from lacet.services.workspace.decode import decode_log, decoding_plan

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
    with Line("decode") as line:
        line.progress(planned(decoding_plan()))
        found = decode_log(args.raw, args.output, args.rig, args.dbc, line.progress)
    _report(found)
    write_result(args.json, "decode", found)
    return WITH_LOSSES if found["losses"] or found["absent"] or found["damage"] else DONE


def _report(found: dict[str, Any]) -> None:
    for line in found["damage"]:
        print(f"damaged: {line}")
    for source, causes in found["ledger"].items():
        rest = {cause: number for cause, number in causes.items() if number and cause != "received"}
        text = ", ".join(f"{number:,} {cause.replace('_', ' ')}" for cause, number in rest.items())
        print(f"{source}: {causes['received']:,} frames; {text or 'nothing decoded'}")
    for name in found["absent"]:
        print(f"{name}: no samples came")
    lost = sum(sum(causes.values()) for causes in found["losses"].values())
    samples = found["samples"]
    print(f"{found['log']}: {sum(samples.values()):,} samples of {len(samples)} channels, {lost:,} lost")
