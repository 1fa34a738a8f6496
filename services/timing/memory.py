"""Paces of the stages of a study's jobs, remembered from one job to the next."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

FILE = "paces.json"
"""Name of the file in the folder of cached values."""
NEWEST = 0.5
"""Weight of the newest pace beside the one remembered: one busy moment of the machine counts by half."""


def remembered(file: Path | None) -> dict[str, float]:
    """Stage → time ÷ usual time; empty where nothing can be read."""
    if file is None:
        return {}
    with suppress(OSError, ValueError):
        found: Any = json.loads(file.read_text(encoding="utf-8"))
        if isinstance(found, dict):
            items = cast(dict[str, Any], found).items()
            return {name: float(x) for name, x in items if isinstance(x, int | float) and 0.0 < x < math.inf}
    return {}


def remember(file: Path | None, found: Mapping[str, float]) -> None:
    """Remember paces; nothing is written to a folder that is not there or cannot be written to."""
    if file is None or not found:
        return
    known = remembered(file)
    mixed = {name: x * NEWEST + known.get(name, x) * (1.0 - NEWEST) for name, x in found.items()}
    part = file.with_suffix(f".{os.getpid()}")
    with suppress(OSError):
        part.write_text(json.dumps({**known, **mixed}), encoding="utf-8")
        part.replace(file)
