"""``lacet live``: the fit of the run that is being recorded, each second."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from lacet.daq.bus.certificates import Role
from lacet.daq.bus.credentials import check_endpoint
from lacet.daq.bus.listener import BusListener
from lacet.daq.bus.session import ROUTER, open_session
from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.services.acquisition.system_calls import is_unread, lower_priority
from lacet.services.commands.bus_options import add_keys, credentials_of, router_of
from lacet.services.render.live_fit import screen
from lacet.services.workspace.live_follow import TARGET, LiveFollower, model_of_study, nothing_known, over

AGAIN = 2.0
"""Time between attempts to reach the router [s]."""
LAST_WORDS = 2.0
"""Longest time that the recorder's last messages take after its router has gone [s]."""
IDLE = 2.0
"""Period of the lines of JSON while nothing is new [s]."""

HELP = "fit the run that is being recorded, each second: error by row, and which parameters are known well enough"
DESCRIPTION = """\
Fit the present model to the recording that is running, each second, over the bus: error ÷ noise floor of every row,
and of every parameter the 95 % interval, the sensor sheet included, beside the target, with the time still to drive.
Stop driving when what you want is enough; drive something else where more of the same never will be.

  lacet live                                         the recorder of this machine, base model
  lacet live STUDY                                   the present model of a study
  lacet live --add anti_roll_bar.front --target 5    one effect more; ± 5 % is enough
  lacet live --connect tls/10.0.0.7:7447 --keys keys/lab     a car over the network (lacet keys)
  lacet live --lines | jq .parameters                one line of JSON a second
  lacet identify run.mcap --to 42                    afterwards: the fit of the first 42 s

"12 s more" is the time until the interval is narrow enough if you go on driving as until now: noise falls with one
over the root of time, zeros, gains and latencies of the sensors do not. It listens to the bus as the workbench does, at
low priority, and cannot disturb the recording. A recording that began before it is caught up with. Ctrl-C ends it.
Docs: live.md.

Exit code 3: no recording was heard, or it could not be fitted."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="STUDY", nargs="?", type=Path, help="its present model (default: base model)")
    parser.add_argument("--add", metavar="EFFECT", action="append", default=[], help="an effect beyond that model")
    parser.add_argument(
        "--target", metavar="PERCENT", type=float, default=TARGET,
        help=f"half of the 95 %% interval ÷ value that is enough (default {TARGET:g})",
    )  # fmt: skip
    parser.add_argument("--connect", metavar="ENDPOINT", help=f"the recorder's router (default {ROUTER})")
    add_keys(parser, Role.WORKER)
    parser.add_argument("--once", action="store_true", help="end with the run that is recorded")
    parser.add_argument("--lines", action="store_true", help="write each second as one line of JSON, for programs")


def run(args: argparse.Namespace) -> int:
    """Follow recordings until Ctrl-C, or one with ``--once``."""
    if not 0.0 < args.target < 100.0:
        raise UsageError(f"--target {args.target:g}: a per cent between 0 and 100")
    credentials = credentials_of(args, Role.WORKER)
    endpoint = args.connect or router_of(credentials)
    check_endpoint(endpoint, credentials)
    model_of = model_of_study(args.study, tuple(args.add))
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    lower_priority()
    last: dict[str, Any] | None = None
    complained = False
    console = Console(stderr=args.json == "-", highlight=False, markup=False)
    with _Shown(console, args.lines) as shown:
        while not stop.is_set():
            shown.require_reader()
            try:
                session = open_session(connect=(endpoint,), wait=AGAIN, credentials=credentials)
            except UsageError as error:
                if not complained:
                    print(f"{error}; trying every {AGAIN:g} s", file=sys.stderr, flush=True)
                complained = True
                if args.lines:
                    shown.show(over(last) if last else nothing_known(args.target / 100.0, str(error)))
                stop.wait(AGAIN)
                continue
            follower = LiveFollower(BusListener(session), model_of, args.target / 100.0)
            try:
                while not stop.is_set() and session.info.routers_zid():
                    shown.require_reader()
                    found = follower.turn(0.05)
                    if found is not None:
                        last = found
                        shown.show(found)
                    elif args.lines and shown.silent > IDLE:
                        shown.show(follower.state())
                    if args.once and follower.over and found is None:
                        # Markers and losses that came after the last second was fitted belong to it.
                        last = follower.state()
                        break
                for found in _last_states(follower, stop):
                    last = found
                    shown.show(found)
            finally:
                session.close()
            if args.once and last is not None:
                break
    write_result(args.json, "live", last or {})
    return DONE if last is not None and last["seconds"] is not None else WITH_LOSSES


def _last_states(follower: LiveFollower, stop: Event) -> Iterator[dict[str, Any]]:
    """States until what a recorder said last has come, where its router has gone with it."""
    until = time.monotonic() + LAST_WORDS
    while not stop.is_set() and time.monotonic() < until:
        found = follower.turn(0.05)
        if found is not None:
            yield found
            until = time.monotonic() + LAST_WORDS
        elif follower.over:
            return


class _Shown:
    """What is shown: a screen in a terminal, one line a second elsewhere, or lines of JSON."""

    def __init__(self, console: Console, lines: bool):
        self._console, self._lines = console, lines
        self._live = None if lines or not console.is_terminal else Live(console=console, auto_refresh=False)
        self._shown = time.monotonic()

    @property
    def silent(self) -> float:
        """Time since something was shown [s]."""
        return time.monotonic() - self._shown

    def require_reader(self) -> None:
        """Raise BrokenPipeError when what is shown is read by nobody any more, before there is something to show."""
        try:
            descriptor = self._console.file.fileno()
        except (OSError, AttributeError):  # a stream in memory
            return
        if is_unread(descriptor):
            raise BrokenPipeError

    def show(self, found: dict[str, Any]) -> None:
        """Show the state of a second."""
        self._shown = time.monotonic()
        if self._lines:
            print(json.dumps(found, ensure_ascii=False), flush=True)
        elif self._live is not None:
            self._live.update(Text(screen(found)), refresh=True)
        else:
            print(found["line"], file=self._console.file, flush=True)

    def __enter__(self) -> _Shown:
        if self._live is not None:
            self._live.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.__exit__(None, None, None)
