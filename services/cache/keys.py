"""Keys of cached values: digests of everything that a value depends on, by content and never by path.

A value depends on lacet's sources up to the room that made it, on NumPy and SciPy, and on what it was computed from.
Of the catalogue only the files of the effects in a model count: a change of another effect leaves its fit valid.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import scipy

import lacet.daq
import lacet.identify
import lacet.services
from lacet.daq.formats.run_files import further_files
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import effect_classes
from lacet.identify.effects.user_files import is_own
from lacet.services.cache.store import FOLDER

SCHEMA = 1
"""Version of what is stored; another one makes everything anew."""
ROOMS = (
    "multibody",
    "signals",
    "car",
    "effects",
    "regression",
    "validation",
    "properties",
    "selection",
    "design",
    "wheel_loads",
    "chains",
)
"""Rooms of `lacet.identify` from bottom to top, as the import contracts have them."""
_IDENTIFY = Path(str(lacet.identify.__file__)).parent
_SERVICES = Path(str(lacet.services.__file__)).parent
_FROM_EFFECTS = re.compile(r"^from (lacet\.identify\.effects\.[\w.]+) import", re.MULTILINE)
_DAQ = Path(str(lacet.daq.__file__)).parent


def key_of(room: str, effects: Iterable[type[Effect]] | None, *parts: object) -> str:
    """Key of a value.

    Parameters
    ----------
    room : the room of `lacet.identify` that makes it.
    effects : classes of the effects in it; None for the whole catalogue.
    parts : everything else that it depends on, as JSON data.
    """
    versions = [SCHEMA, np.__version__, scipy.__version__]
    chosen = None if effects is None else tuple(sorted({_place(cls) for cls in effects if not is_own(cls)}))
    body = json.dumps([versions, _sources(room, chosen), *parts], sort_keys=True, default=str)
    return hashlib.sha256(body.encode()).hexdigest()[:32]


@cache
def _sources(room: str, effect_files: tuple[str, ...] | None) -> str:
    """Digest of lacet's sources up to a room; of files that define effects, those named and those imported."""
    files = [*_DAQ.rglob("*.py"), *_IDENTIFY.glob("*.py")]
    for name in ROOMS[: ROOMS.index(room) + 1]:
        files += (_IDENTIFY / name).rglob("*.py")
    if effect_files is not None:
        alone = {_place(cls) for cls in effect_classes().values()}
        others = [name for file in files if (name := str(file.resolve())) not in alone]
        unneeded = alone - _with_imports([*effect_files, *others])
        files = [file for file in files if str(file.resolve()) not in unneeded]
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.name.encode() + _content(file))
    return digest.hexdigest()


@cache
def _content(file: Path) -> bytes:
    """Digest of a source file, read once for the keys of all rooms."""
    return hashlib.sha256(file.read_bytes()).digest()


def _place(cls: type[Effect]) -> str:
    return str(Path(inspect.getfile(cls)).resolve())


def _with_imports(files: Iterable[str]) -> set[str]:
    """Files with all files of effects that these import."""
    out: set[str] = set()
    open_ = list(files)
    while open_:
        name = open_.pop()
        if name in out:
            continue
        out.add(name)
        for module in _FROM_EFFECTS.findall(Path(name).read_text(encoding="utf-8")):
            inside = _IDENTIFY.joinpath(*module.split(".")[2:]).with_suffix(".py")
            if inside.is_file():
                open_.append(str(inside.resolve()))
    return out


@cache
def service_sources(*rooms: str) -> str:
    """Digest of the sources of rooms of `lacet.services`, for values that hold their sentences."""
    digest = hashlib.sha256()
    for room in rooms:
        for file in sorted((_SERVICES / room).rglob("*.py")):
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


@cache
def simulator_sources() -> str:
    """Digest of the sources of the simulator, for values that depend on simulated runs."""
    digest = hashlib.sha256()
    for file in sorted((_SERVICES.parent / "simulate").rglob("*.py")):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def text_digest(file: Path) -> str:
    """Digest of a small file's content; of no content where there is no file."""
    return hashlib.sha256(file.read_bytes() if file.is_file() else b"").hexdigest()


def run_digests(study: Path, runs: Iterable[Path]) -> list[str]:
    """Digests of the contents of runs, remembered in the study by size, time of change and inode.

    That of a run that cannot be read is empty: whoever reads it says so.
    """
    memory = study / FOLDER / "runs.json"
    known: dict[str, Any] = {}
    with suppress(OSError, ValueError):
        read: Any = json.loads(memory.read_text(encoding="utf-8"))
        known = read if isinstance(read, dict) else known
    found: dict[str, list[Any]] = {}
    out: list[str] = []
    for run in runs:
        name, digest = str(run.resolve()), ""
        with suppress(OSError):
            states = [file.stat() for file in (run, *further_files(run))]
            stamp = [sum(s.st_size for s in states), max(s.st_mtime_ns for s in states), states[0].st_ino]
            before = known.get(name)
            if isinstance(before, list) and len(kept := cast(list[Any], before)) == 4 and kept[:3] == stamp:
                digest = str(kept[3])
            else:
                digest = run_digest(run)
                found[name] = [*stamp, digest]
        out.append(digest)
    if found:
        _remember(memory, {**known, **found})
    return out


def run_digest(run: Path) -> str:
    """Digest of a run: of its file, those it goes on in, and the JSON file beside a CSV."""
    digest = hashlib.sha256()
    for file in (run, *further_files(run)):
        with file.open("rb") as stream:
            while part := stream.read(1 << 20):
                digest.update(part)
    beside = run.with_suffix(".json")
    if run.suffix.lower() == ".csv" and beside.is_file():
        digest.update(beside.read_bytes())
    return digest.hexdigest()


def _remember(file: Path, found: Mapping[str, Any]) -> None:
    part = file.with_suffix(f".{os.getpid()}")
    with suppress(OSError):
        file.parent.mkdir(exist_ok=True)
        part.write_text(json.dumps(found), encoding="utf-8")
        part.replace(file)
