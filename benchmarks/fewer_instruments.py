"""Fewer instruments: do the intervals hold the truth when what is assumed is wrong, and how much wider are they?

One simulated car, many rigs. Four manoeuvres of an independent car are smoothed, and loads moved until they fulfil the
model exactly, by the rig's own laws at their nominal constants. Each campaign draws noise, zeros, gains and latencies
from the sensor sheet, and moves the nominal value of every assumption by a draw of its tolerance: what the rig is told
of the car is then as wrong as it claims to be. The intervals are those *with sheet*.

    python -m benchmarks.fewer_instruments                        # every rig, resumable, writes the table in the page
    python -m benchmarks.fewer_instruments --rigs hubs cells --campaigns 40
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import coverage
from lacet.daq.assumptions import ASSUMABLE
from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.body_motion import body_motion
from lacet.identify.car.car_tree import AXLE, WHEEL
from lacet.identify.car.sources.completion import completed
from lacet.identify.car.sources.wheel_force import GRAVITY
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.properties.whole_vehicle import NAMES, whole_vehicle
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, Stored, fit
from lacet.identify.signals.reconstruct import Recording, Signals
from lacet.identify.validation.parameter_estimates import estimates
from lacet.services.one_thread import one_thread
from tests.identify import cars

Array = NDArray[np.float64]
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "fewer-instruments.md"
MARK = "<!-- written by benchmarks/fewer_instruments.py -->"
RATIO = 0.8
STATED = f"""
[assumed]
motion_ratio = {{ value = {RATIO}, tolerance = 0.008, unit = "-", source = "drawing" }}
pushrod_ratio = {{ value = {RATIO}, tolerance = 0.008, unit = "-", source = "drawing" }}
"""
UNSPRUNG = """
unsprung_mass.front = {{ value = {0}, tolerance = 3, unit = "kg", source = "drawing" }}
unsprung_mass.rear = {{ value = {1}, tolerance = 3, unit = "kg", source = "drawing" }}
"""
SCALE: Mapping[str, tuple[tuple[str, tuple[str, ...], float], ...]] = {
    "mass": (("sprung_mass", ("M6",), 15.0),),
    "spring": (("spring_rate.front", ("spring.fl.k", "spring.fr.k"), 500.0),),
    "damper": (("damper_rate.rear", ("damper.rl.c", "damper.rr.c"), 60.0),),
    "load": tuple((f"static_load.{c}", (f"offset.{c}.f0",), 60.0) for c in CORNERS),
    "pitch": (("pitch_inertia", ("YY6",), 60.0),),
    "tyre": (("tyre_rate.front", ("tyre_stiffness.fl.kt", "tyre_stiffness.fr.kt"), 6000.0),),
}
"""What may set the scale where no wheel load is measured: assumptions, parameters whose mean each is, tolerances."""
INERTIAL = ("imu.accel", "imu.rate")
Channels = Mapping[str, Array]
Values = dict[str, tuple[float, float, float]]
DRAWS = 3
"""Pairs of noise draws behind the correction of each fit."""


@dataclass(frozen=True)
class StudyRig:
    """A rig of the study: `about` it, channels it keeps of the full one, and channels made from the full one's.

    `given` : what the vehicle file gives beside unsprung masses (`SCALE`), empty for nothing; `scales` : whether it
    stands on corner scales in a run more; `unit` : whether it has an inertial unit; `tables` : whether the car has
    joint tables (`tests.identify.cars.with_joints`).
    """

    about: str
    keep: Callable[[str], bool]
    make: Callable[[Channels, Rig], dict[str, Array]] = lambda *_: {}
    given: str = ""
    scales: bool = False
    unit: bool = True
    tables: bool = False


def no_wheels(name: str) -> bool:
    """Everything but the dynamometers."""
    return not name.startswith("wheel.")


def no_loads(name: str) -> bool:
    """Inertial unit, travel, speed and steer."""
    return name.startswith(("imu.", "correvit.")) or name.endswith((".hub", ".steer"))


def bus(values: Channels, rig: Rig) -> dict[str, Array]:
    """Yaw rate and lateral acceleration at the body's origin, as on the car's own bus."""
    signals = Signals.differentiated(dict(values), coverage.FILTERS.rate)
    lateral = body_motion(signals, rig, values["imu.rate"].shape[1]).accel[1:2]
    return {"car.yaw_rate": values["imu.rate"][2:], "car.lateral_accel": lateral}


RIGS: dict[str, StudyRig] = {
    "full": StudyRig("the paper's rig", lambda _: True),
    "hubs": StudyRig(
        "three-axis hubs and an inertial unit, nothing else", lambda n: n.endswith(".force") or n in INERTIAL
    ),
    "hubs_speed": StudyRig(
        "the same and a speed", lambda n: n.endswith(".force") or n in (*INERTIAL, "correvit.speed")
    ),
    "cells": StudyRig(
        "vertical load cells in place of dynamometers",
        no_wheels,
        lambda a, _: {f"hub.{c}.load": a[f"wheel.{c}.force"][2:] for c in CORNERS},
    ),
    "potentiometers": StudyRig(
        "potentiometers with a motion ratio in place of hub lasers",
        lambda n: not n.endswith(".hub"),
        lambda a, _: {f"damper.{c}.travel": RATIO * (0.3 - a[f"laser.{c}.hub"]) for c in CORNERS},
    ),
    "no_attitude": StudyRig(
        "no attitude, ground lasers in front only",
        lambda n: n not in ("imu.attitude", "laser.rl.ground", "laser.rr.ground"),
    ),
    "two_lasers": StudyRig("hub lasers on the left only", lambda n: n not in ("laser.fr.hub", "laser.rr.hub")),
    "no_cameras": StudyRig("no cameras", lambda n: not n.startswith("camera.")),
    "no_moments": StudyRig("dynamometers of three forces", lambda n: not n.endswith(".moment")),
    "pushrods": StudyRig(
        "pushrods with a force gauge in place of dynamometers",
        no_wheels,
        lambda a, _: {f"pushrod.{c}.force": (a[f"wheel.{c}.force"][2:] - 250.0) / RATIO for c in CORNERS},
    ),
    "no_loads": StudyRig(
        "inertial unit, travel, speed and steer; no wheel load, the sprung mass known",
        no_loads,
        given="mass",
    ),
    "scales": StudyRig("the same and a run that stands on corner scales", no_loads, given="mass", scales=True),
    "bus": StudyRig(
        "three-axis hubs, yaw rate and lateral acceleration", lambda n: n.endswith(".force"), bus, unit=False
    ),
    "ground": StudyRig(
        "no wheel load, the sprung mass known, ground lasers",
        lambda n: no_loads(n) or n.endswith(".ground"),
        given="mass",
    ),
    "spring": StudyRig("no wheel load, the rate of the front springs known", no_loads, given="spring"),
    "tables": StudyRig("the paper's rig, on a car with bench tables (wrong as well)", lambda _: True, tables=True),
    "damper": StudyRig("no wheel load, the rate of the rear dampers known to 3 %", no_loads, given="damper"),
    "loads": StudyRig("no wheel load, the static loads of all suspensions known to 2 %", no_loads, given="load"),
    "pitch": StudyRig("no wheel load, the moment of inertia of pitch known to 2 %", no_loads, given="pitch"),
    "tyre": StudyRig(
        "no wheel load, ground lasers, the stiffness of the front tyres known to 3 %",
        lambda n: no_loads(n) or n.endswith(".ground"),
        given="tyre",
    ),
}


@cache
def vehicle() -> Vehicle:
    """The reference car, with the ratios that a rig has to state."""
    return Vehicle.parse(cars.reference_car()[0].text + STATED)


@cache
def vehicle_of(rig: str) -> Vehicle:
    """The vehicle file of a rig; what it gives is of the stored motions, with a nominal mass outboard unsprung, too."""
    given = RIGS[rig].given
    if RIGS[rig].tables:
        return cars.with_joints(vehicle())
    if not given:
        return vehicle()
    theta = coverage.stored_motions()[1]
    of = dict(zip(model().names, theta.tolist(), strict=True))
    outboard = vehicle().assumption("outboard_mass", "fl").value
    unsprung = {c: of[f"M{AXLE[c]}"] + of[f"M{WHEEL[c]}"] + outboard for c in CORNERS}
    axles = (0.5 * (unsprung[f"{axle}l"] + unsprung[f"{axle}r"]) for axle in "fr")
    lines = [
        f"{name} = {{ value = {np.mean([of[one] for one in parameters])}, tolerance = {tolerance}, "
        f'unit = "{ASSUMABLE[name.partition(".")[0]].unit}", source = "bench" }}\n'
        for name, parameters, tolerance in SCALE[given]
    ]
    return Vehicle.parse("".join([vehicle().text, *lines]) + UNSPRUNG.format(*axles))


@cache
def exact(rig: str) -> tuple[Recording, ...]:
    """Exact recordings of the four manoeuvres by a rig: its laws at their nominal constants fulfil the model."""
    records, theta = coverage.stored_motions()
    known = vehicle_of(rig)
    out = [made(record, rig, known) for record in records]
    if RIGS[rig].scales:
        out.append(made(standing(out[0]), rig, known))
    return tuple(cars.fulfil(completed(bare), model().physics, theta).smoothed() for bare in out)


def made(record: Recording, rig: str, known: Vehicle) -> Recording:
    """A recording of the full rig with the channels of another rig, nothing derived or assumed yet."""
    values = dict(record.signals.value)
    kept = {name: a for name, a in values.items() if RIGS[rig].keep(name) or name.startswith("scale.")}
    kept |= RIGS[rig].make(values, record.rig)
    signals = Signals.differentiated(kept, record.filters.rate)
    usable = {name: record.usable.get(name, np.ones(record.t.size, bool)) for name in kept}
    rates = {name: record.rates.get(name, record.filters.rate) for name in kept}
    bare = replace(record, signals=signals, usable=usable, rates=rates, vehicle=known, smoothers={})
    if RIGS[rig].unit:
        return bare
    others = tuple(sensor for sensor in record.rig.sensors if sensor.name != "imu")
    return replace(bare, rig=replace(record.rig, sensors=others))


def standing(record: Recording, seconds: float = 10.0) -> Recording:
    """The car at rest on corner scales, with the mean travel of a recording; its loads do not fulfil the model yet."""
    part = record.at(slice(0, round(seconds * record.filters.rate)))
    ones = np.ones((1, part.t.size))
    still = {name: 0.0 * a for name, a in part.signals.value.items()}
    still |= {f"laser.{c}.hub": ones * np.mean(record.signals.value[f"laser.{c}.hub"]) for c in CORNERS}
    still |= {"imu.accel": np.array([[0.0], [0.0], [GRAVITY]]) * ones}
    still |= {f"scale.{c}.load": 3500.0 * ones for c in CORNERS}
    return part.with_signals(Signals.differentiated(still, record.filters.rate))


def model() -> Model:
    """The base model and both anti-roll bars, which the car has."""
    return coverage.models()[0]


def misinformed(records: Sequence[Recording], rng: np.random.Generator) -> Mapping[str, float]:
    """How far the nominal value of each assumption is off, a draw of its tolerance."""
    every = {name: one for record in records for name, one in record.assumptions.items()}
    return {name: one.tolerance * float(rng.standard_normal()) for name, one in sorted(every.items())}


def sheet_of(records: Sequence[Recording], rng: np.random.Generator) -> dict[tuple[str, int], float]:
    """Gains and latencies of all channels of a rig."""
    sheet = coverage.sheet_draw(records[0], rng)
    for record in records[1:]:
        if {*record.signals.value} - {*records[0].signals.value}:
            sheet = coverage.sheet_draw(record, rng) | sheet
    return sheet


def drawn(record: Recording, rng: np.random.Generator, sheet: Mapping, wrong: Mapping[str, float]) -> PreparedRun:
    """A recording as its instruments would have measured it, with assumptions that are `wrong` by so much."""
    run = coverage.drawn(record, rng, sheet).recording
    assumed = {name: a + wrong[name] for name, a in run.signals.assumed.items()}
    return PreparedRun(replace(run, signals=replace(run.signals, assumed=assumed)))


@cache
def reference(rig: str) -> Stored:
    """How the residual answers to channels and assumptions, the same in all campaigns of a rig; no noise moments."""
    rng = np.random.default_rng([77, 0])
    runs = [drawn(record, rng, {}, dict.fromkeys(record.assumptions, 0.0)) for record in exact(rig)]
    return replace(fit(model(), runs, FitOptions(unbias=False)).stored, moments=None)


def campaign(rig: str, number: int) -> Values:
    """Every value that lacet reports in one campaign: name → estimate, σ with the sheet, true value."""
    rng = np.random.default_rng([77, 1 + list(RIGS).index(rig), number])
    records = exact(rig)
    sheet, wrong = sheet_of(records, rng), misinformed(records, rng)
    runs = [drawn(record, rng, sheet, wrong) for record in records]
    return reported(fit(model(), runs, FitOptions(draws=DRAWS), stored=reference(rig)))


def reported(found: Fit) -> Values:
    """The identifiable values of a fit; the true ones are grouped as the fit groups them."""
    theta = coverage.stored_motions()[1]
    exactly = np.zeros(len(theta))
    exactly[found.base.independent] = found.base.grouping() @ theta
    true = dict(zip(found.model.names, exactly, strict=True))
    out = {
        e.name if e.group == e.name else f"{e.name} and others": (e.value, e.half_sheet / TWO_SIDED_95, true[e.name])
        for e in estimates(found, None, found.runs)
        if e.identifiable
    }
    whole = whole_vehicle(replace(found, covariance=found.covariance + found.covariance_sheet), vehicle(), found.runs)
    right = whole_vehicle(replace(found, theta=exactly), vehicle())
    if whole and right:
        for k, name in enumerate(NAMES):
            if whole.determined[k]:
                out[name] = float(whole.values[k]), float(whole.interval[k]) / TWO_SIDED_95, float(right.values[k])
    return out


def run_rig(rig: str, campaigns: int, folder: Path) -> list[Values]:
    """The values of each campaign, from the folder as far as they are there."""
    file = folder / f"{rig}.jsonl"
    done = [json.loads(line) for line in file.read_text().splitlines()] if file.is_file() else []
    start, fresh = time.monotonic(), len(done)
    for n in range(len(done), campaigns):
        done.append(campaign(rig, n))
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(done[-1]) + "\n")
        rate = (time.monotonic() - start) / (len(done) - fresh)
        print(f"{rig}: {len(done)} of {campaigns}, {rate:.2f} s each", file=sys.stderr, flush=True)
    return done[:campaigns]


SHOWN = {
    "mass": ("mass",), "cog x": ("cog.x",), "cog z": ("cog.z",), "Izz": ("Izz",), "Iyy": ("Iyy",), "Ixx": ("Ixx",),
    "springs": ("spring.fl.k", "spring.rr.k"), "dampers": ("damper.fl.c", "damper.rr.c"),
    "bars": ("anti_roll_bar.front.k", "anti_roll_bar.rear.k"),
    "tyres": ("tyre_stiffness.fl.kt", "tyre_stiffness.rr.kt"), "offsets": ("offset.fl.f0", "offset.rr.f0"),
}  # fmt: skip
"""Columns of the table of widths, and the values whose mean they are."""


def page(found: Mapping[str, list[Values]]) -> str:
    """The table of what is held and how wide it is."""
    widths: dict[str, dict[str, float]] = {}
    lines = [
        f"{min(len(a) for a in found.values())} simulated campaigns a rig, {len(cars.RUNS)} runs of "
        f"{coverage.SECONDS:g} s. *Held*: % of the 95 % intervals (with sheet) of all values reported that hold the",
        "truth. The others: width of the interval ÷ that with the full rig; – not identified.",
        "",
        f"| rig | held % | values | {' | '.join(SHOWN)} |",
        f"|---|---:|---:|{'---:|' * len(SHOWN)}",
    ]
    for rig, campaigns in found.items():
        every = [one for values in campaigns for one in values.values()]
        held = 100.0 * np.mean([abs(value - true) <= TWO_SIDED_95 * sigma for value, sigma, true in every])
        names = {n for values in campaigns for n in values if sum(n in v for v in campaigns) > len(campaigns) / 2}
        widths[rig] = {n: float(np.median([v[n][1] for v in campaigns if n in v])) for n in names}
        cells: list[str] = []
        for members in SHOWN.values():
            ratios = [widths[rig][n] / widths["full"][n] for n in members if n in widths[rig] and n in widths["full"]]
            cells.append(f"{np.mean(ratios):.1f}" if ratios else "–")
        lines.append(f"| {RIGS[rig].about} | {held:.1f} | {len(names)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the study and write its tables into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=100)
    parser.add_argument("--rigs", nargs="+", choices=RIGS, default=list(RIGS))
    parser.add_argument("--folder", type=Path, default=Path("build/fewer"), help="where unfinished work is kept")
    parser.add_argument("--page", type=Path, default=PAGE, help="where the tables go, after the mark")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    with one_thread():
        text = page({rig: run_rig(rig, args.campaigns, args.folder) for rig in dict.fromkeys(["full", *args.rigs])})
    print(text)
    head = args.page.read_text(encoding="utf-8").partition(MARK)[0]
    args.page.write_text(f"{head}{MARK}\n{text}", encoding="utf-8")


if __name__ == "__main__":
    main()
