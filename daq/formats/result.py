"""Machine-readable results, which every command can write with ``--json``; formats: ``docs/json.md``."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, TextIO

from lacet.daq.errors import UsageError

FORMAT = "lacet-result 1"

DONE = 0
BAD_INPUT = 2
WITH_LOSSES = 3
"""Exit codes: success; bad usage or input; success with losses, or nothing identifiable."""


def write_result(path: str | Path | TextIO | None, command: str, payload: dict[str, Any]) -> None:
    """Write ``{"format", "command", **payload}`` to `path` (a file or an open stream); None writes nothing.

    Raises UsageError when the file cannot be written.
    """
    if path is None:
        return
    text = json.dumps(plain({"format": FORMAT, "command": command, **payload}), indent=1, ensure_ascii=False) + "\n"
    if not isinstance(path, str | Path):
        path.write(text)
    else:
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_text(text, encoding="utf-8")
        except OSError as error:
            raise UsageError(f"--json {path}: cannot be written: {error.strerror}") from None


def plain(value: Any) -> Any:
    """`value` as plain JSON: arrays become lists, numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy's arrays and numbers; NumPy itself takes long to load
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
