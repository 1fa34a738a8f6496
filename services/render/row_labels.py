"""Rows of the equations as people see them: short and long names, whether a row fails, and its level of colour."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lacet.identify.car.rows import row_unit
from lacet.identify.validation.score import FAILS, fails

LEVELS = (FAILS, 1.6, 2.5, 6.0)
"""Residual ÷ floor above which a row is drawn at the next of five levels of colour."""

_KINDS = {"suspension": ("Susp", "suspension"), "tyre": ("Tyre", "tyre"), "spin": ("Spin", "wheel spin")}
_CORNERS = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}
_CHASSIS = {
    "fx": "longitudinal force", "fy": "lateral force", "fz": "vertical force", "mx": "roll moment",
    "my": "pitch moment", "mz": "yaw moment",
}  # fmt: skip


def row_label(row: str) -> dict[str, str]:
    """A row of the equations as the page names it: `label` for a small field, `about` in words, `unit`."""
    kind, place = row.split(".")
    if kind == "chassis":
        return {"label": place.capitalize(), "about": f"chassis, {_CHASSIS[place]}", "unit": row_unit(row)}
    label, about = _KINDS[kind]
    return {"label": label, "about": f"{about}, {_CORNERS[place]}", "unit": row_unit(row)}


def with_verdict(score: Mapping[str, Any]) -> dict[str, Any]:
    """A row's score with what the page shows of it: whether the row `fails`, and its `level` of colour, 0 to 4."""
    ratio = float(score["ratio"])
    return {
        **score,
        "fails": fails(ratio) and bool(score.get("judged", True)),
        "level": sum(ratio > limit for limit in LEVELS),
    }
