"""Channel maps made and mended on the page: names of a log, proposals with their probability, checks, and the file."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping, MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.toml_document import TOMLDocument

from lacet.daq.channels import COLUMNS
from lacet.daq.errors import LacetError, RunError, UsageError
from lacet.daq.formats.open_run import is_own
from lacet.daq.formats.result import plain
from lacet.daq.maps.channel_map import CHANNEL_KEYS, FORMAT, ChannelMap, MapError
from lacet.daq.maps.guess import ACCEPTED, guess
from lacet.daq.maps.mapped_run import map_beside, mapped_run
from lacet.daq.sources.open_source import opened
from lacet.daq.sources.source import Reading
from lacet.daq.toml_reader import dotted
from lacet.services.render.units import unit_text
from lacet.services.workbench.file_changes import set_aside
from lacet.services.workbench.run_files import find_run
from lacet.services.workbench.session_cache import SessionCache

MOST = 400
"""Most entries of a map from the page."""

Entry = str | dict[str, str]
"""An entry of ``[channels]``: an expression, or its texts by `CHANNEL_KEYS`."""


def map_payload(cache: SessionCache, name: str) -> dict[str, Any]:
    """Names of a log with units and ranges, what each could be, and the entries of its map.

    Entries are texts, or texts by key where more than an expression is said; `kept` are those in no such form. Without
    a map the entries are the proposals that are probable enough. Raises UsageError for a file of lacet's own,
    RunError where it cannot be read.
    """
    path = _log(cache, name)
    present = map_beside(path)
    tables = _tables(_written(present))
    with opened(path, _reading(present)) as source:
        found = guess(source)
        notes = list(source.notes)
    proposals = {
        g.column: {"expression": g.expression, "unit": g.said_unit, "name": g.name, "probability": g.probability}
        for g in found
        if g.column
    }
    written = _channels(tables)
    entries: dict[str, Entry] = {column: entry for column, entry in written.items() if _is_entry(entry)}
    units = _units(tables)
    if present is None:
        sure = {column: p for column, p in proposals.items() if p["probability"] >= ACCEPTED}
        entries = {column: str(p["expression"]) for column, p in sure.items()}
        units = {p["name"]: p["unit"] for p in sure.values() if p["unit"]}
    others = [column for column, entry in written.items() if not _is_entry(entry)]
    return plain(
        {
            "file": path.name, "map": present.name if present else None, "own": _own(path).name,
            "names": [{"name": g.name, "unit": g.unit, "rate": g.rate, "low": g.low, "high": g.high} for g in found],
            "proposals": proposals, "accepted": ACCEPTED, "entries": entries, "units": units, "kept": others,
            "columns": [{"column": column, "unit": unit_text(channel.unit), "about": channel.about}
                        for column, (channel, _) in COLUMNS.items()],
            "notes": notes,
        }
    )  # fmt: skip


def check_map(cache: SessionCache, name: str, body: Mapping[str, Any], keep: bool) -> dict[str, Any]:
    """Result of a map: each entry's fault, or the range of its column in the run that the map makes.

    `keep` : store it beside the log, where it makes a run; the map before is set aside. Raises UsageError for a body
    that is no map, or one to be kept that makes no run.
    """
    path = _log(cache, name)
    entries, units = _entries(body), _texts(body, "units")
    present = map_beside(path)
    before = _written(present)
    tables = _tables(before)
    columns: dict[str, dict[str, Any]] = {}
    good: dict[str, Entry] = {}
    for column, entry in entries.items():
        fault = _elsewhere(entry, _channels(tables).get(column)) or _fault(
            _edited("", {column: entry}, units), path.parent
        ).replace(f"channels.{column}", "").lstrip(".: ")
        columns[column] = {"fault": fault, "low": None, "high": None}
        if not fault:
            good[column] = entry
    text = _edited(before, good, units)
    notes, seconds = list[str](), None
    try:
        run = mapped_run([path], ChannelMap.parse(text, _own(path).name, path.parent))
        notes, seconds = list(run.problems), run.duration
        for column in good:
            channel, component = COLUMNS[column]
            signal = run.signals.get(channel.name)
            if signal is not None and np.isfinite(signal.values[:, component]).any():
                values = signal.values[:, component]
                columns[column] |= {"low": float(np.nanmin(values)), "high": float(np.nanmax(values))}
    except RunError as error:
        notes = [fault for fault in error.faults if "lacet map" not in fault]  # its remedy is this page
    except LacetError as error:
        notes = [str(error)]
    found = {"columns": columns, "notes": notes, "seconds": seconds, "makes_run": seconds is not None, "kept": False}
    if keep:
        if seconds is None:
            raise UsageError(f"this map makes no run: {'; '.join(notes)}")
        _store(cache, _own(path), text)
        found["kept"] = True
    return plain(found)


def _log(cache: SessionCache, name: str) -> Path:
    path = find_run(cache, name)
    if is_own(path):
        raise UsageError(f"{path.name} is a file of lacet's own: it needs no channel map")
    return path


def _own(path: Path) -> Path:
    """The map of one log alone."""
    return path.with_suffix(".map.toml")


def _written(file: Path | None) -> str:
    """The text of a map; empty without one, or where it cannot be read."""
    with suppress(OSError, ValueError):
        return file.read_text(encoding="utf-8") if file else ""
    return ""


def _tables(text: str) -> dict[str, Any]:
    """Tables of a map as it is written; empty where it is no TOML."""
    with suppress(ValueError):
        return tomllib.loads(text)
    return {}


def _channels(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Column → its entry, as it is written."""
    found = tables.get("channels")
    return dotted(found, COLUMNS) if isinstance(found, dict) else {}


def _units(tables: Mapping[str, Any]) -> dict[str, str]:
    """Name of the log → the unit that a map says it has."""
    said = {name: one.get("unit") if isinstance(one, dict) else one for name, one in tables.get("sources", {}).items()}
    return {name: unit for name, unit in said.items() if isinstance(unit, str) and unit}


def _is_entry(entry: Any) -> bool:
    """Whether an entry is one that the page edits."""
    if isinstance(entry, dict):
        return "from" in entry and set(entry) <= set(CHANNEL_KEYS) and all(isinstance(v, str) for v in entry.values())
    return isinstance(entry, str)


def _elsewhere(entry: Entry, before: Any) -> str:
    """Fault of a lookup table from the page that is no file beside the log; one that the map had before may be."""
    table = entry.get("table", "") if isinstance(entry, dict) else ""
    had = before.get("table") if isinstance(before, dict) else None
    if table in ("", had) or (Path(table).name == table and "\\" not in table):
        return ""
    return f"table: '{table}' is no name of a file beside the log"


def _reading(file: Path | None) -> Reading:
    """How a map says that its log is read."""
    with suppress(LacetError):
        return ChannelMap.load(file).reading if file else Reading()
    return Reading()


def _texts(body: Mapping[str, Any], key: str) -> dict[str, str]:
    found = body.get(key) or {}
    if not isinstance(found, dict) or not all(isinstance(v, str) and len(v) < 1000 for v in found.values()):
        raise UsageError(f"{key}: texts by name")
    if len(found) > MOST:
        raise UsageError(f"{key}: at most {MOST}")
    return {str(name): value.strip() for name, value in found.items() if value.strip()}


def _entries(body: Mapping[str, Any]) -> dict[str, Entry]:
    """Entries of the page; one that has an expression alone is that. Raises UsageError for what is none."""
    found = body.get("entries") or {}
    if not isinstance(found, dict) or len(found) > MOST:
        raise UsageError(f"entries: at most {MOST}, by column")
    out: dict[str, Entry] = {}
    for column, entry in found.items():
        parts = _texts({"entries": {"from": entry} if isinstance(entry, str) else entry}, "entries")
        if not set(parts) <= set(CHANNEL_KEYS):
            raise UsageError(f"entries: a text, or texts of {', '.join(CHANNEL_KEYS)}")
        if "from" in parts:
            out[str(column)] = parts if len(parts) > 1 else parts["from"]
    return out


def _fault(text: str, folder: Path) -> str:
    """What is wrong with a map, in a sentence; empty where nothing is."""
    try:
        ChannelMap.parse(text, "map", folder)
    except MapError as error:
        return "; ".join(error.faults)
    return ""


def _edited(text: str, entries: Mapping[str, Entry], units: Mapping[str, str]) -> str:
    """A map's text with these entries and units; what the page does not edit is as it was, comments too."""
    try:
        document = tomlkit.parse(text)
    except TOMLKitError:
        document = tomlkit.document()
    document["format"] = FORMAT
    sources, channels = _table(document, "sources"), _table(document, "channels")
    for name in [*sources, *(set(units) - set(sources))]:
        _say_unit(sources, name, units.get(name))
    before = _channels(document)
    for column in [column for column, entry in before.items() if _is_entry(entry) and column not in entries]:
        _remove(channels, column)
    for column, entry in entries.items():
        if before.get(column) != entry:
            _put(channels, column, entry)
    for name, table in (("sources", sources), ("channels", channels)):
        if not table:
            del document[name]
    return tomlkit.dumps(document)


def _table(document: TOMLDocument, name: str) -> MutableMapping[str, Any]:
    """A table of a map, which is made where there is none."""
    if not isinstance(document.get(name), dict):
        document[name] = tomlkit.table()
    return cast("MutableMapping[str, Any]", document[name])


def _say_unit(sources: MutableMapping[str, Any], name: str, unit: str | None) -> None:
    """Enter the unit of a source, or none; what else is said of the source stays."""
    said = sources.get(name)
    if not isinstance(said, dict):
        if unit is None:
            del sources[name]
        elif said != unit:
            sources[name] = unit
    elif unit is not None:
        said["unit"] = unit
    else:
        said.pop("unit", None)
        if not said:
            del sources[name]


def _holder(table: MutableMapping[str, Any], column: str) -> tuple[MutableMapping[str, Any], str]:
    """The table that a column's entry is in, or belongs in, and its key there: dotted keys are nested in TOML."""
    for key, inside in table.items():
        if column.startswith(f"{key}.") and isinstance(inside, dict) and "from" not in inside:
            return _holder(inside, column.removeprefix(f"{key}."))
    return table, column


def _put(channels: MutableMapping[str, Any], column: str, entry: Entry) -> None:
    table, key = _holder(channels, column)
    if isinstance(entry, dict):
        inline = tomlkit.inline_table()
        inline.update(entry)
        table[key] = inline
    else:
        table[key] = entry


def _remove(channels: MutableMapping[str, Any], column: str) -> None:
    table, key = _holder(channels, column)
    del table[key]


def _store(cache: SessionCache, file: Path, text: str) -> None:
    """Write a map beside its log, whole or not at all; the one before is set aside."""
    part = file.with_name(f".{os.getpid()}.part.toml")
    try:
        part.write_text(text, encoding="utf-8")
        set_aside(cache, file)
        part.replace(file)
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from None
    finally:
        part.unlink(missing_ok=True)
