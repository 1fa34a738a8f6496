"""``lacet info``: contents of a file, and lists of channels, effects, rows and models."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from lacet.daq.channels import CHANNELS
from lacet.daq.errors import UsageError
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import ROWS, lacking, least, needs
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.commands.progress import Line
from lacet.services.render import effect_text, tables
from lacet.services.render.model_text import print_model
from lacet.services.render.row_needs import needs_text, not_recorded_lines
from lacet.services.render.run_channels import channels_text
from lacet.services.workspace.effect_list import list_effects
from lacet.services.workspace.model_tree import find_model, model_info

HELP = "show what a run, log, rig or vehicle file holds; list channels, effects, rows; the model of a car"
DESCRIPTION = """\
Show what a run, log, rig or vehicle file holds; list channels, effects or rows; or describe the model of a car.

  lacet info run.mcap            channels, rates, gaps and losses of a run; what cannot be formed from it
  lacet info rig.toml            sensors, latencies, tolerances
  lacet info vehicle.toml        geometry, with the source of every number
  lacet info --channels          the vocabulary of measurements
  lacet info --effects           the catalogue: effects of the base model, those that may be missing, sensor faults,
                                 and what cannot be missing because it is measured
  lacet info --effects coulomb   one family of it
  lacet info --rows              the rows of the equations and what each needs measured

  lacet info --model vehicle.toml                  the car's tree of 42 bodies, the parameters of its model, which of
                                                   them the equations determine at all, and why not the others
  lacet info --model vehicle.toml --reference hub  the same for wheel loads between wheel and hub
  lacet info --model sine.mcap brake.mcap          the same, and which of them these runs determine
  lacet info --model STUDY                         the same for the present version of a study and its runs"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "file", metavar="FILE", nargs="*", type=Path, help="a run, log, rig or vehicle file; see --model"
    )
    parser.add_argument("--map", metavar="FILE", type=Path, help="channel map of a log that another system wrote")
    parser.add_argument("--model", action="store_true", help="the model of a vehicle, a study or runs (any number)")
    parser.add_argument("--channels", action="store_true", help="list the vocabulary")
    parser.add_argument(
        "--effects", metavar="NAME", nargs="?", const="", help="list the catalogue of effects, or one family of it"
    )
    parser.add_argument("--rows", action="store_true", help="list the rows of the equations")
    parser.add_argument("--vehicle", help="vehicle file of --effects and --model (default: the shipped peugeot-406)")
    parser.add_argument("--rig", help="--model: rig file of the runs; default: the one in the first run")
    parser.add_argument(
        "--reference", choices=("contact", "hub"), help="wheel loads (default: of the runs, else contact)"
    )


def run(args: argparse.Namespace) -> int:
    """Print the information asked for."""
    for option in ("rig", "vehicle", "reference"):
        if getattr(args, option) is not None and not (args.model or args.rows or args.effects is not None):
            raise UsageError(f"--{option} goes with --model, --rows or --effects; a run alone is shown as recorded")
    status, result = DONE, dict[str, Any]()
    if args.channels:
        result["channels"] = _channels()
    if args.effects is not None:
        vehicle = Vehicle.load(args.vehicle or "peugeot-406")
        result["effects"] = _effects(vehicle, args.reference or "contact", args.effects)
    if args.rows:
        result["rows"] = _rows(args.reference or "contact")
    if args.model:
        with Line("info") as line:
            asked = find_model(args.file, args.reference, args.rig, args.vehicle, line.progress)
            result |= model_info(asked, line.progress)
        print_model(result["model"])
        status = WITH_LOSSES if result["model"]["warnings"] else DONE
    elif len(args.file) > 1:
        raise UsageError("one file at a time (several runs go with --model)")
    elif args.file:
        status, found = _file(args.file[0], args.map)
        result |= found
    elif not result:
        raise UsageError("name a file, or one of --channels, --effects, --rows, --model")
    write_result(args.json, "info", result)
    return status


def _channels() -> list[dict[str, Any]]:
    lines = [
        [
            c.name,
            " ".join(c.components) or "-",
            c.unit,
            c.axes,
            f"{c.rate:g}",
            f"{c.noise:g}",
            c.about + c.optional * " (optional)",
        ]
        for c in CHANNELS.values()
    ]
    print(tables.table(["channel", "components", "unit", "axes", "Hz", "noise 1 σ", "about"], lines, text_columns=7))
    return [{"name": c.name, "components": c.components, "unit": c.unit, "axes": c.axes} for c in CHANNELS.values()]


def _effects(vehicle: Vehicle, reference: str, name: str) -> list[dict[str, Any]]:
    found = list_effects(vehicle, reference, name)
    if name:
        pieces = [effect_text.family_text(family, found.variants, reference) for family in found.families]
        print("\n".join([*pieces, *(effect_text.excluded_text(one) for one in found.measured)]))
    else:
        print(effect_text.catalogue_text(found.families, found.variants, found.measured, reference))
    return found.records


def _rows(reference: str) -> list[dict[str, Any]]:
    print(needs_text(ROWS, reference))
    return [
        {"row": row, "unit": row.unit, "needs": needs(row, reference), "least": least(row, reference)} for row in ROWS
    ]


def _file(path: Path, map: Path | None = None) -> tuple[int, dict[str, Any]]:
    if path.suffix == ".toml":
        head = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
        return (DONE, _vehicle(Vehicle.load(path))) if "lacet-vehicle" in head else (DONE, _rig(Rig.load(path)))
    status, result = DONE, dict[str, Any]()
    if path.suffix == ".mcap" and map is None:
        status, result = _log(path)
        if not result["decoded"]:
            return status, result
    run_ = open_run(path, map)
    print(
        f"{run_.name}: {run_.duration:.1f} s, vehicle {run_.vehicle or '?'}, manoeuvre {run_.manoeuvre or '?'}, ",
        end="",
    )
    print(f"wheel loads {run_.wheel_reference or 'as the rig says'}, brakes {run_.brakes}")
    print(channels_text(run_.signals))
    reference = run_.wheel_reference or "contact"
    absent = {row: lacking(row, reference, run_.signals) for row in ROWS}
    if lacks := {row: channels for row, channels in absent.items() if channels}:
        print("Rows that cannot be formed:", *not_recorded_lines(lacks), sep="\n")
    if any(c not in run_.signals for row in ROWS if not absent[row] for c in needs(row, reference)):
        print("Other rows take what is missing from other channels, or assume it: lacet info --model RUN says how.")
    for mark in run_.marks:
        print(f"  marker '{mark.text}' at {mark.t:.2f} s")
    for problem in run_.problems:
        print(f"! {problem}")
    result |= {
        "run": run_.name, "duration": run_.duration, "vehicle": run_.vehicle, "manoeuvre": run_.manoeuvre,
        "channels": {name: len(s.t) for name, s in run_.signals.items()}, "problems": run_.problems,
        "marks": [{"t": mark.t, "text": mark.text} for mark in run_.marks],
        "rows_missing": lacks,
    }  # fmt: skip
    return (WITH_LOSSES if run_.problems else status), result


def _log(path: Path) -> tuple[int, dict[str, Any]]:
    log = LogReader(path)
    stop = log.stop
    print(f"{path.name}: run {log.start.run_id}, recorded by {log.start.software or 'unknown software'}")
    for source in log.sources():
        print(f"  raw {source}: {len(log.frames(source))} frames")
    if stop is None:
        print("! no closing record: the recording was cut off")
    else:
        print(f"  closed: {stop.reason}")
        for source, losses in stop.losses.items():
            lost = ", ".join(f"{cause} {count}" for cause, count in losses.items() if count)
            if lost:
                print(f"! {source}: {lost}")
    for line in log.damage:
        print(f"! {line}")
    damaged = stop is None or bool(log.damage)
    decoded = bool(log.channels())
    if not decoded:
        raw = "Only raw frames: lacet decode makes the channels of it."
        print(raw if log.sources() else "Neither raw frames nor channels: nothing was recorded in it.")
    return (WITH_LOSSES if damaged else DONE), {"log": str(path), "decoded": decoded, "damage": list(log.damage)}


def _rig(rig: Rig) -> dict[str, Any]:
    # Raises what is wrong.
    decoder = Decoder(replace(rig, sensors=tuple(one for one in rig.sensors if one.driver == "dbc")))
    print(f"rig {rig.name}: {rig.wheel_reference} wheel loads")
    lines = [
        [s.name, s.driver or "-", s.bus or "-", s.axes, f"{1e3 * s.latency:g}", s.clock, str(len(s.channels))]
        for s in rig.sensors
    ]
    print(tables.table(["sensor", "driver", "bus", "axes", "latency ms", "clock", "channels"], lines, text_columns=4))
    for note in decoder.notes:
        print(f"! {note}")
    return {"rig": rig.name, "sensors": [s.name for s in rig.sensors]}


def _vehicle(vehicle: Vehicle) -> dict[str, Any]:
    print(f"vehicle {vehicle.name}")
    lines = [
        [name, f"{q.value:.6g}", q.unit, q.source] for name, q in (*vehicle.numbers.items(), *vehicle.apriori.items())
    ]
    print(tables.table(["number", "value", "unit", "source"], lines, text_columns=4))
    return {"vehicle": vehicle.name, "numbers": {n: q.value for n, q in vehicle.numbers.items()}}
