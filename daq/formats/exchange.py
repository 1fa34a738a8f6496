"""Exchange tables: a run as one Parquet or CSV file, for measurements made elsewhere. Format: ``docs/channels.md``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.blocks import Flag
from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.errors import RunError, nearest
from lacet.daq.pauses import longest_step
from lacet.daq.rig import WHEEL_REFERENCES
from lacet.daq.run import BRAKES, METADATA_KEYS, Run, Signal, signal_of
from lacet.daq.text_source import is_file

SUFFIXES = (".parquet", ".csv")


def read_table(path: str | Path) -> Run:
    """The run of an exchange table (Parquet or CSV).

    Unknown columns, and rows whose stamps do not increase, are left out and reported; missing values become flagged
    samples. Raises RunError when the file is no table, has no ``t`` or no known channel.
    """
    file = Path(path)
    from lacet.daq.formats.arrow_tables import read_columns

    table, metadata, problems = read_columns(file)
    if "t" not in table:
        raise RunError(path, ["there is no column 't' (seconds)" + nearest("t", table)])
    t = table.pop("t")
    signals, faults = _signals(t, table, problems)
    if faults:
        raise RunError(path, faults)
    fields = {key: str(metadata.get(key, "")) for key in METADATA_KEYS}
    for key in metadata:
        if key not in METADATA_KEYS:
            problems.append(f"metadata key '{key}' is not known and was left out{nearest(key, METADATA_KEYS)}")
    if fields["wheel_reference"] not in (*WHEEL_REFERENCES, ""):
        raise RunError(path, [f"wheel_reference must be contact or hub, found {fields['wheel_reference']!r}"])
    if fields["brakes"] not in (*BRAKES, ""):
        raise RunError(path, [f"brakes must be off, used or unknown, found {fields['brakes']!r}"])
    fields["brakes"] = fields["brakes"] or "unknown"
    for key in ("rig", "vehicle"):
        fields[key] = _beside(file, fields[key])
    return Run(name=file.stem, signals=signals, problems=tuple(problems), marks=(), **fields)


def metadata_of(path: Path) -> dict[str, Any]:
    """The metadata of an exchange table, without its columns. Raises RunError when the file is no table."""
    from lacet.daq.formats.arrow_tables import read_metadata

    return read_metadata(path)


def _clock_jumps(t: NDArray[np.float64], keep: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(K,) kept rows before which the clock went back, or stood for as long as a pause (`daq.pauses`).

    The samples on both sides are not consecutive there, whatever the stamps say. Rows that come twice are: their time
    stands, but for no longer than the rows that were left out take, at the mean period of all rows.
    """
    kept = np.flatnonzero(keep)
    stamps = t[kept]
    back = np.zeros(len(t) + 1, np.int64)
    # A stamp that cannot be read says nothing about the clock.
    np.cumsum(t < np.maximum.accumulate(np.where(np.isfinite(t), t, -np.inf)), out=back[1:])
    went_back = np.diff(back[kept], prepend=0) > 0
    period = (stamps[-1] - stamps[0]) / max(1, len(t) - 1)
    stood = (np.diff(kept, prepend=kept[0] - 1) - 1) * period
    return went_back | (stood > longest_step(float(np.median(np.diff(stamps)))))


def _beside(file: Path, named: str) -> str:
    """Path of a file that a table names: in the table's own folder where it exists there."""
    beside = file.parent / named
    return str(beside) if is_file(beside) else named


def is_exchange_table(path: Path) -> bool:
    """Whether a file has a column ``t`` and one of the vocabulary; False also for one that cannot be read."""
    try:
        if path.suffix.lower() == ".csv":
            with path.open("rb") as stream:
                header = stream.read(2**16).partition(b"\n")[0].decode("utf-8-sig", "replace")
            names = [cell.strip().strip('"') for cell in re.split("[,;\t]", header)]
        else:
            from lacet.daq.formats.arrow_tables import column_names  # loads the library of the format

            names = column_names(path)
    except (OSError, ValueError):
        return False
    return "t" in names and any(name in COLUMNS for name in names)


def write_table(run: Run, path: str | Path) -> None:
    """Write a run whose channels share one time base as Parquet or CSV (by the suffix), metadata included.

    Raises RunError when the channels have different stamps: resample first.
    """
    file = Path(path)
    if file.suffix not in SUFFIXES:
        raise RunError(path, [f"an exchange table ends in {' or '.join(SUFFIXES)}"])
    stamps = [signal.t for signal in run.signals.values()]
    if not stamps or any(not np.array_equal(t, stamps[0]) for t in stamps[1:]):
        raise RunError(path, ["an exchange table needs one common time base; these channels have different stamps"])
    columns: dict[str, NDArray[np.float64]] = {"t": stamps[0]}
    for name, signal in run.signals.items():
        values = np.where(signal.usable[:, None], signal.values, np.nan)
        columns.update(zip(CHANNELS[name].columns, values.T, strict=True))
    metadata = {key: value for key in METADATA_KEYS if (value := getattr(run, key))}
    from lacet.daq.formats.arrow_tables import write_columns

    write_columns(file, columns, metadata)


def _signals(
    t: NDArray[np.float64], table: dict[str, NDArray[np.float64]], problems: list[str]
) -> tuple[dict[str, Signal], list[str]]:
    """Signals of the table's columns by channel, and the faults that leave nothing usable; the table is emptied."""
    finite = np.isfinite(t)
    forward = np.ones(len(t), bool)
    if len(t) > 1:
        highest = np.maximum.accumulate(np.where(finite, t, -np.inf))
        forward[1:] = t[1:] > highest[:-1]
    keep = finite & forward
    if not np.all(keep):
        first = int(np.argmin(keep))
        problems.append(
            f"{np.count_nonzero(~keep)} rows have a time that does not increase (first: row {first + 1}) "
            "and were left out"
        )
    if np.count_nonzero(keep) < 2:
        return {}, ["fewer than two rows with an increasing time"]
    stamps, whole = t[keep], bool(np.all(keep))
    jumped = np.where(_clock_jumps(t, keep), np.uint8(Flag.CLOCK), np.uint8(0))
    grouped: dict[str, dict[int, NDArray[np.float64]]] = {}
    for column in list(table):
        values = table.pop(column)  # not twice in memory
        if column not in COLUMNS:
            problems.append(f"column '{column}' is not a channel and was left out{nearest(column, COLUMNS)}")
            continue
        channel, component = COLUMNS[column]
        grouped.setdefault(channel.name, {})[component] = values if whole else values[keep]
    signals: dict[str, Signal] = {}
    for name, parts in grouped.items():
        channel = CHANNELS[name]
        lacking = [channel.columns[i] for i in range(channel.width) if i not in parts]
        if lacking:
            problems.append(f"{name} was left out: {', '.join(lacking)} missing")
            continue
        values = np.stack([parts.pop(i) for i in range(channel.width)], axis=1)
        signals[name] = signal_of(name, stamps, values, jumped)
    return signals, [] if signals else ["no column is a channel of the vocabulary (see docs/channels.md)"]
