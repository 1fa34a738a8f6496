"""Replacement and removal of a study's files from the page, and what they would put out of step.

Nothing is erased: what is removed or replaced is moved into the study's folder `removed`, with the time in its name.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.formats.run_files import further_files
from lacet.services.workbench.refusals import NotThere
from lacet.services.workbench.run_channels import beside
from lacet.services.workbench.run_files import FOLDER, RAW, find_run
from lacet.services.workbench.session_cache import SessionCache

REMOVED = "removed"
"""Folder of the study for what was removed or replaced."""
DESCRIPTIONS = ("rig.toml", "vehicle.toml")
"""Files of a study that describe its car."""


def consequences(cache: SessionCache, name: str) -> dict[str, Any]:
    """What no longer fits together when a file is replaced or removed, a sentence each; whether it may be removed."""
    files = _files(cache, name)
    versions = _versions(cache, files[0])
    one = len(versions) == 1
    numbers = f"version{'' if one else 's'} {', '.join(map(str, versions))}"
    says: list[str] = []
    may = True
    if name in DESCRIPTIONS:
        may = not cache.exists
        what = "instruments" if name == "rig.toml" else "car"
        if versions:
            says.append(
                f"{numbers} {'was' if one else 'were'} fitted with the {what} as described there: "
                f"{'its' if one else 'their'} numbers stay as they are, and what is computed from now on takes the new "
                "description. Choose the runs again to fit a version to it"
            )
        if not may:
            says.append(f"a study needs its {name}: it can be replaced and not removed")
    elif versions:
        says.append(
            f"{numbers} {'uses' if one else 'use'} this run: {'its' if one else 'their'} errors and parameters stay as "
            f"they are, but nothing more can be computed for {'it' if one else 'them'} without the run; with other "
            f"samples under its name, from those. Choose the runs again to fit a version without it"
        )
    return {"name": name, "files": [file.name for file in files], "versions": versions, "says": says, "may_remove": may}


def remove(cache: SessionCache, name: str) -> dict[str, Any]:
    """Move a file, with all that it is read with, to `DIR/removed`.

    Raises UsageError for a file that the study needs or that lies elsewhere, NotThere for one that there is not.
    """
    found = consequences(cache, name)
    if not found["may_remove"]:
        raise UsageError(found["says"][-1])
    moved = [_aside(cache, file) for file in _files(cache, name)]
    return {"removed": [file.name for file in moved], "kept_in": REMOVED}


def set_aside(cache: SessionCache, target: Path) -> None:
    """Move a file that is about to be replaced, and the capture that it was decoded from, aside."""
    for file in (target, cache.folder / RAW / target.name):
        if file.is_file():
            _aside(cache, file)


def _aside(cache: SessionCache, file: Path) -> Path:
    folder = cache.folder / REMOVED
    folder.mkdir(exist_ok=True)
    stamp = time.strftime("%Y%m%d-%H%M%S")
    target = folder / f"{file.stem}.{stamp}{file.suffix}"
    count = 1
    while target.exists():
        count += 1
        target = folder / f"{file.stem}.{stamp}-{count}{file.suffix}"
    file.rename(target)
    return target


def _files(cache: SessionCache, name: str) -> list[Path]:
    """The file of a name, first, and those that are read with it alone. Raises UsageError or NotThere."""
    if name in DESCRIPTIONS:
        file = cache.folder / name
        if not file.is_file():
            raise NotThere(f"there is no {name} in the study's folder")
        return [file]
    capture = cache.folder / RAW / Path(name).name
    if Path(name).name == name and capture.is_file() and not (cache.folder / FOLDER / name).is_file():
        return [capture]
    path = find_run(cache, name)
    if path.resolve().parent != (cache.folder / FOLDER).resolve():
        raise UsageError(f"{path} is outside the study's folder: remove it there, and choose the runs again")
    files = [path, *further_files(path), cache.folder / RAW / path.name]
    if path.suffix.lower() == ".csv":
        files += beside(path)
    return [file for file in dict.fromkeys(files) if file.is_file()]


def _versions(cache: SessionCache, file: Path) -> list[int]:
    """Numbers of the versions that a file's contents are in."""
    if not cache.exists:
        return []
    study = cache.study
    if file.name in DESCRIPTIONS and file.parent == cache.folder:
        return [version.number for version in study.versions()]
    out: list[int] = []
    for version in study.versions():
        at = study.at(version)
        if file.resolve() in {path.resolve() for path in (*at.paths(), *at.paths(held=True))}:
            out.append(version.number)
    return out
