"""Where lacet's model breaks on a car that is not of its class: the tables of docs/benchmarks/second-car.md.

    python -P benchmarks/second_car.py --folder .second-car

Each second car drives a sinus, a rough road and drive with lift-off, and a road with kerbs that is held out, 12 s each
(kept in the folder). The base model is fitted with the joint tables of a bench in the vehicle file, with the table of
its bump test and without any, then with both anti-roll bars added, which the mechanism has and the base model lacks,
then with damping across the rear axle and with a front wheel rate that rises with travel. Printed: error ÷ noise floor
of each row, parameters beside the mechanism's, and the terms of the suspension rows that the model has no place for,
from the noise-free motion.
"""

from __future__ import annotations

import argparse
import functools
from pathlib import Path

import numpy as np

import lacet
from lacet.daq.channels import CORNERS
from lacet.services.commands.__main__ import main as command
from lacet.services.render.tables import table
from lacet.simulate import make_manoeuvre, run
from lacet.simulate.linkage import SecondCar
from lacet.simulate.linkage.mechanism import Mechanism
from lacet.simulate.linkage.motion import LinkageMotion
from lacet.simulate.linkage.statics import Statics
from lacet.simulate.linkage.truth import DesignValues, values_at

CARS = ("second", "second-live-axle", "second-rigid", "second-live-axle-rigid")
USED, HELD = ("sinus", "rough", "liftoff"), "kerb"
ADDED = {
    "bars": ("anti_roll_bar.front", "anti_roll_bar.rear"),
    "damping": ("axle_damping.rear",),
    "progression": ("spring_quadratic.front",),
}
"""Effects added to the base model, one step after the other: the mechanism has them all."""
RIG = "peugeot-406"
TABLES = ("joints", "bump", "none")
SETTINGS = ("duration=12", "sinus.amplitude=0.03")


def drive(car: str, folder: Path) -> None:
    """Simulate the runs of a car into the folder, if they are not there."""
    if (folder / f"{HELD}.parquet").exists():
        return
    words = ["simulate", "--rig", RIG, "--car", car, "--seed", "5", "--format", "parquet", "--force", "-o", str(folder)]
    words += [word for name in (*USED, HELD) for word in ("--manoeuvre", name)]
    words += [word for setting in SETTINGS for word in ("--set", setting)]
    if command(words):
        raise SystemExit(f"{car}: not simulated")


def with_tables(text: str, tables: str) -> str:
    """The vehicle file of a car with these of its tables only: joints, those of the bump test, or none."""
    unwanted = {"joints": (), "bump": (".joints.",), "none": (".joints.", ".kinematics]")}[tables]
    out, skip = [], False
    for line in text.splitlines():
        if line.startswith("["):
            skip = any(part in line for part in unwanted)
        if not skip:
            out.append(line)
    return "\n".join(out) + "\n"


def fits(car: str, folder: Path, tables: str) -> None:
    """Fit and compare with these of `TABLES`, without and with the bars, and print."""
    text = (folder / f"{car}.toml").read_text(encoding="utf-8")
    vehicle = folder / f"tables-{tables}.toml"
    vehicle.write_text(with_tables(text, tables), encoding="utf-8")
    files = {"rig": RIG, "vehicle": vehicle}
    runs = lacet.load_runs(*(folder / f"{name}.parquet" for name in USED), **files)
    held = lacet.load_runs(folder / f"{HELD}.parquet", **files)
    base = lacet.fit(lacet.base_model(runs), runs)
    steps = {"base": base}
    for step, effects in ADDED.items():
        steps[step] = functools.reduce(lacet.add, effects, steps[next(reversed(steps))])
    print(f"\n{car}, tables: {tables}")
    ratios = {}
    for name, fitted in steps.items():
        for where, part in (("", None), (" held", held)):
            for of, rows in lacet.compare(fitted, part).ratios.items():
                ratios[f"{name} {of}{where}"] = rows
    rows = list(dict.fromkeys(row for one in ratios.values() for row in one))
    lines = [[row, *(f"{one[row]:.2f}" if row in one else "" for one in ratios.values())] for row in rows]
    print(table(["row", *ratios], lines))
    for name, fitted in steps.items():
        print(f"\n{car}, tables: {tables}, {name}\n{fitted.summary()}")


def damping(values: DesignValues, car: SecondCar) -> np.ndarray:
    """(4, 4) ∂Q/∂ṡ of the dampers [N·s/m] at the design position, their mounts not giving."""
    ratios = [(damper.damping, values.motion_ratio[damper.name]) for damper in car.linkage.dampers]
    return sum((c * np.outer(r, r) for c, r in ratios), np.zeros((4, 4)))


def missing(car: str, motion: LinkageMotion) -> dict[str, np.ndarray]:
    """Root mean squares (4,) [N] of terms of the suspension rows that the model has no place for."""
    own = SecondCar.named(car)
    statics = Statics(Mechanism(own))
    values = values_at(statics, statics.solve(np.zeros(4)))
    turned = [values_at(statics, statics.solve(np.zeros(4), rack)) for rack in (0.01, -0.01)]
    rack = motion.q[:, statics.mechanism.rack_q]
    force, moment = motion.force, motion.moment
    speed = np.gradient(motion.travel, 1.0 / motion.rate, axis=0)
    pull = np.gradient(speed, 1.0 / motion.rate, axis=0)
    out = {
        name: np.zeros(4)
        for name in (
            "other wheel's load",
            "table of bump for one wheel",
            "rack",
            "damper of the other wheel",
            "mass of the other wheel",
        )
    }
    C, M = damping(values, own), values.unsprung_mass

    def work(j: int, path: np.ndarray, turn: np.ndarray) -> np.ndarray:
        return force[:, j, :2] @ path + moment[:, j] @ turn

    for i in range(4):
        j = i ^ 1
        plus, minus = turned
        by_rack = (plus.path[i, i] - minus.path[i, i]) / 0.02, (plus.turn[i, i] - minus.turn[i, i]) / 0.02
        terms = {
            "other wheel's load": work(j, values.path[j, i], values.turn[j, i]),
            "table of bump for one wheel": work(i, values.path[i, j], values.turn[i, j]),
            "rack": rack * work(i, *by_rack),
            "damper of the other wheel": C[i, j] * speed[:, j],
            "mass of the other wheel": M[i, j] * pull[:, j],
        }  # fmt: skip
        for name, term in terms.items():
            out[name][i] = np.std(term)
    return out


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, required=True, help="for the runs")
    parser.add_argument("--car", action="append", choices=CARS, help="default: all")
    parser.add_argument("--table", action="append", choices=TABLES, help="bench tables of the fits; default: each")
    parser.add_argument("--only", choices=("fits", "terms"), help="one part")
    args = parser.parse_args()
    for car in args.car or CARS:
        if args.only != "terms":
            drive(car, args.folder / car)
            for tables in args.table or TABLES:
                fits(car, args.folder / car, tables)
        if args.only != "fits":
            for name, settings in (("sinus", {"amplitude": 0.03}), ("rough", {})):
                motion = run(SecondCar.named(car), make_manoeuvre(name, duration=4.0, **settings), seed=5, settle=1.0)
                lines = [[term, *(f"{v:.0f}" for v in values)] for term, values in missing(car, motion).items()]
                print(f"\n{car}, {name}: terms without a place in the model [N, 1 σ]")
                print(table(["term", *CORNERS], lines))


if __name__ == "__main__":
    main()
