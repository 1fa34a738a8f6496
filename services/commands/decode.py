"""``lacet decode``: decode raw frames into blocks."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.rig import Rig
from lacet.daq.sources.bus_log import KINDS, is_raw_log
from lacet.services.acquisition.other_logs import OPTION, capture_of
from lacet.services.acquisition.own_drivers import OPTION as TRUST
from lacet.services.acquisition.own_drivers import own_drivers
from lacet.services.commands.limit_options import add_limits, limits_of
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
  lacet decode run.mcap -o slalom.mcap --from "slalom begins" --to "slalom ends"     a part, for any other command

A bus log of another tool (candump, BLF, ASC, TRC, or an MDF bus log) is decoded by a rig, with the log's stamps:

  lacet decode drive.log -o run.mcap --rig rig.toml

Exit code 3 when samples were lost, a channel of the rig never came, or the input is damaged."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("raw", metavar="RAW", type=Path, help="log or capture with raw frames (.mcap), or a bus log")
    parser.add_argument("-o", "--output", metavar="LOG", type=Path, required=True, help="log to write (.mcap)")
    parser.add_argument("--rig", metavar="FILE", help="rig file to use instead of the one recorded")
    parser.add_argument(
        OPTION, metavar="LOGBUS=BUS", dest="buses", action="append", default=[],
        help="which bus of the rig a bus of the bus log is; may be repeated, others are not decoded",
    )  # fmt: skip
    parser.add_argument(
        "--dbc",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="file to use for the recorded one of its name",
    )
    add_limits(parser)
    parser.add_argument(TRUST, action="store_true", help="run the drivers of your own beside the rig file from now on")
    parser.add_argument("--force", action="store_true", help="replace LOG if it exists")


def run(args: argparse.Namespace) -> int:
    """Decode one log."""
    if args.output.exists() and (not args.force or args.output.samefile(args.raw)):
        raise UsageError(f"{args.output} exists: give another name" + ("" if args.force else ", or --force"))
    own = None if args.rig is None else own_drivers(Rig.load(args.rig), args.trust)
    with Line("decode") as line:
        line.progress(planned(decoding_plan()))
        with _capture(args) as raw:
            found = decode_log(raw, args.output, args.rig, args.dbc, line.progress, own, limits_of(args))
    _report(found)
    write_result(args.json, "decode", found)
    return WITH_LOSSES if found["losses"] or found["failures"] or found["absent"] or found["damage"] else DONE


@contextmanager
def _capture(args: argparse.Namespace) -> Iterator[Path]:
    """The capture to decode: the file itself, or what is made of a bus log and removed afterwards."""
    if not is_raw_log(args.raw):
        if args.buses:
            raise UsageError(
                f"{OPTION} {args.buses[0]}: is for bus logs ({KINDS}); a capture of lacet's knows its buses"
            )
        yield args.raw
        return
    if args.rig is None:
        raise UsageError(f"{args.raw}: a bus log says nothing of sensors; give the rig that describes them: --rig FILE")
    made = args.output.with_name(args.output.name + ".capture")
    made.parent.mkdir(parents=True, exist_ok=True)
    try:
        capture_of(args.raw, Rig.load(args.rig), made, args.buses)
        yield made
    finally:
        made.unlink(missing_ok=True)


def _report(found: dict[str, Any]) -> None:
    for line in found["damage"]:
        print(f"damaged: {line}")
    for source, causes in found["ledger"].items():
        rest = {cause: number for cause, number in causes.items() if number and cause != "received"}
        text = ", ".join(f"{number:,} {cause.replace('_', ' ')}" for cause, number in rest.items())
        print(f"{source}: {causes['received']:,} frames; {text or 'nothing decoded'}")
    for sensor, failure in found["failures"].items():
        print(f"sensor {sensor}: its driver failed and decoded nothing more: {failure}")
    for name in found["absent"]:
        print(f"{name}: no samples came")
    for line in found["notes"]:
        print(line)
    lost = sum(sum(causes.values()) for causes in found["losses"].values())
    samples = found["samples"]
    print(f"{found['log']}: {sum(samples.values()):,} samples of {len(samples)} channels, {lost:,} lost")
