"""``lacet compare``: compare the model with the measurement, row by row."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.formats.result import DONE, write_result
from lacet.daq.parts import require
from lacet.identify.validation.score import worst_row
from lacet.services.commands.progress import Line
from lacet.services.render import tables
from lacet.services.render.forces_text import compared_table
from lacet.services.render.identifiability import rows_not_judged
from lacet.services.workspace.forces import compared_result
from lacet.services.workspace.report import write_pictures
from lacet.services.workspace.results import scores
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study

HELP = "compare the model with the measurement, row by row"
DESCRIPTION = """\
Compare every row of the equations, measured and modelled, on the runs used (direct validation) and on those held out
(cross validation): RMS error, NRMSE, VAF, the error in units of its noise floor, and whether the residual looks like
noise or has a colour of its own. A row marked ! fails. A row of a run held out marked ? cannot be judged, because the
runs used leave open a parameter it needs; the parameter is named, and the run that would find it. Of runs held out the
wheel forces are estimated as if there were no dynamometers, and compared with what these measured. Pictures go to
DIR/pictures.

  lacet compare DIR
  lacet compare DIR --version 1
  lacet compare DIR --no-pictures --json compare.json"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", type=Path, help="the study's folder")
    parser.add_argument("--version", type=int, help="version of the model (default: the present one)")
    parser.add_argument("--no-pictures", action="store_true", help="print the table only")


def run(args: argparse.Namespace) -> int:
    """Compare and print."""
    if not args.no_pictures:
        require("plots", "give --no-pictures")
    study = Study.open(args.study)
    version = study.version(args.version)
    pictures: list[Path] = []
    with Line("compare") as line:
        session = Session(study, line.progress)
        drawn = [] if args.no_pictures else [("pictures", version)]
        with session.planned(("compared", version), ("forces", version), *drawn):
            used = session.values.comparisons(version, held=False)
            held = session.values.comparisons(version, held=True)
            forces = session.values.forces(version)
            if drawn:
                pictures = write_pictures(session.values.pictures(version), study.folder / "pictures")
    not_judged = [line for part in held for line in rows_not_judged(part)]
    result = {
        "version": version.number, "effects": version.effects, "used": scores(used), "held": scores(held),
        "not_judged": not_judged, "wheel_forces": compared_result(forces),
    }  # fmt: skip
    for title, part in (("Runs used", result["used"]), ("Runs held out", result["held"])):
        if part:
            print(f"{title}:\n{tables.rows(part)}\n")
            where, ratio = worst_row(part)
            print(f"  farthest from its floor: {where}, {ratio:.2f} times\n")
    for sentence in not_judged:
        print(f"? {sentence}")
    if forces:
        print(
            f"Wheel forces without dynamometers, error ÷ floor and time in the 95 % band:\n{compared_table(forces)}\n"
        )
    for file in pictures:
        print(f"picture: {file}")
    write_result(args.json, "compare", {**result, "pictures": pictures})
    return DONE
