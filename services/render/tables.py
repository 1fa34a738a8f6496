"""Plain text tables of results."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from lacet.identify.validation.score import fails, pooled_ratio, row_ratios, worst_row
from lacet.services.render.intervals import half_width, to_interval, with_interval
from lacet.services.render.units import TRAVEL, TRAVEL_RATE

WIDTH = 118
"""Characters in a line of printed text."""
_INTERVALS = ("with sheet", "noise only")
"""Heads of the halves of a value's 95 % intervals (docs/intervals.md), that which covers more first."""

_ABOUT_INTERVALS = (
    "±: halves of 95 % intervals; noise only: noise and zeros, residuals correlated; with sheet: its gains and "
    "latencies, too."
)


def table(head: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1) -> str:
    """Columns aligned: the first `text_columns` to the left, the others, numbers, to the right."""
    widths = [max(len(line[k]) for line in (head, *rows)) for k in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        parts = [
            c.ljust(w) if k < text_columns else c.rjust(w) for k, (c, w) in enumerate(zip(cells, widths, strict=True))
        ]
        return "  " + "  ".join(parts).rstrip()

    return "\n".join([line(head), line(["-" * w for w in widths]), *(line(row) for row in rows)])


@dataclass(frozen=True)
class Table:
    """A table as values, for text, HTML and Markdown alike.

    `head` and `rows` are cells, the first `text_columns` of words and the others of numbers; `note` stands below.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    text_columns: int = 1
    note: str = ""

    @property
    def text(self) -> str:
        """The table in aligned columns; only its note where it has no rows."""
        if self.note and not self.rows:
            return self.note
        drawn = table(self.head, self.rows, self.text_columns)
        return f"{drawn}\n{self.note}" if self.note else drawn


def bare_intervals(found: Table) -> Table:
    """A table with the ± of half intervals in the head of their column, instead of in every cell."""
    columns = [[row[k] for row in found.rows] for k in range(len(found.head))]
    half = [any(cell.startswith("± ") for cell in column) for column in columns]
    head = [f"± {name}" if own else name for name, own in zip(found.head, half, strict=True)]
    rows = [[cell.removeprefix("± ") for cell in row] for row in found.rows]
    return replace(found, head=head, rows=rows)


def size(value: float) -> str:
    """An RMS or another size to two significant digits, to a whole number from 10 on."""
    return to_interval(value, min(value, 99.0))


def parameters(result: Mapping[str, Any]) -> str:
    """The parameters of a fit with their intervals side by side, the whole vehicle's values, and what ± is."""
    text = parameter_table(result).text
    if result["whole_vehicle"]:
        title, whole = whole_vehicle_table(result)
        text += f"\n\n{title}:\n{whole.text}"
    return f"{text}\n{_ABOUT_INTERVALS}"


def parameter_table(result: Mapping[str, Any]) -> Table:
    """The parameters of a fit with their intervals side by side."""
    drawn = any(p["half95_bootstrap"] is not None for p in result["parameters"])
    rows = [
        [
            p["name"],
            to_interval(p["value"], p["half95"]),
            f"± {half_width(p['half95_sheet'])}",
            f"± {half_width(p['half95'])}",
            *([f"± {half_width(p['half95_bootstrap'])}"] if drawn else []),
            p["unit"],
            f"{p['sxr_percent']:.2f}" if p["sxr_percent"] is not None and p["sxr_percent"] < 1e3 else "-",
            "" if p["group"] == p["name"] else p["group"],
        ]
        for p in result["parameters"]
    ]
    head = [
        "parameter",
        "value",
        *_INTERVALS,
        *(["bootstrap"] if drawn else []),
        "unit",
        "sxr %",
        "stands for",
    ]
    return Table(head, rows)


def whole_vehicle_table(result: Mapping[str, Any]) -> tuple[str, Table]:
    """Title and table of the whole vehicle's values."""
    rows = [
        [
            w["name"], to_interval(w["value"], w["half95"]), f"± {half_width(w['half95_sheet'])}",
            f"± {half_width(w['half95'])}", w["unit"],
        ]
        if w["identifiable"]
        else [w["name"], "not identifiable", "", "", w["unit"]]
        for w in result["whole_vehicle"]
    ]  # fmt: skip
    about = "inboard of the dynamometers" if result["wheel_reference"] == "hub" else "wheels included"
    lacking: dict[str, list[str]] = {}
    for one in result.get("row_sources") or ():
        if one["row"].startswith("chassis.") and one["add"]:
            lacking.setdefault(one["add"], []).append(one["row"].removeprefix("chassis."))
    note = "; ".join(f"chassis.{', '.join(dict.fromkeys(places))} {add}" for add, places in lacking.items())
    if not any(w["identifiable"] for w in result["whole_vehicle"]):
        rows, note = [], f"  not identifiable: {note or 'neither mass nor inertia is determined by these runs'}"
    elif all(w["identifiable"] for w in result["whole_vehicle"]):
        note = ""
    title = f"Whole vehicle at design height ({about})"
    return title, Table(["value", "", *_INTERVALS, "unit"], rows, note=note)


def derived(result: Mapping[str, Any]) -> str:
    """Derived values, those of one kind on one line: corners or axles beside each other; no kind of which none is."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for d in result.get("derived") or []:
        kind, _, where = d["name"].partition(".")
        groups.setdefault(kind if where in _PLACES else d["name"], []).append(d)
    lines: list[list[str]] = []
    for kind, members in groups.items():
        if all(d["identifiable"] and d["value"] == 0.0 for d in members):
            continue  # no bar in the model, no bench table: no value
        if not any(d["identifiable"] for d in members):
            continue  # the list of reasons names it
        cells = [_derived(d) for d in members]
        places = [d["name"].partition(".")[2] for d in members]
        where = "" if kind == members[0]["name"] else "/".join(places)
        lines.append(
            [kind.replace("_", " ").replace(".", " "), where, "   ".join(cells), members[0]["unit"].replace("1", "-")]
        )
    return table(["derived value", "where", f"value ± {_INTERVALS[0]}", "unit"], lines, text_columns=4) if lines else ""


_PLACES = ("fl", "fr", "rl", "rr", "front", "rear")


def _derived(d: Mapping[str, Any]) -> str:
    if not d["identifiable"]:
        return "not determined"
    if d["value"] == 0.0 == d["half95"]:
        return "none"
    return with_interval(d["value"], d.get("half95_sheet", d["half95"]))


def derived_table(result: Mapping[str, Any]) -> Table:
    """Derived values with their intervals, one a line; without those that are zero, as of bars that the car has not."""
    lines: list[list[str]] = []
    for d in result.get("derived") or []:
        half, sheet, unit = d["half95"], d.get("half95_sheet", d["half95"]), d["unit"].replace("1", "-")
        if not d["identifiable"]:
            lines.append([d["name"], "not determined", "", "", unit])
        elif d["value"] != 0.0:
            lines.append(
                [d["name"], to_interval(d["value"], half), f"± {half_width(sheet)}", f"± {half_width(half)}", unit]
            )
    return Table(["derived value", "value", *_INTERVALS, "unit"], lines)


def ranges(result: Mapping[str, Any]) -> str:
    """Ranges of the states covered by the runs, within which every verdict holds."""
    found = ranges_table(result)
    return found.text if found.rows else ""


def ranges_table(result: Mapping[str, Any]) -> Table:
    """Ranges of the states covered by the runs; without rows where none is known."""
    seen = result.get("ranges") or {}
    lines: list[list[str]] = []
    for kind, factor, unit in (("travel", *TRAVEL), ("rate", *TRAVEL_RATE), ("load", 1.0, "N")):
        parts = [seen[f"{kind}.{c}"] for c in _PLACES[:4] if f"{kind}.{c}" in seen]
        if parts:
            low, high = min(p["low"] for p in parts), max(p["high"] for p in parts)
            name = {"travel": "suspension travel", "rate": "travel rate", "load": "wheel load"}[kind]
            lines.append([name, f"{factor * low:.0f} to {factor * high:.0f}", unit])
    for kind, factor, unit in (
        ("speed", 3.6, "km/h"), ("acceleration.longitudinal", 1.0, "m/s²"), ("acceleration.lateral", 1.0, "m/s²"),
    ):  # fmt: skip
        if kind in seen:
            name = " ".join(reversed(kind.split(".")))
            digits = 0 if kind == "speed" else 1
            low, high = factor * seen[kind]["low"], factor * seen[kind]["high"]
            lines.append([name, f"{low:.{digits}f} to {high:.{digits}f}", unit])
    return Table(["these runs cover", "", "unit"], lines, text_columns=2)


def bad_seconds(result: Mapping[str, Any], most: int = 12) -> str:
    """Stretches that a robust fit weighted less, worst first."""
    found = result["bad_seconds"]
    lines = [[b["run"], b["row"], f"{b['start']:g} to {b['stop']:g} s", f"{b['weight']:.2f}"] for b in found[:most]]
    more = f"\n  and {len(found) - most} more" if len(found) > most else ""
    return table(["run", "row", "bad second", "counts as"], lines, text_columns=3) + more


def unknowns(result: Mapping[str, Any]) -> str:
    """Parameters that are not identified, those of one reason together."""
    alike: dict[str, list[str]] = {}
    for item in result["not_identifiable"]:
        alike.setdefault(item["why"], []).append(item["name"])
    return "\n".join(wrapped(f"  {', '.join(names)}: {why}", 4) for why, names in alike.items())


def wrapped(text: str, indent: int) -> str:
    """A text in lines of at most `WIDTH` characters, those after the first indented; no word is cut."""
    return textwrap.fill(text, WIDTH, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)


def rows(scored: Mapping[str, Mapping[str, Any]]) -> str:
    """Scores of every row of every run."""
    return rows_table(scored).text


def rows_table(scored: Mapping[str, Mapping[str, Any]]) -> Table:
    """Scores of every row of every run."""
    lines = [
        [
            run, row, size(s["rms"]), s["unit"], f"{s['nrmse']:.2f}", f"{s['vaf']:.2f}",
            size(s["floor"]), f"{s['ratio']:.2f}" + _mark(s), s.get("colour") or "-",
        ]
        for run, part in scored.items()
        for row, s in part.items()
    ]  # fmt: skip
    head = ["run", "row", "rms", "unit", "NRMSE %", "VAF %", "floor", "rms ÷ floor", "residual"]
    unsure = any(not s.get("judged", True) for part in scored.values() for s in part.values())
    note = "  ? cannot be judged: the runs used leave open what this row needs" if unsure else ""
    return Table(head, lines, text_columns=2, note=note)


def _mark(score: Mapping[str, Any]) -> str:
    """Mark beside a ratio: failed, or not judged."""
    if not score.get("judged", True):
        return " ?"
    return " !" if fails(score["ratio"]) else "  "


def candidates(result: Mapping[str, Any], most: int = 12) -> str:
    """The ranking of a diagnosis."""
    return candidate_table(result, most).text


def candidate_table(result: Mapping[str, Any], most: int = 12) -> Table:
    """The ranking of a diagnosis, the first `most` of it; below it what cannot be tested."""
    lines = [
        [
            c["effect"], _answer(c), f"{100 * c['gain']:.1f}", f"{c['gain_rms']:.3g}", f"{c['p']:.3f}",
            "-" if c["margin"] is None else f"{c['margin']:.3g}",
            f"{c['coverage']:.0f}", ", ".join(t["effect"] for t in (*c["ties"], *c.get("confounded", ()))) or "-",
        ]
        for c in result["candidates"]
        if c["answer"] != "not testable"
    ][:most]  # fmt: skip
    head = ["effect", "answer", "gain %", "gain N", "p", "margin", "blocks", "cannot be told apart from"]
    rest = "\n".join(f"    {line}" for line in _not_testable(result))
    return Table(head, lines, text_columns=2, note=f"  not testable with these runs:\n{rest}" if rest else "")


def _answer(c: Mapping[str, Any]) -> str:
    """Answer to a candidate, and whether the size of one found is open."""
    return f"{c['answer']}, size open" if c.get("open_at") else str(c["answer"])


def _not_testable(result: Mapping[str, Any]) -> list[str]:
    """Effects of a diagnosis that cannot be tested with its runs, those with one reason in a line."""
    rest: dict[str, list[str]] = {}
    for c in result["candidates"]:
        if c["answer"] == "not testable":
            rest.setdefault(c.get("short", ""), []).append(c["effect"])
    return [f"{', '.join(_in_families(keys))}{why and f' ({why})'}" for why, keys in rest.items()]


def _in_families(keys: Sequence[str], most: int = 3) -> list[str]:
    """Effects by name; of a family with more than `most` only the number."""
    families: dict[str, list[str]] = {}
    for key in keys:
        families.setdefault(key.partition(".")[0], []).append(key)
    return [
        name
        for family, mine in families.items()
        for name in (mine if len(mine) <= most else [f"{family} ({len(mine)} places)"])
    ]


def fall_by_row(versions: Sequence[Any]) -> str:
    """Residual ÷ noise floor of each row, version by version, on the runs used | held out."""
    by_version = [{kind: row_ratios(v.result["rows"][kind]) for kind in ("used", "held")} for v in versions]
    rows = dict.fromkeys(row for part in by_version for row in (*part["used"], *part["held"]))

    def cell(part: Mapping[str, Mapping[str, float]], row: str) -> str:
        used, held = (f"{part[kind][row]:.2f}" if row in part[kind] else "-" for kind in ("used", "held"))
        return f"{used} | {held}" if any(one["held"] for one in by_version) else used

    lines = [[row, *(cell(part, row) for part in by_version)] for row in rows]
    return table(["row", *(f"version {v.number}" for v in versions)], lines, text_columns=1)


def history(versions: Sequence[Any]) -> str:
    """Fall of the error, version by version."""
    return history_table(versions).text


def history_table(versions: Sequence[Any]) -> Table:
    """Fall of the error, version by version; where one was not made from the one above it, from which."""
    lines: list[list[str]] = []
    above = 0
    for v in versions:
        what = v.note if v.parent == above else f"{v.note} (from {v.parent})"
        above = v.number
        used, held = v.result["rows"]["used"], v.result["rows"]["held"]
        lines.append(
            [
                str(v.number), what, f"{pooled_ratio(used):.2f}", f"{worst_row(used)[1]:.2f}",
                f"{pooled_ratio(held):.2f}" if held else "-", f"{worst_row(held)[1]:.2f}" if held else "-",
            ]
        )  # fmt: skip
    head = ["version", "what changed", "used", "worst row", "held out", "worst row"]
    note = "  (residual ÷ noise floor, root mean square over rows; 1.00 is the floor)"
    return Table(head, lines, text_columns=2, note=note)
