"""``lacet doctor``: is this computer ready, and what to do where it is not."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.rig import Rig
from lacet.services.acquisition.host_clock import synchronisation
from lacet.services.machine.computer import browser, clock, disk
from lacet.services.machine.finding import State
from lacet.services.machine.packages import packages, python, versions
from lacet.services.machine.wires import wires

HELP = "check whether this computer is ready (packages, CAN, serial ports, clock, disk, browser), and what to do"
DESCRIPTION = """\
Check this computer and print one line a check: ok; absent, which matters only for what its line says; or warning. What
to do stands after →. Nothing is changed and nothing is sent.

  lacet doctor                          before the first hour
  lacet doctor --rig rig.toml           the wires that a rig names must be there
  lacet doctor --logs /media/ssd        is there room for logs?

Exit code 3 with warnings."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "--rig", metavar="RIG", help="rig file, or the name of a shipped one, whose wires must be there"
    )
    parser.add_argument(
        "--logs", metavar="DIR", type=Path, default=Path(), help="folder where logs go (default: this one)"
    )


def run(args: argparse.Namespace) -> int:
    """Check and print; 3 with warnings."""
    buses = Rig.load(args.rig).buses if args.rig else {}
    found = [python(), *packages(), *wires(buses), clock(synchronisation()), disk(args.logs), browser()]
    width = max(len(one.name) for one in found)
    for one in found:
        print(f"{one.state:<8} {one.name:<{width}}  {one.says}")
        if one.remedy:
            print(f"{'':<8} {'':<{width}}  → {one.remedy}")
    warnings = sum(one.state is State.WARNING for one in found)
    if warnings:
        print(
            f"\n{warnings} warning{'s' if warnings > 1 else ''}. What is absent is needed only for what its line says."
        )
    else:
        print("\nReady. What is absent is needed only for what its line says.")
    write_result(
        args.json, "doctor", {"checks": [asdict(one) for one in found], "warnings": warnings, "packages": versions()}
    )
    return WITH_LOSSES if warnings else DONE
