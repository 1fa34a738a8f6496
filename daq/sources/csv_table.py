"""Text tables of any header: separator, decimal sign, encoding, header, units row and time column are found."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from lacet.daq.sources.columns import TimeColumn, find_time, is_time_name, units_row, with_unit
from lacet.daq.sources.source import Array, Listed, Piece, Reading, Series, Source, fault, resolve, unique

pc: Any = pyarrow.compute  # its functions are made when it is loaded
_HEAD = 1 << 17
"""Beginning of the file from which its form is found [byte]."""
_LINES = 200
"""Lines of it that are looked at."""
_SEPARATORS = ";\t,|"
_NUMBER = re.compile(r"^[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?$")
_MISSING = ["", "NaN", "nan", "NAN", "NA", "N/A", "#N/A", "n/a", "-", "--", "---", "null", "NULL", "None", "inf",
            "-inf", "Inf", "-Inf", "INF", "#NV", "NoData", "invalid", "*", "#DIV/0!", "#VALUE!", "#REF!", "#NAME?",
            "#NUM!", "#NULL!", "#WERT!", "#BEZUG!", "#ZAHL!", "#VALEUR!", "#NOMBRE!"]  # fmt: skip
"""Cells without a value, those that spreadsheets write for one included."""
_BLOCK = 1 << 22
"""Bytes that are read at a time."""
_DAY = 86400.0
_HALF = r"(\s*[AP]\.?M\.?)?"
_CLOCK = re.compile(
    rf"^\d{{1,2}}:\d\d(:\d\d([.,]\d+)?)?{_HALF}$|^\d{{4}}-\d\d-\d\d[T ]\d\d:\d\d|^\d{{1,2}}[./]\d{{1,2}}[./]\d{{4}} \d",
    re.IGNORECASE,
)
_TWELVE = re.compile(r"(?P<before>.*?)(?P<hour>\d{1,2})(?P<rest>:\d\d[\d:.,]*)\s*(?P<half>[AP])\.?M\.?", re.IGNORECASE)
"""A time of a clock of twelve hours."""
_JAPANESE = re.compile(rb"(?:[\x81-\x9f][\x40-\x7e\x80-\xfc]){2}")
"""Two characters of cp932 in a row, of the kana and the usual kanji; in cp1252 two signs, each before a letter."""
_ZEROS = 0.4
"""Part of every second byte that is zero, at least, in UTF-16 of mostly Latin letters."""
_SAY_ENCODING = (
    'Say it in the map, [read] encoding = "cp932" (Japanese), "gb18030" (Chinese), "cp1251" (Cyrillic), "cp1250", …; '
    "lacet map --guess takes a map of these two lines with --read"
)
_SHOWN = 5
"""Columns that a note names."""


@dataclass(frozen=True)
class Form:
    """The form of a text table: `header` and `first` are lines counted from 0, `skip` the lines before the numbers."""

    encoding: str
    separator: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    first: int


class CsvTable(Source):
    """A text table with a header: CSV, TSV, semicolons and decimal commas, units in names or in a row of their own."""

    def __init__(self, path: Path, reading: Reading):
        super().__init__(path)
        self.form = find_form(path, reading)
        self._size = max(1, path.stat().st_size)
        head = self._head()
        texts = [name for name, column in head.items() if column is None]
        numbers = {name: column for name, column in head.items() if column is not None}
        units = dict(zip(self.form.names, self.form.units, strict=True))
        for at, name in enumerate(self.form.names):
            if name in numbers:
                self.listed[name] = Listed(name, units[name], None, f"column {at + 1}")
        self._time: TimeColumn | None = None
        self._origin = 0.0
        self._rate = reading.rate
        if reading.time and reading.time not in self.form.names:
            try:
                reading = replace(reading, time=resolve(reading.time, list(self.form.names)))
            except KeyError as cause:
                raise fault(path, f"time column: {cause.args[0]}") from None
        if texts:
            shown = ", ".join(f"'{name}' ({self._examples[name]})" for name in texts[:_SHOWN])
            self.notes.append(f"columns of text are left out: {shown}{' …' if len(texts) > _SHOWN else ''}")
        if not self._rate or reading.time:
            try:
                if not any(map(is_time_name, numbers)) and not reading.time:
                    for name in filter(is_time_name, texts):
                        raise ValueError(
                            f"'{name}' has the name of a time, but is written as {self._examples[name]}: write it as "
                            "seconds or 13:05:59.250, or say the rate in the map, [read] rate = 100"
                        )
                self._time = find_time(numbers, units, reading.time, reading.time_unit)
            except (ValueError, KeyError) as cause:
                raise fault(path, f"time column: {cause}") from None
            if self._time is None:
                some = ", ".join(self.form.names[:12])
                raise fault(
                    path,
                    f"no column is a time (none increases all the time); the columns are {some}: say which in the map, "
                    '[read] time = "NAME", or the rate of a table without times, [read] rate = 100',
                )
            if self._time.note and self._time.name not in self._clock_columns:
                self.notes.append(self._time.note)
            if self._time.epoch:
                self._origin = self.counted_from(float(np.nanmin(numbers[self._time.name])) * self._time.factor)
            self.listed.pop(self._time.name, None)

    def pieces(self, names: Collection[str]) -> Iterator[Piece]:
        """Batches of lines."""
        time = self._time
        wanted: list[str] = list(dict.fromkeys([*([time.name] if time else []), *names]))
        rows, self.done = 0, 0.0
        self._before: dict[str, float] = {}
        last = np.nan
        for batch in self._batches(wanted):
            columns = {name: self._numbers(batch.column(name), name, rows) for name in wanted}
            if time is None:
                t = (rows + np.arange(batch.num_rows)) / self._rate
            else:
                t = columns[time.name] * time.factor
                if time.name not in self._clock_columns and np.nanmax(t, initial=0.0) < _DAY:
                    t = _past_midnight(t, last)
                    last = next((x for x in t[::-1].tolist() if np.isfinite(x)), last)
                t = t - self._origin
            rows += batch.num_rows
            self.done = min(1.0, rows * self._line / self._size)
            there = np.isfinite(t)
            if not there.all():
                self._note("lines without a time are left out")
                t, columns = t[there], {name: values[there] for name, values in columns.items()}
            yield {name: Series(t, columns[name]) for name in names}

    def _batches(self, wanted: list[str]) -> Iterator[Any]:
        """Batches of lines, of numbers; as texts from the first cell on that is none."""
        rows, as_text = 0, False
        while True:
            texts = wanted if as_text else [n for n in wanted if n in self._clock_columns or n in self._grouped]
            types: dict[str, Any] = {n: pa.string() if n in texts else pa.float64() for n in wanted}
            given = rows
            try:
                stream = pa_csv.open_csv(
                    self._open(), read_options=pa_csv.ReadOptions(
                        column_names=list(self.form.names), block_size=_BLOCK, encoding=self.form.encoding,
                        skip_rows=self.form.first),
                    parse_options=self._parse(),
                    convert_options=pa_csv.ConvertOptions(
                        column_types=types, include_columns=wanted, null_values=_MISSING, strings_can_be_null=True,
                        decimal_point=self.form.decimal),
                )  # fmt: skip
                for batch in stream:
                    fresh = batch.slice(min(given, batch.num_rows))
                    given -= batch.num_rows - fresh.num_rows
                    if fresh.num_rows:
                        yield fresh
                        rows += fresh.num_rows
                return
            except UnicodeDecodeError as cause:
                why = f"{cause.reason} in {cause.encoding}" if cause.encoding != "charmap" else str(cause)
                says = f"behind line {self.form.first + rows}: no text in {self.form.encoding} ({why}). {_SAY_ENCODING}"
                raise fault(self.path, says) from None
            except (pa.ArrowException, OSError) as cause:
                if as_text or "conversion error" not in str(cause):
                    raise fault(self.path, f"behind line {self.form.first + rows}: {_said(cause)}") from None
                as_text = True

    def _note(self, text: str) -> None:
        """Add a note that is not there yet."""
        if text not in self.notes:
            self.notes.append(text)

    def _open(self) -> Any:
        return pa.input_stream(str(self.path), compression=None)

    def _parse(self) -> pa_csv.ParseOptions:
        width = len(self.form.names)

        def skip(row: pa_csv.InvalidRow) -> str:
            where = f"line {row.number}" if row.number else "a line"
            note = f"lines without {width} columns are left out (the first: {where})"
            if not any("are left out (the first" in one for one in self.notes):
                self.notes.append(note)
            return "skip"

        return pa_csv.ParseOptions(delimiter=self.form.separator, invalid_row_handler=skip)

    def _head(self) -> dict[str, Array | None]:
        """First values of each column; None for one of text."""
        text = _decoded(self.path, self.form.encoding)
        lines = text.splitlines()[self.form.first : self.form.first + _LINES]
        self._line = sum(map(len, lines)) / max(1, len(lines)) + 1.0
        rows = [row for row in csv.reader(lines, delimiter=self.form.separator) if len(row) == len(self.form.names)]
        out: dict[str, Array | None] = {}
        self._clock_columns: set[str] = set()
        self._grouped: set[str] = set()
        self._wrong: set[str] = set()
        self._examples: dict[str, str] = {}
        for at, name in enumerate(self.form.names):
            cells = [row[at].strip() for row in rows]
            filled = [cell for cell in cells if cell not in _MISSING]
            if filled and all(_CLOCK.match(cell) for cell in filled):
                self._clock_columns.add(name)
                out[name] = _clock(cells)
                continue
            others = [cell for cell in filled if not _is_number(cell, self.form.decimal)]
            if others:
                if not _are_grouped(others, self.form.decimal):
                    self._examples[name], out[name] = repr(others[0][:24]), None
                    continue
                self._grouped.add(name)
                cells = [cell.replace(_other(self.form.decimal), "") for cell in cells]
            point = [cell.replace(self.form.decimal, ".") for cell in cells]
            out[name] = np.array([float(c) if c and c not in _MISSING else np.nan for c in point])
        return out

    def _numbers(self, column: Any, name: str, rows: int) -> Array:
        """Values of a column of a batch that begins after so many lines of numbers."""
        if name in self._clock_columns:
            found = _clock(["" if one is None else one for one in column.to_pylist()], self._before.get(name, np.nan))
            known = found[np.isfinite(found)]
            if known.size:
                self._before[name] = float(known[-1])
            return found
        if pa.types.is_string(column.type):
            column = self._of_texts(column, name, rows)
        missing = pa.Array.from_buffers(pa.float64(), 1, [None, pa.py_buffer(np.array([np.nan]))])[0]
        return np.asarray(np.from_dlpack(column.fill_null(missing)), np.float64)

    def _of_texts(self, column: Any, name: str, rows: int) -> Any:
        """Numbers of cells that were read as texts; those that are none have no value, and are noted with a place."""
        cells = pc.utf8_trim_whitespace(column)
        if name in self._grouped:
            cells = pc.replace_substring(cells, _other(self.form.decimal), "")
        cells = pc.replace_substring(cells, self.form.decimal, ".")
        numbers, wrong = numbers_of_texts(cells)
        if wrong.size and name not in self._wrong:
            self._wrong.add(name)
            place = self.form.first + rows + int(wrong[0]) + 1
            text = column[int(wrong[0])].as_py()
            self._note(f"'{name}' has cells that are no numbers: they count as missing (line {place}: '{text[:24]}')")
        return numbers


def find_form(path: Path, reading: Reading) -> Form:
    """The form of a text table. Raises RunError in words where it is none."""
    try:
        with path.open("rb") as stream:
            begin = stream.read(_HEAD)
    except OSError as cause:
        raise fault(path, f"cannot be read: {cause.strerror}") from None
    return form_of(begin, path, reading)


def form_of(begin: bytes, path: Path, reading: Reading) -> Form:
    """The form of a text table by its beginning; `path` is for messages. Raises RunError in words where it is none."""
    encoding = reading.encoding or encoding_of(begin)
    if not encoding:
        raise fault(path, f"its letters are in an encoding that is not recognized. {_SAY_ENCODING}")
    if b"\0" in begin and not encoding.startswith("utf-16"):
        raise fault(path, "this is no text table: it holds NUL bytes")
    lines = _text_of(begin, path, encoding).splitlines()
    if reading.encoding and not _can_be(begin, encoding):
        raise fault(path, f"this is no text in {encoding}. {_SAY_ENCODING}")
    if len(begin) == _HEAD:
        lines = lines[:-1]
    lines = lines[:_LINES]
    best: tuple[int, int, str, str, int] | None = None
    for separator in [reading.separator] if reading.separator else _SEPARATORS:
        for decimal in [reading.decimal] if reading.decimal else (".", ","):
            if decimal == separator:
                continue
            rows = list(csv.reader(lines, delimiter=separator))
            first, length, width = _numeric_stretch(rows, decimal)
            if length >= 2:
                score = (length * max(1, width - 1), length, separator, decimal, first)
                # Where both signs fit (whole numbers only) the point is meant, and comes first.
                if best is None or score[0] > best[0]:
                    best = score
    if best is None:
        shown = "; ".join(line[:40] for line in lines[:3])
        raise fault(
            path,
            f"no lines of numbers were found (it begins {shown!r}): say how it is written in the map, "
            '[read] separator = ";", decimal = ",", header = 3',
        )
    _, _, separator, decimal, first = best
    rows = list(csv.reader(lines, delimiter=separator))
    width = len(rows[first])
    names, units = _header(path, rows, first, width, reading.header)
    return Form(encoding, separator, decimal, tuple(names), tuple(units), first)


def _header(path: Path, rows: list[list[str]], first: int, width: int, asked: int) -> tuple[list[str], list[str]]:
    top = asked - 1 if asked else first
    if not asked:
        while top > 0 and len(_trimmed(rows[top - 1], width)) == width and any(c.strip() for c in rows[top - 1]):
            top -= 1
    above = [_trimmed(row, width) for row in rows[top:first] if any(cell.strip() for cell in row)]
    above = [row for row in above if len(row) == width]
    if not above:
        raise fault(
            path,
            f"there is no header above the numbers, which begin in line {first + 1}: say its line in the map "
            "([read] header = 3), or put one there",
        )
    of_units = [row for row in above[1:] if units_row(row)]
    named = [row for row in above if row not in of_units] or above[:1]
    header = named[0] if asked else max(named, key=lambda row: len({cell.strip() for cell in row if cell.strip()}))
    split = [with_unit(cell) for cell in header]
    names = unique(name or f"column_{at + 1}" for at, (name, _) in enumerate(split))
    units = [unit for _, unit in split]
    if of_units:
        written = [cell.strip().strip("[]()").strip() for cell in of_units[0]]
        units = [own or row for own, row in zip(units, written, strict=True)]
    return names, units


def _trimmed(row: list[str], width: int) -> list[str]:
    """A line without the empty cells at its end that others do not have."""
    while len(row) > width and not row[-1].strip():
        row = row[:-1]
    return row


def _numeric_stretch(rows: list[list[str]], decimal: str) -> tuple[int, int, int]:
    """First line, length and width of the longest stretch of lines of numbers of equal width."""
    best = (0, 0, 0)
    start = 0
    for at in range(len(rows) + 1):
        good = at < len(rows) and _numeric(rows[at], decimal)
        if good and (at == start or len(rows[at]) == len(rows[start])):
            continue
        if at > start and at - start > best[1]:
            best = (start, at - start, len(rows[start]))
        start = at if good else at + 1
    return best


def _numeric(row: list[str], decimal: str) -> bool:
    """Whether a line holds numbers: some, and not more texts than numbers; clocks count as numbers."""
    cells = [cell.strip() for cell in row if cell.strip() not in _MISSING]
    numbers = sum(_is_number(cell, decimal) or bool(_CLOCK.match(cell)) for cell in cells)
    return numbers > 0 and 2 * numbers > len(cells) and (len(row) > 1)


def _is_number(cell: str, decimal: str) -> bool:
    return bool(_NUMBER.match(cell)) and ("," if decimal == "." else ".") not in cell


def _other(decimal: str) -> str:
    """The sign between groups of three digits where `decimal` is before the decimals."""
    return "," if decimal == "." else "."


def _are_grouped(cells: list[str], decimal: str) -> bool:
    """Whether cells are numbers with their digits in groups of three, as 4,000.0; 4,000 alone could be decimals."""
    group = rf"\{_other(decimal)}\d{{3}}"
    one = re.compile(rf"[-+]?\d{{1,3}}({group})+(\{decimal}\d*)?")
    return all(map(one.fullmatch, cells)) and any(decimal in c or c.count(_other(decimal)) > 1 for c in cells)


def numbers_of_texts(cells: Any) -> tuple[Any, NDArray[np.intp]]:
    """Numbers of an Arrow array of trimmed texts, those that are none missing, and the places of these."""
    are = pc.match_substring_regex(cells, r"^[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?$")
    wrong = np.flatnonzero(np.from_dlpack(pc.cast(pc.fill_null(pc.invert(are), False), pa.uint8())))
    return pc.cast(pc.if_else(are, pc.replace_substring(cells, "+", ""), None), pa.float64()), wrong


def encoding_of(begin: bytes) -> str:
    """Encoding of a text of which this is the beginning; empty where it is none of those that are known by their bytes.

    By its mark, or zero bytes beside Latin letters (UTF-16); else UTF-8 where it can be, cp932 (Shift-JIS) where it has
    Japanese words in it, or cp1252.
    """
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if begin.startswith(mark):
            return encoding
    for start, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        zeros = begin[start::2].count(0)
        if zeros > _ZEROS * len(begin[start::2]) and zeros == begin.count(0):
            return encoding
    japanese = ("cp932",) if _JAPANESE.search(begin) else ()
    return next((one for one in ("utf-8", *japanese, "cp1252") if _can_be(begin, one)), "")


def _can_be(begin: bytes, encoding: str) -> bool:
    """Whether bytes are the beginning of a text in an encoding; a character may be cut at the end."""
    try:
        codecs.getincrementaldecoder(encoding)().decode(begin)
    except UnicodeDecodeError:
        return False
    return True


def _decoded(path: Path, encoding: str) -> str:
    with path.open("rb") as stream:
        return _text_of(stream.read(_HEAD), path, encoding)


def _text_of(begin: bytes, path: Path, encoding: str) -> str:
    try:
        return io.TextIOWrapper(io.BytesIO(begin), encoding, "replace", "").read()
    except LookupError:
        raise fault(path, f"there is no encoding {encoding!r}: utf-8, cp1252, utf-16 …") from None


def _clock(cells: list[str], before: float = np.nan) -> Array:
    """Seconds of times of day, or since 1970 of dates; `before` : those of the line before, NaN for the first."""
    if any(cell[-1:] in "Mm." and _TWELVE.fullmatch(cell) for cell in cells[:5]):
        cells = [_of_24_hours(cell) for cell in cells]
    if any("-" in cell or "/" in cell or cell.count(".") > 1 for cell in cells[:5]):
        out = np.full(len(cells), np.nan)
        for at, cell in enumerate(cells):
            text = cell.replace("/", ".")
            day = re.match(r"(\d{1,2})\.(\d{1,2})\.(\d{4}) (.*)", text)
            iso = f"{day[3]}-{int(day[2]):02d}-{int(day[1]):02d} {day[4]}" if day else cell
            try:
                out[at] = datetime.fromisoformat(
                    iso.replace(",", ".") + ("" if re.search(r"[+Z]", iso) else "+00:00")
                ).timestamp()
            except ValueError:
                continue
        return out
    parts = [cell.replace(",", ".").split(":") for cell in cells]
    of_day = np.array([
        sum(float(x) * f for x, f in zip(p, (3600.0, 60.0, 1.0), strict=False)) if len(p) > 1 else np.nan for p in parts
    ])  # fmt: skip
    return _past_midnight(of_day, before)


def _of_24_hours(cell: str) -> str:
    """A time of a clock of twelve hours as one of 24."""
    found = _TWELVE.fullmatch(cell.strip())
    if found is None:
        return cell
    hour = int(found["hour"]) % 12 + 12 * (found["half"] in "Pp")
    return f"{found['before']}{hour:02d}{found['rest']}"


def _past_midnight(of_day: Array, before: float) -> Array:
    """Times of day that go on after midnight; `before` : the time of the line before, NaN for the first.

    A time more than half a day before the last one is of the next day: a clock that is set back is not by as much.
    """
    known = np.flatnonzero(np.isfinite(of_day))
    last = before if np.isfinite(before) else float(of_day[known[0]]) if known.size else 0.0
    steps = np.diff(of_day[known], prepend=last % _DAY)
    out = of_day + _DAY * (last // _DAY)
    out[known] += _DAY * np.cumsum(steps < -0.5 * _DAY)
    return out


def _said(cause: BaseException) -> str:
    return str(cause).replace("CSV conversion error to double", "not a number").replace("In CSV column", "column")


def read_cells(path: Path, content: bytes | None = None) -> tuple[list[str], list[str], Array, int]:
    """Names, units, numbers (n, k) with NaN for the rest, and the first line of numbers [from 1], of a short table.

    `content` is the file's where it is kept elsewhere. Raises RunError as `find_form`.
    """
    if content is None:
        try:
            content = path.read_bytes()
        except OSError as cause:
            raise fault(path, f"cannot be read: {cause.strerror}") from None
    form = form_of(content[:_HEAD], path, Reading())
    lines = content.decode(form.encoding, "replace").splitlines()[form.first :]
    rows = [row for row in csv.reader(lines, delimiter=form.separator) if any(cell.strip() for cell in row)]
    out = np.full((len(rows), len(form.names)), np.nan)
    for at, row in enumerate(rows):
        for k, cell in enumerate(row[: len(form.names)]):
            if _is_number(cell.strip(), form.decimal):
                out[at, k] = float(cell.strip().replace(form.decimal, "."))
    return list(form.names), list(form.units), out, form.first + 1
