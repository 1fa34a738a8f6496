"""What runs are too still or too short to show, in words and as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lacet.identify.validation.little_shown import FewSamples, LittleShown, StillRun
from lacet.identify.validation.score import FAILS

_SHOWN = 4
"""Rows that a sentence names."""


def little_shown_result(found: LittleShown) -> dict[str, Any]:
    """What runs show too little of as plain data (``docs/json.md``, ``identify``)."""
    few = found.few
    return {
        "hardly_moves": [
            {"run": one.run, "seconds": one.seconds, "variation": one.variation, "stands": one.stands,
             "says": _of_still(one)}
            for one in found.still
        ],
        "too_short": None if few is None else {
            "rows": list(few.rows), "samples": few.samples, "p": few.p, "seconds": few.seconds, "says": _of_few(few),
        },
        "model_fails": found.model_fails,
    }  # fmt: skip


def little_shown_lines(result: Mapping[str, Any]) -> list[str]:
    """What a fit's result says of runs that show too little; results of earlier versions say nothing."""
    few = result.get("too_short")
    return [*(one["says"] for one in result.get("hardly_moves", [])), *([few["says"]] if few else [])]


def _of_still(found: StillRun) -> str:
    how = "stands" if found.stands else "hardly moves"
    return (
        f"{found.run}: the car {how} for its {found.seconds:.1f} s: travels, accelerations and rates vary by "
        f"{found.variation:.1f} times their noise at most. Such a run shows static loads; springs, dampers, inertias "
        "and whether the model lacks something it cannot show: drive, with turns, bumps and lift-offs"
    )


def _of_few(found: FewSamples) -> str:
    more = f" and {len(found.rows) - _SHOWN} more" if len(found.rows) > _SHOWN else ""
    return (
        f"{', '.join(found.rows[:_SHOWN])}{more}: too short for a verdict. Of {found.samples} samples noise alone has "
        f"a row as far above its floor with p = {min(1.0, found.p):.2g}; {found.seconds:.0f} s without gaps are enough "
        f"to see an error of {FAILS:g} floors"
    )
