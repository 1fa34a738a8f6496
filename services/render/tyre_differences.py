"""Tyres that differ between runs, in words and as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lacet.identify.validation.tyre_differences import TyreDifference
from lacet.services.render.identifiability import listed

_SHOWN = 4
"""Runs whose values a sentence has."""


def difference_result(found: TyreDifference | None) -> dict[str, Any] | None:
    """The difference as plain data (``docs/json.md``, ``identify``)."""
    if found is None:
        return None
    return {
        "explained": found.explained,
        "values": [{"name": name, "unit": "N/m", "runs": dict(each)} for name, each in found.values.items()],
    }


def difference_text(result: Mapping[str, Any]) -> str:
    """That tyres differ between runs, and what to do; an empty string where they are the same."""
    found = result.get("tyre_difference")
    if not found:
        return ""
    most = max(found["values"], key=_spread)
    runs = list(most["runs"].items())
    each = listed([f"{value / 1e3:.0f} in {run}" for run, value in runs[:_SHOWN]])
    more = f", and {len(runs) - _SHOWN} more" if len(runs) > _SHOWN else ""
    return (
        f"the tyres are not the same in all runs: with stiffnesses of each run's own {100 * found['explained']:.0f} % "
        f"of what the rows are above their floor would be explained ({most['name']}: about {each} N/mm{more}). Other "
        "tyres or pressures in some of them? Fit these apart"
    )


def _spread(value: Mapping[str, Any]) -> float:
    """Largest difference of a stiffness between runs ÷ its size."""
    each = list(value["runs"].values())
    return (max(each) - min(each)) / max(max(map(abs, each)), 1e-300)
