"""Results as tables: values identified, errors by run and row, ranking of missing effects; as CSV and Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.identify.wheel_loads.measured_forces import ForceError
from lacet.identify.wheel_loads.outputs import EstimatedForces


@dataclass(frozen=True)
class Table:
    """A table: names of the columns with their kind (str, float, bool), and rows with a value or None in each."""

    columns: Mapping[str, type]
    rows: Sequence[Sequence[Any]]


_VALUES = {
    "kind": str, "name": str, "effect": str, "value": float, "unit": str, "low95": float, "high95": float,
    "half95_sheet": float, "half95": float, "group": str, "identified": bool, "why_not": str,
}  # fmt: skip
_ERRORS = {
    "runs": str, "run": str, "row": str, "unit": str, "rms": float, "floor": float, "ratio": float,
    "nrmse_percent": float, "vaf_percent": float, "judged": bool, "colour": str,
}  # fmt: skip
_RANKING = {
    "rank": float, "effect": str, "answer": str, "gain_percent": float, "p": float, "size": float, "why": str,
}  # fmt: skip


def values_table(result: Mapping[str, Any]) -> Table:
    """Parameters, whole-vehicle and derived values of a fit's result (``docs/json.md``), with 95 % intervals.

    The ends of an interval are those with what the sensor sheet's gains and latencies may add, where that is known.
    """
    rows: list[list[Any]] = [
        ["parameter", p["name"], p["effect"], p["value"], p["unit"], *_ends(p), p["half95_sheet"], p["half95"],
         p["group"], True, ""]
        for p in result["parameters"]
    ]  # fmt: skip
    for kind, items in (("whole vehicle", result.get("whole_vehicle") or ()), ("derived", result.get("derived") or ())):
        for d in items:
            known = d["identifiable"]
            numbers = (*_ends(d), d.get("half95_sheet"), d["half95"]) if known else [None] * 4
            rows.append([kind, d["name"], "", d["value"] if known else None, d["unit"], *numbers, d["name"], known,
                         d.get("why", "")])  # fmt: skip
    rows += [
        ["parameter", p["name"], p["effect"], *[None] * 6, "", False, p["why"]] for p in result["not_identifiable"]
    ]
    return Table(_VALUES, rows)


def _ends(value: Mapping[str, Any]) -> tuple[float, float]:
    """Ends of a value's 95 % interval, with the sensor sheet where that is known."""
    half = value.get("half95_sheet")
    half = value["half95"] if half is None else half
    return value["value"] - half, value["value"] + half


def errors_table(result: Mapping[str, Any]) -> Table:
    """Error of each row of each run, used or held out, with its noise floor."""
    return Table(_ERRORS, [
        [kind, run, row, s["unit"], s["rms"], s["floor"], s["ratio"], s["nrmse"], s["vaf"], s.get("judged", True),
         s.get("colour", "")]
        for kind in ("used", "held") for run, scores in result["rows"][kind].items() for row, s in scores.items()
    ])  # fmt: skip


def ranking_table(diagnosis: Mapping[str, Any]) -> Table:
    """Candidates of a diagnosis, best first."""
    return Table(_RANKING, [
        [k + 1, c["effect"], c["answer"], None if c["gain"] is None else 100.0 * c["gain"], c["p"], c["size"], c["why"]]
        for k, c in enumerate(diagnosis["candidates"])
    ])  # fmt: skip


def forces_table(estimated: EstimatedForces, errors: Mapping[str, ForceError]) -> Table:
    """Time histories of wheel forces without dynamometers [N]: time [s], then each force and half of its 95 % band.

    The measured force follows where there are dynamometers, their zeros removed, as ``force_measured``.
    """
    columns: dict[str, Sequence[float]] = {"t": estimated.t.tolist()}
    for name, force in estimated.forces.items():
        columns[name] = force.value.tolist()
        columns[f"{name}.half95"] = force.half95.tolist()
        if name in errors:
            columns[name.replace("force_estimated", "force_measured")] = errors[name].measured.tolist()
    rows = [[x if x == x else None for x in row] for row in zip(*columns.values(), strict=True)]
    return Table(dict.fromkeys(columns, float), rows)


def csv_text(head: Iterable[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table as CSV; None is an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(head)
    writer.writerows([["" if x is None else _cell(x) for x in row] for row in rows])
    return text.getvalue()


def _cell(value: Any) -> Any:
    """A cell that spreadsheets read as text and never as a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r") else value


def write_table(table: Table, path: Path) -> None:
    """Write a table as Parquet or, by any other suffix, CSV. Raises UsageError for a table without rows."""
    if not table.rows:
        raise UsageError(f"{path}: there is nothing to write: the table has no rows")
    if path.suffix.lower() != ".parquet":
        path.write_text(csv_text(table.columns, table.rows), encoding="utf-8", newline="")
        return
    import pyarrow as pa
    import pyarrow.parquet as pq

    kinds = {str: pa.string(), float: pa.float64(), bool: pa.bool_()}
    arrays = [
        pa.array([None if x is None else kind(x) for x in (row[k] for row in table.rows)], kinds[kind])
        for k, kind in enumerate(table.columns.values())
    ]
    pq.write_table(pa.table(arrays, names=list(table.columns)), path)
