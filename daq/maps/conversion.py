"""Conversion of logs by a map: their names resolved, units checked against the files', channels made piece by piece."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import RunError, nearest
from lacet.daq.maps.assembly import Assembly, ChannelPiece
from lacet.daq.maps.channel_map import ChannelMap, Said
from lacet.daq.maps.resolution import Key, in_si, resolved
from lacet.daq.sources.columns import SINCE_1970
from lacet.daq.sources.open_source import open_source
from lacet.daq.sources.source import Array, Series, Source, names_of_all, resolve, unseen_of_all
from lacet.daq.units import read_unit

_ZONES = 900.0
"""Difference of the beginnings of logs of one drive beyond which a time zone may be the reason [s]: that between two
zones is a quarter of an hour at least."""
_SHOWN = 5
"""Names that a note has; the JSON result has all."""


@dataclass(frozen=True)
class _Dropped:
    """Samples left out because their time does not increase: how many, the last time before, and the step back [s]."""

    count: int
    since: float
    back: float

    def and_so(self, more: int) -> _Dropped:
        """With more of them."""
        return replace(self, count=self.count + more)

    def note(self, name: str) -> str:
        """What is said of them, for the column of the time or the first one that has it."""
        text = f"{name}: {self.count} samples have a time that does not increase and are left out"
        if not self.back > 0.0:
            return text
        return (
            f"{text}, as all that has its times; after {self.since:.2f} s it steps back by {self.back:.6g} s: a clock "
            "that was set back, or several recordings in one file, which can be imported one by one"
        )


@dataclass
class Conversion:
    """Logs being converted by a map.

    Attributes
    ----------
    sources : the logs; all are on one clock.
    start_ns : instant of time 0 [ns since the Unix epoch], None where no log says.
    assemblies : channels that can be made.
    notes : what is left out or assumed, one line each.
    without_unit : names that are taken as SI, because neither file nor map says a unit.
    """

    map: ChannelMap
    sources: Sequence[Source]
    start_ns: int | None = None
    assemblies: list[Assembly] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    without_unit: list[str] = field(default_factory=list)
    _places: dict[str, tuple[int, str]] = field(default_factory=dict)
    _offsets: list[float] = field(default_factory=list)
    _last: dict[tuple[int, str], float] = field(default_factory=dict)
    _dropped: dict[str, _Dropped] = field(default_factory=dict)
    _ending: dict[tuple[int, str], float] = field(default_factory=dict)
    _sampled: set[tuple[int, str]] = field(default_factory=set)
    _made: set[str] = field(default_factory=set)

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
                shared: dict[tuple[int, float, float], tuple[Array, NDArray[np.bool_] | None]] = {}
                made: dict[Key, Series] = {}
                for key in own:
                    series = self._series(key, piece, timed[key], at, shared)
                    if series is not None:
                        made[key] = series
                yield from self._fed(made)
                self._ends(piece)
        yield from self._fed({}, last=True)
        for one in self.assemblies:
            if one.channel.name not in self._made:
                absent = [key.name for key in one.series if self._places[key.name] not in self._sampled]
                self.notes.append(
                    f"{one.channel.name} was left out: no sample of {', '.join(absent or ['it'])} is in the log"
                )
        self.notes += [one.note(name) for name, one in self._dropped.items()]
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
                self._made.add(found.channel)
                yield found

    def _series(
        self, key: Key, piece: Mapping[str, Series], time: str, at: int,
        shared: dict[tuple[int, float, float], tuple[Array, NDArray[np.bool_] | None]],
    ) -> Series | None:  # fmt: skip
        """A name's series in SI, its times increasing, without its delay and drift."""
        name = self._places[key.name][1]
        if name not in piece:
            return None
        stamps, values, flags = piece[name]
        if time:
            if time not in piece or len(piece[time].values) != len(values):
                raise RunError(
                    self.sources[at].path, [f"'{time}' cannot be the time of '{name}': they have different lengths"]
                )
            stamps = piece[time].values
        place = (id(stamps), key.delay, key.drift)
        if place not in shared:
            unit = self._unit_of_time(time, at) if time else 1.0
            seconds = self._since_start(stamps * unit, at) if time else stamps
            last = self._last.get((at, time or name), -np.inf)
            finite = np.isfinite(seconds)
            highest = np.maximum.accumulate(np.concatenate([[last], np.where(finite, seconds, -np.inf)]))[:-1]
            keep = finite & (seconds > highest)
            if not keep.all():
                first = int(np.argmin(keep))
                back = float(highest[first] - seconds[first])
                new = _Dropped(int(np.count_nonzero(~keep)), float(highest[first]) + self._offsets[at], back)
                before = self._dropped.get(time or name)
                self._dropped[time or name] = new if before is None else before.and_so(new.count)
                seconds = seconds[keep]
            if len(seconds):
                self._ending[(at, time or name)] = float(seconds[-1])
            t = (seconds - key.delay) / (1.0 + key.drift) + self._offsets[at]
            shared[place] = (t, None if keep.all() else keep)
        t, kept = shared[place]
        values = values if kept is None else values[kept]
        flags = flags if kept is None or flags is None else flags[kept]
        values = in_si(values, key.unit)
        if len(values):
            self._sampled.add(self._places[key.name])
        return Series(t, values, flags)

    def _since_start(self, seconds: Array, at: int) -> Array:
        """Times of a column of their own from the start of their log [s]; they may count from 1970."""
        finite = seconds[np.isfinite(seconds)]
        since_1970 = finite.size > 0 and float(finite[0]) > SINCE_1970
        return seconds - self.sources[at].counted_from(float(finite[0])) if since_1970 else seconds

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
        self._places = names_of_all(self.sources)
        units = {own: self.sources[at].listed[name].unit for own, (at, name) in self._places.items()}
        in_full = {full: name for source in self.sources for full, name in source.in_full().items()}
        found = resolved(self.map, units, in_full, unseen_of_all(self.sources))
        lacking = [f"{name} was left out: {why}" for name, why in found.lacking.items()]
        self.assemblies = [Assembly(*one) for one in found.recipes]
        if len(starts) > 1 and not absolute and not self._delays_said():
            self.notes.append(
                "not every file says when it began: their times are taken as of one clock, unless the map says a delay"
            )
        elif absolute:
            self.notes += self._zones_apart()
        self.notes += lacking
        self.notes += self._said_of_none()
        self.without_unit = [name for name in found.without_unit if not self._is_si(name)]
        if self.without_unit:
            names = ", ".join(self.without_unit[:_SHOWN])
            more = len(self.without_unit) - _SHOWN
            behind = f" and {more} more" if more > 0 else ""
            self.notes.append(f"without a unit in file and map, taken as SI: {names}{behind}")
        if not self.assemblies:
            path = ", ".join(str(source.path) for source in self.sources)
            remedy = f"correct {self.map.name}, or let lacet propose one: lacet map --guess {self.sources[0].path}"
            raise RunError(path, [*lacking, remedy])

    def _zones_apart(self) -> list[str]:
        """Notes on logs whose dates have no time zone, and that begin long before or behind one that has."""
        with_zone = [source.start_ns or 0 for source in self.sources if not source.without_zone]
        return [
            f"{source.path.name} begins {apart / 3600.0:+.2f} h from the other files: its date has no time zone and is "
            "taken as UTC; if that is wrong, say a delay in the map"
            for source in self.sources
            if source.without_zone and with_zone
            for apart in [((source.start_ns or 0) - min(with_zone)) / 1e9]
            if abs(apart) > _ZONES
        ]

    def _delays_said(self) -> bool:
        """Whether the map says how late each log is against the first one used."""
        keys = {key for one in self.assemblies for key in one.series}
        undelayed = {self._places[key.name][0] for key in keys if not key.delay}
        return len(undelayed) <= 1

    def _is_si(self, name: str) -> bool:
        """Whether a log's format says that a name is in SI, though not in which of its units."""
        at, listed = self._places[name]
        return bool(self.sources[at].listed[listed].units)

    def _said_of_none(self) -> list[str]:
        """Notes on lines of `[sources]` that are about no name of the logs: what they say, a delay or unit, is lost."""
        names = {*self._places, *(name for one in self.map.channels.values() for name in one.written.names.values())}
        return [
            f"[sources] '{said}' fits no name of the log and says nothing{nearest(said, names)}"
            for said in self.map.sources
            if not any(fnmatch.fnmatchcase(name, said) for name in names)
        ]
