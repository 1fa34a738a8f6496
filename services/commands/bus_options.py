"""Options of the commands that use the bus: keys, and the router's address."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from lacet.daq.bus.certificates import Role
from lacet.daq.bus.credentials import Credentials
from lacet.daq.bus.link import Link
from lacet.daq.bus.session import ROUTER, SEALED_ROUTER


def add_keys(parser: argparse.ArgumentParser, role: Role) -> None:
    """Declare ``--keys``."""
    parser.add_argument(
        "--keys",
        metavar="DIR",
        type=Path,
        help=f"folder of a {role}'s keys, made by `lacet keys`: needed for every address beyond this machine",
    )


def credentials_of(args: argparse.Namespace, role: Role) -> Credentials | None:
    """The credentials that the command line names; None for none."""
    return Credentials.load(args.keys).require(role) if args.keys is not None else None


def router_of(credentials: Credentials | None) -> str:
    """The router's address where none is given: on this machine only."""
    return ROUTER if credentials is None else SEALED_ROUTER


def link_of(args: argparse.Namespace, credentials: Credentials | None, notify: Callable[[str], None]) -> Link:
    """The link to the bus that ``--listen`` and ``--connect`` name."""
    if args.connect:
        return Link(args.connect, False, credentials, notify)
    return Link(args.listen or router_of(credentials), True, credentials, notify)
