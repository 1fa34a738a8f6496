"""``lacet worker``: identify runs received over the network."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import socket
import sys
import time
from pathlib import Path
from threading import Event
from typing import Any

import zenoh

from lacet.daq.bus.certificates import Role
from lacet.daq.bus.credentials import Credentials, check_endpoint
from lacet.daq.bus.listener import BusListener
from lacet.daq.bus.session import ROUTER, open_session
from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.services.acquisition.folder_in_use import in_use
from lacet.services.acquisition.worker import DEADLINE, INCOMPLETE, PATIENCE, RESULT, Worker
from lacet.services.commands.bus_options import add_keys, credentials_of, router_of

HELP = "assemble runs from the bus and identify the car from them"
DESCRIPTION = f"""\
Listen for runs on the bus, anywhere the recorder's router can be reached. Nothing else is needed: rig, vehicle and
driver files come with the run. At its end the worker checks that it has every block, asks for those it missed, writes
the run as a local log, acknowledges it, fits the base model and writes and publishes the result.

  lacet worker                                     the recorder on this machine, runs go to the current folder
  lacet worker --connect tls/10.0.0.7:7447 --keys keys/lab --out runs     in the car: lacet record --listen (lacet keys)
  lacet worker --once                              end after one run; exit code 3 when the run is not complete

Files: RUN.mcap (decoded channels) and RUN{RESULT} for each run; RUN{INCOMPLETE} for one that lacks blocks."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--connect", metavar="ENDPOINT", help=f"the router (default {ROUTER})")
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path(), help="where files go (default: here)")
    parser.add_argument("--once", action="store_true", help="end after one run")
    parser.add_argument("--no-fit", action="store_true", help="assemble runs only, identify nothing")
    parser.add_argument("--name", help="this worker's name on the bus (default: host and process; with --keys, theirs)")
    add_keys(parser, Role.WORKER)
    parser.add_argument(
        "--patience",
        metavar="S",
        type=float,
        default=PATIENCE,
        help=f"silence after which a run whose recorder is gone is closed for now (default {PATIENCE:g} s)",
    )
    parser.add_argument(
        "--deadline",
        metavar="S",
        type=float,
        default=DEADLINE,
        help=f"how long to go on asking for missing blocks when none come (default {DEADLINE:g} s)",
    )
    parser.add_argument(
        "--wait",
        metavar="S",
        type=float,
        default=3600.0,
        help="how long to wait for the router, at first or when it is gone (default one hour)",
    )


def run(args: argparse.Namespace) -> int:
    """Work. Returns 0 when every run was complete, 3 when one was not or could not be processed."""
    credentials = credentials_of(args, Role.WORKER)
    router = args.connect or router_of(credentials)
    check_endpoint(router, credentials)
    name = args.name or f"{socket.gethostname()}-{os.getpid()}"
    if credentials is not None:
        if args.name not in (None, credentials.name):
            raise UsageError(f"--name {args.name}: with --keys it is that of the certificate, {credentials.name}")
        name = credentials.name
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with in_use(args.out, name):
        return _work(args, router, name, stop, credentials)


def _work(args: argparse.Namespace, router: str, name: str, stop: Event, credentials: Credentials | None) -> int:
    """Work until `stop` is set, in a folder of this worker's own; the exit code."""
    session = _connect(router, args.wait, stop, credentials)
    if session is None:
        return WITH_LOSSES
    try:
        listener = BusListener(session)
        worker = Worker(
            listener,
            args.out,
            name,
            (lambda path: {}) if args.no_fit else fit,
            patience=args.patience,
            deadline=args.deadline,
            unreachable=args.wait,
            notify=lambda text: print(text, file=sys.stderr, flush=True),
        )
        results = worker.run(stop, args.once)
        listener.close()
    finally:
        session.close()
    write_result(args.json, "worker", {"runs": [result.payload() for result in results]})
    good = all(result.complete and "error" not in result.work for result in results)
    return DONE if good and (results or not args.once) else WITH_LOSSES


def _connect(router: str, wait: float, stop: Event, credentials: Credentials | None) -> zenoh.Session | None:
    """The bus session, opened as soon as the router answers; None when stopped before."""
    until = time.monotonic() + wait
    warned = False
    while not stop.is_set():
        try:
            return open_session((), (router,), 1.0, credentials)  # not longer: signals are not handled meanwhile
        except UsageError:
            if time.monotonic() > until:
                raise
        if not warned:
            print(f"no router at {router} yet; trying for {wait:g} s", file=sys.stderr, flush=True)
            warned = True
        stop.wait(0.3)
    return None


def fit(path: Path) -> dict[str, Any]:
    """Fit of the base model to a run; imported on first use, so that the worker starts at once."""
    return importlib.import_module("lacet.services.workspace.session").fit_run(path)
