"""Rig and vehicle files shipped with lacet, found by their bare names."""

from __future__ import annotations

from pathlib import Path

from lacet.daq.errors import FileFault, nearest
from lacet.daq.text_source import is_file

DRIVERS = Path(__file__).resolve().parents[1] / "drivers"
"""Folder of the drivers shipped with lacet. Only the names of its files are looked at here."""


def driver_files(folder: Path) -> tuple[str, ...]:
    """Names of the drivers in a folder, those of its Python files."""
    return tuple(sorted(file.stem for file in folder.glob("*.py") if not file.stem.startswith("_")))


def find_shipped(path: str | Path, folder: str, error: type[FileFault]) -> Path:
    """Path of a file, or of one shipped in ``daq/<folder>`` by its bare name. Raises `error` with the choices."""
    candidate = Path(path)
    if is_file(candidate):
        return candidate
    shipped = Path(__file__).parent / folder
    names = sorted(file.stem for file in shipped.glob("*.toml"))
    if candidate.name in names and candidate.suffix == "":
        return shipped / f"{candidate.name}.toml"
    raise error(path, [f"no such file, and not one shipped with lacet ({', '.join(names)}){nearest(str(path), names)}"])
