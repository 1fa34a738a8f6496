"""What rows of the equations need, and the least that would have to be added for one that is absent, in words."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.identify.car.rows import ROWS, Absence, Row, RowAbsence, instead, least, needs
from lacet.services.render.rows import row_absence
from lacet.services.render.tables import WIDTH, wrapped


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


def not_recorded_lines(lacks: Mapping[Row, Sequence[str]]) -> list[str]:
    """Rows of a run that cannot be formed with the channels to be added, rows that are alike in one line.

    `lacks` : row → channels that it lacks.
    """
    needed = {str(row): "needs: " + ", ".join(_with_alternatives(row, channels)) for row, channels in lacks.items()}
    alike: dict[str, list[str]] = {}
    for row, text in needed.items():
        alike.setdefault(any_corner(row, text), []).append(row)
    lines = [(rows, together({row: needed[row] for row in rows})) for rows in alike.values()]
    return explained([wrapped(f"  {rows_text(rows)}: {text}", 4) for rows, text in lines])


def together(texts: Mapping[str, str]) -> str:
    """One text about several rows, of row → text, which differ in the rows' own corner at most."""
    (row, text), *_ = texts.items()
    return text if len({*texts.values()}) == 1 else any_corner(row, text)


OWN_CORNER = "{c}: the row's own corner; *: all four."
"""What ``{c}`` is in a text about rows of several corners."""


def explained(lines: Sequence[str]) -> list[str]:
    """Lines about rows, and below them what ``{c}`` is where one has it."""
    return [*lines, *[f"  {OWN_CORNER}"] * any("{c}" in line for line in lines)]


def any_corner(row: str, text: str) -> str:
    """A text about a row with ``{c}`` in place of the row's own corner."""
    place = row.partition(".")[2]
    return re.sub(rf"\.{place}\b", ".{c}", text) if place in CORNERS else text


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


_VERTICAL = Row("chassis.fz")
"""The row of the vertical force on the car."""


def no_rows(left_out: Mapping[Row, RowAbsence]) -> str:
    """Why no row at all can be formed: what is lacking for the row that needs least, and for the car's vertical force.

    Beside them the known mass that would give the body's rows, where that alone is lacking.
    """
    if not left_out:
        return "no usable sample outside flagged intervals"
    fewest = min(left_out.items(), key=lambda item: (item[1].cause is not Absence.CHANNELS, len(item[1].channels)))
    whole = [item for item in left_out.items() if item[0] == _VERTICAL and item[1].cause is Absence.CHANNELS]
    scale = [item for item in left_out.items() if item[1].cause is Absence.NO_KNOWN_LOAD]
    ways = [wrapped(f"{row}: {to_add(row, why)}", 4) for row, why in dict.fromkeys([fewest, *whole, *scale[:1]])]
    return (
        "\n  or ".join(ways) + "\n  (lacet info --rows lists what each row needs; logs of one drive become one run by "
        "lacet import A B --map MAP -o RUN.mcap)"
    )


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
        key = tuple(any_corner(row, text) for text in (row.unit, *cells))
        alike.setdefault(key, []).append(row)
    lines: list[str] = []
    for (unit, *cells), group in alike.items():
        lines.append(f"  {rows_text(group)} [{unit}]")
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


def rows_text(rows: Iterable[str]) -> str:
    """Rows of one kind together: ``chassis.fx, fy``."""
    kinds: dict[str, list[str]] = {}
    for row in rows:
        kind, _, place = row.partition(".")
        kinds.setdefault(kind, []).append(place)
    return "; ".join(f"{kind}.{', '.join(places)}" for kind, places in kinds.items())
