"""Folder of cached values, one file each, named by kind and key.

A file is written beside its place and moved there whole, so that neither two writers nor a killed process leave half of
one. A file that cannot be read, whose checksums do not hold or whose classes have changed counts as absent. The folder
is bounded: the values that were not used for longest go first. It may be removed at any time.
"""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from lacet.services.cache.records import Record, from_record, to_record

MOST_BYTES = 1_000_000_000
"""Size of a study's cached values above which the oldest are removed [bytes]."""
FOLDER = ".cache"
"""Name of the folder inside a study."""


class Store:
    """Cached values of one study.

    Parameters
    ----------
    study : folder of the study; the values stand in `.cache` there.
    most : size [bytes] above which the values not used for longest are removed.
    """

    def __init__(self, study: Path, most: int = MOST_BYTES):
        self.folder, self.most = study / FOLDER, most

    def has(self, kind: str, key: str) -> bool:
        """Whether there is a file of this value."""
        return self._file(kind, key).is_file()

    def load(self, kind: str, key: str) -> Any:
        """The value of a key, or None where there is none that can be read."""
        file = self._file(kind, key)
        try:
            with zipfile.ZipFile(file) as archive:
                tree = json.loads(archive.read("tree.json"))
                arrays: list[np.ndarray] = []
                for place in range(len(archive.namelist()) - 1):
                    with archive.open(f"{place}.npy") as stream:
                        arrays.append(np.lib.format.read_array(stream, allow_pickle=False))
                        stream.read()  # to the end, where the checksum is compared
            value = from_record(Record(tree, arrays))
        except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
            return None
        with suppress(OSError):
            os.utime(file)
        return value

    def save(self, kind: str, key: str, value: object) -> None:
        """Store a value. A folder that cannot be written to costs time only. Raises RecordError for a strange value."""
        record = to_record(value)
        try:
            self.folder.mkdir(exist_ok=True)
            (self.folder / ".gitignore").write_text("*\n", encoding="utf-8")
            handle, name = tempfile.mkstemp(dir=self.folder, prefix="writing-")
        except OSError:
            return
        part = Path(name)
        try:
            with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w") as archive:
                archive.writestr("tree.json", json.dumps(record.tree, ensure_ascii=False))
                for place, array in enumerate(record.arrays):
                    with archive.open(f"{place}.npy", "w", force_zip64=True) as member:
                        np.lib.format.write_array(member, array, allow_pickle=False)
            part.chmod(0o644)  # a temporary file is its owner's alone
            part.replace(self._file(kind, key))
            self._forget_oldest()
        except OSError:
            pass
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def clear(self) -> int:
        """Remove everything; the number of files removed."""
        files = [file for file in self.folder.glob("*") if file.is_file() and file.name != ".gitignore"]
        for file in files:
            with suppress(OSError):
                file.unlink(missing_ok=True)
        return len(files)

    def _file(self, kind: str, key: str) -> Path:
        return self.folder / f"{kind}-{key}.zip"

    def _forget_oldest(self) -> None:
        """Remove what was not used for longest, what an older lacet kept and what a killed writer left an hour ago."""
        found: list[tuple[float, int, Path]] = []
        for file in self.folder.glob("*"):
            with suppress(OSError):
                state = file.stat()
                found.append((state.st_mtime, state.st_size, file))
        newest = max((time for time, _, _ in found), default=0.0)
        total = 0
        for time, size, file in sorted(found, reverse=True):
            total += size
            abandoned = file.name.startswith("writing-") and time < newest - 3600.0
            superseded = file.suffix == ".npz"  # of a lacet that kept arrays alone; nothing reads them now
            if abandoned or superseded or (file.suffix == ".zip" and total > self.most):
                with suppress(OSError):
                    file.unlink(missing_ok=True)
