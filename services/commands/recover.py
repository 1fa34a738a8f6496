"""``lacet recover``: write the complete records of a damaged log into a new one."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.formats.log_read import LogReader
from lacet.daq.formats.log_recover import counts_of, recover
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result

HELP = "copy what is readable of a damaged log into a new one"
DESCRIPTION = """\
Read a log that was cut off or damaged (a killed process, an empty battery, a bad disk), and write every whole record of
it into a new, finished log. The records are the same bytes; the new log remembers what the old one had lost, and the
old one is not touched.

lacet reads damaged logs as they are; other readers of MCAP need a finished file.

  lacet recover run.mcap -o whole.mcap

Exit code 3 when anything was lost."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("log", metavar="LOG", type=Path, help="damaged log or capture (.mcap)")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, required=True, help="log to write (.mcap)")
    parser.add_argument("--force", action="store_true", help="replace OUT if it exists")


def run(args: argparse.Namespace) -> int:
    """Recover one log."""
    damage = recover(args.log, args.output, overwrite=args.force)
    counts = counts_of(LogReader(args.output))
    for line in damage:
        print(f"lost: {line}")
    print(f"{args.output}: {sum(counts.values()):,} frames and samples of {len(counts)} buses and channels")
    write_result(args.json, "recover", {"log": args.output, "counts": counts, "damage": damage})
    return WITH_LOSSES if damage else DONE
