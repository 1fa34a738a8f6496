"""``lacet study``: create a study, or show the fall of its error."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from lacet.daq.errors import LacetError, UsageError
from lacet.daq.formats.open_run import open_run
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.formats.run_files import first_files
from lacet.daq.parts import require
from lacet.daq.sources.open_source import is_bag
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS, LEAST_DRAWS
from lacet.services.cache.store import FOLDER, Store
from lacet.services.commands.progress import Line
from lacet.services.render import tables
from lacet.services.render.implausible_values import implausible_text
from lacet.services.render.known_scale import weak_scale
from lacet.services.render.little_shown import little_shown_lines
from lacet.services.workspace.import_log import imported
from lacet.services.workspace.loading import default_filters, find_rig, find_vehicle
from lacet.services.workspace.report import write_report
from lacet.services.workspace.results import study_result
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study

HELP = "make a study of runs, and see how the error fell by version"
DESCRIPTION = """\
A study is a folder of text files: the runs used and held out, every version of the model, its fit and its errors.

  lacet study new DIR --use sinus.mcap rough.mcap --hold braking.mcap      make one and fit the base model
  lacet study DIR                                                          how the error fell, version by version
  lacet study DIR --report report.html                                     the same with pictures, in one file
  lacet study DIR --report report.md                                       its first page and tables in Markdown
  lacet study DIR --version 2                                              go to any version
  lacet study DIR --clear-cache                                            remove what was computed, versions apart"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("new", metavar="new", nargs="?", help="make the study")
    parser.add_argument("folder", metavar="DIR", help="its folder")
    parser.add_argument(
        "--use", metavar="RUN", nargs="+", action="extend", type=Path, default=[], help="runs to identify with"
    )
    parser.add_argument(
        "--hold", metavar="RUN", nargs="+", action="extend", type=Path, default=[], help="runs held out"
    )
    parser.add_argument(
        "--map", metavar="FILE", type=Path, help="channel map of logs that other systems wrote: they are imported first"
    )
    parser.add_argument("--rig", help="rig file; default: the one in the first run's log")
    parser.add_argument("--vehicle", help="vehicle file; default: the one in the first run's log")
    parser.add_argument(
        "--draws",
        type=int,
        default=DEFAULT_DRAWS,
        help=f"noise-floor simulations of a diagnosis (default {DEFAULT_DRAWS})",
    )
    parser.add_argument("--cutoff", metavar="HZ", type=float, help="cut-off of the fit (default 6 Hz)")
    parser.add_argument(
        "--report", metavar="FILE", type=Path, help="write a report: one HTML file, or Markdown (.md) with a picture"
    )
    parser.add_argument("--version", type=int, help="go to a version")
    parser.add_argument(
        "--clear-cache", action="store_true", help="remove the values computed for the study (they are made anew)"
    )


def run(args: argparse.Namespace) -> int:
    """Create or show a study."""
    if args.report:
        require("plots", "leave --report away")
    new, folder = _words(args.new, args.folder)
    if new:
        study, warnings = _new(args, folder)
    else:
        warnings = ()
        if args.use or args.hold:
            raise UsageError(f"--use and --hold go with a new study: lacet study new {folder} --use RUN…")
        study = Study.open(folder)
        if args.version is not None:
            study = study.go_to(args.version)
        if args.clear_cache:
            print(f"{Store(study.folder).clear()} files removed from {study.folder / FOLDER}")
    versions = study.versions()
    if not versions:
        raise UsageError(f"{folder} has no version: its making was broken off; remove it and make it again")
    print(tables.history(versions))
    if len(versions) > 1:
        print(f"\n{tables.fall_by_row(versions)}")
    print(f"  present version: {study.current}")
    result = study.version().result
    for doubt in (*little_shown_lines(result), *filter(None, (implausible_text(result), weak_scale(result)))):
        print(f"! {doubt}")
    if args.report:
        with Line("study") as line:
            write_report(Session(study, line.progress), args.report)
        print(f"report: {args.report}")
    write_result(args.json, "study", {**study_result(study), "warnings": list(warnings)})
    return WITH_LOSSES if warnings else DONE


def _words(new: str | None, folder: str) -> tuple[bool, Path]:
    if new not in (None, "new") or (new is None and folder == "new"):
        raise UsageError("give one folder: lacet study DIR, or lacet study new DIR --use RUN…")
    return new is not None, Path(folder)


def _new(args: argparse.Namespace, folder: Path) -> tuple[Study, tuple[str, ...]]:
    if not args.use:
        raise UsageError(f"name the runs to identify with: lacet study new {folder} --use RUN…")
    if args.draws < LEAST_DRAWS:
        raise UsageError(f"--draws {args.draws}: at least {LEAST_DRAWS} are needed to show p = 0.05")
    for path in (*args.use, *args.hold):
        if not path.is_file() and not is_bag(path):
            raise UsageError(f"{path}: no such file")
    filters = default_filters(args.cutoff)
    there = folder.exists()
    try:
        with Line("import") as line:
            use, hold = (
                imported(first_files(runs), args.map, folder / "runs", line.progress) for runs in (args.use, args.hold)
            )
        first = open_run(use[0])
        study = Study.create(
            folder, use, hold, find_rig(first, args.rig), find_vehicle(first, args.vehicle), filters, args.draws
        )
        del first  # The session reads it again; the channels of a long run are not held twice.
        with Line("study") as line:
            session = Session(study, line.progress)
            session.record({}, "base model")
    except LacetError:
        if not there:  # an incomplete study would prevent the next attempt
            shutil.rmtree(folder, ignore_errors=True)
        raise
    for warning in session.runs.loaded.said:
        print(f"! {warning}")
    return session.study, session.runs.loaded.warnings
