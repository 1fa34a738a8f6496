"""State of a worker's runs on disk, one file beside each log, so that a worker started again knows what it has."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from lacet.daq.bus.session import Keys

FORMAT = "lacet-run-state 1"
SUFFIX = ".state.json"


@dataclass(frozen=True)
class RunState:
    """State of one run that is whole at this worker.

    Attributes
    ----------
    car, run : as in its keys.
    log : name of its log.
    digest : digest of all its blocks, by which it is acknowledged.
    notes : what there is to say about its reception.
    worked : whether its result has been written.
    """

    car: str
    run: str
    log: str
    digest: str
    notes: tuple[str, ...] = ()
    worked: bool = False

    @property
    def keys(self) -> Keys:
        """Keys of the run."""
        return Keys(self.car, self.run)

    def done(self) -> RunState:
        """The state with the result written."""
        return replace(self, worked=True)

    def save(self, folder: Path) -> None:
        """Write the state: a complete file or none."""
        write_text(
            (folder / self.log).with_suffix(SUFFIX), json.dumps({"format": FORMAT, **asdict(self)}, ensure_ascii=False)
        )


def write_text(path: Path, text: str) -> None:
    """Write a text file: a complete one or none, and on the disk when this returns."""
    draft = path.with_name(path.name + ".part")
    try:
        with draft.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def read_states(folder: Path) -> list[RunState]:
    """States of the runs in a folder whose logs are there; other files are ignored."""
    found: list[RunState] = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        try:
            content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            if content.pop("format") != FORMAT:
                continue
            content["notes"] = tuple(content["notes"])
            state = RunState(**content)
            texts = (state.car, state.run, state.log, state.digest, *state.notes)
            there = all(isinstance(text, str) for text in texts) and (folder / state.log).is_file()
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
            continue
        if there:
            found.append(state)
    return found


def free_log(folder: Path, run: str) -> Path:
    """A path for the log of a run that does not exist yet: no log is ever replaced."""
    path, number = folder / f"{run}.mcap", 1
    while path.exists():
        number += 1
        path = folder / f"{run}-{number}.mcap"
    return path
