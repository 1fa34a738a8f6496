"""The rig without wheel loads: which missing effects of fresh simulated cars are named, which not, which not told?

Each trial is a car that no other trial has, four runs used, and one kind of effect hidden at both axles in a size usual
on cars. The rig has an inertial unit, the travel of four suspensions, speed and front steer; the masses stated in the
vehicle file are wrong by a draw of their tolerances, as are zeros, gains and latencies of the sensors.

    python -m benchmarks.no_wheel_loads                 # every trial, resumable, writes the table in the page
    python -m benchmarks.no_wheel_loads --only bars --cars 0 1
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.making import cropped
from benchmarks.fresh.cars import fresh_car, fresh_rig
from benchmarks.fresh.drives import RoughSinus, ScaledRough, drawn_drives
from benchmarks.fresh.laws import LAWS, log_uniform
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import FitOptions, fit
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.validation.noise_floor import floor_of
from lacet.services.one_thread import one_thread
from lacet.simulate import Car, Hidden, Manoeuvre, Sheet, SimulationFailed, exchange_run
from lacet.simulate import run as simulate_drive
from lacet.simulate.manoeuvres import Kerb
from lacet.simulate.vehicle_file import vehicle_text

KINDS: Mapping[str, str] = {
    "nothing": "", "bars": "anti-roll bar", "friction": "friction", "cubic springs": "cubic spring",
    "quadratic springs": "quadratic spring", "asymmetric dampers": "asymmetric damper",
    "digressive dampers": "digressive damper", "bars, smooth runs": "anti-roll bar",
}  # fmt: skip
"""What is hidden → the law of `benchmarks.fresh.laws`."""
SMOOTH = ("bars, smooth runs",)
"""Kinds whose runs have no road that twists the car."""
CARS = 3
"""Cars of each kind."""
SPRUNG, UNSPRUNG = 15.0, 3.0
"""Tolerances of the masses that the vehicle file states [kg]."""
DRAWS = 199
"""Simulated runs behind the noise floor and p."""
RESULTS = Path(__file__).with_suffix(".jsonl")
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "fewer-instruments.md"
MARK = "<!-- written by benchmarks/no_wheel_loads.py -->"


def stated(car: Car, rng: np.random.Generator) -> Vehicle:
    """The car's geometry and its masses, each wrong by a draw of its tolerance."""
    lines = [("sprung_mass", car.chassis.mass, SPRUNG)]
    lines += [(f"unsprung_mass.{name}", car.axle(f"{name[0]}l").unsprung_mass, UNSPRUNG) for name in ("front", "rear")]
    masses = [
        f'{key} = {{ value = {mass + tolerance * rng.standard_normal():.2f}, tolerance = {tolerance}, unit = "kg", '
        'source = "scales and drawing" }'
        for key, mass, tolerance in lines
    ]
    return Vehicle.parse("\n".join([vehicle_text(car), "[assumed]", *masses, ""]))


def kept(run: Run) -> Run:
    """Inertial unit, travel, speed and front steer of a run."""
    names = [
        n for n in run.signals if n.startswith(("imu.", "correvit.")) or n.endswith((".hub", "fl.steer", "fr.steer"))
    ]
    return replace(run, signals={n: run.signals[n] for n in names}, wheel_reference=None)


def hidden_of(kind: str, rng: np.random.Generator) -> list[Hidden]:
    """The law at both axles, a usual size at each."""
    if not KINDS[kind]:
        return []
    law = next(law for law in LAWS if law.name == KINDS[kind])
    shape = {name: float(rng.uniform(*bounds)) for name, bounds in law.shape.items()}
    return [Hidden(f"{law.kind}.{place}", log_uniform(rng, *law.usual), shape=shape) for place in ("front", "rear")]


def smoothed(drives: Mapping[str, Manoeuvre]) -> dict[str, Manoeuvre]:
    """Those of the drives that need no rough road or kerb, on a smooth one."""
    kept = {name: one for name, one in drives.items() if not isinstance(one, ScaledRough | Kerb)}
    return {name: replace(one, scale=0.0) if isinstance(one, RoughSinus) else one for name, one in kept.items()}


def trial(kind: str, number: int) -> dict[str, Any]:
    """What is hidden in a trial, and what a diagnosis of the base model says of it."""
    for attempt in range(20):
        rng = np.random.default_rng([17, [*KINDS].index(kind), number, attempt])
        car, rig = fresh_car(rng, "fresh"), fresh_rig(rng, "fresh")
        used, _ = drawn_drives(car, rng)
        if kind in SMOOTH:
            used = smoothed(used)
        hidden, vehicle = hidden_of(kind, rng), stated(car, rng)
        sheet = Sheet(zeros=True, gains=True, latencies=True, seed=int(rng.integers(2**31)))
        runs: list[PreparedRun] = []
        try:
            for name, drive in used.items():
                motion = simulate_drive(car, drive, hidden, int(rng.integers(2**31)))
                table = exchange_run(motion, rig, int(rng.integers(2**31)), faults=[], sheet=sheet, name=name)
                runs.append(PreparedRun.of(kept(cropped(table, drive.duration)), vehicle, rig))
        except SimulationFailed:
            continue
        break
    else:
        raise RuntimeError(f"{kind} {number}: every car left the road")
    begin = time.process_time()
    base, known = base_model(vehicle, rig.wheel_reference), catalogue(vehicle, rig.wheel_reference)
    fitted = fit(Model.of(base), runs, FitOptions(draws=3))
    there = {effect.key for effect in base}
    found = diagnose(fitted, floor_of(fitted, DRAWS), [known[key] for key in known if key not in there])
    return {
        "kind": kind, "car": number, "seconds": time.process_time() - begin, "runs": [*used],
        "hidden": {h.name: h.size for h in hidden}, "verdict": found.verdict,
        "found": {c.key: [dict(c.shape), c.values, c.interval, [tie for tie, _ in c.ties]] for c in found.found},
        "sums": [[c.total.keys, c.total.value, c.total.half] for c in found.found if c.total is not None],
        "unlisted": [*found.unlisted_rows], "exceeded": found.grounds.tolerance_exceeded,
        "not_testable": sorted(c.key for c in found.candidates if not c.tested and c.key in {h.name for h in hidden}),
        "undecided": [c.key for c in found.candidates if c.answer.value == "undecided"],
    }  # fmt: skip


def read() -> list[dict[str, Any]]:
    """Trials that were run."""
    return [json.loads(line) for line in RESULTS.read_text(encoding="utf-8").splitlines()] if RESULTS.is_file() else []


def table(trials: Sequence[Mapping[str, Any]]) -> str:
    """One line a kind: how many of what is hidden is named, how often its size is within the interval, what else."""
    lines = [
        "| hidden at both axles | cars | named | size in interval | named wrongly | unlisted beside | not testable |",
        "|---|---:|---:|---:|---|---:|---:|",
    ]
    for kind in KINDS:
        these = [one for one in trials if one["kind"] == kind]
        if not these:
            continue
        right = [(key, one) for one in these for key in one["hidden"] if key in one["found"]]
        wrong = [key for one in these for key in one["found"] if key not in one["hidden"]]
        held = sum(_holds(one, key) for key, one in right)
        hidden = sum(len(one["hidden"]) for one in these)
        blind = sum(len(one["not_testable"]) for one in these)
        unlisted = sum(bool(one["unlisted"]) or one["exceeded"] for one in these)
        of = f"{len(right)} of {hidden}" if hidden else "–"
        sizes = f"{held} of {len(right)}" if right else "–"
        lines.append(f"| {kind} | {len(these)} | {of} | {sizes} | {_listed(wrong)} | {unlisted} | {blind} |")
    return "\n".join(lines)


def _holds(one: Mapping[str, Any], key: str) -> bool:
    """Whether the size of an effect found is within its interval; where it is known as a sum, whether that is."""
    for keys, value, half in one.get("sums", []):
        if key in keys:
            return bool(abs(value - sum(one["hidden"].get(member, 0.0) for member in keys)) <= half)
    _, values, interval, _ = one["found"][key]
    return bool(abs(values[0] - one["hidden"][key]) <= interval[0])


def _listed(keys: Collection[str]) -> str:
    return ", ".join(f"`{key}`" for key in sorted(keys)) or "–"


def write_page() -> None:
    """Put the table behind its mark in the page, up to the next empty line."""
    text = PAGE.read_text(encoding="utf-8")
    before, mark, after = text.partition(MARK)
    if not mark:
        raise RuntimeError(f"{PAGE} has no line {MARK}")
    rest = after.lstrip("\n").partition("\n\n")[2] if "|" in after[:4] else after.lstrip("\n")
    PAGE.write_text(f"{before}{mark}\n{table(read())}\n\n{rest}", encoding="utf-8")


def main(words: Sequence[str] | None = None) -> None:
    """Run the trials that have no result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--only", nargs="+", choices=[*KINDS], default=[*KINDS])
    parser.add_argument("--cars", nargs="+", type=int, default=[*range(CARS)])
    given = parser.parse_args(words)
    done: Collection[tuple[str, int]] = {(one["kind"], one["car"]) for one in read()}
    for number in given.cars:
        for kind in given.only:
            if (kind, number) not in done:
                with one_thread():
                    record = trial(kind, number)
                with RESULTS.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(record, ensure_ascii=False) + "\n")
                print(json.dumps(record, ensure_ascii=False), flush=True)
    write_page()


if __name__ == "__main__":
    main(sys.argv[1:])
