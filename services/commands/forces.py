"""``lacet forces``: wheel forces of a run without dynamometers, from a study identified with them."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.parts import require
from lacet.identify.regression.wls import corrected_run
from lacet.identify.wheel_loads.known_car import Changes
from lacet.identify.wheel_loads.measured_forces import errors, has_loads
from lacet.identify.wheel_loads.observer import estimate_forces
from lacet.services.commands.progress import Line
from lacet.services.exports.files import replacing
from lacet.services.exports.tables import forces_table as forces_columns
from lacet.services.exports.tables import write_table
from lacet.services.progress import ServiceStage, ServiceStep
from lacet.services.render.forces_text import forces_table, not_determined
from lacet.services.workspace.forces import forces_result, read_run
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study

HELP = "estimate the wheel forces of a run without dynamometers, from a study identified with them"
DESCRIPTION = """\
Estimate the wheel forces of a run without dynamometers, of a car identified once with them: each with a 95 % band, up
to the fit's cut-off: vertical at each wheel, longitudinal of the car (by axle where a row separates them), lateral by
axle; never lateral left and right. Where the run does have dynamometers they are not used, and the error against them
is shown. Missing and doubtful channels are named; exit code 3 with doubtful ones. How, and what is assumed:
docs/forces.md.

  lacet forces STUDY run.mcap                          table, and a picture in STUDY/pictures
  lacet forces STUDY run.parquet -o forces.parquet     time histories; .csv the same
  lacet forces STUDY run.mcap --rig without.toml       another rig than the study's
  lacet forces STUDY run.mcap --mass -6 2              each wheel 6 kg lighter than in the study, ± 2 kg (1 σ)
  lacet forces STUDY run.mcap --rest 0 8               the car stands from 0 to 8 s: static offsets anew"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="STUDY", type=Path, help="the study's folder")
    parser.add_argument("run_file", metavar="RUN", type=Path, help="log or exchange table of a run of the same car")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="time histories as .csv or .parquet")
    parser.add_argument("--version", type=int, help="version of the model (default: the present one)")
    parser.add_argument("--rig", metavar="FILE", type=Path, help="rig of the run (default: the study's)")
    parser.add_argument("--map", metavar="MAP", type=Path, help="channel map of a log that another system wrote")
    parser.add_argument(
        "--mass", metavar=("KG", "SIGMA"), nargs=2, type=float, default=(0.0, 0.0),
        help="change of each wheel's mass since the study and its 1 σ, as when its dynamometer comes off",
    )  # fmt: skip
    parser.add_argument(
        "--rest", metavar=("FROM", "TO"), nargs=2, type=float, help="seconds in which the car stands: offsets anew"
    )
    parser.add_argument("--no-picture", action="store_true", help="print the table only")
    parser.add_argument("--force", action="store_true", help="replace FILE if it exists")


def run(args: argparse.Namespace) -> int:
    """Estimate and print."""
    if args.mass[1] < 0.0:
        raise UsageError(
            f"--mass {args.mass[0]:g} {args.mass[1]:g}: the second number is a standard deviation, not negative"
        )
    if args.rest and not args.rest[0] < args.rest[1]:
        raise UsageError(
            f"--rest {args.rest[0]:g} {args.rest[1]:g}: the car stands from the first to the second second"
        )
    if not args.no_picture:
        require("plots", "give --no-picture")
    study = Study.open(args.study)
    version = study.version(args.version)
    picture: Path | None = None
    with Line("forces") as line:
        session = Session(study.at(version), line.progress)
        with session.planned(("compared", version)):
            checked = read_run(study, args.run_file, args.rig, args.map)
            drive = checked.prepared
            first, last = (round(float(drive.recording.t[end]), 1) for end in (0, -1))  # as printed
            if args.rest and not first <= args.rest[0] < args.rest[1] <= last:
                raise UsageError(
                    f"--rest {args.rest[0]:g} {args.rest[1]:g}: {drive.name} is from {first:g} to {last:g} s"
                )
            car = session.values.known_car(version)
        line.progress(ServiceStep(ServiceStage.WHEEL_FORCES, subject=drive.name))
        estimated = estimate_forces(
            car, drive, Changes(args.mass[0], args.mass[1], (args.rest[0], args.rest[1]) if args.rest else None)
        )
        found = errors(estimated, corrected_run(drive, car.fitted)) if has_loads(drive) else {}
        if args.output:
            with replacing(args.output, args.force) as part:
                write_table(forces_columns(estimated, found), part)
        if not args.no_picture:
            # Only here: matplotlib takes half a second to load.
            from lacet.services.render.figures.force_plots import forces_picture

            picture = study.folder / "pictures" / f"{drive.name}-v{version.number}-forces.png"
            picture.parent.mkdir(parents=True, exist_ok=True)
            picture.write_bytes(forces_picture(estimated, found))
    about = f"{estimated.reference} loads, {len(estimated.rows)} rows joined"
    print(f"{drive.name}: wheel forces up to {estimated.cutoff:g} Hz, {about}")
    print(forces_table(estimated, found))
    if sentence := not_determined(estimated):
        print(sentence)
    for doubt in checked.doubts:
        print(f"! {doubt}")
    for name, file in (("table", args.output), ("picture", picture)):
        if file:
            print(f"{name}: {file}")
    files = {"output": args.output, "picture": picture, "warnings": checked.doubts}
    write_result(args.json, "forces", {"version": version.number, **forces_result(estimated, found), **files})
    return WITH_LOSSES if checked.doubts else DONE
