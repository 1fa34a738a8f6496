"""``lacet bench``: put a simulated car on a virtual kinematics and compliance bench."""

from __future__ import annotations

import argparse
from pathlib import Path

from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.result import DONE, write_result
from lacet.simulate.linkage import SECOND_CARS, SecondCar
from lacet.simulate.linkage.bench import Bench, bench_tests, find_test
from lacet.simulate.linkage.mechanism import Mechanism

HELP = "put a simulated car on a virtual kinematics and compliance (K&C) bench"
DESCRIPTION = f"""\
Clamp the body of a car on linkages at its design height, move and load its wheels through the tests of a K&C bench, and
write what such rigs deliver: one CSV a test, and a picture of them all. Columns, units and signs: docs/bench.md.

  lacet bench --car second -o bench                                all tests
  lacet bench --car second-live-axle --test bump --test roll -o bench
  lacet bench --car second --noise 1 --seed 3 -o bench             with the repeatability of a usual rig

Tests: {", ".join(bench_tests())}.
Cars: {", ".join(SECOND_CARS)}."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("--car", default="second", metavar="CAR", help="simulated car on linkages (default second)")
    parser.add_argument("--test", action="append", metavar="NAME", help="a test; again for more (default: all)")
    parser.add_argument(
        "--noise", type=float, default=0.0, metavar="FACTOR", help="repeatability of a usual rig × FACTOR"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the noise (default 0)")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the tables")
    parser.add_argument("--force", action="store_true", help="replace tables of the same name")


def run(args: argparse.Namespace) -> int:
    """Run the tests. Returns 0 when every table is written."""
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
