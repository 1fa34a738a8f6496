"""Reader of runs in any of the file formats."""

from __future__ import annotations

from pathlib import Path

from lacet.daq.errors import RunError
from lacet.daq.formats import exchange, mf4
from lacet.daq.formats.log_run import read_run
from lacet.daq.run import Run


def open_run(path: str | Path) -> Run:
    """The run in a file: MCAP log with decoded blocks, exchange table (Parquet or CSV) or MDF file (``.mf4``).

    Raises RunError with every fault when nothing can be used; a damaged file is read as far as possible, with the
    losses in `Run.problems`.

    Examples
    --------
    >>> run = lacet.open_run("tests/data/car/sine.parquet")
    >>> run.name, "wheel.fl.force" in run.signals
    ('sine', True)
    """
    file = Path(path)
    if not file.is_file():
        raise RunError(path, ["no such file"])
    suffix = file.suffix.lower()
    if suffix in exchange.SUFFIXES:
        return exchange.read_table(file)
    if suffix == ".mcap":
        return read_run(file)
    if suffix in mf4.SUFFIXES:
        return mf4.read_mf4(file)
    raise RunError(path, [f"unknown kind of file '{suffix}': give an MCAP log (.mcap), .parquet, .csv or .mf4"])
