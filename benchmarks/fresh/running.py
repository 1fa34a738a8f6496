"""Trials run and kept: one line a trial, in a file for each set."""

from __future__ import annotations

import json
import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.blind.__main__ import append
from benchmarks.fresh import second
from benchmarks.fresh.identifying import Failed, diagnosed, held_of
from benchmarks.fresh.making import make, write
from benchmarks.fresh.scoring import true_model
from lacet.daq.errors import LacetError
from lacet.services.one_thread import one_thread

HERE = Path(__file__).parent


def results_file(name: str, car: str = "fresh") -> Path:
    """Where the trials of a set on cars drawn anew (`car` fresh) or on the second car are kept, with the sources."""
    return HERE / (f"{name}.jsonl" if car == "fresh" else f"{car}-{name}.jsonl")


def read(file: Path, code: str | None = None) -> dict[int, dict[str, Any]]:
    """Trials by number, of these sources alone when a digest is given; a line cut off by a crash is left out."""
    out: dict[int, dict[str, Any]] = {}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        if code in (None, record["code"]):
            out[record["trial"]] = record
    return out


def to_run(name: str, numbers: Iterable[int], file: Path, code: str) -> list[int]:
    """Trials without a result. A test trial is run once, whatever the sources were; a development trial for each."""
    done: Collection[int] = read(file, None if name == "test" else code)
    return [number for number in numbers if number not in done]


def run_trial(name: str, number: int, file: Path, code: str, car: str = "fresh") -> str:
    """Run a trial and keep its record. Returns a line about it.

    What sees the tables is another program, which is given their folder; what is hidden is in no file until it ended.
    """
    begin = time.process_time()
    with one_thread():
        trial = second.make(name, number) if car == second.CAR else make(name, number)
    truth = trial.truth()
    record: dict[str, Any] = {key: truth[key] for key in ("set", "trial", "class", "sizes", "measured", "parts")}
    record |= {"code": code, "runs": {use: list(runs) for use, runs in (("used", trial.used), ("held", trial.held))}}
    if car == second.CAR:
        record["mechanism"] = list(second.MECHANISM)
    with TemporaryDirectory(prefix="fresh-") as place:
        folder = write(trial, Path(place) / "campaign")
        del trial  # 100 MB
        try:
            verdict = diagnosed(folder, Path(place) / "study")
            record["verdict"] = asdict(verdict)
            model = None if car == second.CAR else true_model(truth["parts"])  # of the mechanism no constants are known
            record["true_held"] = None if model is None else held_of(folder, Path(place) / "true", model)
        except (Failed, LacetError) as cause:
            record["failed"] = str(cause)
    record["own_seconds"] = time.process_time() - begin
    append(file, rounded(record))
    return line_of(record)


def line_of(record: Mapping[str, Any]) -> str:
    """A trial in a line."""
    head = f"{record['set']} {record['trial']} ({record['class']})"
    if "failed" in record:
        return f"{head}: failed: {record['failed']}"
    verdict = record["verdict"]
    said = [*verdict["effects"], *(["unlisted"] if verdict["unlisted"] else [])]
    hidden = ", ".join(part["name"] for part in record["parts"])
    return f"{head}: {hidden or '-'} → {', '.join(said) or '-'} ({verdict['seconds']:.0f} s)"


def rounded(record: Mapping[str, Any]) -> dict[str, Any]:
    """Six digits of every number: the trials are kept with the sources."""
    return json.loads(json.dumps(record), parse_float=lambda text: float(f"{float(text):.6g}"))
