"""Simulated motions of the library of manoeuvres, stored or computed, and the ranking of runs for ``lacet plan``."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.errors import LacetError
from lacet.daq.formats.exchange import read_table, write_table
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.design.run_information import (
    Information,
    RunInformation,
    predicted,
    residual_excess,
    run_information,
)
from lacet.identify.design.run_ranking import Ranking, rank
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import Filters, zero_phase
from lacet.services.planning.manoeuvre_library import Limits, Plan
from lacet.services.planning.nominal_car import PlannedCar
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.simulate import Hidden, Sheet, SimulatedMotion, SimulationFailed, exchange_run
from lacet.simulate import run as drive_car

SECONDS = 14.0
"""Duration of a simulated motion; the information of a longer run is extrapolated from it [s]."""
STEP = 0.001
RATE = 100.0
"""Integration step [s] and rate of the channels kept [Hz]: five times the pre-filter's cut-off."""
ABOVE = 1.1
"""Lateral acceleration ÷ limit above which the steering is reduced and the run simulated again."""


@dataclass(frozen=True)
class PlannedRun:
    """A possible run.

    `label` in words, `prepared` its motion, `settings` of the manoeuvre (empty for a run like a measured one), `speed`
    [m/s] and `lateral`, the peak lateral acceleration [m/s²], of a simulated one.
    """

    label: str
    prepared: PreparedRun
    settings: Mapping[str, Any]
    manoeuvre: str = ""
    speed: float | None = None
    lateral: float | None = None


@dataclass(frozen=True)
class SensorSetup:
    """The sensors and filters of planned runs.

    Attributes
    ----------
    rig : mounting of the sensors and sensor sheet.
    filters : filter settings of the fit.
    rates : the channels' own sample rates [Hz], where known from runs.
    channels : channels of the present runs; None for all of the rig.
    """

    rig: Rig
    filters: Filters
    rates: Mapping[str, float] | None = None
    channels: frozenset[str] | None = None


def simulated_runs(
    plans: Sequence[Plan], like: PlannedCar, vehicle: Vehicle, sensors: SensorSetup, limits: Limits,
    folder: Path | None, progress: Progress,
) -> tuple[list[PlannedRun], list[str]]:  # fmt: skip
    """Motions of a library as the rig's sensors would measure them, and why some could not be simulated.

    Parameters
    ----------
    plans, limits : the library, and the limits of what may be driven.
    like, vehicle : the car simulated, and the one identified.
    sensors : the sensors of the planned runs.
    folder : folder of stored motions; None stores none.
    """
    out: list[PlannedRun] = []
    problems: list[str] = []
    for number, plan in enumerate(plans, 1):
        progress(ServiceStep(ServiceStage.SIMULATING_RUN, number, len(plans), plan.label))
        try:
            run, lateral, factor = _motion(plan, like, sensors.rig, limits, folder)
            if (there := sensors.channels) is not None:
                run = replace(run, signals={name: s for name, s in run.signals.items() if name in there})
            prepared = PreparedRun.of(run, vehicle, sensors.rig, sensors.filters)
            own = {name: (sensors.rates or {}).get(name, CHANNELS[name].rate) for name in prepared.recording.rates}
            prepared = PreparedRun(replace(prepared.recording, rates=own))
        except LacetError as error:
            if not isinstance(error, SimulationFailed):
                raise
            problems.append(f"left out: {plan.label}: {error}")
            continue
        settings = dataclasses.asdict(plan.manoeuvre)
        if plan.lateral:
            settings["amplitude"] *= factor
        label, kind = plan.label_at(lateral), plan.manoeuvre.name
        out.append(PlannedRun(label, prepared, settings, kind, plan.manoeuvre.speed, lateral))
    return out, problems


def _motion(plan: Plan, like: PlannedCar, rig: Rig, limits: Limits, folder: Path | None) -> tuple[Run, float, float]:
    """Sensor signals, peak lateral acceleration [m/s²], and the factor by which the steering was reduced."""
    what = json.dumps(
        [
            "lacet-planned 1", dataclasses.asdict(like.car), [h.truth() for h in like.bars], plan.manoeuvre.name,
            dataclasses.asdict(plan.manoeuvre), rig.text, STEP, RATE, limits.lateral if plan.lateral else 0,
        ],
        sort_keys=True,
    )  # fmt: skip
    file = None
    if folder is not None:
        file = folder / f"{plan.manoeuvre.name}-{hashlib.sha256(what.encode()).hexdigest()[:12]}.parquet"
        if file.is_file():
            run = read_table(file)
            notes = json.loads(run.notes)
            return run, float(notes["lateral"]), float(notes["factor"])
    factor = 1.0
    motion, lateral = _drive(like.car, like.bars, plan)
    while plan.lateral and lateral > ABOVE * limits.lateral and factor > 0.1:
        factor *= 0.95 * limits.lateral / lateral
        amplitude = dataclasses.asdict(plan.manoeuvre)["amplitude"]
        motion, lateral = _drive(like.car, like.bars, plan.made(amplitude=factor * amplitude))
    notes = json.dumps({"lateral": lateral, "factor": factor})
    run = exchange_run(motion, rig, rate=RATE, sheet=Sheet(False), noise=False, notes=notes)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        (file.parent / ".gitignore").write_text("*\n", encoding="utf-8")
        beside = file.with_name(f".{file.name}.parquet")
        write_table(run, beside)
        beside.replace(file)
    return run, lateral, factor


def _drive(car: Any, bars: Sequence[Hidden], plan: Plan) -> tuple[SimulatedMotion, float]:
    motion = drive_car(car, plan.manoeuvre, bars, settle=1.0, step=STEP)
    at = motion.at(np.asarray(motion.car.total.com)[None, :])[1][:, 0, 1]
    smooth = zero_phase(at, 2.0, motion.rate, 5)
    return motion, float(np.max(np.abs(smooth)))


def like_runs(runs: Sequence[PreparedRun]) -> list[PlannedRun]:
    """Runs like measured ones."""
    return [PlannedRun(f"another run like {run.name}", run, {}) for run in runs]


def first_fit(model: Model, runs: Sequence[PlannedRun]) -> Fit:
    """A fit of the model with the values of the nominal car, before any run."""
    return fit(model, [run.prepared for run in runs], FitOptions(zeros=False, unbias=False))


def next_runs(
    values: Fit, now: Information | None, runs: Sequence[PlannedRun], vehicle: Vehicle, longest: float,
    names: Sequence[str], goal: float, count: int, progress: Progress,
) -> tuple[Fit, list[Ranking]]:  # fmt: skip
    """The fit with its present intervals, and `count` rankings, each with the best run of the one before added.

    `now` : information of the runs that `values` were fitted to (`with_constants`); None where only the priors are
    known (`first_fit`).
    """
    measured, now = now is not None, now or Information.none(values.model)
    excess = residual_excess(values) if measured else {}
    informations: list[RunInformation] = []
    for number, run in enumerate(runs, 1):
        progress(ServiceStep(ServiceStage.RUN_INFORMATION, number, len(runs), run.label))
        # A fit to the planned runs holds their motions; else a motion, which is large, is not needed again.
        drive = PreparedRun(run.prepared.recording) if measured else run.prepared
        informations.append(run_information(drive, values, excess))
    present = predicted(values, now)
    out: list[Ranking] = []
    for _ in range(count):
        progress(ServiceStep(ServiceStage.RANKING_RUNS))
        found = rank(values, now, informations, vehicle, longest, names, goal)
        out.append(found)
        if found.runs[0].worth <= 0.0:
            break
        now = now + informations[found.runs[0].index].lasting(found.runs[0].duration)
    return present, out
