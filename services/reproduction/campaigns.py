"""The paper's two campaigns reproduced: a simulated car is driven and measured, and the model fitted to its runs.

Simulation writes the runs, the rig and the vehicle's geometry into one folder and the true values into another; the fit
reads the first only. `services.reproduction.scores` alone reads both.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.result import plain
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import base_model, catalogue, find_effect
from lacet.identify.progress import Stage
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.validation.noise_floor import SCORE_DRAWS
from lacet.identify.validation.score import Comparison, compare
from lacet.services.acquisition.capture import encode_rig, simulated_start, write_capture
from lacet.services.progress import Progress, ServiceStage, ServiceStep, Stretch
from lacet.services.reproduction.published_tables import LINES
from lacet.services.timing.usual import drives_plan, stretch
from lacet.services.workspace.decode import decode_log
from lacet.services.workspace.loading import load
from lacet.services.workspace.results import fit_result
from lacet.simulate import START_NS, Hidden, Sheet, exchange_run, make_manoeuvre, measure
from lacet.simulate import run as drive
from lacet.simulate.known_cars import known_car
from lacet.simulate.motion import CarMotion
from lacet.simulate.vehicle_file import vehicle_text

HOUR_NS = 3_600_000_000_000
RUN_STEP = 1000
FRICTION_SPEED = 0.005
"""Speed v0 of the simulated friction f·tanh(ṡ/v0) [m/s]: smaller than the noise of the travel rate."""


@dataclass(frozen=True)
class Campaign:
    """One of the paper's two data sets.

    `tables` of the paper that it reproduces; `manoeuvres` driven, each with its settings; `held` : one driven that no
    fit uses, for cross validation; `effects` beyond the base model that are fitted; `wires` : whether the runs are
    encoded and decoded as the instruments' bytes or are tables.
    """

    name: str
    about: str
    tables: tuple[int, ...]
    car: str
    rig: str
    manoeuvres: tuple[tuple[str, dict[str, Any]], ...]
    held: tuple[str, dict[str, Any]]
    hidden: tuple[Hidden, ...]
    effects: tuple[str, ...]
    wires: bool

    def shortened(self, seconds: float) -> Campaign:
        """The campaign with runs of this duration [s]."""
        manoeuvres = tuple((n, {**s, "duration": seconds}) for n, s in self.manoeuvres)
        return replace(self, manoeuvres=manoeuvres, held=(self.held[0], {**self.held[1], "duration": seconds}))

    @property
    def driven(self) -> tuple[tuple[str, dict[str, Any]], ...]:
        """All that is driven, what is held out last."""
        return (*self.manoeuvres, self.held)


PAPER = "paper"
"""Cars of the campaigns that have the paper's values."""
OF_LINKAGES = (
    "anti_roll_bar.front", "anti_roll_bar.rear", "axle_damping.rear", "spring_quadratic.front", "spring_quadratic.rear",
)  # fmt: skip
"""Effects beyond the base model that are fitted to a car on linkages: bars, dampers that both wheels move, rates that
change with the travel."""
ON_A_ROAD = ("damper_stroke.front", "damper_stroke.rear", "damper_mount.front", "damper_mount.rear")
"""Further ones that a road shows, of dampers; steering and lift-off on a plane have one frequency, at which a mount is
a rate and a mass."""


def campaigns_of(car: str) -> tuple[Campaign, ...]:
    """Both campaigns with the paper's values, or with a car on linkages, whose vehicle file has its bench's tables."""
    plane, road = simulation(), experiment()
    if car == PAPER:
        return plane, road
    return (
        replace(plane, car=car, effects=OF_LINKAGES),
        replace(road, car=car, hidden=(), effects=(*OF_LINKAGES, *ON_A_ROAD)),
    )


def simulation() -> Campaign:
    """Section 4: sinus steering at 90 km/h and sudden deceleration without braking, nearly without noise."""
    manoeuvres = (("sinus", {"speed": 25.0, "duration": 20.0}), ("liftoff", {"duration": 20.0}))
    held = ("spiral", {"duration": 20.0})
    about = "section 4: sinus steering at 90 km/h and sudden lift-off, a hundredth of the instruments' noise"
    return Campaign(
        "simulation", about, (1, 2, 3, 4), "peugeot-406", "paper-simulation", manoeuvres, held, (), (), False
    )


def experiment() -> Campaign:
    """Section 6: sinus steering at 90 km/h and spirals of a minute, experimental instruments, the car of tables 5 to 7.

    The road is of class A: on a perfect plane left and right travel are opposite throughout, and no anti-roll bar can
    be distinguished from the springs.
    """
    found = {line.key: line.estimated for line in LINES if line.table == 6}
    hidden: list[Hidden] = []
    for key, value in found.items():
        effect, where, _ = key.split(".")
        if effect in ("anti_roll_bar", "coulomb") and value is not None:
            shape = {"v0": FRICTION_SPEED} if effect == "coulomb" else {}
            hidden.append(Hidden(f"{effect}.{where}", value, shape=shape))
    manoeuvres = (
        ("sinus", {"speed": 25.0, "duration": 60.0, "grade": "A"}),
        ("spiral", {"duration": 60.0, "grade": "A"}),
    )
    return Campaign(
        "experiment", "section 6: sinus steering at 90 km/h and a spiral, a minute each, experimental instruments",
        (5, 6, 7), "peugeot-406-measured", "peugeot-406", manoeuvres, ("liftoff", {"duration": 30.0, "grade": "A"}),
        tuple(hidden),
        tuple(h.name for h in hidden), True,
    )  # fmt: skip


@dataclass(frozen=True)
class Places:
    """Folders of a campaign's files: the measurements, and apart from them the true values."""

    folder: Path
    truth: Path

    @classmethod
    def of(cls, out: Path, campaign: Campaign) -> Places:
        """The folders inside the command's output folder."""
        return cls(out / campaign.name, out / "truth" / f"{campaign.name}.json")

    @property
    def rig(self) -> Path:
        """Path of the rig file."""
        return self.folder / "rig.toml"

    @property
    def vehicle(self) -> Path:
        """Path of the vehicle file."""
        return self.folder / "vehicle.toml"

    @property
    def figures(self) -> Path:
        """Path of the page with direct and cross validation."""
        return self.folder / "validation.html"

    @property
    def fit(self) -> Path:
        """Path of the fit's result."""
        return self.folder / "fit.json"

    def run(self, campaign: Campaign, name: str) -> Path:
        """Path of a run that is ready for identification."""
        return self.folder / f"{name}{'.mcap' if campaign.wires else '.parquet'}"


def reproduction_plan(campaign: Campaign, places: Places) -> list[Stretch]:
    """The plan of a campaign's reproduction: what is there already takes no time."""
    if places.fit.is_file() and places.figures.is_file():
        return []
    runs = [places.run(campaign, name) for name, _ in campaign.driven]
    driven = places.truth.is_file() and all(file.is_file() for file in runs)
    drives = [] if driven else drives_plan(_duration(name, more) for name, more in campaign.driven)
    of_used = (ServiceStage.READING_RUN, ServiceStage.FITTING, Stage.NOISE_CORRECTION)
    fitted = [stretch(stage, len(campaign.manoeuvres)) for stage in of_used]
    return [*drives, *fitted, stretch(ServiceStage.READING_RUN), stretch(ServiceStage.COMPARING, len(runs))]


def _duration(name: str, settings: Mapping[str, Any]) -> tuple[str, float]:
    return name, make_manoeuvre(name, **settings).duration


def drive_all(campaign: Campaign, places: Places, seed: int, progress: Progress) -> None:
    """Simulate what is not simulated yet: the runs, the files for identification, and apart from them the truth."""
    runs = [places.run(campaign, name) for name, _ in campaign.driven]
    if places.truth.is_file() and all(file.is_file() for file in (*runs, places.rig, places.vehicle)):
        return
    car, rig = known_car(campaign.car), Rig.load(campaign.rig)
    places.folder.mkdir(parents=True, exist_ok=True)
    text = vehicle_text(car)
    _write(places.rig, rig.text)
    _write(places.vehicle, text)
    truths: list[dict[str, Any]] = []
    for index, ((name, settings), file) in enumerate(zip(campaign.driven, runs, strict=True)):
        run_seed = seed + RUN_STEP * index

        def driven(fraction: float, name: str = name) -> None:
            progress(ServiceStep(ServiceStage.DRIVING, round(100 * fraction), 100, name, campaign=campaign.name))

        motion = drive(car, make_manoeuvre(name, **settings), campaign.hidden, run_seed, progress=driven)
        truths.append(motion.truth())
        if file.is_file():
            continue
        progress(ServiceStep(ServiceStage.MEASURING, subject=name, campaign=campaign.name))
        part = file.with_name(f"part-{file.name}")
        part.unlink(missing_ok=True)
        if campaign.wires:
            _over_wires(part, motion, rig, text, run_seed, START_NS + index * HOUR_NS)
        else:
            write_table(exchange_run(motion, rig, run_seed, sheet=Sheet(seed=seed), name=file.stem), part)
        os.replace(part, file)
    places.truth.parent.mkdir(parents=True, exist_ok=True)
    _write(places.truth, json.dumps(plain({"format": "lacet-truth 1", "runs": truths}), indent=1) + "\n")


def _over_wires(file: Path, motion: CarMotion, rig: Rig, vehicle: str, seed: int, start_ns: int) -> None:
    """Write the sensors' signals as a capture of bytes, and decode it by the drivers."""
    raw = file.with_name(f"raw-{file.name}")
    blocks = measure(motion, rig, seed, sheet=Sheet(seed=seed), start_ns=start_ns)
    frames, documents = encode_rig(blocks, rig)
    start = simulated_start(file.stem.removeprefix("part-"), motion, rig, vehicle, start_ns)
    write_capture(raw, frames, replace(start, documents=documents), overwrite=True)
    decode_log(raw, file)
    raw.unlink()


def identify(campaign: Campaign, places: Places, progress: Progress) -> dict[str, Any]:
    """The fit of the campaign's model to its runs (as ``lacet identify --json``), stored for the next time.

    With the page of its validation: measured and modelled rows of the runs used, and beside them of the one held out.
    """
    if places.fit.is_file() and places.figures.is_file():
        return json.loads(places.fit.read_text(encoding="utf-8"))
    files = [places.run(campaign, name) for name, _ in campaign.manoeuvres]
    loaded = load(files, places.rig, places.vehicle, progress=progress)
    fitted = fit_campaign(campaign, loaded.vehicle, loaded.reference, loaded.prepared, progress)
    held = load([places.run(campaign, campaign.held[0])], places.rig, places.vehicle, progress=progress).prepared
    parts: list[Comparison] = []
    for run in (*fitted.runs, *held):
        step = ServiceStep(ServiceStage.COMPARING, len(parts), len(fitted.runs) + 1, run.name, campaign=campaign.name)
        progress(step)
        parts.append(compare(fitted, run, SCORE_DRAWS))
    *used, cross = parts
    # Only here: matplotlib takes half a second to load.
    from lacet.services.reproduction.validation_page import validation_page

    _write(places.figures, validation_page(campaign.about, used, cross))
    result = fit_result(fitted, loaded, used, [cross])
    result["shapes"] = {effect.key: dict(effect.shape) for effect in fitted.model.physics if effect.shape}
    _write(places.fit, json.dumps(result, indent=1) + "\n")
    return result


def fit_campaign(
    campaign: Campaign, vehicle: Vehicle, reference: str, runs: Sequence[PreparedRun], progress: Progress
) -> Fit:
    """Fit of the campaign's model to its runs, wheel loads in `reference`, shape constants by search."""
    known, base = catalogue(vehicle, reference), base_model(vehicle, reference)
    extra = [find_effect(key, known) for key in campaign.effects]
    shapes: dict[str, tuple[float, ...]] = {name: values for e in extra for name, values in e.grids.items()}
    if shapes:  # one constant for all corners, by the likelihood of the residual, before the final fit
        (name, values), *_ = shapes.items()
        tried: dict[float, float] = {}
        for value in values:
            progress(ServiceStep(ServiceStage.FITTING, values={name: value}, campaign=campaign.name))
            model = Model.of([*base, *_shaped(extra, name, value)])
            tried[value] = _misfit(fit(model, runs, FitOptions(unbias=False)))
        extra = _shaped(extra, name, min(tried, key=lambda value: tried[value]))
    progress(ServiceStep(ServiceStage.FITTING, campaign=campaign.name))
    return fit(Model.of([*base, *extra]), runs, progress=progress)


def _shaped(effects: list[Effect], name: str, value: float) -> list[Effect]:
    return [replace(e, shape={**e.shape, name: value}) if name in e.grids else e for e in effects]


def _misfit(fitted: Fit) -> float:
    """Negative log-likelihood of the residual, each row's σ being that of its residual: Σ n log σ."""
    counts = {row: sum(len(part[row]) for part in fitted.residual if row in part) for row in fitted.rows}
    return sum(n * math.log(fitted.sigma[row]) for row, n in counts.items())


def _write(file: Path, text: str) -> None:
    """Write a complete file or none, so that an interrupted step is repeated."""
    part = file.with_name(f"part-{file.name}")
    part.write_text(text, encoding="utf-8")
    os.replace(part, file)
