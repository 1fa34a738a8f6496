"""``lacet export``: an identified car, its results, or a run in the formats of other programs."""

from __future__ import annotations

import argparse
import fnmatch
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from lacet.daq.errors import RunError, UsageError, nearest
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.services.exports.files import Form, export_car, form_of, replacing

HELP = "write an identified car, its results or a run in the formats of other programs"
DESCRIPTION = """\
SOURCE is a study's folder (its present version is exported), or a run. The suffix of FILE says the format.

An identified car:
  lacet export STUDY -o car.toml         vehicle file, the identified values as a-priori values
  lacet export STUDY -o car.xml          MJCF: MuJoCo simulates it by itself
  lacet export STUDY -o car.urdf         URDF: tree, inertias, joint damping (the format has no springs)
  lacet export STUDY -o car.yaml         CommonRoad vehicle parameters
  lacet export STUDY -o car.mat          MATLAB: parameters, derived values, intervals, units, errors, ranking

Its results:
  lacet export STUDY -o result.json      everything (docs/json.md)
  lacet export STUDY -o values.csv       parameters, whole vehicle, derived values; .parquet the same
  lacet export STUDY -o e.csv --as errors        error of every row of every run; --as ranking: missing effects

A run:
  lacet export RUN -o run.mf4            decoded channels as MDF, with units and comments
  lacet export RUN -o rows.mcap          one message a sample, for Foxglove, Lichtblick, PlotJuggler, Rerun

What a format cannot hold is listed. MJCF and URDF need the extra 'consistency' (docs/export.md).
Exit code 3 when a log is damaged: what is whole is exported."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("source", metavar="SOURCE", type=Path, help="study's folder, or run")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="file to write")
    parser.add_argument(
        "--as", dest="form", metavar="FORM", help=f"where the suffix says too little: {', '.join(f.word for f in Form)}"
    )
    parser.add_argument("--rows", action="store_true", help="the same as --as rows")
    parser.add_argument("--version", type=int, help="version of the study (default: the present one)")
    parser.add_argument(
        "--channels", metavar="NAME", nargs="+", action="extend", help="of a run: channels, * stands for anything"
    )
    parser.add_argument("--map", metavar="MAP", type=Path, help="channel map of a log that another system wrote")
    parser.add_argument("--force", action="store_true", help="replace FILE if it exists")


def run(args: argparse.Namespace) -> int:
    """Export a study or a run."""
    if args.rows and args.form not in (None, Form.ROWS.word):
        raise UsageError(f"--rows and --as {args.form} contradict each other: give one of them")
    word = Form.ROWS.word if args.rows else args.form
    if not args.source.exists():
        raise UsageError(f"{args.source}: no such study or run")
    if args.source.is_dir():
        return _study(args, form_of(args.output, word, of_run=False))
    form = form_of(args.output, word, of_run=True)
    if args.version is not None:
        raise UsageError(f"--version goes with a study, and {args.source} is a run")
    if args.output.exists() and args.output.samefile(args.source):
        raise UsageError(f"{args.output} exists and is what is to be exported: give another name")
    return (_rows if form is Form.ROWS else _run)(args)


def _study(args: argparse.Namespace, form: Form) -> int:
    # Only here: a run is exported without what a study needs.
    from lacet.identify.validation.score import fails, worst_row
    from lacet.services.commands.progress import Line
    from lacet.services.exports.study import identified
    from lacet.services.workspace.study import Study

    for option, given in (("--channels", args.channels), ("--map", args.map)):
        if given:
            raise UsageError(f"{option} goes with a run, and {args.source} is a study")
    study = Study.open(args.source)
    with Line("export") as line:
        written = export_car(identified(study, args.version, line.progress), args.output, form, args.force)
    print(f"{written.path}: {form.about}\n  {written.says}")
    if written.left_out:
        print("not in it, or not from the runs:")
        for name, why in written.left_out.items():
            print(f"  {name}: {why}")
    where, ratio = worst_row(study.version(args.version).result["rows"]["used"])
    if fails(ratio):
        print(
            f"! this version fails ({where}, {ratio:.2f} times its noise floor): its values may be off by more than "
            f"their intervals say. Whether an effect is missing: lacet diagnose {args.source}; when: lacet where "
            f"{args.source}"
        )
    write_result(args.json, "export", {"output": args.output, "form": form.word, "left_out": dict(written.left_out)})
    return DONE


def _run(args: argparse.Namespace) -> int:
    # Only here: maps and their units are not needed for rows.
    from lacet.daq.formats.log_run import damage_of_raw_log
    from lacet.daq.formats.mf4_write import write_mf4
    from lacet.daq.formats.open_run import is_own, open_run

    found = open_run(args.source, args.map)
    names = _chosen(args.source, list(found.signals), args.channels)
    found = replace(found, signals={name: found.signals[name] for name in names})
    own_log = args.source.suffix.lower() == ".mcap" and is_own(args.source)
    log = LogReader(args.source) if own_log else None
    with replacing(args.output, args.force) as part:
        write_mf4(found, part, log.start.started_ns if log else None)
    samples = {name: len(signal.t) for name, signal in found.signals.items()}
    damage = [*log.damage, *damage_of_raw_log(log.start)] if log else []
    for line in found.problems:
        if line not in damage:
            print(f"! {line}")
    return _done(args, Form.RUN, samples, damage)


def _rows(args: argparse.Namespace) -> int:
    from lacet.services.exports.rows import write_rows

    reader = LogReader(args.source)
    if not reader.channels():
        raise RunError(args.source, ["raw frames only: run 'lacet decode' first"])
    blocks = reader.blocks(_chosen(reader.path, reader.channels(), args.channels))
    with replacing(args.output, args.force) as part:
        write_rows(part, blocks)
    return _done(args, Form.ROWS, {name: len(block) for name, block in blocks.items()}, reader.damage)


def _done(args: argparse.Namespace, form: Form, samples: dict[str, int], damage: Iterable[str]) -> int:
    lines = list(damage)
    for line in lines:
        print(f"damaged: {line}")
    print(f"{args.output}: {sum(samples.values()):,} samples of {len(samples)} channels")
    result: dict[str, Any] = {"output": args.output, "form": form.word, "samples": samples, "damage": lines}
    write_result(args.json, "export", result)
    return WITH_LOSSES if lines else DONE


def _chosen(path: Path, known: Iterable[str], patterns: list[str] | None) -> list[str]:
    known = list(known)
    for pattern in patterns or ():
        if not fnmatch.filter(known, pattern):
            raise UsageError(f"{path}: no channel '{pattern}'{nearest(pattern, known)}; has {', '.join(known)}")
    return [name for name in known if any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns or ["*"])]
