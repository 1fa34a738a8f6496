"""``lacet foxglove``: show the recording that is running in Foxglove or Lichtblick."""

from __future__ import annotations

import argparse
import importlib
import shutil
import signal
from pathlib import Path
from threading import Event

from lacet.daq.bus.certificates import Role
from lacet.daq.bus.credentials import check_endpoint
from lacet.daq.bus.listener import BusListener
from lacet.daq.bus.session import ROUTER, open_session
from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.daq.parts import from_part
from lacet.services.commands.bus_options import add_keys, credentials_of, router_of
from lacet.services.exports.live_viewer import LAYOUT, LiveViewer

HERE = "127.0.0.1:8765"
"""Address of the websocket server: this machine only, at the port that viewers propose."""
AGAIN = 2.0
"""Time between attempts to reach the router [s]."""

HELP = "show the recording that is running in Foxglove or Lichtblick"
DESCRIPTION = f"""\
Give the channels of the recording that is running to Foxglove or Lichtblick, over a websocket: open a connection
"Foxglove WebSocket" to ws://{HERE} there, and import the layout. It listens to the bus as the workbench does and
cannot disturb the recording. Needs the extra: pip install 'lacet[foxglove]'.

  lacet foxglove                                     the recorder of this machine
  lacet foxglove --layout lacet.json                 write the layout for the viewer, too
  lacet foxglove --connect tls/10.0.0.7:7447 --keys keys/lab
  lacet foxglove --listen 0.0.0.0:8765               viewers on other machines: whoever reaches it sees everything

Shown are 50 samples/s of each channel at most; the log has them all. Ctrl-C ends it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--connect", metavar="ENDPOINT", help=f"the recorder's router (default {ROUTER})")
    add_keys(parser, Role.WORKER)
    parser.add_argument("--listen", metavar="HOST:PORT", default=HERE, help=f"where viewers connect (default {HERE})")
    parser.add_argument("--layout", metavar="FILE", type=Path, help="write the layout there (.json)")


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    with from_part("foxglove"):
        sdk = importlib.import_module("foxglove")
    host, _, port = args.listen.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65_535:
        raise UsageError(f"--listen {args.listen}: write HOST:PORT, for example {HERE}")
    credentials = credentials_of(args, Role.WORKER)
    endpoint = args.connect or router_of(credentials)
    check_endpoint(endpoint, credentials)
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    if args.layout is not None:
        shutil.copyfile(LAYOUT, args.layout)
        print(f"layout: {args.layout}")
    viewer = LiveViewer(host, int(port), sdk)
    try:
        print(f"viewers connect to ws://{host}:{viewer.port}", flush=True)
        complained = False
        while not stop.is_set():
            try:
                session = open_session(connect=(endpoint,), wait=AGAIN, credentials=credentials)
            except UsageError as error:
                if not complained:
                    print(f"{error}; trying every {AGAIN:g} s", flush=True)
                complained = True
                stop.wait(AGAIN)
                continue
            try:
                listener = BusListener(session)
                while not stop.is_set():
                    message = listener.get(0.1)
                    if message is not None:
                        viewer.take(message)
                listener.close()
            finally:
                session.close()
    finally:
        viewer.close()
    write_result(args.json, "foxglove", {"port": viewer.port, "messages": viewer.messages})
    return DONE
