"""``lacet bench``: put a simulated car on a virtual kinematics and compliance bench."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from textwrap import fill

from lacet.daq.bench_compliance import MeasuredCompliance, tables_with_compliance
from lacet.daq.bench_readings import read_bench
from lacet.daq.compliance import JOINTS
from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.result import DONE, write_result
from lacet.daq.joint_tables import CURVES, joints_text
from lacet.simulate.linkage import SECOND_CARS, SecondCar
from lacet.simulate.linkage.bench import Bench, bench_tests, find_test
from lacet.simulate.linkage.mechanism import Mechanism

HELP = "measure a simulated car on a virtual kinematics and compliance (K&C) bench, or read the tables of a real one"
DESCRIPTION = f"""\
Clamp the body of a car on linkages at its design height, move and load its wheels through the tests of a K&C bench, and
write what such rigs deliver: one CSV a test, and a picture of them all. Columns, units and signs: docs/bench.md.

  lacet bench --car second -o bench                                all tests
  lacet bench --car second-live-axle --test bump --test roll -o bench
  lacet bench --car second --noise 1 --seed 3 -o bench             with the repeatability of a usual rig

With TABLES, those of any bench are read instead (names by --map), checked for units, signs and sides, and joint tables
are made of them: [corner.….joints] of a vehicle file, against own travel, the other wheel's travel and the rack, and
the compliance by loads.

  lacet bench left.csv right.csv steer.csv grid.csv --map rig.map.toml -o joints.toml

{fill(f"Tests: {', '.join(bench_tests())}.", 118)}
{fill(f"Cars: {', '.join(SECOND_CARS)}.", 118)}"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("tables", nargs="*", type=Path, metavar="TABLES", help="text tables of a bench")
    parser.add_argument("--map", type=Path, metavar="MAP", help="which of their columns is which (docs/bench.md)")
    parser.add_argument("--car", default="second", metavar="CAR", help="simulated car on linkages (default second)")
    parser.add_argument("--test", action="append", metavar="NAME", help="a test; again for more (default: all)")
    parser.add_argument(
        "--noise", type=float, default=0.0, metavar="FACTOR", help="repeatability of a usual rig × FACTOR"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the noise (default 0)")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="PLACE", help="folder, or with TABLES the file, to write"
    )
    parser.add_argument("--force", action="store_true", help="replace tables of the same name")


def run(args: argparse.Namespace) -> int:
    """Run the tests, or read tables. Returns 0 when all is written."""
    if args.tables:
        return _read(args)
    if args.map is not None:
        raise UsageError("--map goes with the tables of a bench: name them")
    # Only here: matplotlib takes half a second to load.
    from lacet.services.render.figures.bench_plots import bench_picture

    if args.car not in SECOND_CARS:
        known = ", ".join(SECOND_CARS)
        raise UsageError(
            f"no car on linkages is called '{args.car}'{nearest(args.car, SECOND_CARS) or '.'} Known: {known}"
        )
    if args.noise < 0.0:
        raise UsageError(f"--noise {args.noise:g}: a factor of at least 0")
    tests = [find_test(name) for name in dict.fromkeys(args.test or bench_tests())]
    files = [args.output / f"{test.name}.csv" for test in tests]
    picture = args.output / "bench.png"
    there = [str(file) for file in (*files, picture) if file.exists()]
    if there and not args.force:
        raise UsageError(f"{', '.join(there)}: already there; give another folder, or --force to replace")
    args.output.mkdir(parents=True, exist_ok=True)
    bench = Bench(Mechanism(SecondCar.named(args.car)), args.noise, args.seed)
    columns = {}
    for test, file in zip(tests, files, strict=True):
        table = bench.run(test)
        file.write_text(table.csv(), encoding="utf-8")
        columns[test.name] = table.columns
        print(f"{file}: {test.moved}, {len(test.steps)} steps")
    picture.write_bytes(bench_picture(args.car, columns))
    print(f"{picture}: all of them, drawn")
    written = [
        {"test": test.name, "file": str(file), "steps": len(test.steps)}
        for test, file in zip(tests, files, strict=True)
    ]
    write_result(args.json, "bench", {"car": args.car, "tables": written, "picture": str(picture)})
    return DONE


def _read(args: argparse.Namespace) -> int:
    """Joint tables of the tables given."""
    if args.output.exists() and not args.force:
        raise UsageError(f"{args.output}: already there; give another name, or --force to replace")
    joints, given = tables_with_compliance(read_bench(args.tables, args.map))
    args.output.write_text(
        joints_text(joints, f"bench: {', '.join(file.name for file in args.tables)}"), encoding="utf-8"
    )
    for corner, table in joints.items():
        curves = [name for name in CURVES if getattr(table, name) is not None]
        error = ", ".join(f"{joint} {_shown(value, JOINTS[joint])}" for joint, value in table.mixed.items())
        print(f"{corner}: against {', '.join(curves)}; largest error of mixed terms: {error or 'not measured'}")
        if corner in given:
            print(f"{corner}: {_compliance(given[corner])}")
    print(f"{args.output}: joints of the corners, for the vehicle file")
    mixed = {corner: dict(table.mixed) for corner, table in joints.items()}
    compliance = {
        c: {"loads": [*one.slopes.own], "bend": dict(one.bend), "together": [*one.together]} for c, one in given.items()
    }
    write_result(args.json, "bench", {"joints": str(args.output), "mixed": mixed, "compliance": compliance})
    return DONE


def _compliance(given: MeasuredCompliance) -> str:
    """What is known of a corner's compliance, in a sentence."""
    bend = ", ".join(f"{joint} {_shown(value, JOINTS[joint])}" for joint, value in given.bend.items())
    known = f"compliance by {', '.join(given.slopes.own) or 'no load'}; largest departure from straight lines: {bend}"
    if not given.together:
        return known
    loads = " and ".join(given.together)
    return f"{known}; without {loads}: put on both wheels alike only, a test with opposed loads separates them"


def _shown(value: float, unit: str) -> str:
    return f"{1e3 * value:.2f} mm" if unit == "m" else f"{math.degrees(value):.3f}°"
