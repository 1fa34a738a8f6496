"""The verdict on a folder of tables, as a user gets it: ``lacet study new``, then ``lacet diagnose --auto``.

Both are run as programs that are told the folder alone; what they write is read (``docs/json.md``). Nothing else of the
benchmark knows how a verdict is made.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lacet
from lacet.services.one_thread import one_thread

LAST_LINES = 3
"""Lines that are kept of what a program that failed said."""
WELL = (0, 3)
"""Exit codes of a program that did its work; 3: with warnings about the runs."""


class Failed(Exception):
    """A program of lacet ended without a verdict."""


@dataclass(frozen=True)
class Verdict:
    """What was concluded from a folder's tables.

    Attributes
    ----------
    effects : keys of the final set → shape constants; `ties` key → what cannot be told from it.
    parameters : key → parameter → value, half of the 95 % interval (sheet included); of those that the runs show alone.
    unlisted : whether a cause that is not listed was declared at the end; `rows` said to be left unexplained by it.
    held : run held out → row → residual ÷ floor; `base` the same of the base model.
    steps : verdict, best and explained share of each ranking.
    seconds : processor time.
    """

    effects: dict[str, dict[str, float]]
    ties: dict[str, list[str]]
    parameters: dict[str, dict[str, tuple[float, float]]]
    unlisted: bool
    rows: list[str]
    held: dict[str, dict[str, float]]
    base: dict[str, dict[str, float]]
    steps: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    seconds: float = 0.0


def diagnosed(folder: Path, study: Path) -> Verdict:
    """The verdict on a folder's tables; `study` : a folder for the study. Raises Failed."""
    begin = _processor_time()
    used, held = (sorted(map(str, (folder / part).glob("*.parquet"))) for part in ("used", "held"))
    files = ["--rig", str(folder / "rig.toml"), "--vehicle", str(folder / "vehicle.toml")]
    _lacet("study", "new", str(study), "--use", *used, "--hold", *held, *files)
    out = study / "diagnose.json"
    _lacet("diagnose", str(study), "--auto", "--json", str(out))
    return read(study, json.loads(out.read_text(encoding="utf-8")), _processor_time() - begin)


def read(study: Path, said: Mapping[str, Any], seconds: float = 0.0) -> Verdict:
    """The verdict of what the programs wrote."""
    current = json.loads((study / "study.json").read_text(encoding="utf-8"))["current"]
    last, first = (json.loads((study / "versions" / f"{n:03d}.json").read_text(encoding="utf-8")) for n in (current, 1))
    effects = {key: dict(shape) for key, shape in last["effects"].items()}
    ties: dict[str, list[str]] = {}
    for step in said["steps"]:
        for candidate in step["candidates"]:
            if candidate["effect"] in step["found"]:
                ties[candidate["effect"]] = [tie["effect"] for tie in candidate["ties"]]
    parameters: dict[str, dict[str, tuple[float, float]]] = {}
    for one in last["result"]["parameters"]:
        if one["effect"] in effects and one["group"] == one["name"]:  # else it is a sum with others
            parameters.setdefault(one["effect"], {})[one["name"]] = (one["value"], one["half95_sheet"])
    unlisted = bool(said["unlisted"])
    return Verdict(
        effects, {key: ties.get(key, []) for key in effects}, parameters, unlisted,
        list(said["unlisted_rows"]), _ratios(last), _ratios(first),
        [{"verdict": s["verdict"], "best": s["best"], "explained": s["explained"]} for s in said["steps"]], seconds,
    )  # fmt: skip


def held_of(folder: Path, study: Path, effects: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Run held out → row → residual ÷ floor, of a model with these effects fitted to a folder's runs used.

    Constants that an effect of the catalogue does not have are left out.
    """
    used, held = (sorted((folder / part).glob("*.parquet")) for part in ("used", "held"))
    rig, vehicle = lacet.Rig.load(folder / "rig.toml"), lacet.Vehicle.load(folder / "vehicle.toml")
    made = lacet.Study.create(study, used, held, rig, vehicle)
    known = made.effects(rig.wheel_reference)
    model = {
        key: {name: value for name, value in shape.items() if name in known[key].grids}
        for key, shape in effects.items()
    }
    with one_thread():
        version = lacet.Session(made).record(model, "what is hidden")
    return _ratios({"result": version.result})


def _ratios(version: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    held = version["result"]["rows"]["held"]
    return {run: {row: score["ratio"] for row, score in rows.items()} for run, rows in held.items()}


def _lacet(*words: str) -> None:
    alone = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    done = subprocess.run(
        [sys.executable, "-m", "lacet", *words], env={**os.environ, **alone}, capture_output=True, text=True,
        check=False, encoding="utf-8", errors="replace",
    )  # fmt: skip
    if done.returncode not in WELL:
        said = " / ".join((done.stderr or done.stdout).strip().splitlines()[-LAST_LINES:])
        raise Failed(f"lacet {words[0]} ended with {done.returncode}: {said}")


def _processor_time() -> float:
    """Of the programs that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
