"""``lacet plan``: rank the runs to drive next."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.design.run_information import with_constants
from lacet.identify.design.run_ranking import Quantity, Ranked, Ranking, chosen, quantities
from lacet.identify.effects.catalogue import base_model, catalogue, find_effect
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY as G
from lacet.identify.progress import Stage
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.signals.filters import Filters
from lacet.services.cache.keys import service_sources, simulator_sources
from lacet.services.cache.store import FOLDER
from lacet.services.commands.progress import Line
from lacet.services.planning.manoeuvre_library import KMH, Limits, check, kinds, library
from lacet.services.planning.nominal_car import known_values, planned_car
from lacet.services.planning.simulated_plans import (
    SECONDS,
    PlannedRun,
    SensorSetup,
    first_fit,
    like_runs,
    next_runs,
    simulated_runs,
)
from lacet.services.progress import ServiceStage, ServiceStep, Stretch, planned
from lacet.services.render import tables
from lacet.services.render.intervals import half_width
from lacet.services.timing.memory import FILE
from lacet.services.timing.usual import PLANNED_RUNS, stretch
from lacet.services.workspace.kept.study_plans import StudyPlan
from lacet.services.workspace.loading import default_filters, load
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from lacet.simulate import MANOEUVRES
from lacet.simulate.engine import engine_library

HELP = "rank the runs that could be driven next by how much they would show"
DESCRIPTION = f"""\
Rank manoeuvres, at several speeds and amplitudes, by how much a run of each would shrink the 95 % intervals of what is
poorly known: every parameter whose half-width is above --goal, or what --want names. Nothing is measured for it: a car
with your geometry and what is known of its parameters is simulated, seen with your rig's sensors.

  lacet plan STUDY                               on top of the runs of a study, with its present model
  lacet plan run1.mcap run2.mcap                 on top of these runs
  lacet plan --vehicle car.toml --rig rig.toml   before the first run
  lacet plan STUDY --want YY6 'damper.*' Iyy     what is to become better known
  lacet plan STUDY --max-speed 60 --without rough,kerb --max-duration 20
  lacet plan STUDY --runs 3                      the next three, each on top of those before
  lacet plan STUDY --like old1.mcap old2.mcap    runs like these in place of simulated ones (needs no simulator)

Manoeuvres: {", ".join(MANOEUVRES)}.
Simulated motions are kept in STUDY/planned, or where --keep says, so that the next plan is quick.
What the numbers mean: docs/plan.md."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("given", metavar="STUDY or RUN", nargs="*", type=Path, help="a study's folder, or runs")
    parser.add_argument("--rig", help="rig file, or the name of one shipped; default: the one in the run or study")
    parser.add_argument("--vehicle", help="vehicle file, or the name of one shipped; default: as for --rig")
    parser.add_argument("--map", metavar="FILE", type=Path, help="channel map of logs that other systems wrote")
    parser.add_argument("--add", metavar="EFFECT", action="append", default=[], help="an effect beyond the base model")
    parser.add_argument("--cutoff", metavar="HZ", type=float, help="cut-off of the fit (default: the study's, or 6 Hz)")
    parser.add_argument(
        "--want", metavar="NAME", nargs="+", action="extend", default=[], help="parameters, whole-vehicle values"
    )
    parser.add_argument("--goal", metavar="%", type=float, help="half-width aimed at (default 2 %% of the value; "
                        "with --want: as narrow as can be)")  # fmt: skip
    parser.add_argument("--only", metavar="NAMES", default="", help="manoeuvres to choose from, by commas")
    parser.add_argument("--without", metavar="NAMES", default="", help="manoeuvres that cannot be driven, by commas")
    parser.add_argument("--max-speed", metavar="KM/H", type=float, default=100.0, help="default 100")
    parser.add_argument(
        "--max-lateral", metavar="G", type=float, default=0.5, help="lateral acceleration, default 0.5 g"
    )
    parser.add_argument("--max-braking", metavar="G", type=float, default=0.5, help="deceleration, default 0.5 g")
    parser.add_argument("--max-duration", metavar="S", type=float, default=30.0, help="of one run, default 30 s")
    parser.add_argument("--max-bump", metavar="MM", type=float, default=25.0, help="height of bumps, default 25 mm")
    parser.add_argument(
        "--road", choices=("A", "B", "C"), default="B", help="worst road there is (ISO 8608), default B"
    )
    parser.add_argument(
        "--like", metavar="RUN", nargs="+", action="extend", default=[], type=Path, help="rank runs like these instead"
    )
    parser.add_argument("--runs", metavar="N", type=int, default=1, help="plan the next N runs (default 1)")
    parser.add_argument("--most", metavar="N", type=int, default=12, help="rows of the ranking printed (default 12)")
    parser.add_argument("--keep", metavar="DIR", type=Path, help="where simulated motions are kept")


_BY_SHEET = (
    "  ± by sheet: what instruments off by what their sheet allows make of it at present, in no other column here. "
    "A run narrows it little; a calibration does, or lacet check, and a sheet with smaller tolerances."
)


@dataclass(frozen=True)
class _Start:
    """Starting point of a plan: the present fit, or none before the first run."""

    fitted: Fit | None
    model: Model
    vehicle: Vehicle
    rig: Rig
    filters: Filters
    reference: str
    prepared: tuple[PreparedRun, ...]
    files: tuple[str | Path | None, str | Path | None]
    folder: Path | None
    warnings: tuple[str, ...]

    def half_by_sheet(self, name: str) -> float | None:
        """Half of a parameter's 95 % interval that the sheet's gains and latencies make; None where it is not known."""
        if self.fitted is None or name not in self.fitted.model.names:
            return None
        place = self.fitted.model.names.index(name)
        return TWO_SIDED_95 * float(np.sqrt(max(0.0, self.fitted.covariance_sheet[place, place]))) or None


def run(args: argparse.Namespace) -> int:
    """Rank and print; 3 when a run was damaged or left out, or could not be simulated."""
    limits = Limits(
        args.max_speed * KMH, args.max_lateral * G, args.max_braking * G, args.max_duration, 1e-3 * args.max_bump,
        args.road,
    )  # fmt: skip
    check(limits)
    if args.runs < 1:
        raise UsageError(f"--runs {args.runs}: at least 1")
    if args.goal is not None and not 0.0 <= args.goal < 100.0:
        raise UsageError(f"--goal {args.goal:g}: a percentage from 0 to below 100")
    names = kinds(_split(args.only), _split(args.without))
    with Line("plan") as line:
        line.progress(planned(_stretches(args)))
        study = Study.open(args.given[0]) if len(args.given) == 1 and args.given[0].is_dir() else None
        if study is None or args.like or args.rig or args.vehicle or args.cutoff or args.add:
            result = _planned(args, limits, names, line)
        else:
            about = ["plan", asdict(limits), names, args.want, args.goal, args.runs, SECONDS, simulator_sources()]
            about.append(service_sources("planning", "render", "commands"))
            values = Session(study).values
            result = values.next_run(study.version(), about, lambda: (_planned(args, limits, names, line), True))
    _print(result, args.most)
    write_result(args.json, "plan", result)
    return WITH_LOSSES if result["warnings"] else DONE


def _planned(args: argparse.Namespace, limits: Limits, names: Sequence[str], line: Line) -> dict[str, Any]:
    """The plan as plain data."""
    start = _start(args, line)
    known, now = with_constants(start.fitted) if start.fitted else (None, None)
    if known:  # unknown names are refused before the long computation
        chosen(quantities(known, start.vehicle), args.want)
    runs, assumed, problems = _runs(args, start, limits, names, line)
    if not runs:
        raise UsageError("no motion could be made:\n" + "\n".join(problems))
    goal = (0.0 if args.want else 0.02) if args.goal is None else args.goal / 100.0
    values = known or first_fit(start.model, runs)
    wanted = chosen(quantities(values, start.vehicle), args.want)
    fitted, rankings = next_runs(
        values, now, runs, start.vehicle, limits.duration, wanted, goal, args.runs, line.progress
    )
    present = quantities(fitted, start.vehicle)
    return plan_result(start, runs, rankings, present, assumed, [*start.warnings, *problems])


def _stretches(args: argparse.Namespace) -> list[Stretch]:
    """The plan of the command; of a study it is announced anew, with what is kept, once that is open."""
    runs = [ServiceStage.READING_RUN, ServiceStage.FITTING, Stage.NOISE_CORRECTION] if args.given else []
    fitted = [stretch(stage, len(args.given)) for stage in runs]
    if args.like:
        read, seen = [stretch(ServiceStage.READING_RUN, len(args.like), "like")], len(args.like)
    else:
        read, seen = [stretch(ServiceStage.SIMULATING_RUN, PLANNED_RUNS)], PLANNED_RUNS
    return [*fitted, *read, stretch(ServiceStage.RUN_INFORMATION, seen)]


def _split(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _start(args: argparse.Namespace, line: Line) -> _Start:
    """The fit of a study or of runs, or none."""
    given: list[Path] = args.given
    if len(given) == 1 and given[0].is_dir():
        if args.rig or args.vehicle or args.cutoff or args.add:
            raise UsageError("a study has its own rig, vehicle, cut-off and effects: leave those options away")
        study = Study.open(given[0])
        session = Session(study, line.progress)
        version = study.version()
        stretches = StudyPlan(session.values).want([("fit", version)]).stretches
        line.progress(planned([*stretches, *_stretches(args)[3:]], study.folder / FOLDER / FILE))
        fitted, loaded = session.values.fitted(version), session.runs.loaded
        return _Start(
            fitted, fitted.model, loaded.vehicle, loaded.rig, study.filters, loaded.reference, loaded.prepared,
            (study.folder / "rig.toml", study.folder / "vehicle.toml"), args.keep or study.folder / "planned",
            loaded.warnings,
        )  # fmt: skip
    filters = default_filters(args.cutoff)
    if given:
        loaded = load(given, args.rig, args.vehicle, filters, line.progress, args.map)
        model = _model(loaded.vehicle, loaded.reference, args.add)
        line.progress(ServiceStep(ServiceStage.FITTING))
        return _Start(
            fit(model, loaded.prepared, progress=line.progress), model, loaded.vehicle, loaded.rig, filters,
            loaded.reference, loaded.prepared, (args.rig, args.vehicle), args.keep, loaded.warnings,
        )  # fmt: skip
    if not (args.rig and args.vehicle):
        raise UsageError("give a study, or runs; before the first run give --vehicle FILE and --rig FILE")
    vehicle, rig = Vehicle.load(args.vehicle), Rig.load(args.rig)
    model = _model(vehicle, rig.wheel_reference, args.add)
    files = (args.rig, args.vehicle)
    return _Start(None, model, vehicle, rig, filters, rig.wheel_reference, (), files, args.keep, ())


def _model(vehicle: Vehicle, reference: str, added: Sequence[str]) -> Model:
    known = catalogue(vehicle, reference)
    return Model.of([*base_model(vehicle, reference), *(find_effect(key, known) for key in added)])


def _runs(
    args: argparse.Namespace, start: _Start, limits: Limits, names: Sequence[str], line: Line
) -> tuple[list[PlannedRun], tuple[str, ...], list[str]]:
    """The runs to choose from, the assumptions about the car, and why some runs could not be simulated."""
    if args.like:
        loaded = load(
            args.like, *start.files, start.filters, lambda step: line.progress(replace(step, subject="like")), args.map
        )  # fmt: skip
        if loaded.reference != start.reference:
            raise UsageError(f"the runs of --like have {loaded.reference} wheel loads, the others {start.reference}")
        return like_runs(loaded.prepared), (), list(loaded.warnings)
    try:
        engine_library()
    except UsageError as missing:
        raise UsageError(f"{missing}\nOr rank runs like those you have: --like RUN…") from None
    like = planned_car(start.vehicle, known_values(start.vehicle, start.fitted, start.reference))
    plans = library(like.car, limits, names, SECONDS)
    rates = start.prepared[0].recording.rates if start.prepared else None
    channels = frozenset(name for drive in start.prepared for name in drive.recording.rates) if start.prepared else None
    sensors = SensorSetup(start.rig, start.filters, rates, channels)
    runs, problems = simulated_runs(plans, like, start.vehicle, sensors, limits, start.folder, line.progress)
    return runs, like.assumed, problems


def plan_result(
    start: _Start, runs: Sequence[PlannedRun], rankings: Sequence[Ranking], present: Mapping[str, Quantity],
    assumed: Sequence[str], warnings: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    """A plan as plain data (``docs/json.md``, ``plan``)."""
    first = rankings[0]
    useful = [ranking for ranking in rankings if ranking.runs[0].worth > 0.0]
    best = first.runs[0] if useful else None
    out_of_reach = [{"name": n, "half95": present[n].half, "unit": present[n].unit} for n in first.out_of_reach]
    return {
        "runs": [drive.name for drive in start.prepared],
        "wanted": [
            {
                "name": n,
                "value": q.value,
                "unit": q.unit,
                "half95": q.half,
                "goal": goal,
                "sheet95": start.half_by_sheet(n),
            }
            for n, goal in first.targets.items()
            for q in [present[n]]
        ],
        "out_of_reach": out_of_reach,
        "ranking": [_ranked(runs, one) for one in first.runs],
        "best": _ranked(runs, best) if best else None,
        "says": _sentence(runs, first, bool(start.prepared)),
        "next": [_ranked(runs, ranking.runs[0]) for ranking in useful],
        "assumed": list(assumed),
        "warnings": list(warnings),
    }


def _ranked(runs: Sequence[PlannedRun], one: Ranked) -> dict[str, Any]:
    run = runs[one.index]
    return {
        "run": run.label,
        "manoeuvre": run.manoeuvre,
        "settings": {key: value for key, value in run.settings.items() if key != "duration"},
        "speed": run.speed,
        "lateral": run.lateral,
        "duration": one.duration,
        "factor": one.factor,
        "shrinks": [
            {"name": s.name, "unit": s.unit, "before": s.before, "after": s.after, "factor": s.before / s.after}
            for s in one.shrinks
        ],
    }


def _sentence(runs: Sequence[PlannedRun], ranking: Ranking, measured: bool) -> str:
    """The run of most worth, in one sentence."""
    if not ranking.targets:
        reason = "everything that a run of the library can show is known well enough"
        return f"No further run is needed: {reason}." if measured else "No run of the library shows anything."
    best = ranking.runs[0]
    if best.worth <= 0.0:
        return "No run of the library would shrink what is wanted."
    most = "; ".join(_arrow(s.name, s.before, s.after, s.unit) for s in best.shrinks[:3])
    return f"The single next run worth most: {runs[best.index].label}, {best.duration:.0f} s: {most}."


def _arrow(name: str, before: float, after: float, unit: str) -> str:
    return f"{name} ± {half_width(before)} → ± {half_width(after)} {unit}".rstrip()


def _print(result: Mapping[str, Any], most: int) -> None:
    """Print the ranking, the best run's intervals, and the sentence."""
    if result["wanted"]:
        lines = [
            [
                str(number), one["run"], f"{one['duration']:.0f}", f"{one['factor']:.2f}",
                _arrow(*(one["shrinks"][0][key] for key in ("name", "before", "after", "unit"))),
            ]
            for number, one in enumerate(result["ranking"][:most], 1)
        ]  # fmt: skip
        about = f"{len(result['wanted'])} poorly known"
        print(f"{about}. Runs by how much they shrink their 95 % intervals (geometric mean, longest run):\n")
        print(tables.table(["", "run", "s", "÷", "what shrinks most"], lines, text_columns=2))
    if result["best"]:
        shrinks = result["best"]["shrinks"]
        sheet = {one["name"]: one["sheet95"] for one in result["wanted"]}
        rows = [
            [
                s["name"], half_width(s["before"]), half_width(s["after"]), s["unit"], f"{s['factor']:.1f}",
                "-" if sheet[s["name"]] is None else half_width(sheet[s["name"]]),
            ]
            for s in shrinks
        ]  # fmt: skip
        title = f"\nWhat {result['best']['duration']:.0f} s of the first would do:"
        print(f"{title}\n{tables.table(['', '± now', '± then', 'unit', '÷', '± by sheet'], rows)}")
        if any(sheet.values()):
            print(tables.wrapped(_BY_SHEET, 2))
    if result["out_of_reach"]:
        names = [item["name"] for item in result["out_of_reach"]]
        more = f" and {len(names) - 12} more (--json has all)" if len(names) > 12 else ""
        print(f"\nNo run of the library determines: {', '.join(names[:12])}{more}")
    if result["assumed"]:
        print(f"\nAssumed for the simulated car, not known: {', '.join(result['assumed'])}")
    for warning in result["warnings"]:
        print(f"! {warning}")
    print(f"\n{result['says']}")
    for one in result["next"][1:]:
        first = one["shrinks"][0]
        arrow = _arrow(*(first[key] for key in ("name", "before", "after", "unit")))
        print(f"Then: {one['run']}, {one['duration']:.0f} s: {arrow}.")
