"""The folder that one worker writes its logs and results in, and no other at the same time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lacet.daq.errors import UsageError
from lacet.services.acquisition.system_calls import is_locked, lock

LOCK = ".worker.lock"
"""File that the worker of a folder keeps locked, with its name. The system releases it when the process ends."""


@contextmanager
def in_use(folder: Path, name: str) -> Iterator[None]:
    """Hold a folder, made where it is missing, for the worker of that name.

    Raises UsageError while another holds it, with the other's name. Where there are no locks, two are not seen.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise UsageError(f"{folder}: no files can be written there ({error.strerror}); give another --out") from None
    try:
        if is_locked(descriptor):
            other = os.read(descriptor, 200).decode("utf-8", "replace").strip()
            raise UsageError(
                f"{folder}: worker {other or 'of another process'} writes there; give this one a folder of its own "
                "with --out DIR, or end the other"
            )
        lock(descriptor)
        os.ftruncate(descriptor, 0)
        os.write(descriptor, name.encode())
        yield
    finally:
        os.close(descriptor)
