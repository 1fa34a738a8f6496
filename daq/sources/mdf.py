"""Measured MDF files (``.mf4``, ``.mdf``, versions 3 and 4) through asammdf."""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.parts import from_part
from lacet.daq.sources.shares import SharedSource, Stored
from lacet.daq.sources.source import Array, Listed, Reading, fault

_VIRTUAL = (3, 6)
"""Types of channels without bytes in the record."""
_MOST_PACKED = 1100
"""Factor by which DEFLATE can pack data at most (1032), and a little."""
BUS_CHANNEL = "CAN_DataFrame"
"""Channel that a raw log of a bus has."""


def open_mdf(path: Path) -> Any:
    """The file, opened by asammdf. Raises RunError when it cannot be read."""
    try:
        with path.open("rb") as stream:
            if stream.read(3) not in (b"MDF", b"UnF"):
                raise fault(path, "this is no MDF file (it does not begin with 'MDF')")
    except OSError as cause:
        raise fault(path, f"cannot be read: {cause.strerror}") from None
    # Imported here: pandas, which it depends on, takes seconds to load.
    with from_part("logs"):
        from asammdf import MDF

    # A truncated file makes the library raise any exception, and a second one when its object is deleted.
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        try:
            mdf = MDF(path)
            why = _wrong_sizes(mdf, path.stat().st_size)
            if not why:
                return mdf
            mdf.close()
        except Exception as cause:
            why = str(cause) or type(cause).__name__
        gc.collect()
    finally:
        sys.unraisablehook = hook
    raise fault(path, f"cannot be read as MDF (truncated or damaged?): {why}")


def _wrong_sizes(mdf: Any, size: int) -> str:
    """The first channel or block of an MDF 4 file of `size` bytes that reaches beyond what it is in; empty for none.

    The library's compiled part would read and write beyond its arrays there, which ends the process.
    """
    for index, group in enumerate(mdf.groups):
        record = getattr(group.channel_group, "samples_byte_nr", None)
        if record is None:  # MDF 3
            continue
        for channel in group.channels:
            end = channel.byte_offset + (channel.bit_offset + channel.bit_count + 7) // 8
            if channel.channel_type not in _VIRTUAL and end > record:
                return f"channel '{channel.name}' of group {index} ends at byte {end} of a record of {record}"
        for block in group.data_blocks or ():
            if block.compressed_size > size or block.original_size > _MOST_PACKED * max(1, block.compressed_size):
                return f"a block of group {index} claims {block.original_size} bytes"
    return ""


def start_of(mdf: Any) -> int | None:
    """Instant of time 0 [ns since the Unix epoch]."""
    try:
        found = mdf.header.start_time
        return None if found is None or found.year < 1980 else int(found.timestamp() * 1e9)
    except Exception:  # files without a valid date make the library raise what it likes
        return None


class MdfSource(SharedSource):
    """The channels of a measured MDF file. A name in several groups is ``G3.Name``, 3 the group's number.

    `groups` : a channel's own name → each group that has it, and its name in `listed`, where it has numbers.
    """

    def __init__(self, path: Path, reading: Reading, mdf: Any):
        super().__init__(path)
        self._mdf, self.start_ns = mdf, start_of(mdf)
        places: dict[str, list[tuple[int, int]]] = {}
        for index, group in enumerate(mdf.groups):
            master = mdf.masters_db.get(index)
            for number, channel in enumerate(group.channels):
                if number != master:
                    places.setdefault(channel.name, []).append((index, number))
        self.groups: dict[str, list[tuple[int, str]]] = {}
        for name, found in places.items():
            for index, number in found:
                own = name if len(found) == 1 else f"G{index}.{name}"
                self.groups.setdefault(name, []).append((index, own))
                if own not in self.listed:
                    self._add(own, name, index, number)

    def _add(self, own: str, name: str, group: int, number: int) -> None:
        mdf, count = self._mdf, int(self._mdf.groups[group].channel_group.cycles_nr)
        try:
            first = mdf.get(group=group, index=number, record_offset=0, record_count=1, ignore_invalidation_bits=True)
        except Exception as cause:  # truncated data and other types raise any exception
            self.notes.append(f"'{own}' cannot be read: {cause}")
            return
        samples = np.asarray(first.samples)
        if count == 0 or samples.ndim != 1 or samples.dtype.kind not in "iufb":
            return

        def read(start: int, stop: int) -> Array:
            try:
                # Otherwise samples marked invalid would be removed, different ones in each channel.
                found = mdf.get(
                    group=group, index=number, record_offset=start, record_count=stop - start,
                    ignore_invalidation_bits=True,
                )  # fmt: skip
            except Exception as cause:
                raise fault(
                    self.path, f"'{own}' (group {group}) cannot be read from sample {start} on: {cause}"
                ) from None
            values = np.asarray(found.samples).astype(float)
            if found.invalidation_bits is not None:
                values[np.asarray(found.invalidation_bits, bool)] = np.nan
            return values

        def times(start: int, stop: int) -> Array:
            return np.asarray(mdf.get_master(group, record_offset=start, record_count=stop - start), float)

        unit = str(first.unit or "").strip()
        self.add(Listed(own, unit, count, f"group {group}"), Stored(count, read), f"G{group}", Stored(count, times))

    def close(self) -> None:
        """Close the file."""
        self._mdf.close()
