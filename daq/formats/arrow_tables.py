"""Tables of numbers in Parquet and CSV files, with metadata beside them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from lacet.daq.errors import RunError
from lacet.daq.sources.csv_table import encoding_of, numbers_of_texts

pc: Any = pyarrow.compute  # its functions are made when it is loaded
_SHOWN = 24
"""Characters of a cell that a note has."""


def column_names(file: Path) -> list[str]:
    """Names of the columns of a Parquet file; none for a file of another kind. Raises OSError."""
    try:
        return list(pq.read_schema(file).names)
    except pa.ArrowException:
        return []


def write_columns(file: Path, columns: Mapping[str, NDArray[np.float64]], metadata: Mapping[str, Any]) -> None:
    """Write columns of one length as Parquet, metadata inside, or as CSV with the metadata in a JSON file beside it."""
    table = pa.table(dict(columns))
    if file.suffix == ".csv":
        pa_csv.write_csv(table, file)
        file.with_suffix(".json").write_text(json.dumps(metadata, indent=1) + "\n", encoding="utf-8")
    else:
        pq.write_table(table.replace_schema_metadata({"lacet": json.dumps(metadata)}), file, compression="zstd")


def read_columns(file: Path) -> tuple[dict[str, NDArray[np.float64]], dict[str, Any], list[str]]:
    """Columns of numbers by name, missing ones NaN; the metadata; and what was left out. Raises RunError."""
    problems: list[str] = []
    metadata: dict[str, Any] = {}
    try:
        if file.suffix.lower() == ".csv":
            table = _read_csv(file, problems)
            text = _beside(file)
            columns = _columns(file, table.column_names, lambda name: table[name], problems)
            del table
        else:
            with pq.ParquetFile(file) as source:  # pq.read_table loads pandas, half a second of start-up
                schema = source.schema_arrow
                # One column after the other: a run of an hour is large, and the whole table would be there twice.
                columns = _columns(file, schema.names, lambda name: source.read([name])[name], problems)
            text = _inside(schema)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as cause:
        raise _no_table(file, cause) from None
    finally:
        pa.default_memory_pool().release_unused()
    try:
        metadata = _parsed(text)
    except ValueError as cause:
        problems.append(f"metadata is not valid JSON and was left out: {cause}")
    return columns, metadata, problems


def read_metadata(file: Path) -> dict[str, Any]:
    """The metadata of a table alone; empty where they are no JSON. Raises RunError when the file is no table."""
    try:
        return _parsed(_beside(file) if file.suffix.lower() == ".csv" else _inside(pq.read_schema(file)))
    except (pa.ArrowException, OSError, UnicodeDecodeError) as cause:
        raise _no_table(file, cause) from None
    except ValueError:
        return {}


def _beside(file: Path) -> str:
    """Metadata of a CSV file."""
    beside = file.with_suffix(".json")
    return beside.read_text(encoding="utf-8") if beside.is_file() else "{}"


def _inside(schema: pa.Schema) -> str:
    """Metadata of a Parquet file."""
    return ((schema.metadata or {}).get(b"lacet") or b"{}").decode("utf-8")


def _parsed(text: str) -> dict[str, Any]:
    found: Any = json.loads(text)
    if not isinstance(found, dict):
        raise ValueError("not an object")
    return found


def _no_table(file: Path, cause: Exception) -> RunError:
    return RunError(file, [f"cannot be read as a table (truncated or another kind of file?): {cause}"])


def _columns(
    file: Path, names: Sequence[str], read: Callable[[str], pa.ChunkedArray], problems: list[str]
) -> dict[str, NDArray[np.float64]]:
    """Columns of numbers by name, missing ones NaN; what is not numbers is left out and reported."""
    if twice := [name for name, n in Counter(names).items() if n > 1]:
        raise RunError(file, [f"{', '.join(twice)}: more than one column of that name; give each its own"])
    # Array.to_numpy loads pandas, a second of start-up, and so does a scalar made of a number of Python's.
    missing = pa.Array.from_buffers(pa.float64(), 1, [None, pa.py_buffer(np.array([np.nan]))])[0]
    columns: dict[str, NDArray[np.float64]] = {}
    for name in names:
        column = read(name)
        try:
            filled = column.cast(pa.float64()).fill_null(missing)
        except pa.ArrowException:
            found = _numbers(column)
            if found is None:
                problems.append(f"column '{name}' is not numbers and was left out")
                continue
            numbers, said = found
            problems.append(f"column '{name}' has {said}")
            filled = pa.chunked_array([numbers.fill_null(missing)])
        # Copied, so that nothing of the file stays in memory.
        columns[name] = np.concatenate(
            [np.zeros(0), *(np.asarray(np.from_dlpack(chunk), np.float64) for chunk in filled.chunks)]
        )
    return columns


def _numbers(column: pa.ChunkedArray) -> tuple[Any, str] | None:
    """A column of text as numbers, and which cells are none; None where fewer than half are numbers."""
    try:
        cells = pc.utf8_trim_whitespace(column.combine_chunks().cast(pa.string()))
    except pa.ArrowException:
        return None
    numbers, wrong = numbers_of_texts(cells)
    if 2 * numbers.null_count >= len(column):
        return None
    text = str(cells[int(wrong[0])].as_py())[:_SHOWN]
    few = wrong.size == 1
    cells_are = "1 cell that is no number: it counts" if few else f"{wrong.size} cells that are no numbers: they count"
    return numbers, f"{cells_are} as missing (the first: '{text}')"


def _read_csv(file: Path, problems: list[str]) -> pa.Table:
    """A CSV file up to where it is damaged: truncated lines are left out and reported."""
    cut: list[str] = []
    with file.open("rb") as stream:
        begin = stream.read(2**16)
    if b"\0" in begin:
        raise RunError(file, ["cannot be read as a table: it holds NUL bytes, so it is no text (no CSV)"])
    encoding = encoding_of(begin) or "cp1252"
    header, _, numbers = begin.decode(encoding, "replace").partition("\n")
    # The format of spreadsheets where the decimal sign is a comma.
    separator = max(",;\t", key=header.count)
    decimal = "," if separator != "," and "," in numbers else "."

    def skip(row: pa_csv.InvalidRow) -> str:
        cut.append(row.text)
        return "skip"

    table = pa_csv.read_csv(
        file,
        read_options=pa_csv.ReadOptions(encoding=encoding),
        parse_options=pa_csv.ParseOptions(delimiter=separator, invalid_row_handler=skip),
        convert_options=pa_csv.ConvertOptions(decimal_point=decimal),
    )
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 2**16))
        last = stream.read().rpartition(b"\n")[2].decode(encoding, "replace")
    if last.strip() and last not in cut and table.num_rows:
        # A truncated number is still a number: the last one is doubtful where the line's end is missing.
        table = table.slice(0, table.num_rows - 1)
        cut.append(last)
    if cut:
        problems.append(f"{len(cut)} lines are not whole (file cut short?) and were left out")
    return table
