"""Where the rows of the equations come from, in words: measured, derived, assumed, or what would have to be added."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.identify.car.rows import ROWS, Absence, Row, RowAbsence, instead, least, needs
from lacet.identify.signals.sources import Method
from lacet.identify.validation.row_sources import RowKind, RowSource
from lacet.services.render.intervals import half_width
from lacet.services.render.rows import row_absence
from lacet.services.render.tables import WIDTH, size, table, wrapped

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


def shortened(channels: Iterable[str]) -> list[str]:
    """Channels with those of all four corners as one pattern, ``wheel.*.force``."""
    patterns: dict[str, list[str]] = {}
    for name in channels:
        corner = CHANNELS[name].corner
        patterns.setdefault(name if corner is None else name.replace(f".{corner}.", ".*."), []).append(name)
    parts = ([key] if len(names) == len(CORNERS) else names for key, names in patterns.items())
    return [name for part in parts for name in part]


def rows_lacking(lacks: Mapping[Row, Sequence[str]]) -> str:
    """Rows that cannot be formed and the channels that would form them, in one sentence.

    Parameters
    ----------
    lacks : row → channels that it lacks; of a kind all of whose rows are there, only the kind is named.
    """
    rows: dict[str, list[str]] = {}
    for row in lacks:
        rows.setdefault(row.partition(".")[0], []).append(row)
    whole = [kind for kind, found in rows.items() if len(found) == sum(one.startswith(f"{kind}.") for one in ROWS)]
    single = [row for kind, found in rows.items() if kind not in whole for row in found]
    named = [f"all {_listed(whole)} rows"] * bool(whole) + [", ".join(single)] * bool(single)
    channels = shortened(dict.fromkeys(channel for found in lacks.values() for channel in found))
    more = len(channels) - _MOST_CHANNELS
    needed = [*channels[:_MOST_CHANNELS], f"{more} more channels"] if more > 1 else channels
    return f"cannot be formed: {' and '.join(named)}; not recorded: {_listed(needed)}"


_MOST_CHANNELS = 4
"""Largest number of channels named in a sentence about a run."""


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + [*words[-1:]])


def to_add(row: Row, absence: RowAbsence | None) -> str:
    """The least that would have to be measured for a row that cannot be formed, or why else it is absent."""
    if absence is None:
        return "no usable sample outside flagged intervals"
    if absence.cause in (Absence.MEASURED_ELSEWHERE, Absence.NO_KNOWN_LOAD, Absence.BRAKES_ALWAYS):
        return row_absence(absence)
    return "needs: " + ", ".join(_lacking(row, absence))


def _lacking(row: Row, absence: RowAbsence) -> list[str]:
    """Channels to be added, each with what serves as well; of torques the first, with the others as such."""
    if absence.cause is Absence.CHANNELS:
        out = _with_alternatives(row, absence.channels)
    else:
        first, *others = absence.channels
        brakes = () if absence.cause is Absence.DRIVE_TORQUE else ("a run with brakes = 'off'",)
        others = ", ".join((*others, *brakes))
        out = [f"{first} (or {others})" if others else first]
    return out + (_lacking(row, absence.beside) if absence.beside else [])


def no_rows(left_out: Mapping[Row, RowAbsence]) -> str:
    """Why no row at all can be formed: what the vertical force on the car needs, which needs least, or the reasons.

    Beside it the known mass that would give the body's rows, where that alone is lacking.
    """
    if not left_out:
        return "no usable sample outside flagged intervals"
    fewest = min(left_out.items(), key=lambda item: (item[1].cause is not Absence.CHANNELS, len(item[1].channels)))
    scale = [item for item in left_out.items() if item[1].cause is Absence.NO_KNOWN_LOAD]
    ways = [f"{row}: {to_add(row, why)}" for row, why in dict.fromkeys([fewest, *scale[:1]])]
    return "\n  or ".join(ways) + "\n  (lacet info --rows lists what each row needs)"


def _with_alternatives(row: Row, channels: Sequence[str]) -> list[str]:
    out: list[str] = []
    for name in shortened(channels):
        others = instead(row, name.replace(".*.", f".{CORNERS[0]}."))
        if ".*." in name:
            others = tuple(other.replace(f".{CORNERS[0]}.", ".*.") for other in others)
        out.append(f"{name} (or {', '.join(others)})" if others else name)
    return out


def needs_text(rows: Sequence[Row], reference: str) -> str:
    """What each row needs: what must be measured or derived, and what may be assumed; rows that are alike together."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for row in rows:
        must = least(row, reference)
        rest = [
            name
            for name in needs(row, reference)
            if name not in must and not name.endswith(".ground") and not (row.combined and name.startswith("wheel."))
        ]
        cells = (", ".join(_with_alternatives(row, must)), ", ".join(shortened(rest)))
        key = tuple(text.replace(f".{row.corner}.", ".{c}.") if row.corner else text for text in (row.unit, *cells))
        alike.setdefault(key, []).append(row)
    lines: list[str] = []
    for (unit, *cells), group in alike.items():
        lines.append(f"  {_rows(group)} [{unit}]")
        for title, cell in zip(("must be measured", "else assumed"), cells, strict=True):
            if cell:
                lines.append(textwrap.fill(cell, WIDTH, initial_indent=f"    {title}: ", subsequent_indent=" " * 6))
    return "\n".join([*lines, _COMBINED])


_COMBINED = """
  {c}: the row's own corner; *: all four. (or …) serves as well; ground lasers at three corners serve in place of
  imu.attitude. Much of what is else assumed can be derived: docs/fewer-instruments.md.
  spin.* need the torques on the wheel too, suspension.* where the bench table turns the carrier (docs/rows.md).
  body.* and corner.* are formed where no wheel load is measured, and need one known parameter in [assumed] of the
  vehicle file: sprung_mass, or another."""


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
    alike: dict[tuple[str, ...], list[str]] = {}
    for one in result:
        moves = ""
        if one["source"] == "assumed":
            most = ", ".join(a["name"] for a in one["assumptions"][:_SHOWN])
            moves = f"{size(one['moves'])} of {size(one['size'])} {one['unit']}: {most}"
        lacking = _families((*one["derived"], *one["assumed"]))
        add = one["add"].replace(f".{str(one['row']).partition('.')[2]}.", ".*.")
        key = (one["source"], lacking, moves, add, ", ".join(one["runs"]))
        alike.setdefault(key, []).append(str(one["row"]))
    return [[_rows(group), *key] for key, group in alike.items()]


_ADD = HEAD.index("to add")


def sources_table(result: Sequence[Mapping[str, Any]]) -> str:
    """The table of rows, without columns that are empty or alike; below, what to add, and sources of channels."""
    lines = sources_lines(result)
    used = [k for k in range(len(HEAD)) if k < 2 or (k != _ADD and any(line[k] for line in lines))]
    if len({line[-1] for line in lines}) == 1:
        used.remove(len(HEAD) - 1)
    out = [table([HEAD[k] for k in used], [[line[k] for k in used] for line in lines], text_columns=len(used))]
    add = [wrapped(f"  {line[0]}: {line[_ADD]}", 4) for line in lines if line[_ADD]]
    return "\n\n".join(part for part in (*out, "\n".join(dict.fromkeys(add)), _channels_table(result)) if part)


def _channels_table(result: Sequence[Mapping[str, Any]]) -> str:
    """Channels that are not measured, and what they are taken from; an empty text where there are none."""
    found: dict[tuple[str, str], dict[str, None]] = {}
    for one in result:
        for kind in ("derived", "assumed"):
            for name, words in one[kind].items():
                found.setdefault((kind, words), {})[name] = None
    lines = [[", ".join(shortened(names)), kind, words] for (kind, words), names in found.items()]
    return table(["not measured", "source", "taken from"], lines, text_columns=3) if lines else ""


def assumptions_table(result: Sequence[Mapping[str, Any]]) -> str:
    """What is assumed: value, tolerance and where they come from; an empty text where nothing is."""
    found: dict[str, Mapping[str, Any]] = {}
    for one in result:
        for assumption in one["assumptions"]:
            found.setdefault(assumption["name"], assumption)
    lines = [
        [
            name, f"{a['value']:.4g}", half_width(a["tolerance"]), a["unit"],
            a["source"] if a["given"] else f"default: {a['source']}",
        ]
        for name, a in sorted(found.items())
    ]  # fmt: skip
    return table(["assumed", "value", "± 1 σ", "unit", "from"], lines, text_columns=5) if lines else ""


def _families(names: Iterable[str]) -> str:
    """Families of channels, ``wheel.moment, laser.hub``."""
    return ", ".join(dict.fromkeys(CHANNELS[name].family for name in names))


def _rows(rows: Iterable[str]) -> str:
    """Rows of one kind together: ``chassis.fx, fy``."""
    kinds: dict[str, list[str]] = {}
    for row in rows:
        kind, _, place = row.partition(".")
        kinds.setdefault(kind, []).append(place)
    return "; ".join(f"{kind}.{', '.join(places)}" for kind, places in kinds.items())
