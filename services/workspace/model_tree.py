"""Model of a car as plain data: its tree, its parameters, and those that its equations and its runs identify."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model
from lacet.identify.progress import Stage
from lacet.identify.properties.structural_identifiability import Structure, car_tree, structure
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import fit
from lacet.identify.validation.parameter_estimates import Estimate, estimates
from lacet.identify.validation.row_sources import row_sources
from lacet.services.cache.store import FOLDER
from lacet.services.progress import Progress, ServiceStage, ServiceStep, Stretch, planned
from lacet.services.render.identifiability import joint_position, structurally, unidentified
from lacet.services.render.row_sources import sources_result
from lacet.services.render.rows import row_absence
from lacet.services.timing.memory import FILE
from lacet.services.timing.usual import stretch
from lacet.services.workspace.loading import Loaded, default_filters, load
from lacet.services.workspace.study import Study

RUNS = (".mcap", ".parquet", ".csv", ".mf4", ".mdf")


@dataclass(frozen=True)
class Asked:
    """A model on a vehicle with the runs for its identification, if any."""

    vehicle: Vehicle
    reference: str
    model: Model
    loaded: Loaded | None
    rig: Rig | None

    @property
    def brakes(self) -> str:
        """``off`` where any run declares it, for its spin rows, and without runs."""
        declared = {run.recording.brakes for run in self.loaded.prepared} if self.loaded else {"off"}
        return "off" if "off" in declared else sorted(declared)[0]


def find_model(
    files: Sequence[Path], reference: str | None, rig: str | None, vehicle: str | None, progress: Progress
) -> Asked:
    """The model of the command line's arguments: a vehicle, a study or a run first, then runs."""
    first = files[0] if files else Path(vehicle or "peugeot-406")
    if first.is_dir():
        if len(files) > 1 or rig or vehicle or reference:
            raise UsageError(f"{first} is a study: its runs, rig and vehicle are its own; name nothing beside it")
        return _of_study(Study.open(first), progress)
    runs = list(files) if first.suffix in RUNS else list(files[1:])
    car: str | Path | None = vehicle
    if first.suffix not in RUNS:
        if files and vehicle:
            raise UsageError(f"two vehicles: {first} and --vehicle {vehicle}")
        car = first
    if not runs:
        sensors = None if rig is None else Rig.load(rig, kept=True)
        found = Vehicle.load(car or first)
        seen = reference or (sensors.wheel_reference if sensors else "contact")
        return Asked(found, seen, Model.of(base_model(found, seen)), None, sensors)
    progress(planned(_stretches(len(runs))))
    loaded = load(runs, rig, car, default_filters(None), progress)
    if reference and reference != loaded.reference:
        raise UsageError(f"--reference {reference}: the runs have {loaded.reference} wheel loads")
    model = Model.of(base_model(loaded.vehicle, loaded.reference))
    return Asked(loaded.vehicle, loaded.reference, model, loaded, loaded.rig)


def _of_study(study: Study, progress: Progress) -> Asked:
    folder = study.folder
    progress(planned(_stretches(len(study.used)), folder / FOLDER / FILE))
    loaded = load(study.paths(), folder / "rig.toml", folder / "vehicle.toml", study.filters, progress)
    versions = [v for v in study.versions() if v.number == study.current]
    if not versions:
        raise UsageError(f"{folder} has no version: its making was broken off; remove it and make it again")
    return Asked(loaded.vehicle, loaded.reference, study.model(versions[0], loaded.reference), loaded, loaded.rig)


def _stretches(runs: int) -> list[Stretch]:
    """The plan of finding a model and what these runs determine of it."""
    stages = (ServiceStage.READING_RUN, ServiceStage.STRUCTURE, ServiceStage.FITTING, Stage.NOISE_CORRECTION)
    return [stretch(stage, runs) for stage in stages]


def model_info(asked: Asked, progress: Progress) -> dict[str, Any]:
    """The tree and the parameters of a model as plain data (``docs/json.md``, ``info``)."""
    progress(ServiceStep(ServiceStage.STRUCTURE))
    found = structure(asked.vehicle, asked.reference, asked.model.physics, asked.brakes, asked.rig)
    by_name: dict[str, Estimate] = {}
    sources: list[dict[str, Any]] = []
    if asked.loaded is not None:
        progress(ServiceStep(ServiceStage.FITTING))
        fitted = fit(asked.model, asked.loaded.prepared, progress=progress)
        sources = sources_result(row_sources(fitted))
        by_name = {e.name: e for e in estimates(fitted, runs=fitted.runs)}
    tree = car_tree(asked.vehicle)
    lines = [_parameter(found, i, by_name) for i in range(len(found.names))]
    return {
        "model": {
            "vehicle": asked.vehicle.name,
            "wheel_reference": asked.reference,
            "brakes": asked.brakes,
            "effects": [effect.key for effect in asked.model.effects],
            "tree": [{**asdict(joint), "follows": joint_position(joint.follows)} for joint in tree],
            "rows": list(found.rows),
            "rows_left_out": {row: row_absence(why) for row, why in found.left_out.items()},
            "row_sources": sources,
            "base_rank": found.base.rank,
            "singular_gap": found.base.gap,
            "parameters": lines,
            "runs": [run.name for run in asked.loaded.prepared] if asked.loaded else [],
            "warnings": list(asked.loaded.warnings) if asked.loaded else [],
            "notes": list(asked.loaded.notes) if asked.loaded else [],
        }
    }


def _parameter(found: Structure, i: int, by_name: dict[str, Estimate]) -> dict[str, Any]:
    name, group = found.names[i], found.group(i)
    in_principle = "no" if not group else "alone" if group == name else "grouped"
    estimate = by_name.get(name)
    with_runs, why = None, structurally(found.why(i))
    if estimate is not None:
        with_runs = "no" if not estimate.identifiable else "alone" if estimate.group == name else "grouped"
        if not why or estimate.identifiable:
            why = unidentified(estimate.why)
        if estimate.identifiable:
            group = estimate.group
    return {
        "name": name, "unit": found.units[i], "effect": found.effects[i], "in_principle": in_principle,
        "with_runs": with_runs, "group": group, "why": why,
    }  # fmt: skip
