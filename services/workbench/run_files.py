"""Files of runs in a study's folder: contents of each, whether it can be used, and its role in the study."""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.errors import LacetError, RunError, UsageError, nearest
from lacet.daq.formats import mf4
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import KINDS, is_own, open_run
from lacet.daq.formats.result import plain
from lacet.daq.formats.run_files import first_files
from lacet.daq.maps.mapped_run import map_beside
from lacet.daq.run import Run
from lacet.identify.car.rows import ROWS, lacking
from lacet.identify.signals.own_rate import at_own_rate
from lacet.services.render.row_needs import rows_lacking
from lacet.services.workbench.jobs import give_back
from lacet.services.workbench.run_channels import RunChannels, state_key
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workspace.study import Study

FOLDER = "runs"
RAW = "raw"
"""Folders of the study: of runs, and of captures that were decoded into runs."""
READING = "being read"
"""Quality of a run that has not been read yet."""
_KEPT_BACK = ("channel_list", "samples_hash")
"""Keys that the list of runs omits."""


def run_paths(cache: SessionCache) -> dict[str, Path]:
    """Name → file of every run of the folder, and of runs elsewhere that the study uses.

    The name is the file's stem, with its suffix where two have the same stem.
    """
    files = sorted(p for p in (cache.folder / FOLDER).glob("*") if p.suffix.lower() in KINDS and p.is_file())
    if cache.exists:
        study = cache.study
        known = {p.resolve() for p in files}
        files += [p for p in (*study.paths(), *study.paths(held=True)) if p.resolve() not in known]
    files = first_files(files)
    stems = [p.stem for p in files]
    return {p.stem if stems.count(p.stem) == 1 else p.name: p for p in files if not p.name.startswith(".")}


def find_run(cache: SessionCache, name: str) -> Path:
    """File of a run by its name or its file's name. Raises UsageError with the nearest."""
    paths = run_paths(cache)
    by_file = {p.name: p for p in paths.values()}
    if name not in paths and name not in by_file:
        raise UsageError(f"there is no run '{name}'{nearest(name, paths)}")
    return paths.get(name) or by_file[name]


def undecoded(cache: SessionCache) -> list[Path]:
    """Raw captures without a run: their decoding was cancelled, failed or interrupted."""
    made = {p.stem for p in (cache.folder / FOLDER).glob("*.mcap")}
    return sorted(p for p in (cache.folder / RAW).glob("*.mcap") if p.stem not in made)


def undecoded_record(path: Path) -> dict[str, Any]:
    """Entry of the list of runs for a capture without a run."""
    says = ["a raw capture that was not decoded: drop it here again, which decodes it"]
    head = {"name": path.name, "file": path.name, "path": str(path), "role": "unused"}
    return {k: v for k, v in {**head, **_unreadable(path, says)}.items() if k not in _KEPT_BACK}


class RunFiles:
    """Summaries of runs, made once for each state of a file and stored in the study's ``.cache``; so are overviews."""

    def __init__(self, cache: SessionCache, channels: RunChannels):
        self._cache, self._channels, self._lock = cache, channels, threading.Lock()
        self._reader = threading.Thread()
        self._file = cache.folder / ".cache" / "summaries.json"
        self._known: dict[str, dict[str, Any]] = {}
        with suppress(OSError, ValueError):
            self._known = json.loads(self._file.read_text(encoding="utf-8"))

    def all(self) -> list[dict[str, Any]]:
        """Every run, without its channels."""
        return [{k: v for k, v in run.items() if k not in _KEPT_BACK} for run in self._summaries()]

    def at_once(self, changed: Callable[[], None]) -> list[dict[str, Any]]:
        """Every run as far as it has been read; the others are read in a thread, which calls `changed` after each."""
        known: list[dict[str, Any]] = []
        lacking: list[Path] = []
        for one in self._heads():
            path = Path(one["path"])
            if self._is_read(path):
                known.append({**one, **self._known[self._key(path)]})
                continue
            lacking.append(path)
            known.append({**one, **_unreadable(path, []), "quality": READING, "channels": None, "losses": None})
        if lacking and not self._reader.is_alive():
            self._reader = threading.Thread(target=self._read_all, args=(changed,), name="lacet-runs", daemon=True)
            self._reader.start()
        return [{k: v for k, v in run.items() if k not in _KEPT_BACK} for run in _with_twins(known)]

    def _read_all(self, changed: Callable[[], None]) -> None:
        """Read what has not been read, a file at a time."""
        while lacking := [path for one in self._heads() if not self._is_read(path := Path(one["path"]))]:
            with self._lock:
                self._summary(lacking[0])
                self._save()
            give_back()
            changed()

    def one(self, name: str) -> dict[str, Any]:
        """One run with its channels. Raises UsageError."""
        path = find_run(self._cache, name)
        found = next(run for run in self._summaries() if Path(run["path"]) == path)
        return {**{k: v for k, v in found.items() if k not in _KEPT_BACK}, "channels": found["channel_list"]}

    def twins(self, used: list[Path], held: list[Path]) -> tuple[str, str] | None:
        """Names of two runs with the same samples, at least one of which is used."""
        first: dict[str, tuple[str, Path]] = {}
        chosen = [*used, *held]
        for run in sorted(self._summaries(), key=lambda run: Path(run["path"]) not in used):
            path, same = Path(run["path"]), run.get("samples_hash")
            if path not in chosen or not same:
                continue
            name, other = first.setdefault(same, (run["name"], path))
            if other != path and other in used:
                return name, run["name"]
        return None

    def _summaries(self) -> list[dict[str, Any]]:
        out: list[dict[str, Any]] = []
        with self._lock:
            before = len(self._known)
            out += [{**one, **self._summary(Path(one["path"]))} for one in self._heads()]
            if len(self._known) > before:
                give_back()
                self._save()
        return _with_twins(out)

    def _heads(self) -> list[dict[str, Any]]:
        """Name, file and role of each run."""
        roles = _roles(self._cache.study) if self._cache.exists else {}
        return [
            {
                "name": name,
                "file": path.name,
                "path": str(path),
                "role": roles.get(path.resolve(), "unused"),
                "by_map": path.is_file() and not is_own(path),
            }
            for name, path in run_paths(self._cache).items()
        ]

    def _summary(self, path: Path) -> dict[str, Any]:
        """Summary of a file, made where it is not known in this state."""
        if not self._is_read(path):
            try:
                found = summary(path, self._channels)
            except LacetError as error:
                found = _unreadable(path, [str(error)])
            self._known[self._key(path)] = found
        return self._known[self._key(path)]

    def _is_read(self, path: Path) -> bool:
        """Whether the summary of a file in its present state is known."""
        return "samples_hash" in self._known.get(self._key(path), {})

    def _key(self, path: Path) -> str:
        """State of a file; of one that is not there, its name."""
        try:
            return state_key(path)
        except LacetError as error:
            return str(error)

    def _save(self) -> None:
        """Store the summaries; a folder without write access costs time only."""
        part = self._file.with_suffix(f".{os.getpid()}.tmp")
        try:
            part.parent.mkdir(parents=True, exist_ok=True)
            (part.parent / ".gitignore").write_text("*\n", encoding="utf-8")
            part.write_text(json.dumps(self._known), encoding="utf-8")
            part.replace(self._file)
        except OSError:
            part.unlink(missing_ok=True)


def _with_twins(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The summaries, with a warning where two files hold the same samples."""
    names: dict[str, list[str]] = {}
    for run in runs:
        names.setdefault(run.get("samples_hash") or run["path"], []).append(run["name"])
    out: list[dict[str, Any]] = []
    for run in runs:
        others = [name for name in names[run.get("samples_hash") or run["path"]] if name != run["name"]]
        says = [*run["says"], f"the same samples as {', '.join(others)}"] if others else run["says"]
        out.append({**run, "says": says, "quality": "flagged" if others else run["quality"]})
    return out


def _roles(study: Study) -> dict[Path, str]:
    used = {p.resolve(): "used" for p in study.paths()}
    return used | {p.resolve(): "held" for p in study.paths(held=True)}


def _unreadable(path: Path, says: list[str]) -> dict[str, Any]:
    return {
        "format": path.suffix.lower().removeprefix("."), "bytes": path.stat().st_size if path.is_file() else 0,
        "seconds": None, "manoeuvre": "", "vehicle": "", "rig": "", "channels": 0, "losses": 0, "rows": [],
        "quality": "cannot be read", "says": says, "channel_list": [], "samples_hash": "",
    }  # fmt: skip


def summary(path: Path, kept: RunChannels) -> dict[str, Any]:
    """Contents of a run's file, in an engineer's words; the overview of its channels is `kept`."""
    losses = 0
    if not path.exists():
        return _unreadable(path, ["there is no such file: put it back, or open the study in the folder of its runs"])
    try:
        if path.suffix.lower() == ".mcap" and is_own(path):
            log = LogReader(path)
            if not log.channels():
                return _unreadable(path, ["only raw frames: it has to be decoded first (lacet decode)"])
            lost = log.stop.losses if log.stop else {}
            losses = sum(sum(causes.values()) for causes in lost.values())
        run = open_run(path)
        kept.keep(path, run)
    except RunError as error:
        if not is_own(path) and map_beside(path) is None and path.suffix.lower() not in mf4.SUFFIXES:
            return _unreadable(path, ["a log of another system: its channel map has to say which of its names is what"])
        return _unreadable(path, error.faults)
    except LacetError as error:
        return _unreadable(path, [str(error)])
    reference = run.wheel_reference or "contact"
    absent = {row: lacking(row, reference, run.signals) for row in ROWS}
    channels = [_channel(name, run) for name in run.signals]
    says = list(run.problems)
    if losses:
        says.append(f"{losses:,} samples were lost while recording")
    flagged = [f"{c['name']} {100 * c['flagged'] / c['samples']:.1f} %" for c in channels
               if c["samples"] and c["flagged"] > 0.001 * c["samples"]]  # fmt: skip
    if flagged:
        says.append(f"samples that cannot be used: {', '.join(flagged)}")
    if lacks := {row: c for row, c in absent.items() if c}:
        says.append(rows_lacking(lacks))
    bad = bool(run.problems or losses or flagged)
    return plain(
        {
            "format": path.suffix.lower().removeprefix("."), "bytes": path.stat().st_size, "seconds": run.duration,
            "manoeuvre": run.manoeuvre, "vehicle": run.vehicle, "rig": run.rig, "channels": len(run.signals),
            "losses": losses, "rows": [row for row, c in absent.items() if not c], "brakes": run.brakes,
            "wheel_reference": run.wheel_reference, "quality": "flagged" if bad else "good", "says": says,
            "channel_list": channels,
            "samples_hash": _hash(run),
        }
    )  # fmt: skip


def _hash(run: Run) -> str:
    """Digest of a run's samples: equal for two files with the same samples, whatever their names and formats."""
    found = hashlib.sha256()
    stamps: dict[int, bytes] = {}  # the channels of a table have one array of stamps
    for name, s in sorted(run.signals.items()):
        if id(s.t) not in stamps:
            stamps[id(s.t)] = np.ascontiguousarray(s.t - s.t[0] if len(s.t) else s.t).round(7).tobytes()
        found.update(name.encode())
        found.update(stamps[id(s.t)])
        found.update(np.ascontiguousarray(s.values, np.float32).tobytes())
    return found.hexdigest()


def _channel(name: str, run: Run) -> dict[str, Any]:
    s, about = at_own_rate(run.signals[name]), CHANNELS[name]
    rate = (len(s.t) - 1) / (s.t[-1] - s.t[0]) if len(s.t) > 1 else 0.0
    return {
        "name": name, "components": list(about.components), "unit": about.unit, "rate": float(rate),
        "samples": len(s.t), "flagged": int(np.count_nonzero(~s.usable)), "about": about.about,
    }  # fmt: skip
