"""Opening of a log of another system, whatever its kind."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from lacet.daq.sources.frames import bus_kind, form_not_read, is_bus_log, read_frames, read_mdf_frames
from lacet.daq.sources.source import Reading, Source, fault

KINDS = {
    ".csv": "text table", ".txt": "text table", ".tsv": "text table", ".dat": "text table", ".parquet": "Parquet",
    ".pq": "Parquet", ".mf4": "MDF", ".mdf": "MDF", ".mat": "MATLAB", ".tdms": "TDMS", ".mcap": "MCAP",
    ".log": "candump", ".candump": "candump", ".blf": "BLF", ".asc": "ASC", ".trc": "TRC",
}  # fmt: skip
"""What a suffix says; the contents are looked at for bus logs."""

_BAG = "metadata.yaml"
"""File by which a folder is a ROS 2 bag."""
_CONVERTED = (
    "convert it by rosbags (pip install rosbags): rosbags-convert --src {file} --dst {folder} --dst-storage mcap"
)
_ROS1 = f"a bag of ROS 1 is not read: {_CONVERTED}, and give {{folder}}"
_SQLITE = f"a ROS 2 bag in SQLite (.db3) is not read: {_CONVERTED}, and give {{folder}}"
_PACKED = "its files are compressed as a whole (.zstd): unpack them first, zstd -d {file}/*.zstd"


def is_bag(path: Path) -> bool:
    """Whether a path is the folder of a ROS 2 bag, read or not."""
    return (path / _BAG).is_file()


def not_read(file: Path, known: Iterable[str]) -> str:
    """Why a file of an unknown kind is not read, where `known` suffixes are, and what to do."""
    if file.suffix.lower() == ".bag":
        return _ROS1.format(file=file, folder=file.with_suffix(""))
    return f"unknown kind of file '{file.suffix.lower()}': give {', '.join(known)}"


def _bag(folder: Path, reading: Reading) -> Source:
    """The log of a ROS 2 bag. Raises RunError for another folder, or a bag that is not MCAP."""
    if not is_bag(folder):
        raise fault(folder, f"a folder is read only where it is a ROS 2 bag ({_BAG} in it): give the log's file")
    if any(folder.glob("*.mcap")):
        from lacet.daq.sources.mcap_messages import McapMessages

        return McapMessages(folder, reading)
    if any(folder.glob("*.db3")):
        raise fault(folder, _SQLITE.format(file=folder, folder=f"{folder}-mcap"))
    if any(folder.glob("*.mcap.zstd")):
        raise fault(folder, _PACKED.format(file=folder))
    raise fault(folder, "this bag has no files of messages (.mcap)")


def open_source(path: str | Path, reading: Reading | None = None) -> Source:
    """The log in a file, or in the folder of a ROS 2 bag. Raises RunError with what was found and what is read.

    The libraries of a format are loaded when a file of it is opened.
    """
    file, reading = Path(path), reading or Reading()
    if file.is_dir():
        return _bag(file, reading)
    if not file.is_file():
        raise fault(file, "no such file")
    if file.stat().st_size == 0:
        raise fault(file, "the file is empty")
    if kind := bus_kind(file):
        from lacet.daq.sources.bus import BusSource

        source = BusSource(file, reading.dbc, lambda lost: read_frames(file, kind, lost), None)
        source.without_zone = kind in ("ASC", "BLF")
        return source
    if form := form_not_read(file):
        raise fault(file, form)
    match KINDS.get(file.suffix.lower()):
        case "text table" | "candump" | "ASC" | "TRC":
            from lacet.daq.sources.csv_table import CsvTable

            return CsvTable(file, reading)
        case "Parquet":
            from lacet.daq.sources.parquet_table import ParquetTable

            return ParquetTable(file, reading)
        case "MDF":
            from lacet.daq.sources.mdf import MdfSource, open_mdf, start_of

            mdf = open_mdf(file)
            if is_bus_log(mdf):
                from lacet.daq.sources.bus import BusSource

                return BusSource(file, reading.dbc, lambda lost: read_mdf_frames(file, mdf, lost), start_of(mdf))
            return MdfSource(file, reading, mdf)
        case "MATLAB":
            from lacet.daq.sources.mat import MatSource

            return MatSource(file, reading)
        case "TDMS":
            from lacet.daq.sources.tdms import TdmsSource

            return TdmsSource(file, reading)
        case "MCAP":
            from lacet.daq.sources.mcap_messages import McapMessages

            return McapMessages(file, reading)
        case "BLF":
            raise fault(file, "this is no BLF log (it does not begin with 'LOGG')")
        case _:
            raise fault(file, not_read(file, KINDS))


@contextmanager
def opened(path: str | Path, reading: Reading | None = None) -> Iterator[Source]:
    """The log in a file, closed at the end."""
    source = open_source(path, reading)
    try:
        yield source
    finally:
        source.close()
