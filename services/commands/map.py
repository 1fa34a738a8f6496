"""``lacet map``: propose a channel map for logs that other systems wrote."""

from __future__ import annotations

import argparse
import math
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.daq.maps.channel_map import load_reading, reading_text
from lacet.daq.maps.guess import ACCEPTED, guess, map_text
from lacet.daq.sources.open_source import opened
from lacet.daq.sources.source import Reading
from lacet.services.render import tables

HELP = "propose a channel map for a log that another system wrote"
DESCRIPTION = f"""\
List every name of a log with its unit, rate and range, and propose which channel it is, with a probability: from names
(several languages' usual words), units, and the car's behaviour (gravity, loads, turns).

  lacet map --guess lap.csv -o map.toml
  lacet map --guess lap.blf --dbc car.dbc -o map.toml
  lacet map --guess lap.csv lap_imu.csv -o map.toml     the logs of one drive, as lacet import takes them
  lacet import lap.csv --map map.toml -o lap.mcap

What is below {ACCEPTED} is written as a comment, unless it is accepted with --accept. Docs: own-log.md."""

_WIDEST = 60
"""Letters of an expression in the table."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "--guess", metavar="FILE", type=Path, nargs="+", required=True,
        help="logs of other systems of one drive, or the folder of a ROS 2 bag",
    )  # fmt: skip
    parser.add_argument("-o", "--output", metavar="MAP", type=Path, help="write the map proposed")
    parser.add_argument("--dbc", metavar="FILE", type=Path, action="append", default=[], help="a bus's file")
    parser.add_argument("--read", metavar="MAP", type=Path, help="a map, or its [read] alone: how the log is read")
    parser.add_argument("--accept", action="store_true", help=f"use proposals below {ACCEPTED}, too")
    parser.add_argument("--force", action="store_true", help="replace MAP if it exists")


def run(args: argparse.Namespace) -> int:
    """Print names and proposals; write the map."""
    if args.output is not None and args.output.exists() and not args.force:
        raise UsageError(f"{args.output} exists: give another name, or --force")
    for file in args.dbc:
        if not file.is_file():
            raise UsageError(f"--dbc {file}: no such file")
    reading = load_reading(args.read) if args.read else Reading()
    reading = replace(reading, dbc=(*reading.dbc, *args.dbc))
    with ExitStack() as stack:
        sources = [stack.enter_context(opened(file, reading)) for file in args.guess]
        found = guess(*sources)
        notes = [note for source in sources for note in source.notes]
    rows = [
        [one.name, one.unit or "–", f"{one.rate:.4g}", _number(one.low), _number(one.high), one.column,
         _short(one.expression) + (f" [{one.said_unit}]" if one.said_unit else ""),
         f"{one.probability:.2f}" if one.column else ""]
        for one in found
    ]  # fmt: skip
    print(tables.table(["name", "unit", "Hz", "from", "to", "channel", "as", "probability"], rows))
    for note in notes:
        print(f"! {note}")
    likely = sum(one.probability >= ACCEPTED for one in found)
    open_ = sum(0.0 < one.probability < ACCEPTED for one in found)
    below = "accepted" if args.accept else "comments in the map; --accept uses them"
    print(f"{len(found)} names: {likely} columns proposed at {ACCEPTED} or above, {open_} below ({below})")
    if args.output is not None:
        text = map_text(found, ", ".join(file.name for file in args.guess), args.accept)
        if read := reading_text(reading):
            text = text.replace("\n\n", f"\n\n{read}\n", 1)
        args.output.write_text(text, encoding="utf-8")
        print(f"map: {args.output}")
    result = [
        {"name": one.name, "unit": one.unit, "rate": one.rate, "low": one.low, "high": one.high, "column": one.column,
         "expression": one.expression, "said_unit": one.said_unit, "probability": one.probability}
        for one in found
    ]  # fmt: skip
    write_result(args.json, "map", {"files": args.guess, "names": result, "map": args.output, "notes": notes})
    return DONE


def _short(expression: str) -> str:
    """An expression as the table has it; the map and the result have all of it."""
    return expression if len(expression) <= _WIDEST else expression[: _WIDEST - 1] + "…"


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.4g}"
