"""One trial: its tables made, given away, and what comes back compared with what was hidden."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

from benchmarks.blind import identifying
from benchmarks.blind.cases import UNLISTED_FAMILIES, Cell
from benchmarks.blind.identifying import Added, held_out, identify
from benchmarks.blind.making import write_trial
from benchmarks.blind.sizing import tolerated
from daq.errors import LacetError

OWN = 1
"""Seed of the trial of a cell with a noise floor of its own."""
SHOWN = 6
"""Candidates of each diagnosis that are kept in the record, beside what was hidden."""


def reference_of(cell: Cell, build: Path) -> Path:
    """Folder of the cell's drive measured once by a seed no trial has."""
    folder = build / "tables" / cell.name.replace("/", "-") / "reference"
    if not (folder / "vehicle.toml").is_file():
        write_trial(folder, cell, 0)
    return folder


def trial(cell: Cell, seed: int, build: Path, draws: int = identifying.DRAWS) -> dict[str, Any]:
    """Run one trial; JSON-able record. The identifying side is given folders of tables."""
    begin = time.process_time()
    folder = write_trial(build / "tables" / cell.name.replace("/", "-") / f"{seed}", cell, seed)
    # Many trials are needed, and those of a cell share a noise floor, a little wrong for each: with nothing hidden that
    # makes false alarms more likely, not less. Elsewhere the first has its own, as users have it; the page tells both.
    known = folder if seed == OWN and cell.kind != "null" else reference_of(cell, build)
    made = time.process_time() - begin
    record: dict[str, Any] = {
        "cell": cell.name, "kind": cell.kind, "band": cell.band, "seed": seed,
        "hidden": [[h.name, h.size, dict(h.shape)] for h in cell.hidden], "keys": list(cell.keys),
        "root_lambda": list(cell.root_lambda), "shared": known != folder,
    }  # fmt: skip
    if cell.keys:
        record["tolerance"] = tolerated(cell.parts[0], identifying.tables(known))
    try:
        without = UNLISTED_FAMILIES if cell.kind == "unlisted" else ()
        answer = identify(folder, known, without, draws, again=cell.kind == "pair")
        answer.seconds["tables"] = made
        record["steps"] = [_short(step, cell.keys) for step in answer.steps]
        record["added"] = [[key, dict(shape)] for key, shape in answer.added]
        record["parameters"] = answer.parameters
        begin = time.process_time()
        record["held"] = {name: held_out(folder, known, model) for name, model in _models(cell, answer.added).items()}
        answer.timed("held out", begin)
        record["seconds"] = answer.seconds
    except LacetError as cause:
        record["failed"] = str(cause)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return record


def _models(cell: Cell, added: Added) -> dict[str, Added]:
    """Models scored on the runs held out: the base model, what was found, and for a listed effect the true one."""
    out: dict[str, Added] = {"base": (), "found": added}
    if cell.kind in ("single", "pair"):
        out["true"] = tuple((part.key, tuple(sorted(part.constants.items()))) for part in cell.parts)
    return out


def _short(step: dict[str, Any], keys: tuple[str, ...]) -> dict[str, Any]:
    asked = {*keys, step["best"], *step["ties"]}
    kept = [c for i, c in enumerate(step["candidates"]) if i < SHOWN or c["key"] in asked]
    for c in kept:
        for name in ("p", "gain", "total", "drop", "size", "coverage"):
            c[name] = float(f"{c[name]:.4g}")
    return {**step, "candidates": kept}
