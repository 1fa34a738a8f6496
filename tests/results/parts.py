"""The parts of the stored results: each is a few commands, and the JSON that they write.

Only the command line and the blind benchmark are called, so that the same file serves before and after a move.
The demonstration's captures are decoded from their files: a capture that is recorded live has other stamps each time.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

ROOT = Path(__file__).resolve().parents[2]
TRIALS = ROOT / "benchmarks" / "blind" / "trials.jsonl"
LACET = (sys.executable, "-m", "lacet")

NOT_A_RESULT = frozenset({"code", "seconds", "total", "created", "report", "logs", "folder", "pictures", "written"})
"""Keys that differ from one run of the same code to the next: times, digests of the sources, and places of files."""
TRIALS_DRAWN = {"pair": 33, "single": 39, "unlisted": 13, "null": 15}
"""Blind trials by section, 100 in all; two or more steps have those of the pairs."""
SEEDS_A_CELL = 4
"""The first trial of a cell makes its simulated motion and noise floor, which the others share."""
QUICK_TRIALS = (
    ("null/plain.0", 1), ("anti_roll_bar.front/ordinary", 1), ("sensor_gain.hub.fl/large", 1),
    ("spring_cubic.front+sensor_gain.hub.fl/ordinary", 1), ("trailer/large", 1),
)  # fmt: skip
"""Five trials that are run after every room."""


def demo(folder: Path, lacet: Sequence[str]) -> dict[str, Any]:
    """The demonstration's captures: decoded, fitted, and effects added until nothing is missing."""
    captures = sorted((ROOT / "replay_logs" / "anti-roll-bars").glob("*.mcap"))
    commands = [f"decode {shlex.quote(str(file))} -o {file.name}" for file in captures]
    held = {"spiral.mcap", "braking.mcap"}
    used = " ".join(file.name for file in captures if file.name not in held)
    commands += [f"study new study --use {used} --hold {' '.join(sorted(held))} --draws 39"]
    return _run(folder, lacet, [*commands, "where study", "diagnose study --auto", "compare study", "study study"])


def story(page: str) -> Callable[[Path, Sequence[str]], dict[str, Any]]:
    """A page of docs/stories, its commands as they stand there."""

    def play(folder: Path, lacet: Sequence[str]) -> dict[str, Any]:
        text = (ROOT / "docs" / "stories" / page).read_text(encoding="utf-8")
        blocks = re.findall(r"^```sh\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
        commands = "".join(blocks).replace("\\\n", " ").strip().splitlines()
        return _run(folder, lacet, [command.removeprefix("lacet ") for command in commands])

    return play


def reference_car(folder: Path, lacet: Sequence[str]) -> dict[str, Any]:
    """The independent reference car: its four runs fitted, and effects added until nothing is missing."""
    data = ROOT / "tests" / "data" / "car"
    used = " ".join(str(data / f"{name}.parquet") for name in ("sine", "liftoff", "sweep"))
    files = f"--rig {data / 'rig.toml'} --vehicle {data / 'vehicle.toml'}"
    return _run(
        folder,
        lacet,
        [
            f"study new study --use {used} --hold {data / 'rough.parquet'} {files} --draws 39",
            "diagnose study --auto",
            "compare study",
            f"check {used} {files}",
            f"identify {data / 'sine.parquet'} {files} --robust --rows",
            "plan study --only sinus",
        ],
    )


def paper(folder: Path, lacet: Sequence[str]) -> dict[str, Any]:
    """The paper's tables, in full."""
    return _run(folder, lacet, ["paper --out paper"])


PARTS: Mapping[str, Callable[[Path, Sequence[str]], dict[str, Any]]] = {
    "demo": demo,
    "story-bars": story("bars-and-friction.md"),
    "story-own": story("an-effect-of-ones-own.md"),
    "reference": reference_car,
    "paper": paper,
}
"""Everything but the blind trials, by name."""


def trials_drawn() -> list[tuple[str, int]]:
    """Cell and seed of the blind trials: cells drawn by hash from each section, their first trial and two by hash."""
    sections: dict[str, dict[str, list[int]]] = {kind: {} for kind in TRIALS_DRAWN}
    for record in _trials():
        sections[record["kind"]].setdefault(record["cell"], []).append(record["seed"])
    out: list[tuple[str, int]] = []
    for kind, count in TRIALS_DRAWN.items():
        found: list[tuple[str, int]] = []
        for cell in sorted(sections[kind], key=_hash):
            seeds = sorted(sections[kind][cell], key=lambda seed: (seed != 1, _hash(seed)))
            found += [(cell, seed) for seed in sorted(seeds[:SEEDS_A_CELL])]
        out += found[:count]
    return out


def run_trials(chosen: Sequence[tuple[str, int]], folder: Path) -> dict[str, Any]:
    """Blind trials by ``cell seed``, made and judged anew."""
    from benchmarks.blind.__main__ import run_cell
    from benchmarks.blind.cases import cells

    every, file = cells(), folder / "trials.jsonl"
    for cell in dict.fromkeys(name for name, _ in chosen):
        run_cell(every[cell], [seed for name, seed in chosen if name == cell], file, "", 199, False)
    return {_name(record): settled(record) for record in map(json.loads, file.read_text().splitlines())}


def stored_trials(chosen: Sequence[tuple[str, int]]) -> dict[str, Any]:
    """The same trials as the blind benchmark keeps them."""
    wanted = set(chosen)
    return {_name(one): settled(one) for one in _trials() if (one["cell"], one["seed"]) in wanted}


def settled(value: Any, folder: str = "\0") -> Any:
    """A result without what is no result: times, digests, the temporary folder's name."""
    if isinstance(value, dict):
        items = cast(dict[str, Any], value).items()
        return {key: settled(one, folder) for key, one in items if key not in NOT_A_RESULT}
    if isinstance(value, list):
        return [settled(one, folder) for one in cast(list[Any], value)]
    if isinstance(value, str):
        return value.replace(folder, "").replace(str(ROOT), "")
    return value


def _run(folder: Path, lacet: Sequence[str], commands: Sequence[str]) -> dict[str, Any]:
    """Run commands in a folder; their JSON by command."""
    out: dict[str, Any] = {}
    folder = folder.resolve()
    for number, command in enumerate(commands, start=1):
        file = folder / f"{number}.json"
        words = [*lacet, *shlex.split(command), "--json", str(file)]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        assert done.returncode in (0, 3), f"{command}\n{done.stdout}\n{done.stderr}"
        said = command.replace(str(ROOT), "").replace(str(folder), "")
        out[f"{number} {said}"] = settled(json.loads(file.read_text(encoding="utf-8")), str(folder))
    return out


def _trials() -> Iterator[dict[str, Any]]:
    return map(json.loads, TRIALS.read_text(encoding="utf-8").splitlines())


def _name(record: dict[str, Any]) -> str:
    return f"{record['cell']} {record['seed']}"


def _hash(value: object) -> str:
    return hashlib.sha256(str(value).encode()).hexdigest()
