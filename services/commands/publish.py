"""``lacet publish``: offer logs on the bus until a worker has them."""

from __future__ import annotations

import argparse
import contextlib
import math
import signal
from pathlib import Path
from threading import Event
from typing import Any

from lacet.daq.bus.certificates import Role
from lacet.daq.bus.credentials import check_endpoint
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import ROUTER
from lacet.daq.bus.spool import Spool
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.formats.run_files import first_files
from lacet.services.acquisition.delivery import note_delivery
from lacet.services.acquisition.offer import car_of, offer
from lacet.services.commands.bus_options import add_keys, credentials_of, link_of, router_of
from lacet.services.commands.progress import Line

HELP = "offer recorded logs on the bus until a worker has them"
DESCRIPTION = """\
Offer closed logs to workers, as the recorder did: for runs whose end no worker heard, because the link was cut or no
worker was there. A worker asks for the blocks that it lacks, in pieces, and goes on where a cut link ended; it has a
run when its own log is on the disk and all checksums are right.

  lacet publish run.mcap                                          to a worker on this machine
  lacet publish *.mcap --connect tls/10.0.0.9:7447 --keys keys/peugeot
  lacet publish run.mcap --ack-wait 60                            not for ever

Exit code: 0 when every run is at a worker, otherwise 3 (after Ctrl-C, or --ack-wait)."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("logs", metavar="LOG", nargs="+", type=Path, help="logs to offer (.mcap)")
    place = parser.add_mutually_exclusive_group()
    place.add_argument("--listen", metavar="ENDPOINT", help=f"be the router at (default {ROUTER})")
    place.add_argument("--connect", metavar="ENDPOINT", help="use the router at ENDPOINT")
    add_keys(parser, Role.CAR)
    parser.add_argument(
        "--ack-wait", metavar="S", type=float, default=math.inf, help="how long to wait for a request (for ever)"
    )


def run(args: argparse.Namespace) -> int:
    """Offer the logs. Returns 0 when each is at a worker, otherwise 3."""
    credentials = credentials_of(args, Role.CAR)
    check_endpoint(args.connect or args.listen or router_of(credentials), credentials)
    logs = [LogReader(path) for path in first_files(args.logs)]
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    runs: list[dict[str, Any]] = []
    with Line(period=0.5) as line, contextlib.ExitStack() as stack:
        link = link_of(args, credentials, line.notify)
        stack.callback(link.close)
        offered: list[tuple[LogReader, RunPublisher]] = []
        for log in logs:
            spool = Spool(log.path.absolute().parent)
            stack.callback(spool.close)
            car = car_of(log) if credentials is None else credentials.name
            publisher = offer(link.session, car, log, spool, line.notify)
            stack.callback(publisher.close)
            link.add(publisher)
            offered.append((log, publisher))
            line.notify(f"run {log.start.run_id}: offered as {publisher.keys.key()}")
        for log, publisher in offered:
            acks = publisher.wait_for_ack(args.ack_wait, stop.is_set)
            if acks:
                note_delivery(next(iter(log.files.values())), log.start.run_id, acks)
            for worker in acks:
                line.notify(f"run {log.start.run_id}: worker {worker} has it")
            if not acks:
                line.notify(f"run {log.start.run_id}: no worker has taken it")
            runs.append({"run_id": log.start.run_id, "log": log.path, "acknowledged": acks})
    write_result(args.json, "publish", {"runs": runs})
    return DONE if all(found["acknowledged"] for found in runs) else WITH_LOSSES
