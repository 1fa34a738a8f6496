"""What every log of another system offers: its names with units and time bases, and their samples piece by piece."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import LacetError, RunError, nearest

Array = NDArray[np.float64]

PIECE_SAMPLES = 1 << 16
"""Samples of a name that are read at a time."""


@dataclass(frozen=True)
class Listed:
    """A name in a log.

    Attributes
    ----------
    name : unique in the log.
    unit : as the file writes it, empty where it says none.
    count : number of samples, None where the file would have to be read for it.
    place : where it stands, in the words of the format: ``column 3``, ``message 0x0D0``.
    also : its name in full, with the bus that the log's other names are told apart by; or one that it had before.
    units : units that it can have, where the format leaves it one of several.
    quantity : words for what it is, where the format fixes it.
    unseen : whether the log describes it and has, at its beginning, no sample of it.
    """

    name: str
    unit: str = ""
    count: int | None = None
    place: str = ""
    also: str = ""
    units: tuple[str, ...] = ()
    quantity: str = ""
    unseen: bool = False


@dataclass(frozen=True)
class Reading:
    """How a log is to be read, as a map says; what is empty is found.

    Attributes
    ----------
    time : name of the time column; `time_unit` : its unit.
    rate : samples a second, for a table without times [Hz]; 0 otherwise.
    separator, decimal, encoding : of a text table.
    header : line of the column names in a text table, counted from 1; 0 where it is found.
    dbc : files that describe the frames of a bus.
    """

    time: str = ""
    time_unit: str = ""
    rate: float = 0.0
    separator: str = ""
    decimal: str = ""
    encoding: str = ""
    header: int = 0
    dbc: tuple[Path, ...] = ()


class Series(NamedTuple):
    """Consecutive samples of one name: times (N,) [s from the log's start] and values (N,) in the file's unit.

    `flags` (N,) are `daq.blocks.Flag` bits where the log says why there is no value.
    """

    t: Array
    values: Array
    flags: NDArray[np.uint8] | None = None


Piece = Mapping[str, Series]
"""The next samples of some names. Names sampled together share the array of times."""


@dataclass
class Source(ABC):
    """A log of another system.

    Attributes
    ----------
    path : the file.
    listed : everything with a name that has numbers, by name.
    start_ns : instant of time 0 [ns since the Unix epoch], None where the file does not say.
    without_zone : whether that is by a date without a time zone, taken as UTC.
    notes : what was found or assumed, one line each.
    done : share of the file read so far.
    """

    path: Path
    listed: dict[str, Listed] = field(default_factory=dict)
    start_ns: int | None = None
    without_zone: bool = False
    notes: list[str] = field(default_factory=list)
    done: float = 0.0

    @abstractmethod
    def pieces(self, names: Collection[str]) -> Iterator[Piece]:
        """The samples of some names of `listed`, in order of time for each, a bounded number at a time.

        Raises RunError, with the place, where the file cannot be read.
        """

    def close(self) -> None:  # noqa: B027 - most have nothing open
        """Close what is open."""

    def counted_from(self, first: float) -> float:
        """Instant from which times since 1970 are counted [s since the Unix epoch]: `first`, where none was before."""
        if self.start_ns is None:
            self.start_ns = int(first * 1e9)
        return self.start_ns / 1e9

    def resolve(self, name: str) -> str:
        """The name in the log that is meant: itself, its last parts where unique, or in another capitalization.

        Raises KeyError with the reason: there is none, or several.
        """
        return resolve(self.in_full().get(name, name), self.listed)

    def in_full(self) -> dict[str, str]:
        """Names in full, or as they were before → names listed."""
        return {one.also: name for name, one in self.listed.items() if one.also}


def resolve(
    name: str, known: Collection[str], written: Callable[[str], str] = str, unseen: Collection[str] = ()
) -> str:  # fmt: skip
    """As `Source.resolve`, among any names.

    `written` : how one is written where it is asked for. `unseen` : names that are meant only where written in full.
    """
    if name in known:
        return name
    asked = name.replace("/", ".")
    for same in (str, str.lower):
        found = [one for one in known if f".{same(one)}".replace("/", ".").endswith(f".{same(asked)}")]
        found = [one for one in found if one not in unseen] or found
        if len(found) == 1:
            return found[0]
        if found:
            raise KeyError(f"'{name}' could be {', '.join(map(written, found[:6]))}: write one of these")
    some = ", ".join(list(known)[:12]) + (" …" if len(known) > 12 else "")
    raise KeyError(f"there is no '{name}'{nearest(name, known) or _near_last(name, known)}; the file has {some}")


def names_of_all(sources: Sequence[Source]) -> dict[str, tuple[int, str]]:
    """Name among several logs of one drive → index of its log, and its name there.

    A name that several have is told apart by its file, ``lap.speed``; the second file of that name is ``lap_2``.
    """
    count = Counter(name for source in sources for name in source.listed)
    files = unique(source.path.stem for source in sources)
    return {
        name if count[name] == 1 else f"{file}.{name}": (at, name)
        for at, (file, source) in enumerate(zip(files, sources, strict=True))
        for name in source.listed
    }


def unseen_of_all(sources: Sequence[Source]) -> set[str]:
    """Names as of `names_of_all` of which their log has no sample, and another log has some by the same name."""
    seen = {name for source in sources for name, one in source.listed.items() if not one.unseen}
    places = names_of_all(sources)
    return {own for own, (at, name) in places.items() if sources[at].listed[name].unseen and name in seen}


def _last(name: str) -> str:
    return name.replace("/", ".").rpartition(".")[2]


def _near_last(name: str, known: Iterable[str]) -> str:
    return nearest(name, [_last(one) for one in known])


def unique(names: Iterable[str]) -> list[str]:
    """Names made unique: the second ``Fx`` is ``Fx_2``."""
    seen: Counter[str] = Counter()
    taken: set[str] = set()
    out: list[str] = []
    for name in names:
        seen[name] += 1
        one = name if seen[name] == 1 and name not in taken else f"{name}_{seen[name]}"
        while one in taken:
            seen[name] += 1
            one = f"{name}_{seen[name]}"
        taken.add(one)
        out.append(one)
    return out


def read_all(source: Source, names: Collection[str]) -> dict[str, Series]:
    """All samples of some names, for short logs. Times and values are joined."""
    parts: dict[str, list[Series]] = {name: [] for name in names}
    for piece in source.pieces(names):
        for name, series in piece.items():
            parts[name].append(series)
    joined: dict[tuple[int, ...], Array] = {}  # names sampled together go on sharing their times
    out: dict[str, Series] = {}
    for name, series in parts.items():
        if not series:
            out[name] = Series(np.zeros(0), np.zeros(0))
            continue
        key = tuple(id(one.t) for one in series)
        if key not in joined:
            joined[key] = np.concatenate([one.t for one in series])
        out[name] = Series(joined[key], np.concatenate([one.values for one in series]))
    return out


@contextmanager
def read_by_library(path: Path, what: str) -> Iterator[None]:
    """A block in which a library reads a file: what it raises for a damaged one, of any type, becomes a RunError.

    `what` : the format or the place in the file, ``as TDMS``.
    """
    try:
        yield
    except LacetError:
        raise
    except Exception as cause:
        why = str(cause) or type(cause).__name__
        raise fault(path, f"cannot be read {what} (truncated, damaged or another kind of file?): {why}") from cause


def fault(path: Path, *says: str) -> RunError:
    """The error of a log that cannot be used."""
    return RunError(path, says)
