"""``lacet simulate``: simulate runs of a car whose parameters are known."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.result import DONE, plain, write_result
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.services.acquisition.capture import encode_rig, simulated_start, write_capture
from lacet.services.commands.progress import Line
from lacet.services.progress import ServiceStage, ServiceStep, planned
from lacet.services.timing.usual import drives_plan
from lacet.simulate import (
    KINDS,
    MANOEUVRES,
    START_NS,
    Car,
    CarMotion,
    Hidden,
    Manoeuvre,
    Sheet,
    exchange_run,
    make_manoeuvre,
    measure,
)
from lacet.simulate import (
    run as drive,
)
from lacet.simulate.kinds import listed
from lacet.simulate.known_cars import KNOWN_CARS, known_car
from lacet.simulate.linkage import SecondCar
from lacet.simulate.linkage.hidden_laws import POSSIBLE
from lacet.simulate.measuring import drawn
from lacet.simulate.vehicle_file import vehicle_text

HELP = "drive a simulated car and write what its sensors measure"
DESCRIPTION = f"""\
Drive a car of known parameters through manoeuvres and write what the sensors of a rig measure: captures of raw bytes,
as if recorded from the wires, or exchange tables at one rate. Hidden effects are what the car has and the base model
lacks; the truth (every parameter and hidden effect) is written only where --truth says, apart from the runs.

  lacet simulate --rig peugeot-406 --manoeuvre sinus --manoeuvre liftoff -o runs
  lacet simulate --rig rig.toml --manoeuvre rough --set grade=C --format parquet -o runs
  lacet simulate --rig rig.toml --manoeuvre sinus --manoeuvre rough --set rough.grade=C --set duration=20 -o runs
  lacet simulate --rig rig.toml --vehicle my-car.toml --manoeuvre sinus -o runs       a car like that of a vehicle file
  lacet simulate --rig rig.toml --manoeuvre sinus --hide anti_roll_bar.front=19780 --seed 3 -o runs --truth truth.json
  lacet simulate --rig rig.toml --manoeuvre rough --hide bump_stop.front=200000,gap=0.02 -o runs
  lacet simulate --rig rig.toml --car second --manoeuvre sinus -o runs       a car on linkages (docs/second-car.md)
  lacet simulate --rig rig.toml --manoeuvre sinus --noise 2 -o runs      twice the noise the rig file says

{fill(f"Manoeuvres: {', '.join(MANOEUVRES)}. Cars: {', '.join(KNOWN_CARS)}.", 118)}
{fill(f"Hidden effects: {', '.join(KINDS)}.", 118)}
`lacet simulate --hide` alone lists them with law, unit and constants. Those of an axle end in .front or .rear, laws of
a suspension also in one corner (coulomb.fl), those of a sensor in its name (sensor_latency.imu).
The vehicle file to identify with is written beside the runs.

Gains and latencies belong to the instruments: runs of one command share theirs. For runs of the same car made by
several commands give each its own --seed, and all the same --sheet-seed.

From a vehicle file come geometry and what its [apriori] table says (mass, spring.fl.k, …); the rest is usual for the
size and is printed. Bench tables are not simulated: wheel centres move along body z. Those of the cars called second
hang on linkages, and their vehicle file has the joint tables of a bench; these hide sensor faults and
{", ".join(POSSIBLE)},
suspension laws along springs and dampers."""

HOUR_NS = 3_600_000_000_000
RUN_STEP = 1000
"""Difference of the seeds of successive runs of a campaign, so that campaigns of other seeds share no run."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "--vehicle",
        "--car",
        default="peugeot-406",
        metavar="CAR",
        help="simulated car (default peugeot-406), or a vehicle file",
    )
    parser.add_argument("--rig", required=True, metavar="FILE", help="rig file, or the name of one shipped with lacet")
    parser.add_argument(
        "--manoeuvre", action="append", required=True, metavar="NAME", help="what is driven; again for more runs"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a setting of all manoeuvres, or of one (rough.grade=C): speed=25 (m/s), duration=30 (s), "
        "amplitude=0.03 (rad), grade=C …",
    )
    parser.add_argument(
        "--hide",
        action=_Hide,
        nargs="?",
        default=[],
        metavar="EFFECT=SIZE",
        help="add a hidden effect, SI units; alone: list all with law, unit and constants",
    )
    parser.add_argument("--seed", type=int, default=0, help="of road, noise and zeros (default 0)")
    parser.add_argument("--sheet-seed", type=int, metavar="SEED", help="of gains and latencies (default --seed)")
    parser.add_argument("--format", choices=("capture", "parquet"), default="capture", help="default capture (.mcap)")
    parser.add_argument("--rate", type=float, default=250.0, metavar="HZ", help="of exchange tables (default 250)")
    parser.add_argument("--no-noise", action="store_true", help="leave the sensors' white noise out")
    parser.add_argument(
        "--noise", type=float, default=1.0, metavar="FACTOR", help="white noise as a multiple of the rig's (default 1)"
    )
    parser.add_argument("--no-zeros", action="store_true", help="do not draw sensor zeros from the rig's tolerances")
    parser.add_argument("--gains", action="store_true", help="draw sensor gains from the rig's tolerances, too")
    parser.add_argument("--latencies", action="store_true", help="draw latency errors from the rig's tolerances, too")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the runs")
    parser.add_argument("--truth", type=Path, metavar="FILE", help="write what was put in (JSON); not into DIR")
    parser.add_argument("--force", action="store_true", help="replace runs of the same name")


def run(args: argparse.Namespace) -> int:
    """Simulate. Returns 0 when every run is written."""
    rig = Rig.load(args.rig)
    car, bars, assumed = _car(args.vehicle, rig)
    hidden = [*bars, *(Hidden.parse(text) for text in args.hide)]
    settings = _settings(args)
    manoeuvres = [make_manoeuvre(name, **settings[name]) for name in args.manoeuvre]
    noise = 0.0 if args.no_noise else args.noise
    if noise < 0.0:
        raise UsageError(f"--noise {noise:g}: a factor of at least 0")
    sheet_seed = args.seed if args.sheet_seed is None else args.sheet_seed
    sheet = Sheet(not args.no_zeros, args.gains, args.latencies, sheet_seed)
    suffix = ".mcap" if args.format == "capture" else ".parquet"
    files = [args.output / f"{name}{suffix}" for name in _names(manoeuvres)]
    vehicle_file = args.output / f"{car.name}.toml"
    _check_places(args, [*files, vehicle_file])
    args.output.mkdir(parents=True, exist_ok=True)
    text = vehicle_text(car)
    vehicle_file.write_text(text, encoding="utf-8")
    runs, truths = [], []
    with Line("simulate") as line:
        line.progress(planned(drives_plan((one.name, one.duration) for one in manoeuvres)))
        for index, (manoeuvre, file) in enumerate(zip(manoeuvres, files, strict=True)):
            name = manoeuvre.name
            seed = args.seed + RUN_STEP * index
            motion = drive(
                car, manoeuvre, hidden, seed,
                progress=lambda part, name=name: line.progress(
                    ServiceStep(ServiceStage.DRIVING, round(100 * part), 100, name)
                ),
            )  # fmt: skip
            line.progress(ServiceStep(ServiceStage.MEASURING, subject=name))
            start_ns = START_NS + index * HOUR_NS
            if args.format == "capture":
                _capture(file, motion, rig, text, seed, sheet, noise, start_ns)
            else:
                table = exchange_run(motion, rig, seed, rate=args.rate, sheet=sheet, noise=noise)
                file.unlink(missing_ok=True)
                write_table(table, file)
            runs.append({"file": str(file), "manoeuvre": motion.manoeuvre, "duration_s": float(motion.t[-1])})
            truths.append({"file": file.name, "sheet": _sheet(sheet, noise, rig, seed), **motion.truth()})
    if args.truth is not None:
        args.truth.parent.mkdir(parents=True, exist_ok=True)
        document = {"format": "lacet-truth 1", "runs": truths}
        args.truth.write_text(json.dumps(plain(document), indent=1) + "\n", encoding="utf-8")
    for row in runs:
        print(f"{row['file']}: {row['manoeuvre']}, {row['duration_s']:g} s")
    print(f"{vehicle_file}: geometry of the car, to identify with")
    if assumed:
        print(f"not in {args.vehicle}, taken as usual: {', '.join(assumed)}")
    write_result(args.json, "simulate", {"runs": runs, "vehicle_file": str(vehicle_file), "rig": rig.name})
    return DONE


def _car(named: str, rig: Rig) -> tuple[Car | SecondCar, tuple[Hidden, ...], tuple[str, ...]]:
    """The car, its anti-roll bars, and the assumptions about it."""
    if named in KNOWN_CARS or not named.endswith(".toml"):
        return known_car(named), (), ()
    from lacet.services.planning.nominal_car import known_values, planned_car  # imports the identification: 2 s

    vehicle = Vehicle.load(named)
    like = planned_car(vehicle, known_values(vehicle, None, rig.wheel_reference))
    return replace(like.car, name=vehicle.name), like.bars, like.assumed


class _Hide(argparse.Action):
    """Action that collects effects; without a value it lists the known ones and exits."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, values: Any, option_string: Any = None) -> None:
        if values is None:
            print(listed())
            parser.exit(0)
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), values])


def _setting(text: str) -> tuple[str, Any]:
    key, found, value = text.partition("=")
    if not found or not key or not value:
        raise UsageError(f"--set {text}: write KEY=VALUE, e.g. --set amplitude=0.03")
    for kind in (int, float):
        try:
            return key, kind(value)
        except ValueError:
            continue
    return key, value


def _settings(args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Settings by manoeuvre: those for all, overridden by its own."""
    for_all: dict[str, Any] = {}
    own: dict[str, dict[str, Any]] = {name: {} for name in args.manoeuvre}
    for text in args.set:
        key, value = _setting(text)
        manoeuvre, found, field = key.rpartition(".")
        if found and manoeuvre not in own:
            raise UsageError(f"--set {text}: '{manoeuvre}' is not driven{nearest(manoeuvre, own) or '.'}")
        (own[manoeuvre] if found else for_all)[field] = value
    return {name: {**for_all, **settings} for name, settings in own.items()}


def _names(manoeuvres: list[Manoeuvre]) -> list[str]:
    """File names of the runs: the manoeuvre's, numbered where one is driven more than once."""
    names = [manoeuvre.name for manoeuvre in manoeuvres]
    return [name if names.count(name) == 1 else f"{name}-{names[:i].count(name) + 1}" for i, name in enumerate(names)]


def _check_places(args: argparse.Namespace, files: list[Path]) -> None:
    there = [str(file) for file in files[:-1] if file.exists()]
    if there and not args.force:
        raise UsageError(f"{', '.join(there)}: already there; give another folder, or --force to replace")
    if args.truth is not None and args.truth.resolve().parent == args.output.resolve():
        raise UsageError(f"--truth {args.truth}: the truth is not kept among the runs; name another folder")
    if files[-1].resolve() == Path(args.vehicle).resolve():
        raise UsageError(f"{files[-1]} would be replaced by the geometry of the simulated car; give another folder")


def _sheet(sheet: Sheet, noise: float, rig: Rig, seed: int) -> dict[str, Any]:
    return {**drawn(rig, seed, sheet), "seed": sheet.seed, "noise_scale": noise}


def _capture(
    file: Path, motion: CarMotion, rig: Rig, vehicle: str, seed: int, sheet: Sheet, noise: float, start_ns: int
) -> None:
    blocks = measure(motion, rig, seed, sheet=sheet, noise=noise, start_ns=start_ns)
    frames, documents = encode_rig(blocks, rig)
    start = replace(simulated_start(file.stem, motion, rig, vehicle, start_ns), documents=documents)
    write_capture(file, frames, start, overwrite=True)
