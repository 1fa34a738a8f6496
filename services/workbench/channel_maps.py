"""Channel maps made and mended on the page: names of a log, proposals with their probability, checks, and the file."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.channels import COLUMNS
from lacet.daq.errors import LacetError, RunError, UsageError
from lacet.daq.formats.open_run import is_own
from lacet.daq.formats.result import plain
from lacet.daq.maps.channel_map import FORMAT, ChannelMap, MapError
from lacet.daq.maps.guess import ACCEPTED, guess
from lacet.daq.maps.mapped_run import map_beside, mapped_run
from lacet.daq.sources.open_source import opened
from lacet.daq.sources.source import Reading
from lacet.services.render.units import unit_text
from lacet.services.workbench.file_changes import set_aside
from lacet.services.workbench.run_files import find_run
from lacet.services.workbench.session_cache import SessionCache

MOST = 400
"""Most entries of a map from the page."""


def map_payload(cache: SessionCache, name: str) -> dict[str, Any]:
    """Names of a log with units and ranges, what each could be, and the entries of its map.

    Without a map the entries are the proposals that are probable enough. Raises UsageError for a file of lacet's own,
    RunError where it cannot be read.
    """
    path = _log(cache, name)
    present = map_beside(path)
    tables = _tables(present)
    with opened(path, _reading(present)) as source:
        found = guess(source)
        notes = list(source.notes)
    proposals = {
        g.column: {"expression": g.expression, "unit": g.said_unit, "name": g.name, "probability": g.probability}
        for g in found
        if g.column
    }
    entries = {column: entry for column, entry in tables.get("channels", {}).items() if isinstance(entry, str)}
    units = {key: entry for key, entry in tables.get("sources", {}).items() if isinstance(entry, str)}
    if present is None:
        sure = {column: p for column, p in proposals.items() if p["probability"] >= ACCEPTED}
        entries = {column: p["expression"] for column, p in sure.items()}
        units = {p["name"]: p["unit"] for p in sure.values() if p["unit"]}
    others = [column for column, entry in tables.get("channels", {}).items() if not isinstance(entry, str)]
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
    entries, units = (_texts(body, key) for key in ("entries", "units"))
    present = map_beside(path)
    tables = _tables(present)
    columns: dict[str, dict[str, Any]] = {}
    good: dict[str, str] = {}
    for column, expression in entries.items():
        fault = _fault(_text({}, {column: expression}, units), path.parent).replace(f"channels.{column}: ", "")
        columns[column] = {"fault": fault, "low": None, "high": None}
        if not fault:
            good[column] = expression
    text = _text(tables, good, units)
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


def _tables(file: Path | None) -> dict[str, Any]:
    """Tables of a map as it is written; empty without one, or where it is no TOML."""
    with suppress(OSError, ValueError):
        return tomllib.loads(file.read_text(encoding="utf-8")) if file else {}
    return {}


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


def _fault(text: str, folder: Path) -> str:
    """What is wrong with a map, in a sentence; empty where nothing is."""
    try:
        ChannelMap.parse(text, "map", folder)
    except MapError as error:
        return "; ".join(error.faults)
    return ""


def _text(tables: Mapping[str, Any], entries: Mapping[str, str], units: Mapping[str, str]) -> str:
    """A map's text: what the page does not edit as it was, its entries and units as given."""
    sources = {k: v for k, v in tables.get("sources", {}).items() if not isinstance(v, str)} | dict(units)
    channels = {k: v for k, v in tables.get("channels", {}).items() if not isinstance(v, str)} | dict(entries)
    parts = {"run": tables.get("run", {}), "read": tables.get("read", {}), "sources": sources, "channels": channels}
    lines = [f'format = "{FORMAT}"']
    for title, table in parts.items():
        if table:
            lines += ["", f"[{title}]", *(f"{_value(key)} = {_value(value)}" for key, value in table.items())]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    """A value of a map in TOML."""
    if isinstance(value, dict):
        inside = ", ".join(f"{_value(key)} = {_value(one)}" for key, one in value.items())
        return f"{{ {inside} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value, ensure_ascii=False)


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
