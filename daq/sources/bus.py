"""Raw bus logs with the owner's DBC: every signal is a name ``Message.Signal``, decoded from all frames at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lacet.daq.frames import EXTENDED, STANDARD
from lacet.daq.shared_stamps import one_by_one
from lacet.daq.sources.dbc_messages import BusMessage, Senders, read_dbcs
from lacet.daq.sources.frames import BusFrames
from lacet.daq.sources.source import Array, Listed, Piece, Series, Source, fault


class BusSource(Source):
    """The signals of a raw bus log; `read` reads it anew from its beginning, and adds what is lost to a list."""

    def __init__(
        self, path: Path, dbc: Sequence[Path], read: Callable[[list[str]], Iterator[BusFrames]], start_ns: int | None
    ):
        super().__init__(path, start_ns=start_ns)

        def frames() -> Iterator[BusFrames]:
            return read(self.notes)

        self._frames = frames
        self._size = max(1, path.stat().st_size)
        if not dbc:
            beside = sorted(file.name for file in path.parent.glob("*.dbc"))
            there = f"; beside it {'is' if len(beside) == 1 else 'are'} {', '.join(beside)}" if beside else ""
            named = beside[0] if len(beside) == 1 else "my-car.dbc"
            raise fault(
                path, f"these are raw frames of a bus ({_some_ids(frames)}): the file that describes them is missing"
                f'{there}; say it in the map, [read] dbc = ["{named}"], or on a command line with --dbc FILE',
            )  # fmt: skip
        self._messages = read_dbcs(dbc)
        first = next(iter(frames()), None)
        if first is None:
            raise fault(path, "it holds no frames", *self.notes)
        self._origin = float(first.t[0]) if self.start_ns is None else 0.0
        if self.start_ns is None and (first.start_ns or self._origin > 1e8):
            self.start_ns = first.start_ns + round(self._origin * 1e9)
        self._twice: set[str] = set()
        self._only_bus: dict[str, str] = {}
        for message in self._messages:
            mine = message.of(first.ident)
            buses = np.unique(first.bus[mine])
            if len(buses) > 1:
                self._twice.add(message.name)
            names_of_buses = [f"{first.buses[bus]}." for bus in buses]
            for before in names_of_buses if len(buses) > 1 else [""]:
                for one in message.signals:
                    name = f"{before}{message.name}.{one.name}"
                    place = f"message {message.ident & ~EXTENDED:#05x}" + (
                        "" if mine.any() else ", no frame of it seen"
                    )
                    also = f"{names_of_buses[0]}{name}" if len(buses) == 1 else ""
                    self.listed.setdefault(
                        name, Listed(name, one.signal.unit, None, place, also, unseen=not mine.any())
                    )
        known = np.zeros(len(first.ident), bool)
        for message in self._messages:
            known |= message.of(first.ident)
        others = np.unique(first.ident[~known])
        some = ""
        if others.size:
            some = _written(others)
            count = "1 identifier is" if others.size == 1 else f"{others.size} identifiers are"
            self.notes.append(f"{count} not in the DBC: {some}")
        if not known.any():
            names = ", ".join(str(file.name) for file in dbc)
            raise fault(path, f"none of its first {len(known):,} frames is in {names}: it has {some}")

    def pieces(self, names: Collection[str]) -> Iterator[Piece]:
        """Some hundred thousand frames at a time."""
        asked = set(names)
        for message in self._messages:
            mine = {
                one.name
                for one in message.signals
                if any(f".{name}".endswith(f".{message.name}.{one.name}") for name in asked)
            }
            self.notes += [note for note in message.overlapping(mine) if note not in self.notes] if mine else []
        last: dict[tuple[str, str], tuple[float, int]] = {}
        senders: dict[tuple[str, str], Senders] = {}
        for frames in self._frames():
            piece: dict[str, Series] = {}
            for message in self._messages:
                if not any(f"{message.name}." in name for name in asked):
                    continue
                rows = np.flatnonzero(message.of(frames.ident))
                if not rows.size:
                    continue
                for before, those in self._by_bus(message, frames, rows):
                    key = (before, message.name)
                    used, senders[key] = senders.get(key, Senders()).then(message, frames.ident[those])
                    mine = those[used]
                    t = _in_turn(frames.t[mine] - self._origin, last, key)
                    payload, lengths = message.fitted(frames.rows[mine]), frames.lengths[mine]
                    for one in message.signals:
                        name = f"{before}{message.name}.{one.name}"
                        if name in asked:
                            found = one.values(payload, lengths)
                            own = t if len(found.rows) == len(t) else t[found.rows]
                            piece[name] = Series(own, found.values, found.flags if found.flags.any() else None)
            self.done = min(0.99, self.done + len(frames.t) * 24 / self._size)
            if piece:
                yield piece
        by_name = {message.name: message for message in self._messages}
        said = [(before, one.note(by_name[name])) for (before, name), one in senders.items()]
        self.notes += [f"{before}{note}" for before, note in said if note]
        self.done = 1.0

    def _by_bus(
        self, message: BusMessage, frames: BusFrames, rows: NDArray[np.int64]
    ) -> Iterator[tuple[str, NDArray[np.int64]]]:
        """Rows of a message's frames by bus, with what its names begin with."""
        if message.name in self._twice:
            for bus in np.unique(frames.bus[rows]):
                yield f"{frames.buses[bus]}.", rows[frames.bus[rows] == bus]
            return
        only = self._only_bus.setdefault(message.name, frames.buses[frames.bus[rows[0]]])
        for bus in np.unique(frames.bus[rows]):
            if frames.buses[bus] == only:
                yield "", rows[frames.bus[rows] == bus]
            else:
                self._note_late(message.name, only, frames.buses[bus])

    def _note_late(self, message: str, only: str, bus: str) -> None:
        """Note that a message comes on a second bus, where its names, those of the log's beginning, have no place."""
        note = (
            f"message {message} begins on bus {only} and comes on bus {bus} long after: its frames of bus {bus} are "
            "left out; a log that begins later tells them apart"
        )
        if note not in self.notes:
            self.notes.append(note)


def _in_turn(t: Array, last: dict[tuple[str, str], tuple[float, int]], key: tuple[str, str]) -> Array:
    """Stamps of a message's frames (N,) [s], of equal ones every next a nanosecond later; earlier ones as they are.

    `last` : its latest stamp of the pieces before, as received [s] and made so [ns].
    """
    latest, made_ns = last.get(key, (-np.inf, None))
    highest = np.maximum.accumulate(np.concatenate([[latest], t]))
    if (t > highest[:-1]).all():
        last[key] = float(t[-1]), round(float(t[-1]) * 1e9)
        return t
    later = t >= highest[:-1]
    stamps = one_by_one(np.rint(t[later] * 1e9).astype(np.int64), made_ns)
    if later.any():
        last[key] = float(highest[-1]), int(stamps[-1])
    out = t.copy()
    out[later] = stamps / 1e9
    return out


def _some_ids(frames: Callable[[], Iterator[BusFrames]]) -> str:
    first = next(iter(frames()), None)
    if first is None:
        return "none at all"
    return f"identifiers {_written(np.unique(first.ident))}"


def _written(idents: NDArray[np.uint32]) -> str:
    """Identifiers as hexadecimal numbers, the first of them; of 29 bits said where the number does not show it."""
    some = [
        f"{number:#05x}" + (" (29 bits)" if ident & EXTENDED and number <= STANDARD else "")
        for ident in idents[:8].tolist()
        for number in (ident & ~EXTENDED,)
    ]
    return ", ".join(some) + (" …" if idents.size > 8 else "")
