"""Options of the commands that use a part of a run: its limits."""

from __future__ import annotations

import argparse

from lacet.daq.run_limits import RunLimits


def add_limits(parser: argparse.ArgumentParser) -> None:
    """Declare ``--from`` and ``--to``."""
    what = "a marker's text (lacet mark), or seconds since the run's start"
    parser.add_argument("--from", dest="begin", metavar="MARK|S", default="", help=f"begin of the part used: {what}")
    parser.add_argument("--to", dest="end", metavar="MARK|S", default="", help="end of the part used, likewise")


def limits_of(args: argparse.Namespace) -> RunLimits:
    """The limits that the command line names."""
    return RunLimits(args.begin, args.end)
