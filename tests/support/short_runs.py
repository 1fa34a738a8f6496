"""Many short runs of the reference car, cut from its committed tables."""

from __future__ import annotations

from pathlib import Path

from tests.support.tables import CAR, piece, written

TABLES = ("sine", "rough", "sweep", "liftoff")
LENGTH = 30.0
"""Length of each table [s]."""

__all__ = ["CAR", "write_short_runs"]


def write_short_runs(folder: Path, count: int, seconds: float) -> list[Path]:
    """Files of so many windows of the tables, in turn, each from another time on; many of them overlap."""
    folder.mkdir(parents=True, exist_ok=True)
    turns = -(-count // len(TABLES))
    out: list[Path] = []
    for number in range(count):
        name, turn = TABLES[number % len(TABLES)], number // len(TABLES)
        start = turn * (LENGTH - seconds) / turns
        file = folder / f"{name}-{turn:04d}.parquet"
        out.append(file if file.exists() else written(piece.__wrapped__(name, start, start + seconds), file))
    return out
