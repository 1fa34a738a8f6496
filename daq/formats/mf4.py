"""Reader of runs that other systems recorded: MDF files (``.mf4``) with a channel map. Format: ``docs/channels.md``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, COLUMNS, Channel
from lacet.daq.errors import RunError, nearest
from lacet.daq.formats.mf4_write import RIG, VEHICLE, attached, declared
from lacet.daq.rig import WHEEL_REFERENCES
from lacet.daq.run import BRAKES, METADATA_KEYS, Run, Signal, signal_of
from lacet.daq.sources.mdf import MdfSource, open_mdf
from lacet.daq.sources.source import Reading, read_all
from lacet.daq.toml_reader import Reader
from lacet.daq.units import read_unit

SUFFIXES = (".mf4", ".mdf")
FORMAT = "lacet-mf4 1"
SHARED_MAP = "mf4.toml"
"""Name of the map for every MDF file in its folder that has none of its own."""


@dataclass(frozen=True)
class _Source:
    """Origin of a column: value = scale · recorded + offset, `unit` of the product (empty: the file's own)."""

    name: str
    group: int | None = None
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0


def read_mf4(path: str | Path) -> Run:
    """The run of an MDF file, version 3 or 4; of one that `mf4_write.write_mf4` wrote with all that it declares.

    Its channels are named by the map beside it (``run.toml`` beside ``run.mf4``, or ``mf4.toml`` in its folder); those
    with the names of exchange-table columns need none. Raises RunError, with every fault, when the file or its map
    cannot be used, or no channel of the vocabulary is found.
    """
    file = Path(path)
    columns, metadata = _map_of(file)
    recorded = _Recorded(file)
    problems: list[str] = []
    for column in COLUMNS:
        if column not in columns and recorded.has(column):
            columns[column] = _Source(column)
    signals: dict[str, Signal] = {}
    for channel in CHANNELS.values():
        if any(column in columns for column in channel.columns):
            found = _channel(channel, columns, recorded, problems)
            if found is not None:
                signals[channel.name] = found
    recorded.close()
    if recorded.without_unit:
        names = ", ".join(recorded.without_unit[:6]) + (" …" if len(recorded.without_unit) > 6 else "")
        problems.append(f"without a unit, taken as SI: {names}")
    if not signals:
        hint = f"write a map, {file.with_suffix('.toml').name} or {SHARED_MAP}, that names them (docs/channels.md)"
        raise RunError(file, [*problems, f"no channel of the vocabulary is in it; it has {recorded.some()}: {hint}"])
    start = min(float(one.t[0]) for one in signals.values())
    signals = {name: Signal(one.t - start, one.values, one.flags) for name, one in signals.items()}
    texts = {"vehicle_text": recorded.attached.get(VEHICLE, ""), "rig_text": recorded.attached.get(RIG, "")}
    return Run(
        name=file.stem,
        signals=signals,
        problems=tuple(problems),
        marks=(),
        **texts,
        **(declared(recorded.attached) | metadata),
    )


class _Recorded:
    """The channels of an MDF file by name."""

    def __init__(self, file: Path):
        mdf = open_mdf(file)
        self.attached = attached(mdf)
        self._source = MdfSource(file, Reading(), mdf)
        self.without_unit: list[str] = []

    def has(self, name: str) -> bool:
        """Whether any group has a channel of that name."""
        return name in self._source.groups

    def some(self) -> str:
        """Names of its first channels."""
        names = list(self._source.groups)
        return ", ".join(names[:12]) + (" …" if len(names) > 12 else "") or "none at all"

    def get(self, source: _Source) -> tuple[NDArray[np.float64], NDArray[np.float64], str]:
        """Stamps [s], values (NaN where marked invalid) and unit, the map's first. Raises ValueError in words."""
        places = self._source.groups.get(source.name, [])
        if source.group is not None:
            places = [place for place in places if place[0] == source.group]
        if not places:
            where = "" if source.group is None else f" in group {source.group}"
            raise ValueError(f"there is no '{source.name}'{where}{nearest(source.name, self._source.groups)}")
        if len(places) > 1:
            groups = ", ".join(str(group) for group, _ in places)
            raise ValueError(f"'{source.name}' is in groups {groups}: say which in the map (group = …)")
        own = places[0][1]
        if own not in self._source.listed:
            raise ValueError(f"'{source.name}' cannot be read: it is text, an array, or empty")
        try:
            series = read_all(self._source, [own])[own]
        except RunError as cause:
            raise ValueError("; ".join(cause.faults)) from None
        unit = source.unit or self._source.listed[own].unit
        if not unit:
            self.without_unit.append(source.name)
        return series.t, series.values, unit

    def close(self) -> None:
        """Close the file."""
        self._source.close()


def _channel(
    channel: Channel, columns: Mapping[str, _Source], recorded: _Recorded, problems: list[str]
) -> Signal | None:
    """A channel from its columns, on the stamps of the first; None, with the reason in `problems`, where one lacks."""
    parts: list[NDArray[np.float64]] = []
    stamps: NDArray[np.float64] | None = None
    for column in channel.columns:
        if column not in columns:
            problems.append(f"{channel.name} was left out: {column} is missing")
            return None
        source = columns[column]
        try:
            t, values, unit = recorded.get(source)
            values = _in_si(source, values, unit, channel.unit)
        except ValueError as cause:
            problems.append(f"{channel.name} was left out: {column}: {cause}")
            return None
        keep = np.isfinite(t)
        if t.size:
            highest = np.maximum.accumulate(np.where(keep, t, -np.inf))
            keep[1:] &= t[1:] > highest[:-1]
        if np.count_nonzero(keep) < 2:
            problems.append(f"{channel.name} was left out: {column} has fewer than two samples")
            return None
        if not np.all(keep):
            problems.append(f"{column}: {np.count_nonzero(~keep)} samples have a time that does not increase")
        t, values = t[keep], values[keep]
        if stamps is None:
            stamps = t
        elif not np.array_equal(t, stamps):
            values = np.interp(stamps, t, values, left=np.nan, right=np.nan)
            problems.append(f"{column} has other stamps than {channel.columns[0]} and was interpolated")
        parts.append(values)
    assert stamps is not None
    return signal_of(channel.name, stamps, np.stack(parts, axis=1))


def _in_si(source: _Source, values: NDArray[np.float64], unit: str, wanted: str) -> NDArray[np.float64]:
    """Values in the channel's SI unit. Raises ValueError for a unit that is unknown or of another dimension."""
    values = source.scale * values + source.offset
    if not unit:
        return values  # the map's scale then converts to SI
    found = read_unit(unit)
    if not found.fits(wanted):
        raise ValueError(f"its unit is {unit}, wanted is {wanted}: say the right one in the map (unit = …, scale = …)")
    return found.factor * values + found.offset


def map_beside(file: Path) -> Path | None:
    """The channel map of an MDF file, or None."""
    return next((f for f in (file.with_suffix(".toml"), file.with_name(SHARED_MAP)) if f.is_file()), None)


def _map_of(file: Path) -> tuple[dict[str, _Source], dict[str, str]]:
    beside = map_beside(file)
    return read_map(beside) if beside else ({}, {})


def read_map(path: Path) -> tuple[dict[str, _Source], dict[str, str]]:
    """A channel map: column → source, and the run's metadata. Raises RunError with every fault of the map."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as cause:
        raise RunError(path, [f"cannot be read: {cause}"]) from None
    reader = Reader(text, str(path), RunError, FORMAT)
    root = reader.root
    reader.known(root, ("format", "run", "channels"), "")
    run = reader.table(root, "run", "", required=False)
    reader.known(run, METADATA_KEYS, "run")
    metadata = {key: reader.text(run, key, "run", "") for key in METADATA_KEYS if key in run}
    if "wheel_reference" in run:
        reader.choice(run, "wheel_reference", "run", WHEEL_REFERENCES, "")
    if "brakes" in run:
        reader.choice(run, "brakes", "run", BRAKES, "unknown")
    columns: dict[str, _Source] = {}
    for column, entry in _flat(reader.table(root, "channels", "", required=False)).items():
        place = f"channels.{column}"
        if column not in COLUMNS:
            reader.fault(place, f"is not a channel{nearest(column, COLUMNS)}")
        elif isinstance(entry, str):
            columns[column] = _Source(entry)
        elif isinstance(entry, dict):
            columns[column] = _source(reader, entry, place)
        else:
            reader.fault(place, 'write "NAME" or { name = "NAME", unit = "deg", scale = -1.0 }')
    reader.finish()
    return columns, metadata


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """A table of tables with dotted keys: ``wheel.fl.force.x`` without quotes is nested in TOML."""
    out: dict[str, Any] = {}
    for key, entry in table.items():
        if isinstance(entry, dict) and "name" not in entry and f"{before}{key}" not in COLUMNS:
            out |= _flat(entry, f"{before}{key}.")
        else:
            out[f"{before}{key}"] = entry
    return out


def _source(reader: Reader, entry: dict[str, Any], place: str) -> _Source:
    reader.known(entry, ("name", "group", "unit", "scale", "offset"), place)
    group = entry.get("group")
    if group is not None and (isinstance(group, bool) or not isinstance(group, int) or group < 0):
        reader.fault(f"{place}.group", f"must be the number of a group, from 0, found {group!r}")
        group = None
    unit = reader.text(entry, "unit", place, "")
    if unit:
        try:
            read_unit(unit)
        except ValueError as cause:
            reader.fault(f"{place}.unit", str(cause))
    return _Source(
        reader.text(entry, "name", place), group, unit,
        reader.number(entry, "scale", place, 1.0), reader.number(entry, "offset", place, 0.0),
    )  # fmt: skip
