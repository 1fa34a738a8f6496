"""Channel maps, ``lacet-map 1``: each column of the vocabulary as an expression over a log's names, with units.

Nothing in a map is executed. Units are checked when it is read, as far as it says them; those of the files when a file
is opened. Format: ``docs/maps.md``.
"""

from __future__ import annotations

import fnmatch
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.dimension import Dimension
from lacet.daq.errors import FileFault, RunError, nearest
from lacet.daq.expressions.dimensions import Dimensions
from lacet.daq.expressions.expression import ExpressionFault
from lacet.daq.expressions.functions import FUNCTIONS
from lacet.daq.maps.lookup import Lookup, read_lookup
from lacet.daq.maps.names import Written, marked, read_names
from lacet.daq.rig import WHEEL_REFERENCES
from lacet.daq.run import BRAKES, METADATA_KEYS
from lacet.daq.sources.source import Reading
from lacet.daq.text_source import is_file
from lacet.daq.toml_reader import Reader, dotted
from lacet.daq.units import Unit, UnitFault, read_unit

FORMAT = "lacet-map 1"
_TABLES = ("format", "run", "read", "sources", "channels")
READ_KEYS = ("time", "time_unit", "rate", "separator", "decimal", "encoding", "header", "dbc")
SOURCE_KEYS = ("name", "unit", "time", "delay", "drift")
LARGEST_DRIFT = 0.1
"""Drift from which on it is no clock's but another unit of time [s/s]. Source: a choice; loggers are below 1e-3."""
CHANNEL_KEYS = ("from", "unit", "table", "delay")


class MapError(FileFault):
    """A channel map with faults."""


@dataclass(frozen=True)
class Said:
    """What a map says of a name of the log.

    Attributes
    ----------
    name : another name there; `unit` : of the recorded numbers; `time` : its column of times.
    delay : that much later than measured it is stamped at the log's beginning [s]; `drift` : growth of that [s/s], by
        a clock that runs fast.
    """

    name: str = ""
    unit: str = ""
    time: str = ""
    delay: float = 0.0
    drift: float = 0.0


@dataclass(frozen=True)
class Mapped:
    """A column of the vocabulary and where it comes from.

    Attributes
    ----------
    column : ``wheel.fl.force.x``.
    written : the expression.
    unit : unit of its only name where this entry says it, over the file's.
    lookup : table that the expression's value is looked up in.
    delay : that much later than measured the samples are stamped [s].
    """

    column: str
    written: Written
    unit: str = ""
    lookup: Lookup | None = None
    delay: float = 0.0

    def check(self, units: Mapping[str, Unit | None]) -> None:
        """Check that the result is in a unit of the column, as far as the units of its names (in the log) are known.

        Raises ExpressionFault with the place, ValueError in words.
        """
        wanted = CHANNELS[COLUMNS[self.column][0].name].unit if self.lookup is None else self.lookup.x_unit.si
        known: dict[str, Dimension | None] = {}
        for name, source in self.written.names.items():
            unit = units.get(source)
            known[name] = None if unit is None else unit.dimension
        try:
            found = Dimensions(self.written.expression, known, self.written.numbers).found()
        except ExpressionFault as cause:
            says = cause.says
            for stand_in, source in self.written.names.items():
                says = says.replace(stand_in, source) if stand_in != source else says
            raise ExpressionFault(self.written.text, says, cause.start, cause.stop) from None
        target = read_unit(wanted)
        what = f"column '{self.lookup.name}' looks up" if self.lookup is not None else f"{self.column} is"
        if found is not None and found != target.dimension:
            if found.plain and not self.written.names:
                raise ValueError(f"a constant needs its unit: {self.written.text} {wanted}")
            is_in = "a plain number or an angle" if found.plain else f"in {found.unit}"
            raise ValueError(f"this is {is_in}, and {what} in {wanted}")
        if self.written.bare and self.written.names:
            unit = units.get(next(iter(self.written.names.values())))
            if unit is not None and not unit.fits(wanted):
                more = ": it could mean turns or radians a second, write rev/s or rad/s" if unit.si == "Hz" else ""
                raise ValueError(f"'{unit.text}' is no unit of what {what} in, {wanted}{more}")


@dataclass(frozen=True)
class ChannelMap:
    """A map from names of a log to columns of the vocabulary.

    Attributes
    ----------
    name : of the file, for messages.
    channels : column → where it comes from.
    sources : name or pattern → what is said of it, in the order written.
    reading : how the log is read.
    metadata : of the run: vehicle, rig, manoeuvre, …
    text : the file's full text.
    """

    name: str
    channels: Mapping[str, Mapped]
    sources: Mapping[str, Said] = field(default_factory=dict)
    reading: Reading = field(default_factory=Reading)
    metadata: Mapping[str, str] = field(default_factory=dict)
    text: str = ""

    @classmethod
    def load(cls, path: str | Path) -> ChannelMap:
        """The map in a file. Raises MapError with every fault at once."""
        return cls.parse(_text(path), str(path), Path(path).parent)

    @classmethod
    def parse(cls, text: str, name: str = "map", folder: Path | None = None) -> ChannelMap:
        """The map of a text; files it names are in `folder`. Raises MapError with every fault at once."""
        reader = Reader(text, name, MapError, FORMAT)
        root, folder = reader.root, folder or Path()
        reader.known(root, _TABLES, "")
        metadata = _metadata(reader, folder)
        reading = _reading(reader, folder)
        sources = _sources(reader)
        channels = _channels(reader, folder, sources)
        if not channels and not reader.faults:
            proposed = "remove the # of the proposals that are right, or " if re.search('^# "', text, re.M) else ""
            reader.fault("channels", f'names no channel: {proposed}write "imu.accel.y" = "LatAcc", one line a channel')
        reader.finish()
        return cls(name, channels, sources, reading, metadata, text)

    @classmethod
    def of_tables(
        cls, tables: Mapping[str, Any], name: str, folder: Path | None = None, files: Mapping[str, bytes] | None = None
    ) -> ChannelMap:
        """The map of the tables ``signals`` and ``sources`` of another file, as `[channels]` and `[sources]` of a map.

        `files` : contents of lookup tables that are kept elsewhere, by name. Raises MapError with every fault at once.
        """
        reader = Reader.of(tables, name, MapError)
        sources = _sources(reader)
        channels = _channels(reader, folder or Path(), sources, "signals", files)
        reader.finish()
        return cls(name, channels, sources)

    def said(self, name: str) -> Said:
        """What the map says of a name: by the name itself, else by the first pattern that fits."""
        if name in self.sources:
            return self.sources[name]
        return next((s for pattern, s in self.sources.items() if fnmatch.fnmatchcase(name, pattern)), Said())


def load_reading(path: str | Path) -> Reading:
    """How a log is read by the `[read]` of a map, which may name no channels yet. Raises MapError with every fault."""
    reader = Reader(_text(path), str(path), MapError, FORMAT)
    reader.known(reader.root, _TABLES, "")
    reading = _reading(reader, Path(path).parent)
    reader.finish()
    return reading


def reading_text(reading: Reading) -> str:
    """The table ``[read]`` of a map; empty where nothing is said."""
    values = {key: getattr(reading, key) for key in READ_KEYS}
    values["dbc"] = [str(file.resolve()) for file in reading.dbc]
    lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in values.items() if value]
    return "\n".join(["[read]", *lines]) + "\n" if lines else ""


def _text(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as cause:
        raise MapError(path, [f"cannot be read: {getattr(cause, 'strerror', None) or cause}"]) from None


def _metadata(reader: Reader, folder: Path) -> dict[str, str]:
    run = reader.table(reader.root, "run", "", required=False)
    reader.known(run, METADATA_KEYS, "run")
    out = {key: reader.text(run, key, "run", "") for key in METADATA_KEYS if key in run}
    if "wheel_reference" in run:
        reader.choice(run, "wheel_reference", "run", WHEEL_REFERENCES, "")
    if "brakes" in run:
        reader.choice(run, "brakes", "run", BRAKES, "unknown")
    for key in ("vehicle", "rig"):
        if out.get(key) and is_file(folder / out[key]):
            out[key] = str(folder / out[key])
    return out


def _reading(reader: Reader, folder: Path) -> Reading:
    read = reader.table(reader.root, "read", "", required=False)
    reader.known(read, READ_KEYS, "read")
    unit = reader.text(read, "time_unit", "read", "")
    if unit:
        try:
            if read_unit(unit).si != "s":
                reader.fault("read.time_unit", f"'{unit}' is no unit of time: s, ms, us …")
        except UnitFault as cause:
            reader.fault("read.time_unit", str(cause))
    header = read.get("header", 0)
    if isinstance(header, bool) or not isinstance(header, int) or header < 0:
        reader.fault("read.header", f"must be the line of the names, from 1, found {header!r}")
        header = 0
    files = read.get("dbc", [])
    files = [files] if isinstance(files, str) else files
    if not isinstance(files, list) or not all(isinstance(one, str) for one in files):
        reader.fault("read.dbc", 'must be files: dbc = ["my-car.dbc"]')
        files = []
    dbc = tuple(folder / one for one in files)
    for one in dbc:
        if not is_file(one):
            there = [other.name for other in folder.glob("*.dbc")]
            reader.fault("read.dbc", f"there is no file {one}{nearest(one.name, there)}")
    return Reading(
        reader.text(read, "time", "read", ""), unit, reader.number(read, "rate", "read", 0.0, low=0.0),
        reader.text(read, "separator", "read", ""), reader.text(read, "decimal", "read", ""),
        reader.text(read, "encoding", "read", ""), header, dbc,
    )  # fmt: skip


def _sources(reader: Reader) -> dict[str, Said]:
    out: dict[str, Said] = {}
    for name, entry in reader.table(reader.root, "sources", "", required=False).items():
        place = f"sources.{name}"
        if isinstance(entry, str):
            entry = {"unit": entry}
        if not isinstance(entry, dict):
            reader.fault(place, 'write "mm", or { unit = "mm", time = "t_pot", delay = "12 ms", name = "Damper Pot" }')
            continue
        if not set(entry) & set(SOURCE_KEYS) and entry:
            reader.fault(place, f'unknown key; a name with dots is written in quotes: "{name}.{next(iter(entry))}"')
            continue
        reader.known(entry, SOURCE_KEYS, place)
        unit = reader.text(entry, "unit", place, "")
        _check_unit(reader, unit, f"{place}.unit")
        out[name] = Said(
            reader.text(entry, "name", place, ""), unit, reader.text(entry, "time", place, ""),
            _delay(reader, entry, place), _drift(reader, entry, place),
        )  # fmt: skip
    return out


def _check_unit(reader: Reader, unit: str, place: str) -> None:
    if unit:
        try:
            read_unit(unit)
        except UnitFault as cause:
            reader.fault(place, str(cause))


def _delay(reader: Reader, entry: dict[str, Any], place: str) -> float:
    text = entry.get("delay", "0 s")
    found = _constant(text, Dimension.of(time=1))
    if found is None and text != "0 s":
        reader.fault(f"{place}.delay", f'must be a time with its unit, "12 ms", found {text!r}')
    return found or 0.0


def _drift(reader: Reader, entry: dict[str, Any], place: str) -> float:
    text = entry.get("drift", "0 ms/s")
    found = _constant(text, Dimension.of())
    if found is None or not abs(found) < LARGEST_DRIFT:
        reader.fault(
            f"{place}.drift", f'must be a share of time below {LARGEST_DRIFT:.0%}, "10 ms/s" or "1 %", found {text!r}'
        )
    return found or 0.0


def _constant(text: object, dimension: Dimension) -> float | None:
    """Value of a text that is a number of this dimension; None for any other."""
    if not isinstance(text, str):
        return None
    try:
        written = read_names(text, {})
        if not written.names and Dimensions(written.expression, {}, written.numbers).of() == dimension:
            return written.expression.value({})
    except (ExpressionFault, ValueError):
        pass
    return None


def _channels(
    reader: Reader, folder: Path, sources: Mapping[str, Said], key: str = "channels",
    files: Mapping[str, bytes] | None = None,
) -> dict[str, Mapped]:  # fmt: skip
    out: dict[str, Mapped] = {}
    for column, entry in dotted(reader.table(reader.root, key, "", required=False), COLUMNS).items():
        place = f"{key}.{column}"
        if column not in COLUMNS:
            if column in CHANNELS:
                parts = ", ".join(CHANNELS[column].columns)
                reader.fault(place, f"has components: write {parts}")
            else:
                reader.fault(place, f"is not a channel{nearest(column, COLUMNS)} (lacet info --channels lists them)")
            continue
        entry = {"from": entry} if isinstance(entry, str) else entry
        if isinstance(entry, int | float) and not isinstance(entry, bool):
            unit = COLUMNS[column][0].unit
            reader.fault(place, f'a constant is written with its unit: "{entry} {unit}"')
            continue
        if not isinstance(entry, dict) or "from" not in entry:
            reader.fault(place, 'write "EXPRESSION" or { from = "EXPRESSION", table = "FILE.csv", delay = "12 ms" }')
            continue
        found = _mapped(reader, folder, column, entry, place, files or {})
        if found is None:
            continue
        out[column] = found
        units = {source: _said_unit(found, sources, source) for source in found.written.names.values()}
        try:
            found.check(units)
        except ExpressionFault as cause:
            reader.fault(place, marked(found.written.text, cause))
        except ValueError as cause:
            reader.fault(place, f"{cause}\n      {found.written.text}")
    return out


def _said_unit(mapped: Mapped, sources: Mapping[str, Said], name: str) -> Unit | None:
    said = sources.get(name) or next((s for p, s in sources.items() if fnmatch.fnmatchcase(name, p)), Said())
    text = mapped.unit or said.unit
    try:
        return read_unit(text) if text else None
    except UnitFault:
        return None  # reported where it stands


def _mapped(
    reader: Reader, folder: Path, column: str, entry: dict[str, Any], place: str, files: Mapping[str, bytes]
) -> Mapped | None:
    reader.known(entry, CHANNEL_KEYS, place)
    text = reader.text(entry, "from", place)
    try:
        written = read_names(text, FUNCTIONS)
    except ExpressionFault as cause:
        hint = " (a name with spaces or signs is written in `backquotes`)" if "`" not in text else ""
        reader.fault(place, marked(text, cause) + hint)
        return None
    unit = reader.text(entry, "unit", place, "")
    _check_unit(reader, unit, f"{place}.unit")
    if unit and len(written.names) != 1:
        reader.fault(f"{place}.unit", "says the unit of one name, and here are more: say it in [sources]")
    lookup = None
    if "table" in entry:
        try:
            file = reader.text(entry, "table", place)
            lookup = read_lookup(folder / file, column, files.get(file))
            wanted = COLUMNS[column][0].unit
            if not lookup.y_unit.fits(wanted):
                reader.fault(f"{place}.table", f"its values are in {lookup.y_unit.text}, and {column} is in {wanted}")
        except RunError as cause:
            there = [file.name for file in folder.glob("*.csv")]
            hint = "" if is_file(folder / str(entry["table"])) else nearest(str(entry["table"]), there)
            reader.fault(f"{place}.table", f"{cause.path}: {'; '.join(cause.faults)}{hint}")
            return None
    return Mapped(column, written, unit, lookup, _delay(reader, entry, place))
