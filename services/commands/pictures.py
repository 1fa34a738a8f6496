"""Pictures as files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def write_pictures(pictures: Mapping[str, bytes], folder: Path) -> list[Path]:
    """Write pictures, name → PNG, into a folder; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    files: list[Path] = []
    for name, content in pictures.items():
        files.append(folder / f"{name}.png")
        files[-1].write_bytes(content)
    return files
