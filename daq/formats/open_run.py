"""Reader of runs in any of the file formats, lacet's own or, by a channel map, those of others."""

from __future__ import annotations

from pathlib import Path

from lacet.daq.errors import RunError
from lacet.daq.formats import exchange, mf4
from lacet.daq.formats.log_run import read_run
from lacet.daq.formats.mf4_write import is_written_here
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.mapped_run import map_beside, mapped_run
from lacet.daq.run import Run
from lacet.daq.sources.open_source import KINDS as SOURCE_KINDS
from lacet.daq.sources.open_source import is_bag, not_read

KINDS = tuple(dict.fromkeys((".mcap", *sorted(exchange.SUFFIXES), *mf4.SUFFIXES, *SOURCE_KINDS)))
"""Suffixes of files that can be runs."""
_START = b"lacet.StartRecord"
_HEAD = 1 << 16


def open_run(path: str | Path, map: str | Path | ChannelMap | None = None) -> Run:
    """The run in a file.

    MCAP logs with decoded blocks, exchange tables (Parquet or CSV) and MDF files (``.mf4``) are read as they are; logs
    of other systems (CSV of any header, Parquet, MDF, MATLAB, TDMS, MCAP, bus logs with their DBC) by a channel map:
    the one given, or one beside the file (``run.map.toml``, or ``map.toml`` in its folder).

    Raises RunError with every fault when nothing can be used, MapError for a map with faults; a damaged file is read as
    far as possible, with the losses in `Run.problems`.

    Examples
    --------
    >>> run = lacet.open_run("tests/data/car/sine.parquet")
    >>> run.name, "wheel.fl.force" in run.signals
    ('sine', True)
    """
    file = Path(path)
    if not file.is_file() and not is_bag(file):
        raise RunError(path, ["no such file"])
    if map is not None:
        return mapped_run([file], map if isinstance(map, ChannelMap) else ChannelMap.load(map))
    suffix = file.suffix.lower()
    beside = map_beside(file)
    if suffix == ".mcap" and _is_own_log(file):
        return read_run(file)
    if beside is not None and (beside.stem == f"{file.stem}.map" or not _is_own_table(file)):
        return mapped_run([file], ChannelMap.load(beside))
    remedy = (
        f"if another system wrote it, a channel map says which of its names is what: lacet map --guess {file} -o "
        "map.toml proposes one, and --map map.toml (or map.toml beside the file) is read by"
    )
    try:
        if suffix in exchange.SUFFIXES:
            return exchange.read_table(file)
        if suffix == ".mcap":
            return read_run(file)
        if suffix in mf4.SUFFIXES:
            return mf4.read_mf4(file)
    except RunError as error:
        if error.path == str(path) and not _is_own_table(file):
            raise RunError(path, [*error.faults, remedy]) from None
        raise
    if is_bag(file):
        raise RunError(path, [f"this is a ROS 2 bag: {remedy}"])
    if suffix in SOURCE_KINDS:
        raise RunError(path, [f"this is a log of another system ({SOURCE_KINDS[suffix]}): {remedy}"])
    raise RunError(path, [not_read(file, KINDS)])


def open_log(path: str | Path, map: ChannelMap | None) -> Run:
    """The run in a file, by a map where there is one and the file is not lacet's own. Raises as `open_run`."""
    return open_run(path, None if is_own(Path(path)) else map)


def is_own(file: Path) -> bool:
    """Whether a file is one of lacet's own: a log, an exchange table, an MDF file of lacet or with its own map."""
    return file.is_file() and (_is_own_log(file) if file.suffix.lower() == ".mcap" else _is_own_table(file))


def _is_own_log(file: Path) -> bool:
    with file.open("rb") as stream:
        return _START in stream.read(_HEAD)


def _is_own_table(file: Path) -> bool:
    """Whether a table has columns of an exchange table, or an MDF file an own map beside it, or lacet as its writer."""
    if file.suffix.lower() in exchange.SUFFIXES:
        return exchange.is_exchange_table(file)
    return file.suffix.lower() in mf4.SUFFIXES and (mf4.map_beside(file) is not None or is_written_here(file))
