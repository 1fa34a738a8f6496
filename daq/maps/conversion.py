"""Conversion of logs by a map: their names resolved, units checked against the files', channels made piece by piece."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.errors import RunError
from lacet.daq.expressions.expression import ExpressionFault
from lacet.daq.maps.assembly import Assembly, ChannelPiece, Key
from lacet.daq.maps.channel_map import ChannelMap, Mapped, Said
from lacet.daq.maps.names import marked
from lacet.daq.sources.open_source import open_source
from lacet.daq.sources.source import Array, Series, Source, resolve
from lacet.daq.units import Unit, UnitFault, read_unit


@dataclass
class Conversion:
    """Logs being converted by a map.

    Attributes
    ----------
    sources : the logs; all are on one clock.
    start_ns : instant of time 0 [ns since the Unix epoch], None where no log says.
    assemblies : channels that can be made.
    notes : what is left out or assumed, one line each.
    """

    map: ChannelMap
    sources: Sequence[Source]
    start_ns: int | None = None
    assemblies: list[Assembly] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    _places: dict[str, tuple[int, str]] = field(default_factory=dict)
    _offsets: list[float] = field(default_factory=list)
    _last: dict[tuple[int, str], float] = field(default_factory=dict)
    _dropped: dict[str, int] = field(default_factory=dict)
    _ending: dict[tuple[int, str], float] = field(default_factory=dict)

    @classmethod
    def of(cls, paths: Sequence[str | Path], map_: ChannelMap) -> Conversion:
        """The conversion of files. Raises RunError, with every reason, when no channel can be made."""
        sources: list[Source] = []
        try:
            for path in paths:  # one by one: those opened are closed when the next cannot be
                sources.append(open_source(path, map_.reading))  # noqa: PERF401
            out = cls(map_, sources)
            out._prepare()
        except BaseException:
            for source in sources:
                source.close()
            raise
        return out

    def close(self) -> None:
        """Close the logs."""
        for source in self.sources:
            source.close()

    @property
    def done(self) -> float:
        """Share of the logs that is read."""
        return sum(source.done for source in self.sources) / max(1, len(self.sources))

    def pieces(self) -> Iterator[ChannelPiece]:
        """The channels' samples, a bounded number at a time, each channel in order of time."""
        keys = list(dict.fromkeys(key for one in self.assemblies for key in one.series))
        for at, source in enumerate(self.sources):
            own = [key for key in keys if self._places[key.name][0] == at]
            if not own:
                continue
            timed = {key: self._time_of(key) for key in own}
            wanted = dict.fromkeys(self._places[key.name][1] for key in own)
            wanted |= dict.fromkeys(time for time in timed.values() if time)
            for piece in source.pieces(list(wanted)):
                shared: dict[tuple[int, float], tuple[Array, NDArray[np.bool_] | None]] = {}
                made: dict[Key, Series] = {}
                for key in own:
                    series = self._series(key, piece, timed[key], at, shared)
                    if series is not None:
                        made[key] = series
                yield from self._fed(made)
                self._ends(piece)
        yield from self._fed({}, last=True)
        for name, count in self._dropped.items():
            self.notes.append(f"{name}: {count} samples have a time that does not increase and are left out")
        for source in self.sources:
            self.notes += [note for note in source.notes if note not in self.notes]
        for one in self.assemblies:
            if one.interpolated:
                first, *others = dict.fromkeys(key.name for key in one.series)
                self.notes.append(f"{one.channel.name}: {', '.join(others)} brought to the stamps of {first}")

    def _fed(self, made: Mapping[Key, Series], last: bool = False) -> Iterator[ChannelPiece]:
        for assembly in self.assemblies:
            found = assembly.feed(made, last)
            if found is not None:
                yield found

    def _series(
        self, key: Key, piece: Mapping[str, Series], time: str, at: int,
        shared: dict[tuple[int, float], tuple[Array, NDArray[np.bool_] | None]],
    ) -> Series | None:  # fmt: skip
        """A name's series in SI, its times increasing, without its delay."""
        name = self._places[key.name][1]
        if name not in piece:
            return None
        stamps, values = piece[name]
        if time:
            if time not in piece or len(piece[time].values) != len(values):
                raise RunError(
                    self.sources[at].path, [f"'{time}' cannot be the time of '{name}': they have different lengths"]
                )
            stamps = piece[time].values
        place = (id(stamps), key.delay)
        if place not in shared:
            unit = self._unit_of_time(time, at) if time else 1.0
            t = stamps * unit - key.delay + self._offsets[at]
            last = self._last.get((at, time or name), -np.inf)
            finite = np.isfinite(t)
            highest = np.maximum.accumulate(np.concatenate([[last], np.where(finite, t, -np.inf)]))[:-1]
            keep = finite & (t > highest)
            if not keep.all():
                self._dropped[time or name] = self._dropped.get(time or name, 0) + int(np.count_nonzero(~keep))
            shared[place] = (t if keep.all() else t[keep], None if keep.all() else keep)
        t, kept = shared[place]
        values = values if kept is None else values[kept]
        unit_ = read_unit(key.unit) if key.unit else None
        if unit_ is not None and (unit_.factor != 1.0 or unit_.offset):
            values = unit_.factor * values + unit_.offset
        if len(t):
            self._ending[(at, time or name)] = float(t[-1]) + key.delay
        return Series(t, values)

    def _ends(self, piece: Mapping[str, Series]) -> None:
        for place, end in self._ending.items():
            self._last[place] = max(end, self._last.get(place, -np.inf))
        self._ending = {}

    def _time_of(self, key: Key) -> str:
        """Name of the column of times of a series of its own; empty for the log's."""
        at, name = self._places[key.name]
        said = self._said(key.name)
        if not said.time:
            return ""
        try:
            return resolve(said.time, self.sources[at].listed)
        except KeyError as cause:
            raise RunError(self.sources[at].path, [f"time of '{name}': {cause.args[0]}"]) from None

    def _unit_of_time(self, time: str, at: int) -> float:
        unit = self._said(time).unit or self.sources[at].listed[time].unit
        if not unit:
            return 1.0
        found = read_unit(unit)
        if found.si != "s":
            raise RunError(self.sources[at].path, [f"'{time}' is in {unit}, and cannot be a time"])
        return found.factor

    def _said(self, name: str) -> Said:
        return self.map.said(name)

    # -- preparation --------------------------------------------------------------------------------------------------

    def _prepare(self) -> None:
        starts = [source.start_ns for source in self.sources]
        self.start_ns = min((start for start in starts if start is not None), default=None)
        absolute = all(start is not None for start in starts)
        for start in starts:
            self._offsets.append((start - (self.start_ns or 0)) / 1e9 if absolute and start is not None else 0.0)
        if len(starts) > 1 and not absolute:
            self.notes.append("not every file says when it began: their times are taken as of one clock")
        several: dict[str, int] = {}
        for source in self.sources:
            for name in source.listed:
                several[name] = several.get(name, 0) + 1
        for at, source in enumerate(self.sources):
            for name in source.listed:
                own = name if several[name] == 1 else f"{source.path.stem}.{name}"
                self._places[own] = (at, name)
        lacking: list[str] = []
        columns: dict[str, dict[int, Mapped]] = {}
        for column, mapped in self.map.channels.items():
            channel, component = COLUMNS[column]
            columns.setdefault(channel.name, {})[component] = mapped
        without_unit: list[str] = []
        for name, parts in columns.items():
            channel = CHANNELS[name]
            if missing := [channel.columns[i] for i in range(channel.width) if i not in parts]:
                alone = ALONE.get(next(m.column for m in parts.values()), "")
                hint = f" (map it to {alone}, which is one component alone)" if alone else ""
                lacking.append(f"{name} was left out: the map does not have {', '.join(missing)}{hint}")
                continue
            try:
                mapped = [parts[i] for i in range(channel.width)]
                keys = [self._keys(one, without_unit) for one in mapped]
                if not any(keys):
                    raise ValueError("constants only: no name of the log is in it")
                self.assemblies.append(Assembly(channel, mapped, keys))
            except ValueError as cause:
                lacking.append(f"{name} was left out: {cause}")
        self.notes += lacking
        if without_unit:
            names = ", ".join(dict.fromkeys(without_unit))
            self.notes.append(f"without a unit in file and map, taken as SI: {names}")
        if not self.assemblies:
            path = ", ".join(str(source.path) for source in self.sources)
            remedy = f"correct {self.map.name}, or let lacet propose one: lacet map --guess {self.sources[0].path}"
            raise RunError(path, [*lacking, remedy])

    def _keys(self, mapped: Mapped, without_unit: list[str]) -> dict[str, Key]:
        """The series of a column's expression. Raises ValueError in words."""
        out: dict[str, Key] = {}
        units: dict[str, Unit | None] = {}
        for name, source in mapped.written.names.items():
            said = self._said(source)
            try:
                found = resolve(said.name or source, self._places)
            except KeyError as cause:
                raise ValueError(f"{mapped.column}: {cause.args[0]}") from None
            at, own = self._places[found]
            unit = mapped.unit or said.unit or self._said(found).unit or self.sources[at].listed[own].unit
            if not unit:
                without_unit.append(found)
            try:
                units[source] = read_unit(unit) if unit else None
            except UnitFault as cause:
                remedy = f'say the right one in the map: [sources] "{source}" = "…"'
                raise ValueError(f"{mapped.column}: '{found}': {cause}; {remedy}") from None
            said_delay = said.delay or self._said(found).delay
            out[name] = Key(found, unit, mapped.delay + said_delay)
        try:
            mapped.check(units)
        except ExpressionFault as cause:
            raise ValueError(f"{mapped.column}: {marked(mapped.written.text, cause)}") from None
        except ValueError as cause:
            named = ", ".join(f"'{n}' is in {u.text}" for n, u in units.items() if u is not None)
            raise ValueError(f"{mapped.column}: {cause}{f' ({named})' if named else ''}") from None
        return out


ALONE = {
    "imu.accel.x": "car.longitudinal_accel", "imu.accel.y": "car.lateral_accel", "imu.accel.z": "car.vertical_accel",
    "imu.rate.x": "car.roll_rate", "imu.rate.y": "car.pitch_rate", "imu.rate.z": "car.yaw_rate",
}  # fmt: skip
"""Component → the channel that is this component alone."""
