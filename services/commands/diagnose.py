"""``lacet diagnose``: which physical effect is missing."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.services.commands.progress import Line
from lacet.services.render import tables
from lacet.services.render.separation_report import add_arguments as add_next_arguments
from lacet.services.render.separation_report import hint, next_of, next_text
from lacet.services.workspace.session import LEAST_DRAWS, Work, diagnosis_result, overall
from lacet.services.workspace.study import Study

HELP = "find out which physical effect is missing"
DESCRIPTION = """\
Every effect of the catalogue, and every sensor fault, is tried on top of the study's present model and ranked by how
much of the error it takes away from parts of the runs it was not fitted to. It is proposed only when simulated runs
that lack nothing never look like that by chance. Each effect gets one answer: missing, not needed, or not testable
with these runs (undecided: judged again once the first is added). Held-out runs are not looked at.

  lacet diagnose DIR             rank once
  lacet diagnose DIR --auto      add the first, fit again, and so on until nothing is missing
  lacet diagnose DIR --why       the reason for every answer
  lacet diagnose DIR --next      which run tells the first from those it is tied with
  lacet diagnose DIR --next spring_cubic.front bump_stop.front
  lacet diagnose DIR --next chassis_torsion     which run would show what these cannot"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", type=Path, help="the study's folder")
    parser.add_argument("--auto", action="store_true", help="add effects until nothing is missing")
    parser.add_argument("--draws", type=int, help="noise-floor simulations (default: the study's)")
    parser.add_argument("--most", type=int, default=8, help="rows of the ranking printed (default 8)")
    parser.add_argument("--why", action="store_true", help="print the reason for every answer")
    add_next_arguments(parser)


MOST_EFFECTS = 10


def run(args: argparse.Namespace) -> int:
    """Rank, and with --auto add."""
    study = Study.open(args.study)
    if args.draws is not None:
        if args.draws < LEAST_DRAWS:
            raise UsageError(f"--draws {args.draws}: at least {LEAST_DRAWS} are needed to tell p = 0.05")
        study = study.with_draws(args.draws)
    added: list[dict[str, Any]] = []
    steps: list[dict[str, Any]] = []
    result: dict[str, Any] = {}
    with Line() as line:
        work = Work(study, line.progress)
        while True:
            diagnosis = work.diagnose()
            steps.append(diagnosis_result(diagnosis))
            print_diagnosis(steps[-1], args.most, args.why)
            if not args.auto or diagnosis.best is None or len(added) >= MOST_EFFECTS:
                break
            before = work.study.version()
            after = work.add(diagnosis.best.key, diagnosis.best.shape)
            added.append(fall(diagnosis.best.key, before.result["rows"], after.result["rows"]))
            print_fall(added[-1])
        following = next_of(args, work, diagnosis, line.progress)
    result = {**steps[-1], **following}
    if args.auto:
        print(tables.history(work.study.versions()))
    elif result["best"]:
        print(f"\nTo add it: lacet add {study.folder} {result['best']}")
    print(f"\n{next_text(result, args.most) or hint(diagnosis, study.folder)}".rstrip())
    write_result(args.json, "diagnose", {**result, "auto": args.auto, "added": added, "steps": steps})
    return DONE


def print_diagnosis(result: Mapping[str, Any], most: int, why: bool) -> None:
    """The verdict and the ranking."""
    print(f"{result['says']}\n\n{tables.candidates(result, most)}\n", flush=True)
    if why:
        for c in result["candidates"]:
            print(f"  {c['effect']}: {c['why']}")


def fall(key: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Error ÷ floor before and after an effect was added, on the runs used and held out."""
    return {
        "effect": key,
        "used": {"before": overall(before["used"]), "after": overall(after["used"])},
        "held": {"before": overall(before["held"]), "after": overall(after["held"])},
        "rows": {"before": before, "after": after},
    }


def print_fall(item: Mapping[str, Any], what: str = "Added") -> None:
    """One line: how far the error fell."""
    used, held = item["used"], item["held"]
    text = f"{what} {item['effect']}: error ÷ floor {used['before']:.2f} → {used['after']:.2f} on the runs used"
    if held["before"] == held["before"]:
        text += f", {held['before']:.2f} → {held['after']:.2f} on those held out"
    print(f"{text}.\n", flush=True)
