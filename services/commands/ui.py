"""``lacet ui``: serve the workbench for the browser."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from lacet.daq.bus.certificates import Role
from lacet.daq.bus.credentials import check_endpoint
from lacet.daq.bus.session import ROUTER
from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.daq.parts import require
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS, LEAST_DRAWS
from lacet.services.commands.bus_options import add_keys, credentials_of, router_of

HELP = "open the workbench: a local page to compare, add effects, and see the error fall"
DESCRIPTION = """\
Serve a page on this machine and print its address. On it runs are dropped in and chosen, the model is compared with
the measurement, what is missing is ranked, added, removed and undone, own effects are written, the next run is
recommended, and the report is exported. All state is in the study's folder: close the page, open it twice, or go on
with the other commands at any time.

  lacet ui                                  a new study in ./study, or the one that is there
  lacet ui DIR                              the study in DIR; a new one when there is none
  lacet ui DIR --open                       and open the browser
  lacet ui DIR --connect tls/10.0.0.7:7447 --keys keys/lab   the car live that another computer records (lacet keys)
  lacet ui DIR --host 0.0.0.0               for other machines

It listens on loopback only by default, and loads nothing from elsewhere. The address printed holds a token, without
which nothing is answered. Ctrl-C ends it.
Docs: workbench.md."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", nargs="?", type=Path, default=Path("study"), help="the study's folder")
    parser.add_argument("--port", type=int, default=8765, help="port (default 8765; 0 for any that is free)")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument(
        "--name", metavar="HOST", action="append", default=[], help="a further name the page is opened by (a proxy's)"
    )
    parser.add_argument(
        "--no-token", action="store_true", help="anyone on this machine may open the page (loopback only)"
    )
    parser.add_argument("--open", action="store_true", help="open the browser")
    parser.add_argument("--connect", metavar="ENDPOINT", help=f"the recorder's router (default {ROUTER})")
    add_keys(parser, Role.WORKER)
    parser.add_argument(
        "--most-upload", metavar="GB", type=float, default=4.0, help="largest file taken from the page (default 4 GB)"
    )
    parser.add_argument(
        "--draws",
        type=int,
        default=DEFAULT_DRAWS,
        help=f"noise-floor simulations of a study made here (default {DEFAULT_DRAWS})",
    )


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    if not 0 <= args.port <= 65535:
        raise UsageError(f"--port {args.port}: 0 to 65535")
    if not args.most_upload > 0.0:
        raise UsageError(f"--most-upload {args.most_upload:g}: above 0 GB")
    if args.draws < LEAST_DRAWS:
        raise UsageError(f"--draws {args.draws}: at least {LEAST_DRAWS} are needed to show p = 0.05")
    if args.study.exists() and not args.study.is_dir():
        raise UsageError(f"{args.study} is a file: name a folder")
    credentials = credentials_of(args, Role.WORKER)
    args.connect = args.connect or router_of(credentials)
    check_endpoint(args.connect, credentials)
    require("ui")
    # Imported here, so that the other commands start without it.
    server = importlib.import_module("lacet.services.workbench.server")
    server.serve(server.settings_of(args, credentials), args.open)
    write_result(args.json, "ui", {"folder": args.study})
    return DONE
