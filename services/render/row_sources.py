"""Where the rows of the equations come from, in words: measured, derived, assumed, or what would have to be added."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.identify.signals.sources import Method
from lacet.identify.validation.row_sources import RowKind, RowSource
from lacet.services.render.intervals import half_width
from lacet.services.render.row_needs import OWN_CORNER, any_corner, explained, rows_text, shortened, to_add, together
from lacet.services.render.tables import size, table, wrapped

_WORDS = {
    Method.MOTION_RATIO: "potentiometer ÷ motion ratio",
    Method.LOAD_TRAVEL: "load and static deflection",
    Method.LOAD_CELL: "vertical load cell; x and y from load and acceleration",
    Method.PUSHROD: "pushrod force × ratio + unsprung mass",
    Method.SCALE: "corner scale",
    Method.NOMINAL_LOAD: "loads at rest; vertical parts cancel",
    Method.CONTACT: "forces in the contact patch",
    Method.OTHER_WHEEL: "other wheel of the axle",
    Method.STEERING_WHEEL: "steering wheel",
    Method.BENCH_TABLE: "static angle and bench table",
    Method.TURN: "yaw rate, speed and slip angles",
    Method.FROM_SPEED: "speed ÷ loaded radius",
    Method.NOMINAL_SPEED: "speed that the turns give",
    Method.GRAVITY: "rates and gravity, smoothed",
    Method.CAR_BUS: "single accelerations and rates",
}
_KINDS = {
    RowKind.MEASURED: "measured",
    RowKind.DERIVED: "derived",
    RowKind.ASSUMED: "assumed",
    RowKind.IMPOSSIBLE: "impossible",
}


def method_words(method: Method) -> str:
    """How a channel that is not measured is obtained."""
    return _WORDS[method]


def sources_result(sources: Sequence[RowSource]) -> list[dict[str, Any]]:
    """The sources of the rows as plain data (``docs/json.md``, ``identify``)."""
    return [
        {
            "row": one.row,
            "unit": one.row.unit,
            "source": _KINDS[one.kind],
            "runs": list(one.runs),
            "derived": {name: method_words(method) for name, method in one.derived.items()},
            "assumed": {name: method_words(method) for name, method in one.assumed.items()},
            "assumptions": [
                {
                    "name": a.name, "value": a.value, "tolerance": a.tolerance, "unit": a.unit, "given": a.given,
                    "source": a.source, "moves": moves,
                }
                for a, moves in sorted(one.assumptions.items(), key=lambda item: -item[1])
            ],
            "moves": one.moved,
            "size": one.size,
            "add": to_add(one.row, one.absence) if one.kind is RowKind.IMPOSSIBLE else "",
        }
        for one in sources
    ]  # fmt: skip


_SHOWN = 2
"""Assumptions shown in a line of the table, those that move the row most."""


HEAD = ("rows", "source", "not measured", "assumptions move it by (1 σ)", "to add", "runs")
"""Columns of the table of rows."""


def sources_lines(result: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """The rows by where they come from, those that are alike in one line: cells in the order of `HEAD`."""
    alike: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for one in result:
        moves = ""
        if one["source"] == "assumed":
            most = ", ".join(a["name"] for a in one["assumptions"][:_SHOWN])
            moves = f"{size(one['moves'])} of {size(one['size'])} {one['unit']}: {most}"
        lacking = _families((*one["derived"], *one["assumed"]))
        key = (one["source"], lacking, moves, any_corner(one["row"], one["add"]), ", ".join(one["runs"]))
        alike.setdefault(key, []).append(one)
    lines: list[list[str]] = []
    for (source, lacking, moves, _, runs), group in alike.items():
        adds = {str(one["row"]): str(one["add"]) for one in group}
        lines.append([rows_text(adds), source, lacking, moves, together(adds), runs])
    return lines


_ADD = HEAD.index("to add")


def sources_table(result: Sequence[Mapping[str, Any]]) -> str:
    """The table of rows, without columns that are empty or alike; below, what to add, and sources of channels."""
    lines = sources_lines(result)
    used = [k for k in range(len(HEAD)) if k < 2 or (k != _ADD and any(line[k] for line in lines))]
    if len({line[-1] for line in lines}) == 1:
        used.remove(len(HEAD) - 1)
    out = [table([HEAD[k] for k in used], [[line[k] for k in used] for line in lines], text_columns=len(used))]
    add = list(dict.fromkeys(wrapped(f"  {line[0]}: {line[_ADD]}", 4) for line in lines if line[_ADD]))
    below = explained(add) + _WITHOUT_LOADS * _at_some_wheels(result)
    return "\n\n".join(part for part in (*out, "\n".join(below), _channels_table(result)) if part)


_WITHOUT_LOADS = [
    wrapped(
        "  Or form rows of all four corners without any wheel load: leave wheel.* out of the runs (of a map), and give "
        "sprung_mass in [assumed] of the vehicle file (docs/fewer-instruments.md).", 4,
    )
]  # fmt: skip


def _at_some_wheels(result: Sequence[Mapping[str, Any]]) -> bool:
    """Whether suspension rows are formed at some corners and impossible at others."""
    there = {one["source"] != "impossible" for one in result if str(one["row"]).startswith("suspension.")}
    return len(there) == 2


CHANNELS_HEAD = ("not measured", "source", "taken from")
"""Columns of the table of channels."""


def channels_lines(result: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Channels that are not measured, and what they are taken from: cells in the order of `CHANNELS_HEAD`."""
    found: dict[tuple[str, str], dict[str, None]] = {}
    for one in result:
        for kind in ("derived", "assumed"):
            for name, words in one[kind].items():
                found.setdefault((kind, words), {})[name] = None
    return [[", ".join(shortened(names)), kind, words] for (kind, words), names in found.items()]


def _channels_table(result: Sequence[Mapping[str, Any]]) -> str:
    lines = channels_lines(result)
    return table(CHANNELS_HEAD, lines, text_columns=3) if lines else ""


ASSUMPTIONS_HEAD = ("assumed", "value", "± 1 σ", "unit", "from")
"""Columns of the table of what is assumed."""


def assumptions_lines(result: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """What is assumed: value, tolerance and where they come from, in the order of `ASSUMPTIONS_HEAD`.

    One line for what is the same at several places.
    """
    found: dict[str, Mapping[str, Any]] = {}
    for one in result:
        for assumption in one["assumptions"]:
            found.setdefault(assumption["name"], assumption)
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, a in sorted(found.items()):
        source = a["source"] if a["given"] else f"default: {a['source']}"
        cells = (f"{a['value']:.4g}", half_width(a["tolerance"]), a["unit"], source)
        alike.setdefault((name.partition(".")[0], *cells), []).append(name)
    return [[_at_places(names), *cells] for (_, *cells), names in alike.items()]


def _at_places(names: Sequence[str]) -> str:
    """Names of one assumption at several places, ``camber.*`` for all four corners, ``camber_slope.front, rear``."""
    name, places = names[0].partition(".")[0], [one.partition(".")[2] for one in names]
    return f"{name}.*" if set(places) == {*CORNERS} else ", ".join([names[0], *places[1:]])


def assumptions_table(result: Sequence[Mapping[str, Any]]) -> str:
    """The table of what is assumed; an empty text where nothing is."""
    lines = assumptions_lines(result)
    return table(ASSUMPTIONS_HEAD, lines, text_columns=5) if lines else ""


def _families(names: Iterable[str]) -> str:
    """Families of channels, ``wheel.moment, laser.hub``."""
    return ", ".join(dict.fromkeys(CHANNELS[name].family for name in names))


def sources_tables(result: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The tables of rows, of channels that are not measured and of what is assumed, those that have lines.

    Each with `head`, titles of its columns, `lines`, one cell a column, and a `note`, empty where it needs none.
    """
    parts = (
        (HEAD, sources_lines(result)),
        (CHANNELS_HEAD, channels_lines(result)),
        (ASSUMPTIONS_HEAD, assumptions_lines(result)),
    )
    return [
        {
            "head": head,
            "lines": lines,
            "note": OWN_CORNER if any("{c}" in cell for line in lines for cell in line) else "",
        }
        for head, lines in parts
        if lines
    ]
