"""``lacet identify``: fit a model to runs, without a study."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.parts import require
from lacet.identify.effects.catalogue import base_model, catalogue, find_effect
from lacet.identify.progress import Stage
from lacet.identify.properties.consistent_fit import consistency, consistent_fit
from lacet.identify.properties.derived import damper_curves
from lacet.identify.regression.instrumental_variables import fit_instruments, pairs_of
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import FitOptions, fit
from lacet.identify.validation.noise_floor import SCORE_DRAWS
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import Comparison, compare, fails, worst_row
from lacet.services.commands.limit_options import add_limits, limits_of
from lacet.services.commands.progress import Line
from lacet.services.progress import ServiceStage, ServiceStep, Stretch, planned
from lacet.services.render import tables
from lacet.services.render.consistency_report import consistency_text, left_open
from lacet.services.render.identifiability import not_derived_lines
from lacet.services.render.implausible_values import implausible_text
from lacet.services.render.known_beforehand import beforehand_table
from lacet.services.render.known_scale import weak_scale
from lacet.services.render.little_shown import little_shown_lines
from lacet.services.render.row_sources import assumptions_table, sources_table
from lacet.services.render.tyre_differences import difference_text
from lacet.services.timing.usual import stretch
from lacet.services.workspace.loading import default_filters, load
from lacet.services.workspace.report import write_pictures
from lacet.services.workspace.results import consistency_result, fit_result

HELP = "fit the base model to runs and print the parameters"
DESCRIPTION = """\
Fit the base model (rigid bodies, springs, dampers, static loads, tyres), and any effects added to it, to one run or to
several together, by weighted least squares. Prints the parameters, what an engineer derives from them (ride rates and
frequencies, roll stiffness, load transfer; docs/derived.md) with 95 % intervals, and the travel, speed and load that
the runs cover. Logs carry their rig and vehicle; exchange tables need them named.

  lacet identify run1.mcap run2.mcap
  lacet identify run1.mcap --pictures pictures
  lacet identify sine.parquet rough.parquet --rig rig.toml --vehicle vehicle.toml
  lacet identify run1.mcap --add anti_roll_bar.front --rows --json fit.json
  lacet identify run1.mcap --from "slalom begins" --to 42.5     # between markers (lacet mark) or seconds
  lacet identify run1.mcap --robust        # bad seconds count less, and are named
  lacet identify run1.mcap --consistent    # bodies that can exist, and what that costs (docs/consistency.md)

Exit code 3: done, but a run was damaged or left out, or nothing is identifiable."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("runs", metavar="RUN", nargs="+", type=Path, help="decoded log (.mcap), .parquet, .csv or .mf4")
    add_limits(parser)
    parser.add_argument("--map", metavar="FILE", type=Path, help="channel map of logs that other systems wrote")
    parser.add_argument("--rig", help="rig file, or the name of one shipped; default: the one in the run")
    parser.add_argument("--vehicle", help="vehicle file, or the name of one shipped; default: the one in the run")
    parser.add_argument("--add", metavar="EFFECT", action="append", default=[], help="an effect beyond the base model")
    parser.add_argument("--cutoff", metavar="HZ", type=float, help="cut-off of the fit (default 6 Hz)")
    parser.add_argument("--rows", action="store_true", help="also print the error of every row")
    parser.add_argument(
        "--pictures", metavar="FOLDER", type=Path,
        help="draw measurement, model and error, residual spectra and damper curves there",
    )  # fmt: skip
    parser.add_argument("--why", action="store_true", help="also print why parameters cannot be identified")
    parser.add_argument(
        "--robust", action="store_true", help="let seconds with a residual far beyond the usual count less"
    )
    parser.add_argument(
        "--instruments", action="store_true", help="no bias from noise, whatever its level: instrumental variables"
    )
    parser.add_argument(
        "--consistent", action="store_true", help="fit bodies that can exist (needs the extra 'consistency')"
    )


def _stretches(args: argparse.Namespace) -> list[Stretch]:
    """The plan of the command."""
    stages = [ServiceStage.READING_RUN, ServiceStage.FITTING, Stage.NOISE_CORRECTION]
    stages += [ServiceStage.INSTRUMENTS] * bool(args.instruments)
    stages += [ServiceStage.BODY_CONSISTENCY, ServiceStage.CONSISTENT_FIT] * bool(args.consistent)
    stages += [ServiceStage.COMPARING, *[ServiceStage.DRAWING_RUN] * bool(args.pictures)]
    return [stretch(stage, len(args.runs)) for stage in stages]


def run(args: argparse.Namespace) -> int:
    """Fit and print; 3 when a run was damaged or left out, or nothing is identifiable."""
    if args.pictures is not None:
        require("plots", "leave --pictures away")
    if args.consistent:
        require("consistency", "leave --consistent away")
    with Line("identify") as line:
        line.progress(planned(_stretches(args)))
        filters = default_filters(args.cutoff)
        loaded = load(
            args.runs, args.rig, args.vehicle, filters, line.progress, args.map, args.instruments, limits_of(args)
        )
        known = catalogue(loaded.vehicle, loaded.reference)
        model = Model.of([*base_model(loaded.vehicle, loaded.reference), *(find_effect(k, known) for k in args.add)])
        line.progress(ServiceStep(ServiceStage.FITTING))
        fitted = fit(model, loaded.prepared, FitOptions(robust=args.robust), progress=line.progress)
        if args.instruments:
            line.progress(ServiceStep(ServiceStage.INSTRUMENTS))
            fitted = fit_instruments(fitted, pairs_of(fitted, loaded.runs)).fit
        found = nearest = None
        if args.consistent:
            line.progress(ServiceStep(ServiceStage.BODY_CONSISTENCY))
            found = consistency(fitted)
            line.progress(ServiceStep(ServiceStage.CONSISTENT_FIT))
            nearest = consistent_fit(fitted)
            fitted = nearest.fit
        parts: list[Comparison] = []
        for done, drive in enumerate(fitted.runs):
            line.progress(ServiceStep(ServiceStage.COMPARING, done, len(fitted.runs), drive.name))
            parts.append(compare(fitted, drive, SCORE_DRAWS))
        knowledge = Knowledge.of(fitted)
        drawn = None if args.instruments else fitted.bootstrap()
        result = fit_result(fitted, loaded, parts, knowledge=knowledge, drawn=drawn)
        pictures: list[Path] = []
        if args.pictures is not None:
            # Only here: matplotlib takes half a second to load.
            from lacet.services.render.figures.validation_plots import comparison_pictures, damper_picture

            drawings: dict[str, bytes] = {}
            for done, part in enumerate(parts):
                line.progress(ServiceStep(ServiceStage.DRAWING_RUN, done, len(parts), part.name))
                drawings |= {f"{part.name}-{what}": png for what, png in comparison_pictures(part).items()}
            if (dampers := damper_picture(damper_curves(fitted, knowledge))) is not None:
                drawings["dampers"] = dampers
            pictures = write_pictures(drawings, args.pictures)
    if found and nearest:
        result["consistency"] = consistency_result(found, nearest)
    many = "s" if len(loaded.prepared) > 1 else ""
    print(f"{loaded.vehicle.name}, {len(loaded.prepared)} run{many}, {loaded.reference} wheel loads\n")
    print(tables.parameters(result))
    if known := beforehand_table(loaded.vehicle.apriori, result):
        print(f"\n{known.text}")
    if values := tables.derived(result):
        print(f"\n{values}")
    if lacking := not_derived_lines(result):
        print("\nDerived values not determined:", *lacking, sep="\n")
    if covered := tables.ranges(result):
        print(f"\n{covered}")
    print(f"\n{sources_table(result['row_sources'])}")
    if assumed := assumptions_table(result["row_sources"]):
        print(f"\n{assumed}")
        print("They are in the intervals with sheet. Give what you know better in [assumed] of the vehicle file.")
    if result["not_identifiable"]:
        names = ", ".join(item["name"] for item in result["not_identifiable"])
        print("\n" + tables.wrapped(f"Not identifiable with these runs (--why says why): {names}", 2))
        if args.why:
            print(tables.unknowns(result))
            print("\nWhat the runs leave open:\n" + "\n".join(f"  {line}" for line in left_open(fitted)))
    if not result["parameters"]:
        print("\nNothing is identifiable with these runs.")
    if found and nearest:
        print("\n" + consistency_text(found, nearest))
    where, ratio = worst_row(result["rows"]["used"])
    print(f"\nWorst row: {where}, {ratio:.2f} times its noise floor.")
    for line in (little := little_shown_lines(result)):
        print(f"! {line}")
    if fails(ratio) and (result["model_fails"] or not little):
        print("Values that stand on a failing row are off by more than their intervals say.")
        print("The model lacks something, or an instrument, a bench table or a length in the vehicle file is off.")
        print("To find it: lacet study new DIR --use RUN…, then lacet diagnose DIR.")
        print("Late instruments: lacet check RUN… --only latency.")
    if args.rows:
        print("\n" + tables.rows(result["rows"]["used"]))
    if result["bad_seconds"]:
        print("\n" + tables.bad_seconds(result))
    doubts = [implausible_text(result), weak_scale(result), difference_text(result)]
    for warning in (*loaded.said, *filter(None, doubts)):
        print(f"! {warning}")
    for file in pictures:
        print(f"picture: {file}")
    write_result(args.json, "identify", {**result, "pictures": pictures})
    return WITH_LOSSES if loaded.warnings or not result["parameters"] else DONE
