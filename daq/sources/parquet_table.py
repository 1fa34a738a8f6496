"""Parquet tables of any column names; units in the names, or in the metadata of a column."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lacet.daq.sources.columns import find_time, with_unit
from lacet.daq.sources.source import (
    PIECE_SAMPLES,
    Array,
    Listed,
    Piece,
    Reading,
    Series,
    Source,
    fault,
    read_by_library,
    resolve,
    unique,
)

_HEAD = 500
_STEPS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNIT_KEYS = (b"unit", b"units", b"Unit", b"Units", b"unit_string")


class ParquetTable(Source):
    """A Parquet file with a column of times, which may be of any numeric or timestamp type."""

    def __init__(self, path: Path, reading: Reading):
        super().__init__(path)
        with read_by_library(path, "as Parquet"):
            self._file = pq.ParquetFile(path)
            schema, self._rows = self._file.schema_arrow, self._file.metadata.num_rows
            head = next(self._file.iter_batches(_HEAD), None)
        split = [with_unit(name) for name in schema.names]
        self._columns: dict[str, str] = {}
        heads: dict[str, Array] = {}
        self._origins: dict[str, int] = {}
        units: dict[str, str] = {}
        for at, name in enumerate(unique(name for name, _ in split)):
            column = schema.field(at)
            if not _numeric(column.type):
                continue
            said = next((column.metadata[k].decode() for k in _UNIT_KEYS if k in (column.metadata or {})), "")
            self._columns[name], units[name] = schema.names[at], said or split[at][1]
            if head is not None:
                if pa.types.is_timestamp(column.type):  # as whole numbers: since 1970 a float has steps of 0.2 µs
                    first = head.column(at).cast(pa.int64()).drop_null()
                    self._origins[schema.names[at]] = first[0].as_py() if len(first) else 0
                heads[name] = self._values(head, schema.names[at])
            self.listed[name] = Listed(name, units[name], self._rows, f"column {at + 1}")
        self._rate = reading.rate
        self._time, self._origin = None, 0.0
        if not self._rate:
            try:
                asked = resolve(reading.time, list(self._columns)) if reading.time else ""
                stamps = [n for n in heads if pa.types.is_timestamp(schema.field(self._columns[n]).type)]
                self._time = find_time(heads, units | dict.fromkeys(stamps, "s"), asked, reading.time_unit)
            except (ValueError, KeyError) as cause:
                raise fault(path, f"time column: {cause.args[0]}") from None
            if self._time is None:
                some = ", ".join(list(self._columns)[:12])
                raise fault(
                    path, f"no column is a time (none increases all the time); the columns are {some}: say which in "
                    'the map, [read] time = "NAME", or [read] rate = 100',
                )  # fmt: skip
            own = self._columns[self._time.name]
            if own in self._origins:
                self.start_ns = round(self._origins[own] * 1e9 * _STEPS[schema.field(own).type.unit])
            if self._time.note:
                self.notes.append(self._time.note)
            if self._time.epoch:
                self._origin = self.counted_from(float(np.nanmin(heads[self._time.name])) * self._time.factor)
            self.listed.pop(self._time.name, None)

    def pieces(self, names: Collection[str]) -> Iterator[Piece]:
        """Batches of rows."""
        time, rows = self._time, 0
        columns = list(dict.fromkeys([self._columns[n] for n in (*([time.name] if time else []), *names)]))
        try:
            for batch in self._file.iter_batches(PIECE_SAMPLES, columns=columns):
                values = {column: self._values(batch, column) for column in columns}
                if time is None:
                    t = (rows + np.arange(batch.num_rows)) / self._rate
                else:
                    t = values[self._columns[time.name]] * time.factor - self._origin
                rows += batch.num_rows
                self.done = rows / max(1, self._rows)
                yield {name: Series(t, values[self._columns[name]]) for name in names}
        except (pa.ArrowException, OSError) as cause:
            raise fault(self.path, f"behind row {rows}: {cause}") from None

    def _values(self, batch: Any, name: str) -> Array:
        """A column as numbers; one of timestamps in seconds from its first."""
        column = batch.column(batch.schema.get_field_index(name))
        if pa.types.is_timestamp(column.type):
            factor, origin = _STEPS[column.type.unit], self._origins.get(name, 0)
            whole = column.cast(pa.int64())
            steps = np.asarray(np.from_dlpack(whole.fill_null(origin)), np.int64) - origin
            return np.asarray(steps * factor, np.float64)
        if pa.types.is_boolean(column.type):
            column = column.cast(pa.int8())
        missing = pa.Array.from_buffers(pa.float64(), 1, [None, pa.py_buffer(np.array([np.nan]))])[0]
        return np.asarray(np.from_dlpack(column.cast(pa.float64(), safe=False).fill_null(missing)), np.float64)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _numeric(kind: Any) -> bool:
    t = pa.types
    return t.is_integer(kind) or t.is_floating(kind) or t.is_boolean(kind) or t.is_timestamp(kind) or t.is_decimal(kind)
