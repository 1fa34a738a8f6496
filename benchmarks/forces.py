"""Are the wheel forces of a run without dynamometers right, and do their bands hold? Simulated campaigns.

Each campaign draws noise, zeros, gains and latencies of its instruments anew, and tyres and released brakes that differ
from wheel to wheel (`benchmarks.uneven_cars`), identifies the car from four runs with dynamometers, and estimates the
wheel forces of other manoeuvres from which the dynamometers were taken. The truth is the simulator's, without noise.
The brakes of a run held out are uneven by a draw of what is assumed of them.

    python -m benchmarks.forces                   # writes docs/benchmarks/forces.md
    python -m benchmarks.forces --campaigns 2     # a shorter look, printed only
    python -m benchmarks.forces --campaigns 40 --first 500   # further ones, printed only
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import coverage
from benchmarks.uneven_cars import uneven_car
from lacet.daq.channels import CORNERS
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import AXLES
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import bring_together
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import compare
from lacet.identify.wheel_loads.known_car import KnownCar
from lacet.identify.wheel_loads.lack_of_fit import known_car
from lacet.identify.wheel_loads.measured_forces import ForceError, errors
from lacet.identify.wheel_loads.observer import estimate_forces
from lacet.identify.wheel_loads.outputs import FORCES, EstimatedForces
from lacet.identify.wheel_loads.settings import STANDARD
from lacet.identify.wheel_loads.without_dynamometers import LOADS
from lacet.services.one_thread import one_thread
from lacet.simulate import Car, Sheet, exchange_run, find_car, make_manoeuvre
from lacet.simulate import run as drive
from lacet.simulate.motion import SimulatedMotion
from lacet.simulate.vehicle_file import vehicle_text
from tests.identify import cars

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "forces.md"
CAR = "peugeot-406"
BARS = ("anti_roll_bar.front", "anti_roll_bar.rear")
USED: tuple[tuple[str, Mapping[str, Any]], ...] = (
    ("sinus", {"duration": 15.0}),
    ("rough", {"duration": 15.0}),
    ("braking", {"duration": 12.0}),
    ("liftoff", {"duration": 15.0}),
)
"""Manoeuvres that the car is identified from."""
HELD: tuple[tuple[str, Mapping[str, Any]], ...] = (
    ("sweep", {"duration": 20.0}),
    ("rough", {"duration": 15.0, "speed": 25.0}),
    ("spiral", {"duration": 20.0}),
    ("braking", {"duration": 12.0, "speed": 33.0}),
    ("kerb", {"duration": 12.0}),
)
"""Manoeuvres whose wheel forces are estimated."""
CAMPAIGNS, FIRST = 24, 1000
"""Number of campaigns on the page, and of the first: by those before it what is assumed, and how, was chosen."""
SETS = 4000
"""Sets of tyres and brakes whose drag alone is drawn."""
LATER = 1e-3
"""Step of the time by which the truth's rate of change is taken [s]."""
REFERENCE_CAMPAIGNS = 5
"""Campaigns of the reference car's four motions."""


@dataclass(frozen=True)
class Line:
    """A force of a held-out run: its name, error, half of its band, mean over the run [N].

    `on_time` : error of a vertical force ÷ noise floor, without the one delay of all those of the run.
    """

    campaign: int
    run: str
    name: str
    error: ForceError
    half: float
    on_time: float = float("nan")


def motion(car: Car, name: str, settings: Mapping[str, Any], seed: int) -> SimulatedMotion:
    """A drive of a car."""
    return drive(car, make_manoeuvre(name, **settings), [], seed, settle=1.0, step=0.001)


def without_loads(run: Run) -> Run:
    """The run as a car without dynamometers records it: wheel speeds, no loads."""
    return replace(run, signals={name: signal for name, signal in run.signals.items() if name not in LOADS})


def car_of(fitted: Fit, runs: Sequence[PreparedRun]) -> KnownCar:
    """The car as a fit knows it, its lack of fit that of the runs used."""
    return known_car(fitted, Knowledge.of(fitted), [(run, compare(fitted, run, draws=8)) for run in runs])


def campaign(number: int, held: Sequence[tuple[str, Mapping[str, Any]]] = HELD) -> Iterator[Line]:
    """One campaign: the car identified, and the forces of each held-out run against the simulator's."""
    rig, filters = Rig.load(CAR), Filters()
    rng = np.random.default_rng([23, number])
    driven = uneven_car(rng, find_car(CAR))
    vehicle = Vehicle.parse(vehicle_text(driven))
    sheet = Sheet(gains=True, latencies=True, seed=1000 + number)

    def measured(moved: SimulatedMotion, seed: int) -> Run:
        return exchange_run(moved, rig, 100 * number + seed, sheet=sheet)

    used = [measured(motion(driven, name, some, 1), k) for k, (name, some) in enumerate(USED)]
    runs = [PreparedRun.of(run, vehicle, rig) for run in used]
    fitted = fit(Model.of(base_model(vehicle, rig.wheel_reference)), runs, FitOptions(draws=4))
    car = car_of(fitted, runs)
    for k, (name, some) in enumerate(held):
        if name == "braking":
            uneven = (
                2.0 * STANDARD.longitudinal.sigma * rng.standard_normal(2)
            )  # the tolerance is of half the difference
            some = {**some, "uneven_front": float(uneven[0]), "uneven_rear": float(uneven[1])}
        moved = motion(driven, name, some, 2)
        hidden = PreparedRun.of(without_loads(measured(moved, 50 + k)), vehicle, rig, filters)
        estimated = estimate_forces(car, hidden, seed=number)
        exact, t = exchange_run(moved, rig, 0, sheet=Sheet(zeros=False), noise=0.0), hidden.recording.t
        truth, later = (bring_together(exact, vehicle, rig, filters, on=t + shift) for shift in (0.0, LATER))
        moving = errors(estimated, PreparedRun(replace(later, t=t)), exact=True)
        yield from on_time(estimated, moving, [*lines_of(number, name, estimated, PreparedRun(truth), exact=True)])


def on_time(estimated: EstimatedForces, later: Mapping[str, ForceError], lines: Sequence[Line]) -> Iterator[Line]:
    """The lines of a run, vertical forces with the one delay of all that explains their errors best.

    `later` : errors against the truth of `LATER` seconds afterwards.
    """
    vertical = [line for line in lines if line.name.endswith("z")]
    pairs: list[tuple[np.ndarray, np.ndarray]] = []
    for line in vertical:
        off = line.error.measured - estimated[line.name].value
        rate = (later[line.name].measured - line.error.measured) / LATER
        used = np.isfinite(off) & np.isfinite(rate)
        pairs.append((off[used] - np.mean(off[used]), rate[used] - np.mean(rate[used])))
    delay = sum(float(off @ rate) for off, rate in pairs) / sum(float(rate @ rate) for _, rate in pairs)
    left = {line.name: float(np.std(off - delay * rate)) for line, (off, rate) in zip(vertical, pairs, strict=True)}
    for line in lines:
        if line.name in left:
            line = replace(line, on_time=left[line.name] / estimated[line.name].floor)
        yield replace(line, error=replace(line.error, measured=np.zeros(0)))


def reference_car() -> Iterator[Line]:
    """Each run of the independent reference car, from the other three, against its dynamometers."""
    vehicle, rig = cars.reference_car()
    known = catalogue(vehicle, rig.wheel_reference)
    model = Model.of(base_model(vehicle, rig.wheel_reference)) + known[BARS[0]] + known[BARS[1]]
    runs = {name: PreparedRun.of(open_run(cars.CAR / f"{name}.parquet"), vehicle, rig) for name in cars.RUNS}
    for name, held in runs.items():
        others = [run for other, run in runs.items() if other != name]
        fitted = fit(model, others)
        yield from lines_of(0, name, estimate_forces(car_of(fitted, others), held), held, exact=False)


def reference_campaign(number: int) -> Iterator[Line]:
    """Each of the reference car's four motions, measured by instruments drawn anew, from the other three.

    The motions are stored smooth, with loads that fulfil the model exactly (`benchmarks.coverage`): the truth is known.
    """
    records, model = coverage.stored_motions()[0], coverage.models()[0]
    rng = np.random.default_rng([23, 1, number])
    sheet = coverage.sheet_draw(records[0], rng)
    runs = [coverage.drawn(record, rng, sheet) for record in records]
    for name, held, exact in zip(cars.RUNS, runs, records, strict=True):
        others = [run for run in runs if run is not held]
        car = car_of(fit(model, others, FitOptions(draws=4)), others)
        yield from lines_of(number, name, estimate_forces(car, held, seed=number), PreparedRun(exact), exact=True)


def lines_of(number: int, name: str, estimated: EstimatedForces, run: PreparedRun, exact: bool) -> Iterator[Line]:
    """The forces of a run against measured or exact ones."""
    for force, error in errors(estimated, run, exact).items():
        half = float(np.nanmean(estimated[force].half95))
        yield Line(number, name, force, error, half)


def kind_of(name: str) -> str:
    """A force's kind: its name, without the wheel."""
    return "wheel.{c}.force_estimated.z" if name.endswith("z") else name


HEAD = (
    "| force | runs | error about its mean [N] | ÷ floor | worst | its mean, RMS [N] | ± 95 % [N] | inside |\n"
    "|---|---|---|---|---|---|---|---|"
)


def table(lines: Sequence[Line]) -> str:
    """Error, band and part of the time inside it, by kind of force."""
    out = [HEAD]
    for kind in dict.fromkeys(kind_of(name) for name in FORCES):
        some = [line for line in lines if kind_of(line.name) == kind]
        if not some:
            continue
        rms, offset = (
            float(np.sqrt(np.mean(np.square([getattr(line.error, what) for line in some]))))
            for what in ("rms", "offset")
        )
        floors = [line.error.floors for line in some]
        half, inside = (float(np.mean(a)) for a in ([x.half for x in some], [100.0 * x.error.inside for x in some]))
        runs = len({(line.campaign, line.run) for line in some})
        out.append(
            f"| `{kind}` | {runs} | {rms:.0f} | {np.median(floors):.2f} | {max(floors):.2f} | {offset:.0f} "
            f"| {half:.0f} | {inside:.1f} % |"
        )
    return "\n".join(out)


def sets_inside() -> float:
    """Part of `SETS` sets of tyres and released brakes whose drag on the rear axle is within what is assumed [%]."""
    car, assumed = find_car(CAR), STANDARD
    rng, wheels = np.random.default_rng([23, 2]), AXLES["rear"]
    loads = np.array([car.static_loads[CORNERS.index(c)] for c in wheels])
    radius = car.rear.radius - loads / car.rear.tyre_stiffness

    def drag(rolling: Any, brake: Any) -> Any:
        return np.sum(rolling * loads + brake / radius, axis=-1)

    drawn = (uneven_car(rng, car) for _ in range(SETS))
    sets = [[(one.tyres[c].rolling_resistance, one.axle(c).brake_drag) for c in wheels] for one in drawn]
    rolling, brakes = np.moveaxis(np.array(sets), 2, 0)
    off = drag(rolling, brakes) - drag(assumed.rolling.mean, assumed.brake_drag.mean)
    own = np.hypot(assumed.rolling_own.sigma * loads, assumed.brake_drag.sigma / radius)
    sigma = np.hypot(assumed.rolling.sigma * np.sum(loads), np.sqrt(np.sum(own**2)))
    return 100.0 * float(np.mean(np.abs(off) <= TWO_SIDED_95 * sigma))


def page(lines: Sequence[Line], reference: Sequence[Line], redrawn: Sequence[Line]) -> str:
    """The page of the study."""
    vertical = [line for line in lines if line.name.endswith("z")]
    within = 100.0 * np.mean([line.error.floors <= 2.0 for line in vertical])
    timed = np.array([line.on_time for line in vertical])
    parts = [
        "# Wheel forces without dynamometers",
        "",
        "Written by `python -m benchmarks.forces`; what the columns mean is in [forces.md](../forces.md).",
        "",
        f"**Simulated.** {len({line.campaign for line in lines})} campaigns: noise, zeros, gains and latencies of all",
        "instruments are drawn from the sensor sheet, the Peugeot is identified from four runs with dynamometers",
        f"({', '.join(name for name, _ in USED)}), and of {len(HELD)} other runs without dynamometers the forces are",
        "estimated, by the same instruments. The truth is the simulator's, without noise. Each campaign has tyres and",
        "brakes of its own, uneven from wheel to wheel (`benchmarks/uneven_cars.py`): toe and conicity (0.11°),",
        "cornering stiffness (4 %), rolling resistance (0.0115 ± 0.0025, 5 % within a set), trail (20 %), drag of",
        "released brakes (up to 4 N·m). Braking is uneven left and right by a draw of what is assumed (half the",
        "difference 5 % of the axle's F_x). A floor is that of the row: the suspension's for vertical forces, that of",
        "the chassis along x or y for the others; ÷ floor is the median over runs and wheels. The mean error is what",
        "zeros and gains of the study's dynamometers and of the run's own sensors leave; it lasts for a run, so that",
        "*inside* is judged over runs. Vertical forces within two floors of",
        f"their row: {within:.1f} % of runs and wheels.",
        "",
        "**What is beyond is time.** Latencies are known to 2 ms (1 σ). Study and run say how late the instruments are",
        "compared with each other, and not how late all are (1.2 ms, of three sensors): a force that is late with them",
        "is as wrong as it moves in that time, most on kerbs and rough roads. Without one delay a run, common to its",
        f"vertical forces, {100.0 * np.mean(timed <= 2.0):.1f} % are within two floors",
        f"(median {np.median(timed):.2f}, worst {np.max(timed):.2f}).",
        "",
        "F_x of the rear axle is one number for a set of tyres and brakes, of which these campaigns have few: of",
        f"{SETS} further sets, {sets_inside():.1f} % roll within the band that is assumed of them.",
        "",
        table(lines),
        "",
        "By run, vertical forces:",
        "",
        HEAD.replace("| force |", "| run |"),
    ]
    for name, _ in HELD:
        own = table([line for line in vertical if line.run == name]).splitlines()[-1]
        parts.append(f"| {name} |" + own.split("|", 2)[2])
    parts += [
        "",
        "**Reference car.** Each of its four runs from the other three, against its own dynamometers, of which the",
        "zeros are taken away as `lacet compare` takes them.",
        "",
        table(reference),
        "",
        "Its four motions, 15 s each, with loads that fulfil the model exactly, measured by instruments drawn anew in",
        f"{len({line.campaign for line in redrawn})} campaigns, against the exact loads:",
        "",
        table(redrawn),
        "",
    ]
    return "\n".join(parts)


def main() -> int:
    """Run the campaigns, and print or write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, help=f"number of campaigns (default: {CAMPAIGNS}); printed only")
    parser.add_argument("--first", type=int, default=FIRST, help="number of the first of them")
    args = parser.parse_args()
    lines: list[Line] = []
    with one_thread():
        reference = [*reference_car()]
        redrawn = [line for number in range(REFERENCE_CAMPAIGNS) for line in reference_campaign(number)]
        for number in range(args.first, args.first + (args.campaigns or CAMPAIGNS)):
            lines += campaign(number)
            print(f"campaign {number + 1}", file=sys.stderr)
    text = page(lines, reference, redrawn)
    if args.campaigns or args.first != FIRST:
        print(text)
    else:
        PAGE.write_text(text, encoding="utf-8")
        print(f"{PAGE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
