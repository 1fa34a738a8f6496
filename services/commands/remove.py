"""``lacet remove``: remove an effect from a study's model and report the change of the error."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.formats.result import DONE, write_result
from lacet.services.commands.progress import Line
from lacet.services.render import tables
from lacet.services.render.verdicts import print_change
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study

HELP = "remove an effect from the model"
DESCRIPTION = """\
Remove an effect from the study's present model, fit again and print the error before and after. The study keeps every
version; lacet undo DIR goes back.

  lacet remove DIR coulomb.front"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", type=Path, help="the study's folder")
    parser.add_argument("effect", metavar="EFFECT", help="an effect that was added (lacet study DIR lists them)")


def run(args: argparse.Namespace) -> int:
    """Remove, fit, print."""
    study = Study.open(args.study)
    before = study.version()
    with Line("remove") as line:
        session = Session(study, line.progress)
        after = session.remove(args.effect)
        item = session.change(args.effect, before, after)
    print_change(item, "Removed")
    print(tables.history(session.study.versions()))
    write_result(args.json, "remove", {"version": after.number, **item})
    return DONE
