"""The live fit in words: what each parameter still needs, and the text of a terminal."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from lacet.services.render.intervals import half_width, to_interval
from lacet.services.render.tables import table

SHORT = 60.0
"""Time up to which seconds are said as such; longer ones in minutes [s]."""
COLUMNS = 100
"""Widest line of the lists in a terminal [characters]."""
_TOGETHER = "\u00a0"  # a space at which no line is broken
LONG = 3600.0
"""Time from which on it is said to be hours, without a number [s]."""


def still_needed(seconds: float, least: float, target: float) -> str:
    """What a parameter needs: ``enough``, the time of driving as so far, or why no time will do.

    Parameters
    ----------
    seconds : how much longer to drive [s]; infinite where it never is enough.
    least : half interval ÷ value after endless driving of the same kind.
    target : what is enough of it; a best that is hardly more is written with digits that show it.
    """
    if seconds <= 0.0:
        return "enough"
    if math.isinf(seconds):
        digits = half_width(100.0 * least)
        if float(digits) <= 100.0 * target:
            digits = f"{100.0 * least:.4g}"
        best = "over 100 %" if least > 1.0 else f"± {digits} %"
        return f"not by more of the same: {best} at best"
    if seconds > LONG:
        return "hours more"
    return f"{seconds:.0f} s more" if seconds <= SHORT else f"{seconds / 60.0:.0f} min more"


def percent(part: float) -> str:
    """A part in per cent, to two digits; what is more than the whole is said as such."""
    if not part <= 1.0:
        return "over 100 %"
    value = 100.0 * part
    return f"{value:.0f} %" if value >= 10.0 else f"{value:.2g} %"


def state_line(found: Mapping[str, Any]) -> str:
    """One line: how far the fit is, how far behind the newest sample, and what it is of."""
    if found["why"]:
        return str(found["why"])
    how = "from scratch" if found["from_scratch"] else f"sums since {found['since']:.0f} s"
    if found["from_scratch"] and not found["recording"]:
        how = f"from scratch, as lacet identify --to {found['seconds']:.0f}"
    many = len(found["parameters"])
    text = f"{found['seconds']:.0f} s fitted ({how}), {found['behind']:.1f} s behind; "
    failing = [row["row"] for row in found["rows"] if row["fails"]]
    rows = f"failing: {', '.join(failing)}" if failing else "no row fails"
    return f"{text}{found['enough']} of {many} parameters enough; {rows}"


def screen(found: Mapping[str, Any]) -> str:
    """All of it for a terminal: sensors, losses, markers, error ÷ floor by row, parameters."""
    head = f"{found['run_id'] or 'no recording is heard'}" + ("" if found["recording"] else " (not recording)")
    lines = [f"{head}: {found['line']}"]
    if found["sensors"]:
        when = "" if found["recording"] else "at the end of the run: "
        lines.append(f"  {when}" + "; ".join(_sensor(one) for one in found["sensors"]))
    if found["losses"]:
        lines.append(f"  LOST {found['losses']}")
    if found["marks"]:
        lines.append(
            "  markers: " + ", ".join(f"{one['text']} at {one['seconds']:.1f} s" for one in found["marks"][-5:])
        )
    if found["rows"]:
        ratios = [_ratio(one) for one in sorted(found["rows"], key=lambda one: -one["ratio"])]
        lines += ["", _list("error ÷ floor", ratios)]
    if found["parameters"]:
        cells = [
            [
                one["name"], one["answer"], to_interval(one["value"], one["half95_sheet"]),
                f"± {half_width(one['half95_sheet'])}", one["unit"], percent(one["relative"]),
            ]
            for one in found["parameters"]
        ]  # fmt: skip
        head_cells = ["parameter", f"± {percent(found['target'])}", "value", "95 %", "unit", "± %"]
        lines += ["", table(head_cells, cells, text_columns=2)]
    if found["not_identifiable"]:
        lines += ["", _list("not identifiable so far", [one["name"] for one in found["not_identifiable"]])]
    return "\n".join(lines).replace(_TOGETHER, " ")


def _list(name: str, parts: Sequence[str]) -> str:
    return textwrap.fill(f"{name}: {', '.join(parts)}", COLUMNS, initial_indent="  ", subsequent_indent="    ")


def _ratio(one: Mapping[str, Any]) -> str:
    return f"{one['row']} {one['ratio']:.2f}{' FAILS' if one['fails'] else ''}".replace(" ", _TOGETHER)


def _sensor(one: Mapping[str, str]) -> str:
    return one["name"] if one["state"] == "running" else f"{one['name']} {one['state'].upper()}"
