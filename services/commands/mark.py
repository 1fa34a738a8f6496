"""``lacet mark``: set a marker in the recordings that are running."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.bus.certificates import Role
from lacet.daq.bus.credentials import Credentials, check_endpoint
from lacet.daq.bus.marks import set_mark
from lacet.daq.bus.session import open_session
from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.services.commands.bus_options import router_of

HELP = "set a marker in the recording that is running"
DESCRIPTION = """\
Set a marker, now, in the recording that is running: in lacet record of this machine, or of a car over the bus. It is
an event of the log (/lacet/events), and a limit of the run: lacet identify and lacet decode take --from and --to.

  lacet mark "slalom begins"                                  lacet record on this machine
  lacet mark                                                  without a text it gets a number: mark 1, mark 2 ...
  lacet mark "gravel" --connect tls/10.0.0.7:7447 --keys keys/lab     from another machine, with a worker's keys
  lacet identify run.mcap --from "slalom begins" --to "mark 2"

In the terminal of lacet record the Enter key does the same, with the text before it; so does the workbench's live page.

Exit code: 0 when a recording has it, otherwise 2."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("text", metavar="TEXT", nargs="?", default="", help="what is marked (default: a number)")
    parser.add_argument("--connect", metavar="ENDPOINT", help="the recorder's router (default: of this machine)")
    parser.add_argument(
        "--keys", metavar="DIR", type=Path, help="folder of the car's or a worker's keys, made by `lacet keys`"
    )


def run(args: argparse.Namespace) -> int:
    """Set the marker. Raises UsageError where no recording has it."""
    credentials = Credentials.load(args.keys) if args.keys else None
    endpoint = args.connect or router_of(credentials)
    check_endpoint(endpoint, credentials)
    session = open_session(connect=(endpoint,), wait=2.0, credentials=credentials)
    try:
        car = credentials.name if credentials is not None and credentials.role is Role.CAR else "*"
        found = set_mark(session, args.text, car)
    finally:
        session.close()
    if not found:
        raise UsageError(
            f"no recording is running at {endpoint}: start lacet record, or give its address with --connect. One "
            "without the bus takes markers in its own terminal only: the Enter key"
        )
    for one in found:
        print(f"run {one['run_id']}: '{one['text']}' at {one['seconds']:.1f} s")
    write_result(args.json, "mark", {"marks": found})
    return DONE
