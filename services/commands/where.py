"""``lacet where``: analyse in which rows, when and on what states a model fails, and its explainable residual."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.formats.result import DONE, write_result
from lacet.daq.parts import require
from lacet.services.commands.progress import Line
from lacet.services.render.failure_text import explainable_table, failure_sentences, follows_table, phase_table
from lacet.services.workspace.failure import failure_result
from lacet.services.workspace.report import write_where
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study

HELP = "see where the model fails: rows, phases, states, and how much is left to explain"
DESCRIPTION = """\
Print which rows are above their noise floor, and in which phase of driving (found from the motion: braking, cornering,
rough road …); which measured states the error follows; and how much of it any smooth function of those states could
explain, tested on parts of the runs the function was not made from. When that is no more than chance, nothing is left
to find that these states can show. What depends on the past of the states and not on their present (a liquid, a mass
on a mount) is listed apart, as history. Phases and errors are of all runs, the rest of the runs used. See
docs/where.md.

  lacet where DIR                         the tables
  lacet where DIR --report where.html     with all pictures, in one file
  lacet where DIR --row suspension.fl     one row
  lacet where DIR --run sinus             one run's phases and errors
  lacet where DIR --version 1             an earlier model"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", type=Path, help="the study's folder")
    parser.add_argument("--row", default="", help="one row of the equations (lacet info --rows lists them)")
    parser.add_argument(
        "--run", dest="only_run", metavar="RUN", default="", help="one run, used or held out: its phases and errors"
    )
    parser.add_argument("--version", type=int, help="version of the model (default: the present one)")
    parser.add_argument("--report", metavar="FILE", type=Path, help="write all pictures as one HTML file")


def run(args: argparse.Namespace) -> int:
    """Analyse and print."""
    if args.report:
        require("plots", "leave --report away")
    study = Study.open(args.study)
    version = study.version(args.version)
    with Line("where") as line:
        session = Session(study, line.progress)
        drawn = [("present failure", version)] if args.report else []
        with session.planned(("where", version), *drawn):
            found = session.values.failure(version, args.row, args.only_run)
        if args.report:
            write_where(session, version, found, args.report, [args.row, args.only_run])
    print(f"{failure_sentences(found)}\n")
    print(f"Error ÷ noise floor by phase:\n{phase_table(found).text}\n")
    print(f"What the error follows (part of its squares in cross-validation):\n{follows_table(found).text}\n")
    print(f"Left to explain (history: beyond the present states):\n{explainable_table(found).text}")
    if args.report:
        print(f"\nreport: {args.report}")
    report = {"report": args.report} if args.report else {}
    write_result(args.json, "where", {**failure_result(version, found), **report})
    return DONE
