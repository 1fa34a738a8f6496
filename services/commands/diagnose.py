"""``lacet diagnose``: rank the physical effects that may be missing."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.noise_floor import LEAST_DRAWS
from lacet.services.commands.progress import Line
from lacet.services.planning.separation import next_run, tied, untestable
from lacet.services.render import tables
from lacet.services.render.implausible_values import implausible_text
from lacet.services.render.known_scale import weak_scale
from lacet.services.render.little_shown import little_shown_lines
from lacet.services.render.rows import failing_in_one_run
from lacet.services.render.separation_report import hint, next_text
from lacet.services.render.verdicts import print_change, print_diagnosis, simple_laws
from lacet.services.workspace.results import diagnosis_result
from lacet.services.workspace.session import MOST_EFFECTS, Session
from lacet.services.workspace.study import Study

HELP = "find out which physical effect is missing"
DESCRIPTION = """\
Try every effect of the catalogue, and every sensor fault, on top of the study's present model, and rank them by how
much of the error it takes away from parts of the runs it was not fitted to. All that are missing are searched
together: one is named only when simulated runs that lack it hardly ever look like that. Each effect gets one answer:
missing, stands in for one that is, implausible size, smaller than asked for, not needed, or not testable with these
runs (undecided: it could be in the place of one found). What remains beside the names, and is not listed, is reported
with its rows. Held-out runs are not looked at.

  lacet diagnose DIR             rank once
  lacet diagnose DIR --auto      add all that is found, until nothing is missing
  lacet diagnose DIR --why       the reason for every answer
  lacet diagnose DIR --next      which run distinguishes the first from those it is tied with
  lacet diagnose DIR --next spring_cubic.front bump_stop.front
  lacet diagnose DIR --next chassis_torsion     which run would show what these cannot"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", type=Path, help="the study's folder")
    parser.add_argument("--auto", action="store_true", help="add effects until nothing is missing")
    parser.add_argument("--draws", type=int, help="noise-floor simulations (default: the study's)")
    parser.add_argument("--most", type=int, default=8, help="rows of the ranking printed (default 8)")
    parser.add_argument("--why", action="store_true", help="print the reason for every answer")
    parser.add_argument(
        "--next", metavar="EFFECT", nargs="*",
        help="which run to drive next: to tell apart the best candidate and those tied with it, or the effects named; "
        "of one effect named, to show it",
    )  # fmt: skip
    parser.add_argument(
        "--without", metavar="NAMES", default="", help="with --next: manoeuvres that cannot be driven, by commas"
    )


def run(args: argparse.Namespace) -> int:
    """Rank, and with --auto add."""
    study = Study.open(args.study)
    if args.draws is not None:
        if args.draws < LEAST_DRAWS:
            raise UsageError(f"--draws {args.draws}: at least {LEAST_DRAWS} are needed to show p = 0.05")
        study = study.with_draws(args.draws)
    steps: list[dict[str, Any]] = []
    with Line("diagnose") as line:
        session = Session(study, line.progress)

        def show(diagnosis: Diagnosis) -> None:
            steps.append(diagnosis_result(diagnosis))
            print_diagnosis(steps[-1], args.most, args.why)

        wanted = [("ranking", study.version()), ("next", study.version())]
        with contextlib.nullcontext() if args.auto or args.next is None else session.planned(*wanted):
            found = session.add_missing(MOST_EFFECTS if args.auto else 0, show, print_change)
            following = _next(args, session, found.last)
    result = {**steps[-1], **following}
    if session.runs.present[0]:  # a ranking that is kept needs no run
        for warning in session.runs.loaded.sheet:
            print(f"! {warning}")
    present = session.study.version().result
    explained = (*result["small_rows"], *result["unlisted_rows"])
    missed = "" if result["found"] else failing_in_one_run(present["rows"]["used"], explained)
    for doubt in (
        *little_shown_lines(present),
        *filter(None, (implausible_text(present), weak_scale(present), missed)),
    ):
        print(f"! {doubt}")
    if args.auto:
        print(tables.history(session.study.versions()))
    elif result["best"]:
        several = len(found.last.found) > 1
        print(f"\nTo add {'the first' if several else 'it'}: lacet add {study.folder} {result['best']}")
        if several:
            print(f"To add all: lacet diagnose {study.folder} --auto")
    print(f"\n{next_text(result, args.most) or _hint(found.last, study)}".rstrip())
    write_result(args.json, "diagnose", {**result, "auto": args.auto, "added": found.changes, "steps": steps})
    return DONE


def _next(args: argparse.Namespace, session: Session, diagnosis: Diagnosis) -> dict[str, Any]:
    """Entries of the result for ``--next``, ready to print; empty without that option."""
    if args.next is None:
        return {}
    without = [word.strip() for word in args.without.split(",") if word.strip()]
    return {"next": next_run(session, diagnosis, args.next, without)}


def _hint(diagnosis: Diagnosis, study: Study) -> str:
    many = bool(tied(diagnosis)), bool(untestable(diagnosis))
    return hint(*many, diagnosis.unlisted, simple_laws(diagnosis), study.folder)
