"""Arrays of long runs on disk: what is needed once in a pass over all samples need not be in memory between passes."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lacet.daq.file_places import read_at, write_at

Array = NDArray[np.float64]
K = TypeVar("K", bound=Hashable)


def free_bytes() -> int:
    """Free space on the disk where `DiskSpace` writes [bytes]."""
    return shutil.disk_usage(tempfile.gettempdir()).free


class DiskSpace:
    """Space for arrays in a file without a name, in the folder for temporary files (TMPDIR), released with this object.

    The file is made with the first arrays. One thread at a time may write. Raises OSError when the disk is full.
    """

    def __init__(self) -> None:
        self._end = 0

    def __reduce__(self) -> tuple[Callable[[Array], DiskSpace], tuple[Array]]:
        """A copy, elsewhere too, has a file of its own."""
        return _space_with, (self.read(0, (self._end // 8,)),)

    def put(self, arrays: Mapping[K, Array]) -> ArraysOnDisk[K]:
        """Write arrays, which are then no more needed in memory."""
        return self.put_each(arrays.items())

    def put_each(self, arrays: Iterable[tuple[K, Array]]) -> ArraysOnDisk[K]:
        """Write arrays one after the other, as they are made."""
        places: dict[K, tuple[int, tuple[int, ...]]] = {}
        if self._end == 0:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the arrays are wanted
        for key, array in arrays:
            places[key] = self._end, array.shape
            self._write(np.ascontiguousarray(array, float))
        return ArraysOnDisk(self, places)

    def _write(self, array: Array) -> None:
        rest = array.reshape(-1).data.cast("B") if array.size else memoryview(b"")
        while rest:
            done = write_at(self._file.fileno(), rest, self._end)
            self._end, rest = self._end + done, rest[done:]

    def read(self, start: int, shape: tuple[int, ...]) -> Array:
        """The array of a shape that begins at a byte of the file."""
        out = np.empty(shape)
        rest = out.reshape(-1).data.cast("B") if out.size else memoryview(b"")
        while rest:
            done = read_at(self._file.fileno(), rest, start)
            if not done:
                raise OSError("a temporary file is shorter than what was written to it")
            start, rest = start + done, rest[done:]
        return out


def _space_with(content: Array) -> DiskSpace:
    space = DiskSpace()
    if content.size:
        space.put({"content": content})
    return space


class ArraysOnDisk(Mapping[K, Array]):
    """Arrays in a `space` on disk, each read whenever it is asked for; `places` key → first byte and shape."""

    def __init__(self, space: DiskSpace, places: Mapping[K, tuple[int, tuple[int, ...]]]):
        self.space, self.places = space, places

    def __getitem__(self, key: K) -> Array:
        return self.space.read(*self.places[key])

    def stretch(self, key: K, start: int, stop: int) -> Array:
        """The values from index `start` up to `stop` of an array of one dimension."""
        return self.space.read(self.places[key][0] + 8 * start, (stop - start,))

    def __iter__(self) -> Iterator[K]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)


class JoinedOnDisk(Mapping[K, Array]):
    """Arrays of which every one of the `parts` holds a stretch, one after the other along `axis`.

    A part without an array of a name has no samples of it.
    """

    def __init__(self, parts: Sequence[ArraysOnDisk[K]], axis: int = -1):
        self.parts, self.axis = tuple(parts), axis
        self._keys = dict.fromkeys(key for part in parts for key in part)

    def __getitem__(self, key: K) -> Array:
        if key not in self._keys:
            raise KeyError(key)
        return np.concatenate([part[key] for part in self.parts if key in part], axis=self.axis)

    def __iter__(self) -> Iterator[K]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)
