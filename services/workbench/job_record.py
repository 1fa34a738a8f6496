"""Record of a server's jobs that are not over, on disk: a server started after it says which were lost.

The record is `.cache/jobs.json` in the study's folder. One server at a time keeps it, the first on that folder: it
holds a lock that the system releases when the process ends, however it ends.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from lacet.services.acquisition.system_calls import is_locked, lock
from lacet.services.cache.store import FOLDER


class JobRecord:
    """The record in the study's `folder`, which may not exist yet; nothing is written before there is a job."""

    def __init__(self, folder: Path):
        self._file = folder / FOLDER / "jobs.json"
        self._lock: int | None = None
        if self._file.parent.is_dir():
            self._take()

    def unfinished(self) -> list[dict[str, Any]]:
        """`do` and `args` of the jobs that an earlier server did not finish, in order."""
        if self._lock is None:
            return []
        with suppress(OSError, ValueError, TypeError):
            found = json.loads(self._file.read_text(encoding="utf-8"))
            return [{"do": str(job["do"]), "args": dict(job["args"])} for job in found]
        return []

    def keep(self, jobs: Sequence[tuple[str, Mapping[str, Any]]]) -> None:
        """Record these jobs, `do` and `args` of each, in place of those before; nothing without write access."""
        part = self._file.with_suffix(f".{os.getpid()}.tmp")
        try:
            if not self._take():
                return
            part.write_text(json.dumps([{"do": do, "args": args} for do, args in jobs]), encoding="utf-8")
            part.replace(self._file)
        except OSError:
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def close(self) -> None:
        """Release the record for another server."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _take(self) -> bool:
        """Whether this server keeps the record: it has the lock, or gets it now."""
        if self._lock is not None:
            return True
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            (self._file.parent / ".gitignore").write_text("*\n", encoding="utf-8")
            descriptor = os.open(self._file.with_suffix(".lock"), os.O_RDWR | os.O_CREAT, 0o644)
        except OSError:
            return False
        if is_locked(descriptor):
            os.close(descriptor)
            return False
        lock(descriptor)
        self._lock = descriptor
        return True
