"""What is dear to make is made once in a run of the tests, whichever of its processes needs it first."""

from __future__ import annotations

import fcntl
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

FOLDER = "LACET_TESTS_SHARED"
"""Environment variable: the folder that the processes of one run share; see `tests/conftest.py`."""

T = TypeVar("T")


def folder_once(name: str, make: Callable[[Path], object]) -> Path:
    """A folder in which `make` has put files, in this or in another process of this run: to be read or copied."""

    def made() -> Path:
        folder = Path(os.environ[FOLDER]) / name
        folder.mkdir()
        make(folder)
        return folder

    return once(name, made)


def once(name: str, make: Callable[[], T]) -> T:
    """`make()`, or a copy of what another process of this run has made of that name; it is waited for."""
    folder = Path(os.environ[FOLDER])
    kept = folder / f"{name}.pickle"
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if kept.exists():
            return pickle.loads(kept.read_bytes())
        value = make()
        with kept.open("wb") as file:
            pickle.dump(value, file, protocol=5)
        return value
