"""What the commands work on: input runs, made once for both commits, and each commit's studies as they are copied."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from benchmarks.first_work.measuring import ran
from benchmarks.first_work.sides import BUILD, HOME, Side

CAPTURES = HOME / "replay_logs" / "anti-roll-bars"
CAR = HOME / "tests" / "data" / "car"
SCRIPTS = Path(__file__).parent / "scripts"
USED, HELD = ("sinus", "liftoff", "rough"), ("spiral", "braking")
RUNS = BUILD / "runs"
TEN = ("sinus", "liftoff", "rough")
TEN_LENGTH = 200
"""Length of each of three runs [s]: ten minutes of data."""
TEN_HIDDEN = ("anti_roll_bar.front=19780", "anti_roll_bar.rear=19185", "coulomb.front=60", "spring_cubic.rear=4e6")
"""Missing in the base model, in the ten minutes: both bars, front friction [N], a stiffening rear spring [N/m³]."""
CELL = "anti_roll_bar.front/ordinary"
"""Case of the blind trial."""


def logs(now: Side) -> Path:
    """The committed captures, 16 s each, decoded by the present commit. f0e8420 reads them as well."""

    def make(part: Path) -> None:
        for capture in sorted(CAPTURES.glob("*.mcap")):
            ran(now.lacet("decode", capture, "-o", part / capture.name), now)

    return _made(RUNS / "logs", make)


def ten_minutes(now: Side) -> Path:
    """Tables and vehicle file of three simulated runs, ten minutes together, with several effects hidden."""

    def make(part: Path) -> None:
        driven = [word for name in TEN for word in ("--manoeuvre", name)]
        hidden = [word for one in TEN_HIDDEN for word in ("--hide", one)]
        words = ("simulate", "--rig", "peugeot-406", "--set", f"duration={TEN_LENGTH}", "--seed", 3)
        ran(now.lacet(*words, *driven, *hidden, "--format", "parquet", "-o", part), now)

    return _made(RUNS / "ten-minutes", make)


def long_run(now: Side, minutes: int) -> Path:
    """One run of so many minutes: the tables of sine steering and rough road of the reference car, repeated."""

    def make(part: Path) -> None:
        tables = [str(CAR / f"{name}.parquet") for name in ("sine", "rough")]
        out = part / f"run-{minutes}.parquet"
        ran([*_python(now), str(SCRIPTS / "tiled.py"), str(out), str(minutes), *tables], now)

    return _made(RUNS / f"long-{minutes}", make) / f"run-{minutes}.parquet"


def blind_tables(now: Side) -> Path:
    """Folder of a blind trial's tables, simulated by the present commit."""

    def make(part: Path) -> None:
        ran([*_python(now), str(SCRIPTS / "blind_trial.py"), "make", CELL, str(part), "0"], now)

    return _made(RUNS / "blind", make)


def study(side: Side, now: Side, state: str) -> Path:
    """A side's study of the captures, not to be worked on.

    `state` : "new" with the base model fitted, "diagnosed", or "finished", when nothing is missing any more; "ten" is
    new on the ten minutes, "long-10" on one run of so many minutes.
    """
    before = {"diagnosed": "new", "finished": "diagnosed"}.get(state)

    def make(part: Path) -> None:
        part.rmdir()
        if state.startswith("long-"):
            ran(side.lacet(*new_long(now, part, int(state.removeprefix("long-")))), side)
        elif state == "ten":
            ran(side.lacet(*new_ten(now, part)), side)
        elif before is None:
            ran(side.lacet(*new_study(now, part)), side)
        else:
            shutil.copytree(study(side, now, before), part)
            ran(side.lacet("diagnose", part, *(["--auto"] if state == "finished" else [])), side)

    return _made(side.work / f"study-{state}", make)


def new_study(now: Side, folder: Path) -> list[object]:
    """Words of `lacet study new` on the captures."""
    at = logs(now)
    return ["study", "new", folder, "--use", *(at / f"{n}.mcap" for n in USED), "--hold",
            *(at / f"{n}.mcap" for n in HELD)]  # fmt: skip


def new_ten(now: Side, folder: Path) -> list[object]:
    """Words of `lacet study new` on the ten minutes."""
    at = ten_minutes(now)
    return ["study", "new", folder, "--use", *(at / f"{n}.parquet" for n in TEN), "--rig", "peugeot-406",
            "--vehicle", at / "peugeot-406.toml"]  # fmt: skip


def new_long(now: Side, folder: Path, minutes: int) -> list[object]:
    """Words of `lacet study new` on one long run."""
    rig, vehicle = CAR / "rig.toml", CAR / "vehicle.toml"
    return ["study", "new", folder, "--use", long_run(now, minutes), "--rig", rig, "--vehicle", vehicle]


def copied(source: Path, cold: bool) -> Path:
    """A copy to work on, beside the study, replaced by the next one; `cold` leaves out what lacet had kept."""
    out = source.with_name("work")
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(source, out, ignore=shutil.ignore_patterns(".cache", "planned") if cold else None)
    return out


def _python(side: Side) -> list[str]:
    return [*side.lacet()[:1], "-P"]


def _made(folder: Path, make: Callable[[Path], None]) -> Path:
    """The folder, made whole or not at all."""
    if not folder.is_dir():
        print(f"  making {folder.relative_to(BUILD)}", flush=True)
        part = folder.with_name(f"{folder.name}-part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        make(part)
        part.rename(folder)
    return folder
