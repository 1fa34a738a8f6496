"""MATLAB files: version 5 through SciPy, version 7.3 (HDF5) through h5py; structures are flattened to ``a.b.c``."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.parts import from_part
from lacet.daq.sources.columns import find_time, is_time_name, may_be_time, with_unit
from lacet.daq.sources.shares import SharedSource, Stored
from lacet.daq.sources.source import Listed, Reading, fault, read_by_library

_HEAD = 500
_DATA = ("data", "values", "value", "signal", "y")
_UNIT = ("unit", "units", "einheit")
_HEAD_BYTES, _COMPRESSED, _PIECE = 128, 15, 1 << 16
"""Of a version 5 file: length of its header [byte], type of a compressed element; bytes unpacked at a time."""
_MOST_COLUMNS = 64
"""Most columns of a matrix that become series."""


@dataclass(frozen=True)
class _Leaf:
    """A numeric array `count` × `width` with reader by columns, or a `text`."""

    count: int = 0
    width: int = 1
    read: Any = None
    text: str = ""


class MatSource(SharedSource):
    """The vectors of a MATLAB file, each with the time vector of its length that stands nearest to it."""

    def __init__(self, path: Path, reading: Reading):
        super().__init__(path)
        self._file: Any = None
        leaves = dict(self._leaves())
        texts = {name: leaf.text for name, leaf in leaves.items() if leaf.text}
        arrays = {name: leaf for name, leaf in leaves.items() if leaf.read is not None and leaf.count > 1}
        times = self._times(arrays, texts, reading)
        without: list[str] = []
        for name, leaf in arrays.items():
            if name in times:
                continue
            key = _nearest(name, leaf.count, {t: arrays[t].count for t in times})
            base = times.get(key) if key else None
            if base is None and reading.rate:
                key, base = "rate", Stored(leaf.count, lambda a, b: np.arange(a, b) / reading.rate)
            if base is None or leaf.width > _MOST_COLUMNS:
                without.append(name)
                continue
            short, unit = self._named(name, texts, arrays)
            for k in range(leaf.width):
                one = short if leaf.width == 1 else f"{short}.{k + 1}"
                stored = Stored(leaf.count, lambda a, b, read=leaf.read, k=k: read(a, b, k))
                if one not in self.listed:
                    self.add(Listed(one, unit, leaf.count, f"variable {name}"), stored, key, base)
        if without:
            self.notes.append(f"without a time vector of their length: {', '.join(without[:8])}")
        if not self.listed:
            raise fault(path, *self.notes, "no vector has a time vector of its length: say it in the map, "
                        '[read] time = "NAME", or the rate, [read] rate = 100')  # fmt: skip

    def _leaves(self) -> Iterator[tuple[str, _Leaf]]:
        with self.path.open("rb") as stream:
            begin = stream.read(128)
        if b"MATLAB 7.3" in begin or begin.startswith(b"\x89HDF"):
            with from_part("logs"):
                import h5py

            with read_by_library(self.path, "as MATLAB 7.3"):
                self._file = h5py.File(self.path, "r")
                yield from list(_hdf(self._file, ""))
            return
        from scipy.io import loadmat

        with read_by_library(self.path, "as a MATLAB file"):
            _check_packed(self.path)
            found = loadmat(self.path, struct_as_record=False, squeeze_me=True)
        for name, value in found.items():
            if not name.startswith("__"):
                yield from _plain(name, value)

    def _times(self, arrays: dict[str, _Leaf], texts: dict[str, str], reading: Reading) -> dict[str, Stored]:
        """Time vectors by name."""
        out: dict[str, Stored] = {}
        for name, leaf in arrays.items():
            last = with_unit(name.rpartition(".")[2])[0]
            wanted = name in (reading.time, f"{reading.time}") if reading.time else is_time_name(last)
            if leaf.width != 1 or not wanted:
                continue
            with read_by_library(self.path, f"at the beginning of '{name}'"):
                head = {last: leaf.read(0, min(_HEAD, leaf.count), 0)}
            unit = _unit_of(name, texts) or with_unit(name.rpartition(".")[2])[1]
            try:
                units = {last: unit} if may_be_time(unit) else {}  # beside data it may be that of the data
                found = find_time(head, units, last if reading.time else "", reading.time_unit)
            except ValueError as cause:
                if reading.time:
                    raise fault(self.path, str(cause)) from None
                found = None
            if found is None:
                continue
            origin = self.counted_from(float(head[last][0]) * found.factor) if found.epoch else 0.0
            if found.note:
                self.notes.append(found.note)
            out[name] = Stored(
                leaf.count, lambda a, b, read=leaf.read, f=found.factor, o=origin: read(a, b, 0) * f - o
            )  # fmt: skip
        if reading.time and not out:
            known = ", ".join(list(arrays)[:12])
            raise fault(self.path, f"there is no vector '{reading.time}' for the time; it has {known}")
        return out

    def _named(self, name: str, texts: dict[str, str], arrays: dict[str, _Leaf]) -> tuple[str, str]:
        """Name and unit: ``Speed`` for ``Speed.data`` beside ``Speed.unit``."""
        head, _, last = name.rpartition(".")
        short, unit = with_unit(last)
        full = f"{head}.{short}" if head else short
        if head and last.lower() in _DATA:
            beside = [one.rpartition(".")[2] for one in arrays if one.startswith(f"{head}.")]
            if sum(not is_time_name(one) for one in beside) == 1:
                return head, unit or _unit_of(name, texts)
        return full, unit or _unit_of(name, texts)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def _check_packed(path: Path) -> None:
    """Raise an error of zlib or ValueError where a compressed variable of a version 5 file is damaged.

    SciPy's compiled reader goes on with what it has unpacked so far, and may end the process.
    """
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
        if head[124:128] not in (b"\x00\x01IM", b"\x01\x00MI"):
            return  # version 4 has no compressed ones
        order = "<" if head[126:128] == b"IM" else ">"
        while len(tag := stream.read(8)) == 8:
            kind, remaining = struct.unpack(order + "II", tag)
            if kind != _COMPRESSED:
                stream.seek(remaining, 1)
                continue
            packed = zlib.decompressobj()
            while remaining > 0 and (piece := stream.read(min(remaining, _PIECE))):
                remaining -= len(piece)
                rest = piece
                while rest:
                    packed.decompress(rest, _PIECE)
                    rest = packed.unconsumed_tail
            if not packed.eof:
                raise ValueError("a compressed variable ends too early")


def _unit_of(name: str, texts: dict[str, str]) -> str:
    """Unit of a variable: ``x.unit`` beside ``x.data``, ``units.x`` beside ``x``, ``x_unit``."""
    head, _, last = name.rpartition(".")
    dot = f"{head}." if head else ""
    for word in (*_UNIT, *(w.capitalize() for w in _UNIT)):
        for place in ((f"{dot}{word}",) if last.lower() in (*_DATA, "time", "t") else ()) + (
            f"{dot}{word}.{last}", f"{dot}{last}_{word}", f"{word}.{name}",
        ):  # fmt: skip
            if place in texts:
                return texts[place].strip()
    return ""


def _nearest(name: str, count: int, times: dict[str, int]) -> str:
    """The time vector of that length that shares most of the path."""
    fitting = [one for one in times if times[one] == count]
    parts = name.split(".")

    def shared(other: str) -> int:
        theirs = other.split(".")
        return next((i for i, (a, b) in enumerate(zip(parts, theirs, strict=False)) if a != b), len(theirs))

    return max(fitting, key=shared, default="")


def _plain(name: str, value: Any) -> Iterator[tuple[str, _Leaf]]:
    """Leaves of a value that SciPy read."""
    if hasattr(value, "_fieldnames"):
        for one in value._fieldnames:
            yield from _plain(f"{name}.{one}", getattr(value, one))
        return
    if isinstance(value, str):
        yield name, _Leaf(text=value)
        return
    array = np.asarray(value)
    if array.dtype.kind == "O" and array.ndim == 1 and array.size <= _MOST_COLUMNS:
        for at, one in enumerate(array):
            yield from _plain(f"{name}.{at + 1}", one)
    elif array.dtype.kind in "iufb" and array.ndim in (1, 2) and array.size > 1:
        table = array.reshape(array.shape[0], -1)
        if array.ndim == 2 and table.shape[0] < table.shape[1]:  # series along the second axis
            table = table.T
        yield name, _Leaf(len(table), table.shape[1], lambda a, b, k: np.asarray(table[a:b, k], float))


def _hdf(group: Any, before: str) -> Iterator[tuple[str, _Leaf]]:
    """Leaves of an HDF5 group that MATLAB wrote; its arrays are transposed, its texts are numbers of characters."""
    import h5py

    for name, item in group.items():
        if name.startswith("#"):
            continue
        full = f"{before}.{name}" if before else name
        if isinstance(item, h5py.Group):
            yield from _hdf(item, full)
            continue
        if getattr(item, "shape", None) is None:  # a broken link, a named type, an empty data set
            continue
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode() if isinstance(kind, bytes) else str(kind)
        if kind == "char" or item.dtype.kind in "SO":
            if kind == "char" and item.dtype.kind in "iu":
                yield full, _Leaf(text="".join(map(chr, np.asarray(item).ravel())))
            elif item.dtype.kind == "S" or h5py.check_string_dtype(item.dtype):
                found = np.asarray(item).ravel()
                if found.size == 1:
                    yield full, _Leaf(text=found[0].decode() if isinstance(found[0], bytes) else str(found[0]))
            continue
        if item.dtype.kind not in "iufb" or item.ndim not in (1, 2) or item.size < 2:
            continue
        shape = item.shape
        if item.ndim == 1:
            yield full, _Leaf(shape[0], 1, lambda a, b, k, d=item: np.asarray(d[a:b], float))
        elif shape[0] > shape[1]:
            yield full, _Leaf(shape[0], shape[1], lambda a, b, k, d=item: np.asarray(d[a:b, k], float))
        else:
            yield full, _Leaf(shape[1], shape[0], lambda a, b, k, d=item: np.asarray(d[k, a:b], float))
