"""Where lacet's model breaks on a car that is not of its class: the tables of docs/benchmarks/second-car.md.

    python -P benchmarks/second_car.py --folder .second-car

Each second car drives a sinus, a rough road and drive with lift-off, and a road with kerbs that is held out, 12 s each
(kept in the folder). The base model is fitted with the joint tables of a bench in the vehicle file, with the table of
its bump test and without any, then with both anti-roll bars added, which the mechanism has and the base model lacks,
then with damping across the rear axle and with a front wheel rate that rises with travel. Printed: error ÷ noise floor
of each row, parameters beside the mechanism's, the terms of the suspension rows that the model has no place for, from
the noise-free motion, and what fits to runs without noise leave, in noise floors of runs with noise.
"""

from __future__ import annotations

import argparse
import functools
import operator
import re
import shutil
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import lacet
from lacet.daq.channels import CORNERS
from lacet.identify.effects.base import AXLES, PhysicalEffect
from lacet.identify.effects.unknown_table import SLOPES, table_terms
from lacet.identify.regression.prepared_run import PreparedRun
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
MOUNTED = {"damper_mount.front": 0.0074, "damper_mount.rear": 0.0055}
"""Damping ÷ stiffness of the dampers' mounts [s]."""
BEYOND = ("spring_quadratic.rear", "damper_stroke.front", "damper_stroke.rear")
"""Further effects of runs without noise: wheel rates and ratios of levers that change with the travel."""
TABLES = ("joints", "bump", "none")
SETTINGS = ("duration=12", "sinus.amplitude=0.03")
DIAGNOSED = ("sinus", "rough", "spiral")
"""Manoeuvres of 20 s that a diagnosis is made of."""
LAWS = (*(key for step in ADDED.values() for key in step), "damper_mount.front", "damper_mount.rear")
"""Effects that the mechanism has and the base model lacks."""


TIMES = 1.2
"""Factor of a joint's tables of an axle that are made wrong in proportion."""
PARTS = ("fits", "terms", "travel", "noise-free", "no-tables", "pitch", "diagnosis")
"""What can be printed."""
MADE_WRONG = (
    "right",
    *(f"{axle}.{joint}" for axle in AXLES for joint in ("half_track", "half_wheelbase", "toe", "camber", "pitch")),
    "no-compliance", "none",
)  # fmt: skip
"""Tables that a diagnosis is given."""
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")


def drive(car: str, folder: Path, *more: str) -> None:
    """Simulate the runs of a car into the folder, if they are not there; `more` arguments of the command."""
    if (folder / f"{HELD}.parquet").exists():
        return
    words = ["simulate", "--rig", RIG, "--car", car, "--seed", "5", "--format", "parquet", "--force", "-o", str(folder)]
    words += [*more, *(word for name in (*USED, HELD) for word in ("--manoeuvre", name))]
    words += [word for setting in SETTINGS for word in ("--set", setting)]
    if command(words):
        raise SystemExit(f"{car}: not simulated")


def with_tables(text: str, tables: str) -> str:
    """The vehicle file of a car with these of its tables only: joints, those of the bump test, or none."""
    for part in {"joints": (), "bump": (".joints.",), "none": (".joints.", ".kinematics]")}[tables]:
        text = _without(text, part)
    return text


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


def noise_free(car: str, folder: Path) -> None:
    """Fit runs without noise by plain least squares, weighted by the floors of runs with it, and print what is left.

    With the joints of the vehicle file, and without their compliance.
    """
    drive(car, folder)
    still = folder / "noise-free"
    drive(car, still, "--no-noise", "--no-zeros")
    text = (still / f"{car}.toml").read_text(encoding="utf-8")
    floors: dict[str, float] = {}
    for tables in ("joints", "joints without compliance"):
        vehicle = still / f"{tables.replace(' ', '-')}.toml"
        vehicle.write_text(text if tables == "joints" else _without(text, ".compliance."), encoding="utf-8")
        files = {"rig": RIG, "vehicle": vehicle}
        if not floors:
            noisy = lacet.load_runs(*(folder / f"{name}.parquet" for name in USED), **files)
            scores = lacet.compare(lacet.fit(lacet.base_model(noisy), noisy)).runs[USED[0]].scores
            floors = {row: score.floor for row, score in scores.items()}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # channels that hardly vary count as dead where nothing else is noisy
            runs = lacet.load_runs(*(still / f"{name}.parquet" for name in (*USED, HELD)), **files)
        known = lacet.catalogue(runs)
        effects = [*lacet.base_model(runs).physics, *(known[key] for step in ADDED.values() for key in step)]
        effects += [known[key] for key in BEYOND]
        effects += [replace(known[key], shape={**known[key].shape, "T": T}) for key, T in MOUNTED.items()]
        values, left = _plain_fit(runs.prepared, effects, floors)
        lines = [[row, *(f"{part[row]:.2f}" for part in left.values())] for row in left[USED[0]]]
        print(f"\n{car}, no noise, {tables}: error ÷ floor of noise")
        print(table(["row", *left], lines))
        names = [parameter.name for effect in effects for parameter in effect.parameters]
        wanted = ("spring", "anti_roll_bar", "damper.", "axle_damping", "tyre_stiffness")
        print(", ".join(f"{k} {v:.5g}" for k, v in zip(names, values, strict=True) if k.startswith(wanted)))


def diagnosed_runs(car: str, folder: Path, seed: int) -> Path:
    """Folder of the runs that a diagnosis is made of, simulated if they are not there."""
    own = folder / f"diagnosed-{seed}"
    if not (own / f"{DIAGNOSED[-1]}.parquet").exists():
        words = ["simulate", "--rig", RIG, "--car", car, "--seed", str(seed), "--format", "parquet", "-o", str(own)]
        words += ["--set", "duration=20", *(word for name in DIAGNOSED for word in ("--manoeuvre", name))]
        if command(words):
            raise SystemExit(f"{car}: not simulated")
    return own


def wrong_tables(text: str, made: str) -> str:
    """The vehicle file of a car with its tables made wrong, as one of `MADE_WRONG` says."""
    if made == "right":
        return text
    if made == "none":
        return with_tables(text, "none")
    if made == "no-compliance":
        return _without(text, ".compliance.")
    axle, _, joint = made.partition(".")
    return scaled_tables(text, axle, joint, TIMES)


def scaled_tables(text: str, axle: str, joint: str, factor: float) -> str:
    """The vehicle file of a car with the tables of a joint by both travels multiplied, at both wheels of an axle."""
    sections = [f"[corner.{axle[0]}{side}.joints.{part}]" for side in "lr" for part in ("own", "other", "product")]
    out, section = [], ""
    for line in text.splitlines():
        section = line if line.startswith("[") else section
        if section in sections and line.startswith(f"{joint} ="):
            values, unit = line.split(", unit", 1)
            head, numbers = values.split("value = ", 1)
            line = f"{head}value = {_NUMBER.sub(lambda one: repr(factor * float(one[0])), numbers)}, unit{unit}"
        out.append(line)
    return "\n".join(out) + "\n"


def diagnosis(car: str, folder: Path, seed: int, made: Sequence[str]) -> None:
    """Diagnose the runs with the tables of the vehicle file made wrong, each in a study of its own, and print."""
    own = diagnosed_runs(car, folder, seed)
    text = (own / f"{car}.toml").read_text(encoding="utf-8")
    runs = [str(own / f"{name}.parquet") for name in DIAGNOSED]
    for one in made:
        vehicle, study = own / f"tables-{one}.toml", own / f"study-{one}"
        vehicle.write_text(wrong_tables(text, one), encoding="utf-8")
        print(f"\n{car}, tables: {one}", flush=True)
        began = time.process_time()
        shutil.rmtree(study, ignore_errors=True)
        new = ["study", "new", str(study), "--use", *runs, "--rig", RIG, "--vehicle", str(vehicle)]
        for words in (new, ["diagnose", str(study), "--auto"]):
            if command(words) not in (0, 3):  # 3: with warnings about the runs
                raise SystemExit(f"{car}, tables {one}: lacet {words[0]} failed")
        print(f"{time.process_time() - began:.0f} s of processor time")


def unknown_tables(car: str, folder: Path, seed: int) -> None:
    """Without tables: the laws by what the model has of the tables, and what is missing beside all terms of them."""
    own = diagnosed_runs(car, folder, seed)
    vehicle = own / "tables-none.toml"
    vehicle.write_text(with_tables((own / f"{car}.toml").read_text(encoding="utf-8"), "none"), encoding="utf-8")
    runs = lacet.load_runs(*(own / f"{name}.parquet" for name in DIAGNOSED), rig=RIG, vehicle=vehicle)
    known, base = lacet.catalogue(runs), lacet.base_model(runs)
    terms = [term for axle in AXLES for term in table_terms(axle)]
    steps = {"nothing": [], "slopes": [one for one in terms if isinstance(one, SLOPES)], "all terms": terms}
    cells: dict[str, list[str]] = {key: [key] for key in LAWS}
    for more in steps.values():
        fitted = lacet.fit(functools.reduce(operator.add, [*(known[key] for key in LAWS), *more], base), runs)
        for key in LAWS:
            (name,) = [q.name for q in known[key].parameters]
            half = 1.96 * np.sqrt((fitted.details.covariance + fitted.details.covariance_sheet).diagonal())
            at = fitted.details.model.names.index(name)
            cells[key].append(f"{fitted.details.theta[at]:.0f} ± {half[at]:.0f}")
    print(f"\n{car}, no tables, seed {seed}: laws beside what the model has of the tables")
    print(table(["law", *steps], list(cells.values())))
    there = {term.key for term in terms}
    effects = [effect for key, effect in known.items() if not effect.base and key not in there]
    began = time.process_time()
    ranked = lacet.rank(lacet.fit(functools.reduce(operator.add, terms, base), runs), effects)
    print(f"beside all terms, {time.process_time() - began:.0f} s of processor time: {ranked.explain()}")


def pitch_slopes(car: str, folder: Path, seed: int) -> None:
    """`pitch_change.rear` where the rear pitch is missing in the tables, as an error of right ones, and beside itself.

    Beside itself: with the slope found as the value of the tables' error, so that its column is linear about it.
    """
    own = diagnosed_runs(car, folder, seed)
    right = (own / f"{car}.toml").read_text(encoding="utf-8")
    none, found = scaled_tables(right, "rear", "pitch", 0.0), 0.0
    print(f"\n{car}, seed {seed}: slope p of the rear pitch [rad/m], and p J [kg·m], beside what the mechanism has")
    for name, text in (("right tables", right), ("none", none), ("that slope", none)):
        said = f'value = {found}, tolerance = 0, unit = "rad/m", source = "the fit without"'
        given = f"\n[assumed]\ntable_pitch_axle.rear = {{ {said} }}\n" if name == "that slope" else ""
        vehicle = own / f"pitch-{name.replace(' ', '-')}.toml"
        vehicle.write_text(text + given, encoding="utf-8")
        runs = lacet.load_runs(*(own / f"{one}.parquet" for one in DIAGNOSED), rig=RIG, vehicle=vehicle)
        known = lacet.catalogue(runs)
        effects = (known[key] for key in (*LAWS, *BEYOND, "pitch_change.rear"))
        fitted = lacet.fit(functools.reduce(operator.add, effects, lacet.base_model(runs)), runs)
        p, p_j = (one for one in fitted.parameters if one.name.startswith("pitch_change."))
        print(f"{name}: p {p.value:.3f} ± {p.half_sheet:.3f}, p J {p_j.value:.3f} ± {p_j.half_sheet:.3f}", flush=True)
        found = p.value


def _without(text: str, part: str) -> str:
    """A vehicle file without the tables that have this in their names."""
    out, skip = [], False
    for line in text.splitlines():
        if line.startswith("["):
            skip = part in line
        if not skip:
            out.append(line)
    return "\n".join(out) + "\n"


def _plain_fit(
    prepared: Sequence[PreparedRun], effects: Sequence[PhysicalEffect], floors: Mapping[str, float]
) -> tuple[np.ndarray, dict[str, dict[str, float]]]:
    """Least squares of the runs used: parameter values, and run → row → root mean square of the error ÷ floor."""
    parts = {(run.name, row): (run.matrix(effects, row), run.measured[row]) for run in prepared for row in run.rows}
    used = [(W / floors[row], y / floors[row]) for (name, row), (W, y) in parts.items() if name in USED]
    A, b = (np.concatenate(each) for each in zip(*used, strict=True))
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    values = np.linalg.lstsq(A / size, b, rcond=1e-7)[0] / size
    left: dict[str, dict[str, float]] = {}
    for (name, row), (W, y) in parts.items():
        left.setdefault(name, {})[row] = float(np.sqrt(np.mean((y - W @ values) ** 2))) / floors[row]
    return values, left


def damping(values: DesignValues, car: SecondCar) -> np.ndarray:
    """(4, 4) ∂Q/∂ṡ of the dampers [N·s/m] at the design position, their mounts not giving."""
    ratios = [(damper.damping, values.motion_ratio[damper.name]) for damper in car.linkage.dampers]
    return sum((c * np.outer(r, r) for c, r in ratios), np.zeros((4, 4)))


def by_travel(car: str) -> list[list[str]]:
    """Laws that the mechanism's wheel rate and damping are of, by travels of an axle's wheels to ± 40 mm, as rows.

    Of a motion in which the left wheel goes by s: ∂Q/∂s = k + 2 k2 s + 3 k3 s², damping c + p s + q |s|, by least
    squares of mechanical equilibria; by the names of the catalogue.
    """
    own = SecondCar.named(car)
    statics = Statics(Mechanism(own))
    s = np.linspace(-0.04, 0.04, 9)
    rows: list[list[str]] = []
    for name, right in (("bump", 1.0), ("roll", -1.0), ("one wheel", 0.0)):
        pattern = np.array([1.0, right, 1.0, right])
        found = [values_at(statics, statics.solve(x * pattern)) for x in s]
        for axle, (i, j) in {"front": (0, 1), "rear": (2, 3)}.items():
            rate, drag = (
                np.array([table[i, i] + right * table[i, j] for table in tables])
                for tables in ([v.wheel_rate for v in found], [damping(v, own) for v in found])
            )
            k = np.linalg.lstsq(np.column_stack([s**0, 2 * s, 3 * s**2]), rate, rcond=None)[0]
            c = np.linalg.lstsq(np.column_stack([s**0, s, np.abs(s)]), drag, rcond=None)[0]
            rows.append([f"{axle}, {name}", *(f"{value:,.0f}" for value in (*k, *c))])
    return rows


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
    parser.add_argument("--only", choices=PARTS, help="one part")
    parser.add_argument("--made", action="append", choices=MADE_WRONG, help="tables of a diagnosis; default: each")
    parser.add_argument("--seed", type=int, default=1, help="of the runs of no-tables, pitch and diagnosis")
    args = parser.parse_args()
    for car in args.car or CARS:
        if args.only in (None, "fits"):
            drive(car, args.folder / car)
            for tables in args.table or TABLES:
                fits(car, args.folder / car, tables)
        if args.only in (None, "noise-free"):
            noise_free(car, args.folder / car)
        if args.only == "no-tables" or (args.only is None and car == CARS[0]):
            unknown_tables(car, args.folder / car, args.seed)
        if args.only == "pitch":
            pitch_slopes(car, args.folder / car, args.seed)
        if args.only == "diagnosis":
            diagnosis(car, args.folder / car, args.seed, args.made or MADE_WRONG)
        if args.only in (None, "travel"):
            print(f"\n{car}: wheel rate [N/m, N/m², N/m³] and damping [N·s/m, N·s/m²] of the mechanism by travel")
            head = ["motion", "k", "spring_quadratic", "spring_cubic", "c", "damper_stroke", "damper_stroke_symmetric"]
            print(table(head, by_travel(car)))
        if args.only in (None, "terms"):
            for name, settings in (("sinus", {"amplitude": 0.03}), ("rough", {})):
                motion = run(SecondCar.named(car), make_manoeuvre(name, duration=4.0, **settings), seed=5, settle=1.0)
                lines = [[term, *(f"{v:.0f}" for v in values)] for term, values in missing(car, motion).items()]
                print(f"\n{car}, {name}: terms without a place in the model [N, 1 σ]")
                print(table(["term", *CORNERS], lines))


if __name__ == "__main__":
    main()
