"""``lacet undo``: return to the version that a study's present one was made from."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.services.render import tables
from lacet.services.workspace.results import study_result
from lacet.services.workspace.study import Study

HELP = "go back to the version before"
DESCRIPTION = """\
Go back to the version of the model that the present one was made from. Nothing is deleted: lacet study DIR --version N
goes to any version.

  lacet undo DIR"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", type=Path, help="the study's folder")


def run(args: argparse.Namespace) -> int:
    """Return to it and print."""
    study = Study.open(args.study)
    if study.current <= 1:
        raise UsageError("the present version is the first: there is nothing to undo")
    study = study.go_to(study.version().parent)
    print(tables.history(study.versions()))
    print(f"  present version: {study.current}")
    write_result(args.json, "undo", study_result(study))
    return DONE
