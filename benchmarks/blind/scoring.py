"""One trial: its tables made, given away, and what comes back compared with what was hidden."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from benchmarks.blind import identifying
from benchmarks.blind.cases import UNLISTED_FAMILIES, Cell
from benchmarks.blind.identifying import Added, held_out, identify
from benchmarks.blind.making import write_trial
from benchmarks.blind.sizing import tolerated
from lacet.daq.errors import LacetError

OWN = 1
"""Seed of the trial of a cell with a noise floor of its own, which the others share."""
SHOWN = 4
"""Candidates of each diagnosis that are kept in the record, beside what was hidden."""


def tables_of(cell: Cell, seed: int, build: Path) -> Path:
    """Folder of a trial's tables, written if it is not there."""
    folder = build / "tables" / cell.name.replace("/", "-") / f"{seed}"
    return folder if (folder / "vehicle.toml").is_file() else write_trial(folder, cell, seed)


def trial(cell: Cell, seed: int, build: Path, draws: int = identifying.DRAWS) -> dict[str, Any]:
    """Run one trial; JSON-able record. The identifying side is given folders of tables."""
    begin = time.process_time()
    folder = tables_of(cell, seed, build)
    # Many trials are needed. The first of a cell has a noise floor of its own, as users have it; the others share it, a
    # little wrong for each: with nothing hidden that makes false alarms more likely, not less. The page tells both.
    known = tables_of(cell, OWN, build)
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
        if folder != known:
            shutil.rmtree(folder, ignore_errors=True)
    return _rounded(record)


def _rounded(value: Any) -> Any:
    """Six digits of every number: the trials are kept with the sources."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in cast(dict[str, Any], value).items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(one) for one in cast(Sequence[Any], value)]
    return value


def _models(cell: Cell, added: Added) -> dict[str, Added]:
    """Models scored on the runs held out: the base model, what was found, and for a listed effect the true one."""
    out: dict[str, Added] = {"base": (), "found": added}
    if cell.kind in ("single", "pair"):
        out["true"] = tuple((part.key, tuple(sorted(part.constants.items()))) for part in cell.parts)
    return out


def _short(step: dict[str, Any], keys: tuple[str, ...]) -> dict[str, Any]:
    asked = {*keys, step["best"], *step["ties"]}
    kept = [c for i, c in enumerate(step["candidates"]) if i < SHOWN or c["key"] in asked]
    return {**step, "candidates": kept}
