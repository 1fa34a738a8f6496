"""``lacet info --model``: a car's tree, its parameters, and which of them its equations and its runs can tell."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model
from lacet.identify.progress import Progress, Stage, Step
from lacet.identify.properties.structural_identifiability import Structure, TreeJoint, car_tree, structure
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import fit
from lacet.identify.validation.parameter_estimates import Estimate, estimates
from lacet.services.render import tables
from lacet.services.workspace.loading import Loaded, load
from lacet.services.workspace.session import default_filters
from lacet.services.workspace.study import Study

RUNS = (".mcap", ".parquet", ".csv", ".mf4", ".mdf")
_WIDTH = 118


@dataclass(frozen=True)
class Asked:
    """What to tell of: a model on a vehicle, and the runs it is to be seen with, if any."""

    vehicle: Vehicle
    reference: str
    model: Model
    loaded: Loaded | None
    rig: Rig | None

    @property
    def brakes(self) -> str:
        """``off`` when any run declares it, for its spin rows; without runs they are taken to be off."""
        declared = {drive.recording.brakes for drive in self.loaded.drives} if self.loaded else {"off"}
        return "off" if "off" in declared else sorted(declared)[0]


def find_model(
    files: Sequence[Path], reference: str | None, rig: str | None, vehicle: str | None, progress: Progress
) -> Asked:
    """From the words of the command line: a vehicle, a study or a run first, then runs."""
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
        sensors = None if rig is None else Rig.load(rig)
        found = Vehicle.load(car or first)
        seen = reference or (sensors.wheel_reference if sensors else "contact")
        return Asked(found, seen, Model.of(base_model(found, seen)), None, sensors)
    progress(Step(Stage.READING_RUNS, total=len(runs)))
    loaded = load(runs, rig, car, default_filters(None))
    if reference and reference != loaded.reference:
        raise UsageError(f"--reference {reference}: the runs have {loaded.reference} wheel loads")
    model = Model.of(base_model(loaded.vehicle, loaded.reference))
    return Asked(loaded.vehicle, loaded.reference, model, loaded, loaded.rig)


def _of_study(study: Study, progress: Progress) -> Asked:
    folder = study.folder
    progress(Step(Stage.READING_RUNS, total=len(study.used), subject="used"))
    loaded = load(study.paths(), folder / "rig.toml", folder / "vehicle.toml", study.filters)
    versions = [v for v in study.versions() if v.number == study.current]
    if not versions:
        raise UsageError(f"{folder} has no version: its making was broken off; remove it and make it again")
    return Asked(loaded.vehicle, loaded.reference, study.model(versions[0], loaded.reference), loaded, loaded.rig)


def model_info(asked: Asked, progress: Progress) -> dict[str, Any]:
    """Print the tree and the parameters; the same as plain data (``docs/json.md``, ``info``)."""
    progress(Step(Stage.STRUCTURE))
    found = structure(asked.vehicle, asked.reference, asked.model.physics, asked.brakes, asked.rig)
    by_name: dict[str, Estimate] = {}
    if asked.loaded is not None:
        progress(Step(Stage.FITTING))
        by_name = {e.name: e for e in estimates(fit(asked.model, asked.loaded.drives))}
    tree = car_tree(asked.vehicle)
    _print_tree(asked, tree)
    lines = [_parameter(found, i, by_name) for i in range(len(found.names))]
    _print_parameters(asked, found, lines)
    return {
        "model": {
            "vehicle": asked.vehicle.name,
            "wheel_reference": asked.reference,
            "brakes": asked.brakes,
            "effects": [effect.key for effect in asked.model.effects],
            "tree": [asdict(joint) for joint in tree],
            "rows": list(found.rows),
            "rows_left_out": dict(found.left_out),
            "base_rank": found.base.rank,
            "singular_gap": found.base.gap,
            "parameters": lines,
            "runs": [drive.name for drive in asked.loaded.drives] if asked.loaded else [],
            "warnings": list(asked.loaded.warnings) if asked.loaded else [],
        }
    }


def _parameter(found: Structure, i: int, by_name: dict[str, Estimate]) -> dict[str, Any]:
    name, group = found.names[i], found.group(i)
    in_principle = "no" if not group else "alone" if group == name else "grouped"
    estimate = by_name.get(name)
    with_runs, why = None, found.why(i)
    if estimate is not None:
        with_runs = "no" if not estimate.identifiable else "alone" if estimate.group == name else "grouped"
        if not why or estimate.identifiable:
            why = estimate.why
        if estimate.identifiable:
            group = estimate.group
    return {
        "name": name, "unit": found.units[i], "effect": found.effects[i], "in_principle": in_principle,
        "with_runs": with_runs, "group": group, "why": why,
    }  # fmt: skip


def _print_tree(asked: Asked, tree: Sequence[TreeJoint]) -> None:
    print(f"{asked.vehicle.name}: 42 bodies in a tree, {asked.reference} wheel loads\n")
    rows = [
        [str(k.number), str(k.antecedent), k.corner or "-", k.name, f"{k.kind} {k.axis}", k.body or "-", k.follows]
        for k in tree
    ]
    print(tables.table(["joint", "on", "corner", "what it is", "moves", "carries", "follows"], rows, left=7))
    print(
        "\n  Axes at zero angles: x forward, y left, z up. Bodies without a name have no mass. Suspension springs and\n"
        "  dampers act on damper clearance, tyres on tyre deflection."
    )


def _print_parameters(asked: Asked, found: Structure, lines: Sequence[dict[str, Any]]) -> None:
    runs = asked.loaded.drives if asked.loaded else ()
    print(
        f"\nIn principle (any motion, brakes {asked.brakes}): {len(lines)} parameters, of which the equations can tell "
        f"{found.base.rank}\n(smallest pivot kept ÷ largest dropped: {found.base.gap:.1e})."
    )
    if runs:
        told = sum(line["with_runs"] not in (None, "no") for line in lines)
        print(f"With {', '.join(drive.name for drive in runs)}: {told}.")
    for why, rows in _alike(found.left_out).items():
        print(_wrapped(f"  rows not formed: {', '.join(rows)}: {why}", 4))
    if asked.reference == "hub":
        print("  Axles and wheels are the parts inboard of the dynamometers: spin inertia of rim and tyre is not seen.")
    head = ["parameter", "unit", "effect", "in principle", *(["with runs"] if runs else []), "stands for"]
    body = [
        [
            line["name"], line["unit"], line["effect"], line["in_principle"], *([line["with_runs"]] if runs else []),
            line["group"] if line["group"] != line["name"] else "",
        ]
        for line in lines
    ]  # fmt: skip
    room = _WIDTH - sum(max(len(row[k]) for row in (head, *body)) + 2 for k in range(len(head) - 1)) - 2
    cut = [[*row[:-1], row[-1] if len(row[-1]) <= room else row[-1][: room - 2] + " …"] for row in body]
    print("\n" + tables.table(head, cut, left=len(head)))
    for title, asked_for in (
        ("No value of their own, whatever the runs", lambda line: line["in_principle"] == "no"),
        ("Not with these runs", lambda line: line["in_principle"] != "no" and line["with_runs"] == "no"),
    ):
        reasons = _alike({line["name"]: line["why"] for line in lines if asked_for(line)})
        if reasons:
            print(f"\n{title}:")
        for why, names in reasons.items():
            print(_wrapped(f"  {', '.join(names)}: {why}", 4))
    for warning in asked.loaded.warnings if asked.loaded else ():
        print(_wrapped(f"! {warning}", 2))


def _alike(reasons: Mapping[str, str]) -> dict[str, list[str]]:
    """What has the same reason together."""
    out: dict[str, list[str]] = {}
    for name, why in reasons.items():
        out.setdefault(why, []).append(name)
    return out


def _wrapped(text: str, indent: int) -> str:
    return textwrap.fill(text, _WIDTH, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)
