"""``lacet keys``: certificates for cars, workers and routers, for a bus that nobody else can use."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from lacet.daq.bus.certificates import (
    DAYS,
    NAMES_FILE,
    Names,
    Role,
    check_name,
    make_authority,
    make_certificate,
)
from lacet.daq.bus.credentials import Credentials
from lacet.daq.bus.router_file import ROUTER_FILE, ROUTER_LISTEN, write_router
from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result

HELP = "make certificates for cars, workers and routers, so that nobody else can use the bus"
DESCRIPTION = f"""\
Make an authority of your own in DIR, on first use, and certify cars, workers and routers by name. Each gets a folder
DIR/NAME with its certificate, its key and everybody's names; copy it to its machine, and nothing else.

  lacet keys keys --car peugeot --worker lab              then, in the car and in the laboratory:
  lacet record ... --keys keys/peugeot --listen tls/0.0.0.0:7447
  lacet worker --keys keys/lab --connect tls/10.0.0.7:7447

  lacet keys keys --car clio --router depot     further names: copy the new {NAMES_FILE} to all the others, too
  lacet keys keys --remove clio                 it may do nothing more where the new {NAMES_FILE} is
  lacet keys keys --car peugeot                 a new certificate for the same name, before the old one expires
  lacet keys keys                               who is certified

A car writes under its own name only (keys lacet/NAME/…), only a worker acknowledges and gives results, under its own
name. A router is a zenohd in between: zenohd --config DIR/NAME/{ROUTER_FILE}. DIR/authority stays here; who has its key
can certify anybody. Names are not addresses: those may change."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of the authority and of everybody's keys")
    for role in Role:
        parser.add_argument(
            f"--{role}", metavar="NAME", action="append", default=[], help=f"certify a {role}; may be repeated"
        )
    parser.add_argument("--remove", metavar="NAME", action="append", default=[], help="strike a name off the lists")
    parser.add_argument("--days", metavar="N", type=float, default=DAYS, help=f"validity (default {DAYS} days)")
    listen = f"address of routers (default {ROUTER_LISTEN})"
    parser.add_argument("--router-listen", metavar="ENDPOINT", default=ROUTER_LISTEN, help=listen)


def run(args: argparse.Namespace) -> int:
    """Make what is asked for, and list everybody."""
    folder: Path = args.folder
    if args.days <= 0.0:
        raise UsageError(f"--days {args.days:g}: above 0")
    names = Names.read(folder / NAMES_FILE) if (folder / NAMES_FILE).exists() else Names({})
    new = {check_name(name): role for role in Role for name in getattr(args, str(role))}
    for name, role in new.items():
        if names.roles.get(name, role) is not role:
            raise UsageError(f"'{name}' is a {names.roles[name]} already: take another name, or --remove {name} first")
    if unknown := sorted(set(args.remove) - set(names.roles)):
        raise UsageError(f"--remove {unknown[0]}: not certified here ({', '.join(sorted(names.roles)) or 'nobody is'})")
    if not (names.roles or new):
        raise UsageError("nobody to certify: give --car NAME and --worker NAME")
    make_authority(folder)
    names = Names({name: role for name, role in (names.roles | new).items() if name not in args.remove})
    for name in new:
        make_certificate(folder, name, args.days)
    for name in args.remove:
        shutil.rmtree(folder / name, ignore_errors=True)
    names.write(folder / NAMES_FILE)
    for name, role in names.roles.items():
        if not (folder / name).is_dir():  # moved to its machine
            continue
        names.write(folder / name / NAMES_FILE)
        if role is Role.ROUTER:
            write_router(Credentials.load(folder / name), args.router_listen)
    for role in Role:
        for name in names.of(role):
            print(f"{role} {name}: {folder / name}{', made now' if name in new else ''}")
    if (new or args.remove) and set(names.roles) - set(new):
        print(f"Copy {folder / NAMES_FILE} (of a router: {ROUTER_FILE}) into the others' folders, too.")
    write_result(args.json, "keys", {"folder": folder, **{f"{role}s": names.of(role) for role in Role}})
    return DONE
