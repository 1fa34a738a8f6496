"""``lacet import``: make a run of logs that other systems wrote."""

from __future__ import annotations

import argparse
import re
from collections.abc import Container
from dataclasses import replace
from pathlib import Path

from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.maps.channel_map import ChannelMap
from lacet.identify.signals.for_equations import stands_in_for
from lacet.services.commands.progress import Line
from lacet.services.progress import ServiceStage, planned
from lacet.services.render import tables
from lacet.services.timing.usual import stretch
from lacet.services.workspace.import_log import import_logs

HELP = "make a run of logs that other systems wrote, by a channel map"
DESCRIPTION = """\
Read logs of any acquisition system and write a run that every other command takes.

Read are: CSV and other text tables, Parquet, MDF (measured, and raw bus logs), MATLAB (5 and 7.3), TDMS, MCAP
(Protobuf, ROS 2, JSON), and bus logs with their DBC: candump, BLF, ASC, TRC. The map says which name is which channel;
lacet map --guess proposes one. Several files are one drive.

  lacet import lap.csv --map car.toml -o lap.mcap
  lacet import lap.blf lasers.tdms --map car.toml --dbc car.dbc -o lap.mcap

Docs: maps.md. Exit code 3: done, but a channel of the map was left out, or something had to be assumed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("files", metavar="FILE", nargs="+", type=Path, help="logs of one drive")
    parser.add_argument("--map", metavar="FILE", type=Path, required=True, help="channel map")
    where = "run to write (.mcap, or .parquet)"
    parser.add_argument("-o", "--output", metavar="RUN", type=Path, required=True, help=where)
    parser.add_argument(
        "--dbc", metavar="FILE", type=Path, action="append", default=[], help="describes a bus; again for more"
    )
    parser.add_argument("--rig", help="rig file stored with the run; default: the map's")
    parser.add_argument("--vehicle", help="vehicle file stored with the run; default: the map's")
    parser.add_argument("--force", action="store_true", help="replace RUN if it exists")


def run(args: argparse.Namespace) -> int:
    """Import and print what was made."""
    if args.output.exists() and (not args.force or any(args.output.samefile(f) for f in args.files if f.exists())):
        raise UsageError(f"{args.output} exists: give another name" + ("" if args.force else ", or --force"))
    map_ = with_dbc(ChannelMap.load(args.map), args.dbc)
    with Line("import") as line:
        line.progress(planned([stretch(ServiceStage.IMPORTING_LOG)]))
        found = import_logs(args.files, map_, args.output, args.rig, args.vehicle, line.progress)
    rows = [
        [name, CHANNELS[name].unit, f"{count:,}", f"{100.0 * found['usable'][name] / max(1, count):.1f} %", _use(name)]
        for name, count in found["samples"].items()
    ]  # fmt: skip
    print(tables.table(["channel", "unit", "samples", "usable", ""], rows))
    for note in found["notes"]:
        print(f"! {note}")
    print(f"{found['log']}: {len(rows)} channels, {found['duration']:.1f} s")
    if proposed := _proposed(args.map, found["samples"]):
        print(
            f"{proposed} proposals are comments in {args.map}: look at them, and remove the # of those that are right"
        )
    if absent := [key for key in ("vehicle", "rig") if not (getattr(args, key) or map_.metadata.get(key))]:
        print(f"To fit it, name its {' and '.join(absent)} file: in [run] of {args.map} (docs/own-log.md)")
    write_result(args.json, "import", found)
    return WITH_LOSSES if found["notes"] else DONE


def _use(channel: str) -> str:
    """What the equations do with a channel that is none of theirs; empty for theirs."""
    if not CHANNELS[channel].recorded_only:
        return ""
    stands_for = stands_in_for(channel)
    return f"in place of {', '.join(stands_for)}, where not measured" if stands_for else "no equation uses it"


def _proposed(file: Path, samples: Container[str]) -> int:
    """How many lines of a map are comments of `lacet map --guess` (doubtful proposals) for channels without samples."""
    lines = re.findall(r'^# "([\w.]+)" = ', file.read_text(encoding="utf-8"), re.MULTILINE)
    return sum(column in COLUMNS and COLUMNS[column][0].name not in samples for column in lines)


def with_dbc(map_: ChannelMap, files: list[Path]) -> ChannelMap:
    """The map with further files that describe buses. Raises UsageError for one that is not there."""
    for file in files:
        if not file.is_file():
            raise UsageError(f"--dbc {file}: no such file")
    return replace(map_, reading=replace(map_.reading, dbc=(*map_.reading.dbc, *files)))
