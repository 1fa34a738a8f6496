"""``lacet campaign``: fit a model to many runs, each a task, on one machine or on several."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.regression.sensor_offsets import PayloadSpread
from lacet.identify.regression.sums.linear_fit import FitOptions
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS, LEAST_DRAWS
from lacet.identify.validation.score import fails, worst_row
from lacet.services.campaign.cluster import Cluster, connected
from lacet.services.campaign.fitting import Campaign, fit_campaign
from lacet.services.campaign.ranking import DiagnosedFit, diagnosed
from lacet.services.campaign.results import campaign_result
from lacet.services.campaign.run_reference import Settings
from lacet.services.commands.progress import Line
from lacet.services.progress import ServiceStage, ServiceStep, Stretch, planned
from lacet.services.render import tables
from lacet.services.render.verdicts import print_diagnosis
from lacet.services.workspace.import_log import imported
from lacet.services.workspace.loading import default_filters
from lacet.services.workspace.session import MOST_EFFECTS

HELP = "fit a model to many runs, on one machine or several"
DESCRIPTION = """\
Fit the base model, and any effects added to it, to many runs together (docs/campaign.md). Each run is a task of its
own that gives sums; the sums are merged in a fixed order, so that the result has the same bits on any number of
workers. A run that cannot be used is named and left out; runs of a worker that dies are done again; a campaign that
was interrupted goes on where it was, from the sums in its folder. Needs the extra: pip install 'lacet[campaign]'.

  lacet campaign runs/*.mcap                                  a local cluster, one worker for each processor
  lacet campaign runs/*.mcap --workers 4 --keep sums
  lacet campaign --list runs.txt --scheduler tcp://host:8786  the same on a Dask cluster elsewhere
  lacet campaign *.parquet --rig rig.toml --vehicle vehicle.toml --add anti_roll_bar.front
  lacet campaign laps/*.csv --map car.toml --keep sums        logs of another system
  lacet campaign runs/*.mcap --diagnose                       and which physical effect is missing
  lacet campaign runs/*.mcap --auto                           add the first, fit again, until nothing is missing

Exit code 3: done, but a run was damaged or left out, or nothing is identifiable."""


_PASSES = {
    "reading": 0.6, "what the parameters group into": 0.7, "sensitivities and equations": 0.7,
    "noise in the regressors": 1.3, "spread of the scores": 0.7, "noise floor and scores": 1.4,
}  # fmt: skip
"""Passes over the runs of a fit without sensor faults, and the usual time of each for a run [s]."""
_PRODUCTS, _TESTS, _NOISE = ("products of columns", 1.4), ("tests of candidates", 1.4), ("noise in the columns", 2.5)
_RANKING = (
    ("noise floor of the ranking", 0.8), _PRODUCTS, _PRODUCTS, _NOISE, _TESTS, _TESTS, _PRODUCTS, _TESTS, _PRODUCTS,
    _TESTS, _NOISE,
)  # fmt: skip
"""Passes of a ranking in which something is found missing; a pass more for each constant that is refined."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("runs", metavar="RUN", nargs="*", help="paths as the workers see them, or addresses (s3://…)")
    parser.add_argument("--list", metavar="FILE", type=Path, help="further runs, one a line")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler (tcp://host:8786); default: local")
    parser.add_argument("--workers", metavar="N", type=int, help="local workers (default: one for each processor)")
    parser.add_argument("--keep", metavar="FOLDER", type=Path, help="keep each run's sums there, to go on another time")
    parser.add_argument(
        "--map", metavar="FILE", type=Path,
        help="channel map of logs that other systems wrote: they are imported here first, into FOLDER/runs of --keep",
    )  # fmt: skip
    parser.add_argument("--rig", help="rig file, or the name of one shipped; default: the one in each run")
    parser.add_argument("--vehicle", help="vehicle file, or the name of one shipped; default: that of the first run")
    parser.add_argument("--add", metavar="EFFECT", action="append", default=[], help="an effect beyond the base model")
    parser.add_argument("--cutoff", metavar="HZ", type=float, help="cut-off of the fit (default 6 Hz)")
    parser.add_argument(
        "--robust", action="store_true", help="let seconds with a residual far beyond the usual count less"
    )
    parser.add_argument(
        "--payload", metavar="KG", type=float,
        help="each run has a payload of its own, so much (1 σ) from that of the others",
    )  # fmt: skip
    parser.add_argument("--most", metavar="N", type=int, default=10, help="worst runs printed (default 10)")
    parser.add_argument("--diagnose", action="store_true", help="find out which physical effect is missing")
    parser.add_argument("--auto", action="store_true", help="the same, and add effects until nothing is missing")
    parser.add_argument(
        "--draws", type=int, default=DEFAULT_DRAWS,
        help=f"with --diagnose: noise-floor simulations (default {DEFAULT_DRAWS})",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Fit and print; 3 when a run was damaged or left out, or nothing is identifiable."""
    if args.scheduler and args.workers is not None:
        raise UsageError("--workers is for a local cluster: the scheduler has workers of its own")
    if args.workers is not None and args.workers < 1:
        raise UsageError(f"--workers {args.workers}: at least one")
    if args.payload is not None and not args.payload > 0.0:
        raise UsageError(f"--payload {args.payload:g}: a mass above 0 kg")
    if args.draws < LEAST_DRAWS:
        raise UsageError(f"--draws {args.draws}: at least {LEAST_DRAWS} are needed to show p = 0.05")
    payload = None if args.payload is None else PayloadSpread(args.payload)
    places = [*args.runs, *_listed(args.list)]
    imports = _place_of_imports(args, places)
    settings = Settings(
        rig=Rig.load(args.rig).text if args.rig else "",
        vehicle=Vehicle.load(args.vehicle).text if args.vehicle else "",
        filters=default_filters(args.cutoff),
        effects=tuple(args.add),
        payload=payload,
        store=str(args.keep.resolve()) if args.keep else "",
    )
    with Line("campaign") as line, imports as folder:
        if folder is not None:
            places = [
                str(run) for run in imported([Path(place) for place in places], args.map, Path(folder), line.progress)
            ]
        if not args.scheduler:
            places = [place if "://" in place else str(Path(place).resolve()) for place in places]
        line.show("starting the workers")
        with connected(args.scheduler, args.workers) as client:
            line.notify(f"dashboard: {client.dashboard_link}")
            ranking = _RANKING if args.diagnose or args.auto else ()
            line.progress(_plan([*_PASSES.items(), *ranking], len(places)))
            cluster = Cluster(client, line.progress)
            campaign = Campaign.of(cluster, places, settings)
            options = FitOptions(robust=args.robust, payload=payload)
            found = fit_campaign(cluster, campaign, options)
            most = MOST_EFFECTS if args.auto else 0
            steps: list[DiagnosedFit] = []
            for step in diagnosed(cluster, found, options, most, args.draws) if ranking else ():
                steps.append(step)
                line.progress(_plan([*list(_PASSES.items())[1:], *ranking], len(places)))
    if steps:
        found = steps[-1].found
    result = campaign_result(found, cluster, steps)
    _print(result, args.most)
    if payload is not None and (note := payload_note(result)):
        print(f"! {note}")
    for step in result["diagnose"]["steps"] if steps else []:
        print()
        print_diagnosis(step, args.most, False)
    if result["added"]:
        print(f"\nAdded: {', '.join(result['added'])}. The parameters above are those of the model with them.")
    write_result(args.json, "campaign", result)
    return WITH_LOSSES if result["warnings"] or not result["parameters"] else DONE


def _place_of_imports(args: argparse.Namespace, places: Sequence[str]) -> AbstractContextManager[str | Path | None]:
    """The folder that runs are imported into by a map, of this campaign alone without --keep; None without a map."""
    if args.map is None:
        return nullcontext(None)
    if elsewhere := [place for place in places if "://" in place]:
        raise UsageError(
            f"{elsewhere[0]}: --map imports files of this machine; give a path, or import it: lacet import"
        )
    if args.keep is not None:
        return nullcontext(args.keep / "runs")
    if args.scheduler:
        raise UsageError(
            "--map with --scheduler: say where the imported runs go, a folder that its workers see: --keep FOLDER"
        )
    return TemporaryDirectory(prefix="lacet-campaign-")


def _plan(passes: Sequence[tuple[str, float]], runs: int) -> ServiceStep:
    """The step that says which passes are ahead; of a search for missing effects one more fit and ranking at a time."""
    return planned(Stretch(ServiceStage.CAMPAIGN_PASS, runs * usual, what, once=True) for what, usual in passes)


def _listed(file: Path | None) -> list[str]:
    """Runs of a list, one a line; empty lines and those that begin with # are none."""
    if file is None:
        return []
    if not file.is_file():
        raise UsageError(f"{file}: no such list of runs")
    lines = (line.strip() for line in file.read_text(encoding="utf-8").splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def payload_note(result: Mapping[str, Any]) -> str:
    """Why a campaign with a payload in each run does not know the car's mass; an empty string where it does."""
    whole = {one["name"]: one for one in result["whole_vehicle"] or ()}
    if not whole or whole["mass"]["identifiable"]:
        return ""
    return (
        "each run has a payload of its own (--payload): the car's mass and the mean of these are one sum. Leave "
        "--payload out where runs have one load; lacet diagnose names the payload of a single run"
    )


def _print(result: dict[str, Any], most: int) -> None:
    """The result for people."""
    runs, minutes = len(result["runs"]), result["seconds"] / 60.0
    many = "s" if runs > 1 else ""
    print(f"{result['vehicle']}, {runs} run{many}, {minutes:.1f} min, {result['wheel_reference']} wheel loads\n")
    print(tables.parameters(result))
    if result["not_identifiable"]:
        names = ", ".join(item["name"] for item in result["not_identifiable"])
        print("\n" + tables.wrapped(f"Not identifiable with these runs: {names}", 2))
    ratios = [[row, f"{ratio:.2f}", "fails" if fails(ratio) else ""] for row, ratio in result["row_ratios"].items()]
    print("\nError ÷ noise floor, over all runs:\n" + tables.table(["row", "error ÷ floor", ""], ratios))
    worst = sorted(result["runs"], key=lambda one: -one["overall"])[:most]
    print("\nRuns farthest above their floor:\n" + tables.table(
        ["run", "error ÷ floor", "s"], [[one["run"], f"{one['overall']:.2f}", f"{one['seconds']:.0f}"] for one in worst]
    ))  # fmt: skip
    where, ratio = worst_row(result["rows"]["used"])
    print(f"\nWorst row: {where}, {ratio:.2f} times its noise floor.")
    lost = f"; {result['workers_lost']} workers were lost, and their runs done again" if result["workers_lost"] else ""
    print(f"{result['passes']} passes over the runs, {result['passes_over_sums']} over their sums{lost}.")
    for warning in result["warnings"]:
        print(f"! {warning}")
    if result["doubtful"]:
        names = ", ".join(result["doubtful"])
        print(f"\nIn doubt, and in the fit: {names} (the lines with ! say why). Mend them, or repeat without.")
